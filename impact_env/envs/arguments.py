"""Arguments of an environment with their defaults and meanings.

They are read from the docstrings of the classes that define the arguments.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from inspect import cleandoc
from typing import Any, NamedTuple

from impact_env.envs.settings import TaskSettings


class Argument(NamedTuple):
    """Name, default as Python writes it, and meaning of an argument."""

    name: str
    default: str
    meaning: str


def read_parameters(kind: type) -> dict[str, str]:
    """Return the meanings in the section ``Parameters`` of a class and of its bases, by name."""
    result = {}
    for base in reversed(kind.__mro__):
        section = cleandoc(base.__doc__ or "").partition("Parameters\n----------\n")[2]
        for match in re.finditer(r"^(\w+) : .*\n((?:    .*\n?)+)", section, re.MULTILINE):
            result[match[1]] = " ".join(match[2].split())
    return result


def list_arguments(kind: type, defaults: Mapping[str, Any]) -> list[Argument]:
    """Return the arguments of a dataclass, with other defaults where ``defaults`` has them."""
    meanings = read_parameters(kind)
    arguments = []
    for field in fields(kind):
        default = field.default if field.default_factory is MISSING else field.default_factory()
        default = defaults.get(field.name, default)
        arguments.append(Argument(field.name, repr(default), meanings.get(field.name, "")))
    return arguments


def list_own_arguments(
    groups: Sequence[type], defaults: Mapping[str, Any]
) -> tuple[list[Argument], list[Argument]]:
    """Return the arguments that only an environment has, and the common ones that it changes.

    The latter are arguments of all environments that have another default here.

    Parameters
    ----------
    groups : sequence of type
        Dataclasses of its arguments.
    defaults : mapping
        Defaults that differ from those of the dataclasses, by name.
    """
    own = [
        argument
        for group in groups
        if group is not TaskSettings
        for argument in list_arguments(group, defaults)
    ]
    other = [
        argument for argument in list_arguments(TaskSettings, defaults) if argument.name in defaults
    ]
    return own, other
