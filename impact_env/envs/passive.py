"""ImpactAbsorber/Passive-v0: a passage through resonance at one rate."""

from functools import partial
from typing import Any

from impact_env.envs.kind import Kind
from impact_env.envs.settings import Settings
from impact_env.envs.shells import TaskEnv
from impact_env.envs.sweep_task import OneRate, PassiveTask
from impact_env.envs.vector_shell import TaskVectorEnv
from impact_env.extras import optional

with optional():
    from gymnasium.spaces import Discrete

DEFAULTS: dict[str, Any] = {"time_price": 0.0}
KIND = Kind(PassiveTask, (Settings, OneRate), DEFAULTS, partial(Discrete, 1))


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
    - ``rate`` in % per 100 pseudo periods (default: what suits the damping of the resonance, `impact_env.drive.default_rate`; 1 for the paper's)
    - ``limits`` (default 0.9 to 1.06) and ``interval`` (default 5)
    - ``direction``, ``time_price``, ``objective``, ``fatigue_exponent``: as in `SweepRateEnv`
    - those of every environment: `impact_env.envs.settings.Settings` describes scene, force, method, interval and observation

    ## Version History
    - v0: first version
    """

    kind = KIND


class PassiveVectorEnv(TaskVectorEnv):
    """Native vector of `PassiveEnv`, see `TaskVectorEnv`; lane i is the single one with seed + i."""

    kind = KIND
