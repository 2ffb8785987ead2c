"""The task and the groups of arguments behind an environment's name, in one place for the single environment and the vector."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from impact_env.envs.settings import with_defaults
from impact_env.envs.task import Task
from impact_env.extras import optional
from impact_env.parameters import ParameterError

with optional():
    from gymnasium import spaces


@dataclass(frozen=True)
class Kind:
    """``task`` is called with one of each of ``groups``, dataclasses that share the environment's arguments out among them, and the number of lanes.

    ``defaults``: arguments that are others than the dataclasses say; ``actions`` makes the space of one lane's actions.
    """

    task: Callable[..., Task]
    groups: tuple[type, ...]
    defaults: Mapping[str, Any]
    actions: Callable[[], spaces.Space[Any]]

    def make(self, lanes: int, arguments: Mapping[str, Any]) -> Task:
        """Return the task with these keyword arguments; raises ParameterError for a bad one."""
        parts = split(with_defaults(self.defaults, arguments), *self.groups)
        return self.task(*(group(**part) for group, part in zip(self.groups, parts, strict=True)), lanes)


def split(arguments: dict[str, Any], *groups: type) -> list[dict[str, Any]]:
    """Return keyword arguments as one dict for each dataclass that has them; raise ParameterError for one that none has."""
    names = [tuple(getattr(group, "__dataclass_fields__")) for group in groups]  # noqa: B009
    strange = sorted(set(arguments) - {name for group in names for name in group})
    if strange:
        raise ParameterError(f"{strange[0]} is not an argument of this environment: it has {', '.join(sorted({n for g in names for n in g}))}")
    return [{name: value for name, value in arguments.items() if name in group} for group in names]
