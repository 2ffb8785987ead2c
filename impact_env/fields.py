"""Fields of dataclasses that declare their check, unit, name and description once.

::

    @dataclass(frozen=True)
    class YieldingWalls:
        yield_velocity: float = field(
            metadata=parameter(
                positive, unit="m/s", description="Impact velocity from which restitution falls"
            )
        )

        def __post_init__(self) -> None:
            check_fields(self)

`parameter` only makes the metadata of `dataclasses.field`, and checks run where ``__post_init__``
says so. All that depends on these facts reads them here:

- `check_fields`: the values that the class accepts;
- `list_options`: options of commands, arguments of environments and design variables, through
  `impact_env.laws.CONCEPTS`;
- `list_file_keys`: keys of the tables of files, through `impact_env.plain_files.dataclass_keys`.

What depends on several fields is checked in ``__post_init__``, by `require` or by `check_fields` of
these fields. So are all values of a class that is read from no file and has no options.
"""

import re
from collections.abc import Mapping
from dataclasses import Field, fields
from functools import cache
from typing import Any

from impact_env.checks import Check, ParameterError


def parameter(
    check: Check | None = None,
    *,
    unit: str = "",
    name: str = "",
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
    unit : str, optional
        Unit of its value, such as "N m^2". Default: none.
    name : str, optional
        Its name in files and options. Default: that of the field.
    description : str, optional
        What it is, in the help of commands. Default: it is no option.
    omit_default : bool, optional
        Whether the default is left out where values of options are listed.

    Examples
    --------
    >>> from dataclasses import dataclass, field
    >>> from impact_env.checks import positive
    >>> @dataclass(frozen=True)
    ... class Spring:
    ...     stiffness: float = field(metadata=parameter(positive, unit="N/m"))
    ...     def __post_init__(self) -> None:
    ...         check_fields(self)
    >>> list_file_keys(Spring)
    {'stiffness_n_m': 'stiffness'}
    >>> Spring(-1.0)
    Traceback (most recent call last):
    ...
    impact_env.checks.ParameterError: stiffness = -1.0 is not allowed: a finite number above 0, \
from 1e-30 to 1e+30
    """
    return {
        "check": check,
        "unit": unit,
        "name": name,
        "description": description,
        "omit_default": omit_default,
    }


def list_options(kind: type) -> dict[str, Field[Any]]:
    """Return the fields of a dataclass that are options, by their names in options.

    The unit of a field is ``field.metadata["unit"]``, and so on: see `parameter`.
    """
    return {
        field.metadata["name"] or field.name: field
        for field in fields(kind)
        if field.metadata.get("description")
    }


def list_file_keys(kind: type) -> dict[str, str]:
    """Return the keys of a dataclass in files, each with the name of its field.

    A key is the name, followed by the unit if there is one: ``amplitude_n`` in N,
    ``tip_shape_per_sqrt_kg`` in 1/sqrt(kg).
    """
    result = {}
    for field in fields(kind):
        name = field.metadata.get("name") or field.name
        unit = field.metadata.get("unit", "").lower()
        unit = re.sub(r"^1/", "per_", unit).replace("^", "").replace(")", "")
        suffix = re.sub(r"[ /(]", "_", unit)
        result[f"{name}_{suffix}" if suffix else name] = field.name
    return result


@cache
def _list_checks(kind: type) -> dict[str, Check]:
    """Return the checks that the fields of a dataclass declare, by field."""
    return {
        field.name: field.metadata["check"]
        for field in fields(kind)
        if field.metadata.get("check") is not None
    }


def check_fields(group: object, /, **checks: Check) -> None:
    """Replace fields of an object by the values that their checks return.

    A dataclass, also a frozen one, calls it in ``__post_init__``. Without ``checks`` all its fields
    are checked as declared. With ``checks`` only the fields of these names are checked, by these
    checks; the object may then be of any class.

    Raises
    ------
    ParameterError
        A value is not allowed. Its ``argument`` is the field.
    """
    # mypy takes the method __hash__ of the class's objects for that of the class
    chosen = checks or _list_checks(type(group))  # type: ignore[arg-type]
    for name, check in chosen.items():
        try:
            value = check(name, getattr(group, name))
        except ParameterError as error:
            error.argument = name
            raise
        object.__setattr__(group, name, value)
