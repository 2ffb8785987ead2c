"""ImpactAbsorber/SweepRate-v0: the rate of a passage through resonance, chosen interval by interval."""

from typing import Any

from impact_env.envs.kind import Kind
from impact_env.envs.settings import Settings
from impact_env.envs.shells import TaskEnv, choice
from impact_env.envs.sweep_task import Passage, SweepTask
from impact_env.envs.vector_shell import TaskVectorEnv

# The paper's example of a jump during a sweep (section 3.1), where the rate decides. Range, rates, budget and price are chosen such that a
# slow passage pays in a part of the range only.
DEFAULTS: dict[str, Any] = {"modes": 2, "absorber_options": {"friction_limit": 0.025}, "limits": (0.93, 1.03)}
KIND = Kind(SweepTask, (Settings, Passage), DEFAULTS, choice)


class SweepRateEnv(TaskEnv):
    """How quickly to run through a resonance: the hard exploration task.

    ## Description
    A machine runs through a resonance of the beam, and the agent decides how quickly. Passing slowly catches the high response branch, passing very
    slowly or very quickly may avoid it (paper, section 3.1). The fastest rate is limited, the time does not suffice to be very slow
    everywhere, and it has a price. Exploration is hard: what pays is to be much slower in a tenth of the range, a little slower pays nowhere,
    and one decision of up to 800 changes next to nothing. `SweepRateV1Env` is the same passage without these hurdles.

    ## Action Space
    A ``Box`` of one float32 number a in [-1, 1]: the sweep rate for the next control interval is ``slow * (fast/slow)**((a + 1)/2)`` in % of the
    resonance frequency per 100 pseudo periods. With ``backward_rate`` above 0 the map is ``slow * (fast/slow)**a`` for a >= 0, and for a < 0
    the frequency goes back at the rate ``backward_rate * |a|``, no further than to the start. Numbers outside are cut to [-1, 1].

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
    | 7 | frequency ratio to the resonance, less 1 | 1 / 0.1 |
    | 8 | share of the time budget that is left | 1 |
    | 9 | response level so far | m / reference level |
    | 10 | far frequency less present one | ratio / 0.1 |

    ## Rewards
    The sum of all rewards is the score: minus the paper's resonant response level of the whole passage (RMS over 10 pseudo periods to either side of
    the maximum) relative to a reference, minus ``time_price`` for every 100 pseudo periods, and minus ``unfinished_price`` if the time budget is
    spent before the far frequency is reached: not to pass is no way to pass quietly. Each interval's reward is its change of that. The
    reference is the level of a beam without absorber under the same force in a sweep at the rate that suits its damping (1 % per 100 pseudo
    periods for the paper's) over the same range in the same direction, from the closed form. With ``objective="fatigue"`` damage takes the
    level's place: the sum over time of the tip's displacement to the power ``fatigue_exponent``, relative to that of the reference passage.

    ## Starting State
    At rest, the absorber in the middle of the cavity, the frequency at one end of ``limits``. The phase of the force is drawn, and the direction and
    the force where the arguments say so.

    ## Episode End
    Terminated when the far frequency is reached, truncated when the time budget is spent.

    ## Arguments
    - ``direction``: "down" (default), "up" or "random"; ``limits`` (default 0.93 to 1.03): range of frequency ratios
    - ``rates`` (default 0.05 to 4): slowest and fastest rate in % per 100 pseudo periods; ``backward_rate`` (default 0: never back)
    - ``time_budget`` (default 4000) in pseudo periods, rounded up to whole intervals; ``time_price`` (default 0.002) per 100 pseudo periods;
      ``unfinished_price`` (default 1)
    - ``budget_end`` (default "truncated"; or "terminated"): what it is called when the time budget is spent
    - ``frequency_origin`` (default "resonance"; or "middle" of ``limits``), ``frequency_unit`` (default 0.1): zero and unit of features 7 and 10
    - ``level_unit`` of feature 9 (default "reference"; or "gap": half-clearances, which tell nothing of a force that is drawn)
    - ``objective``: "level" or "fatigue"; ``fatigue_exponent``
    - those of every environment: `impact_env.envs.settings.Settings` describes scene, force, method, interval and observation; here ``modes`` 2 and
      a friction limit of 0.025 N
    - ``render_mode``: None, "rgb_array" or "human"

    Bad values raise `impact_env.ParameterError`, a step before a reset or after the end `gymnasium.error.ResetNeeded`.

    ## Version History
    - v0: first version, also named ``ImpactAbsorber/SweepRateHard-v0``: the task of exploration, which v1 does not replace
    """

    kind = KIND


class SweepRateVectorEnv(TaskVectorEnv):
    """Native vector of `SweepRateEnv`, see `TaskVectorEnv`; lane i is the single one with seed + i."""

    kind = KIND
