"""ImpactAbsorber/SweepRate-v1: a passage through resonance in which feedback pays, and can be learned."""

from typing import Any

from impact_env.envs.kind import Kind
from impact_env.envs.settings import Settings
from impact_env.envs.shells import TaskEnv, choice
from impact_env.envs.sweep_rate import DEFAULTS as OLD_DEFAULTS
from impact_env.envs.sweep_task import Passage, SweepTask
from impact_env.envs.vector_shell import TaskVectorEnv

DEFAULTS: dict[str, Any] = {
    **OLD_DEFAULTS,
    "interval": 25.0,
    "backward_rate": 4.0,
    "time_budget": 8000.0,
    "budget_end": "terminated",
    "frequency_origin": "middle",
    "frequency_unit": 0.0125,
}
KIND = Kind(SweepTask, (Settings, Passage), DEFAULTS, choice)


class SweepRateV1Env(TaskEnv):
    """How quickly to run through a resonance, and when to go back.

    ## Description
    The passage of `SweepRateEnv`, set up so that what feedback is worth can be found. Below the resonance a response that still has impacts is on
    the high branch and grows; where impacts stop, it has dropped to the low one and stays there. Whether and when it drops is chance, and
    seldom outside of frequency ratios from about 0.965 to 0.98. Whoever looks can wait there, go back and try again, and hurry on once impacts
    have stopped; a schedule over the frequency cannot. Decisions are fewer (an interval is 25 pseudo periods), the frequency is seen at the
    scale on which it matters, going back is allowed, and the time suffices for several tries.

    ## Action Space
    A ``Box`` of one float32 number a in [-1, 1]: for a >= 0 the sweep rate for the next control interval is ``slow * (fast/slow)**a`` in % of the
    resonance frequency per 100 pseudo periods, and for a < 0 the frequency goes back at the rate ``backward_rate * |a|``, no further than to the
    start. Numbers outside are cut to [-1, 1].

    ## Observation Space
    A ``Box`` of 10 float32 numbers, cut off at +-100. The unit of displacement is the scene's half-clearance (1 mm without walls).

    | # | what | unit and scale |
    | --- | --- | --- |
    | 1 | amplitude of the tip in phase with the force, over the last interval | m / half-clearance |
    | 2 | amplitude of the tip a quarter of a period behind the force | m / half-clearance |
    | 3 | absorber less tip at the interval's end | m / half-clearance |
    | 4 | its rate | m/s / (half-clearance times the resonance's circular frequency) |
    | 5 | impacts in the last interval | per pseudo period / 2 |
    | 6 | absorber's kinetic energy over that of beam and absorber | 1 |
    | 7 | frequency ratio to the resonance, less the middle of ``limits`` | 1 / ``frequency_unit`` |
    | 8 | share of the time budget that is left | 1 |
    | 9 | response level so far | m / reference level |
    | 10 | far frequency less present one | ratio / ``frequency_unit`` |

    ## Rewards
    Those of `SweepRateEnv`: minus the level relative to that of the beam without absorber, minus a price of time, minus ``unfinished_price`` if
    the time budget is spent before the far frequency is reached.

    ## Starting State
    That of `SweepRateEnv`.

    ## Episode End
    Terminated when the far frequency is reached, and when the time budget is spent: that is a failure which is observed beforehand and has its
    price, not an interruption. With ``budget_end="truncated"`` the latter is a truncation.

    ## Arguments
    All of `SweepRateEnv`, with these defaults:

    - ``interval`` 25, ``time_budget`` 8000, ``backward_rate`` 4, ``budget_end`` "terminated"
    - ``frequency_origin`` "middle" (of ``limits``; or "resonance"), ``frequency_unit`` 0.0125: zero and unit of the frequency's features

    ``ImpactAbsorber/SweepRateNoisy-v1`` has ``observation_noise`` 0.3, ``ImpactAbsorber/SweepRateDelayed-v1`` has ``observation_delay`` 4 (100 pseudo
    periods).

    ## Version History
    - v1: interval, features, end of the budget, and going back; v0 (`SweepRateEnv`) stays as it was
    """

    kind = KIND


class SweepRateV1VectorEnv(TaskVectorEnv):
    """Native vector of `SweepRateV1Env`, see `TaskVectorEnv`; lane i is the single one with seed + i."""

    kind = KIND
