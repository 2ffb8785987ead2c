"""Fields of dataclasses that declare their check, key, unit and description once.

::

    @dataclass(frozen=True)
    class YieldingWalls:
        yield_velocity: float = field(
            metadata=parameter(
                positive,
                key="yield_velocity",
                unit="m/s",
                description="Impact velocity from which restitution falls",
            )
        )

        def __post_init__(self) -> None:
            check_fields(self)

All that depends on these facts reads them here: the check by `check_fields`; tables of files,
options of commands, arguments of environments and design variables by `list_keys`. `parameter` only
makes the metadata of `dataclasses.field`, and checks run where ``__post_init__`` says so.

What depends on several fields is checked in ``__post_init__``, after `check_fields`.
"""

from collections.abc import Mapping
from dataclasses import Field, fields
from typing import Any

from impact_env.checks import Check, ParameterError


def parameter(
    check: Check | None = None,
    *,
    key: str = "",
    unit: str = "",
    description: str = "",
    omit_default: bool = False,
) -> Mapping[str, Any]:
    """Return the metadata of a field that is a parameter.

    Parameters
    ----------
    check : callable, optional
        Check of its value, (name, value) -> the value that is used, such as
        `impact_env.checks.positive`. None: ``__post_init__`` checks it, as the check depends on
        other fields.
    key : str, optional
        Its name in files, options and arguments. Default: it has none.
    unit, description : str, optional
        Unit, and what it is, in the help of commands.
    omit_default : bool, optional
        Whether the default is left out where values are listed.

    Examples
    --------
    >>> from dataclasses import dataclass, field
    >>> from impact_env.checks import positive
    >>> @dataclass(frozen=True)
    ... class Spring:
    ...     stiffness: float = field(metadata=parameter(positive, key="stiffness_n_m"))
    ...     def __post_init__(self) -> None:
    ...         check_fields(self)
    >>> list(list_keys(Spring))
    ['stiffness_n_m']
    >>> Spring(-1.0)
    Traceback (most recent call last):
    ...
    impact_env.checks.ParameterError: stiffness = -1.0 is not allowed: a finite number above 0, \
from 1e-30 to 1e+30
    """
    return {
        "check": check,
        "key": key,
        "unit": unit,
        "description": description,
        "omit_default": omit_default,
    }


def list_keys(kind: type) -> dict[str, Field[Any]]:
    """Return the fields of a dataclass that have a key, by their keys.

    The unit of a field is ``field.metadata["unit"]``, and so on: see `parameter`.
    """
    return {field.metadata["key"]: field for field in fields(kind) if field.metadata.get("key")}


def check_fields(group: Any, /, **checks: Check) -> None:
    """Replace fields of a frozen dataclass by the values that their checks return.

    It is called in ``__post_init__``. Without ``checks`` all fields are checked as declared; with
    ``checks`` only the fields of these names, by these checks.

    Raises
    ------
    ParameterError
        A value is not allowed. Its ``argument`` is the field.
    """
    if not checks:
        declared = {field.name: field.metadata.get("check") for field in fields(group)}
        checks = {name: check for name, check in declared.items() if check is not None}
    for name, check in checks.items():
        try:
            value = check(name, getattr(group, name))
        except ParameterError as error:
            error.argument = name
            raise
        object.__setattr__(group, name, value)
