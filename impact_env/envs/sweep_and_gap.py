"""ImpactAbsorber/SweepAndGap-v0: rate and clearance during a passage through resonance under a force that is not announced."""

from __future__ import annotations

from typing import Any

from impact_env.envs.settings import Settings, with_defaults
from impact_env.envs.shells import TaskEnv, choice, lanes_of, split
from impact_env.envs.sweep_gap_task import Cavity, SweepGapTask
from impact_env.envs.sweep_task import Passage
from impact_env.envs.vector_shell import TaskVectorEnv, shell_of

DEFAULTS: dict[str, Any] = {
    "force": (0.5, 6.0),
    "absorber_options": {"restitution": 0.7},
    "limits": (0.93, 1.03),
    "interval": 10.0,
    "time_budget": 4000.0,
    "budget_end": "terminated",
    "frequency_origin": "middle",
    "frequency_unit": 0.0125,
}


def _task(lanes: int, arguments: dict[str, Any]) -> SweepGapTask:
    settings, passage, cavity = split(with_defaults(DEFAULTS, arguments), Settings, Passage, Cavity)
    return SweepGapTask(Settings(**settings), Passage(**passage), Cavity(**cavity), lanes)


class SweepAndGapEnv(TaskEnv):
    """TEXT"""

    def __init__(self, render_mode: str | None = None, **arguments: Any) -> None:
        super().__init__(_task(1, arguments), choice(2), render_mode)


class SweepAndGapVectorEnv(TaskVectorEnv):
    """Native vector of `SweepAndGapEnv`, see `TaskVectorEnv`; lane i is the single one with seed + i."""

    def __init__(self, num_envs: int = 1, render_mode: str | None = None, **arguments: Any) -> None:
        own, shell = shell_of(arguments)
        super().__init__(_task(lanes_of(num_envs), own), choice(2), render_mode, shell)
