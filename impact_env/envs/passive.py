"""ImpactAbsorber/Passive-v0: a passage through resonance at one rate."""

from __future__ import annotations

from typing import Any

from impact_env.drive import PAPER_RATE
from impact_env.envs.settings import Settings, with_defaults
from impact_env.envs.shells import TaskEnv, lanes_of, split
from impact_env.envs.sweep_task import PassiveTask, passive_passage
from impact_env.envs.vector_shell import TaskVectorEnv, shell_of
from impact_env.extras import optional

with optional():
    from gymnasium.spaces import Discrete

DEFAULTS: dict[str, Any] = {"time_price": 0.0, "rate": PAPER_RATE}


def _task(lanes: int, arguments: dict[str, Any]) -> PassiveTask:
    passage = ("rate", "direction", "limits", "time_price", "objective", "fatigue_exponent")
    given = with_defaults(DEFAULTS, arguments)
    (settings,) = split({name: value for name, value in given.items() if name not in passage}, Settings)
    return PassiveTask(Settings(**settings), passive_passage(**{name: given[name] for name in passage if name in given}), lanes)


class PassiveEnv(TaskEnv):
    """A passage through resonance without a choice.

    ## Description
    A passage through resonance at one rate: for benchmarks, for recordings, and as the yardstick of agents.

    ## Action Space
    ``Discrete(1)``: 0, go on.

    ## Observation Space
    That of `SweepRateEnv`.

    ## Rewards
    Those of `SweepRateEnv`; ``time_price`` is 0 unless given.

    ## Starting State
    That of `SweepRateEnv`.

    ## Episode End
    Terminated when the far frequency is reached.

    ## Arguments
    - ``rate`` (default 1) in % per 100 pseudo periods
    - ``limits`` (default 0.9 to 1.06) and ``interval`` (default 5)
    - ``direction``, ``time_price``, ``objective``, ``fatigue_exponent`` and all arguments of scene, force, method, interval and
      observation: as in `SweepRateEnv`; the defaults of the scene are 3 modes and an impact absorber without friction

    ## Version History
    - v0: first version
    """

    def __init__(self, render_mode: str | None = None, **arguments: Any) -> None:
        super().__init__(_task(1, arguments), Discrete(1), render_mode)


class PassiveVectorEnv(TaskVectorEnv):
    """Native vector of `PassiveEnv`, see `TaskVectorEnv`; lane i is the single one with seed + i."""

    def __init__(self, num_envs: int = 1, render_mode: str | None = None, **arguments: Any) -> None:
        own, shell = shell_of(arguments)
        super().__init__(_task(lanes_of(num_envs), own), Discrete(1), render_mode, shell)
