"""ImpactAbsorber/GapChoice-v1: the clearance of the cavity, chosen interval by interval."""

from typing import Any

from impact_env.envs.gap_task import GapControl, GapTask
from impact_env.envs.kind import Kind
from impact_env.envs.observation import FEW_IMPACTS
from impact_env.envs.settings import Settings
from impact_env.envs.shells import TaskEnv, choice
from impact_env.envs.vector_shell import TaskVectorEnv

DEFAULTS: dict[str, Any] = {"force": (0.5, 6.0), "absorber_options": {"restitution": 0.7}, "impacts_limit": FEW_IMPACTS}
KIND = Kind(GapTask, (Settings, GapControl), DEFAULTS, choice)


class GapChoiceEnv(TaskEnv):
    """Which clearance to give the cavity under a force that changes.

    ## Description
    A machine runs at one frequency near a resonance (another one in each episode), and its force changes from time to time without notice. An
    impact absorber works best where its clearance fits the force (paper, section 3.3), and the agent sets the clearance.

    ## Action Space
    A ``Box`` of one float32 number a in [-1, 1]: the half-clearance for the next control interval, from the low to the high one of ``gap_limits``.
    Numbers outside are cut to [-1, 1]. The walls never close onto the absorber: a half-clearance below its distance from the middle is raised to
    that distance, and a wall it rests on does not push it. Info's ``gap`` (m) says what was set, ``gap_limited`` whether it was raised.

    ## Observation Space
    A ``Box`` of 10 float32 numbers, cut off at +-100. The unit of displacement is the scene's half-clearance (1 mm without walls).

    | # | what | unit and scale |
    | --- | --- | --- |
    | 1 | amplitude of the tip in phase with the force, over the last interval | m / half-clearance |
    | 2 | amplitude of the tip a quarter of a period behind the force | m / half-clearance |
    | 3 | absorber less tip at the interval's end | m / half-clearance |
    | 4 | its rate | m/s / (half-clearance times the resonance's circular frequency) |
    | 5 | impacts in the last interval | per pseudo period / 2, cut off at 4 |
    | 6 | absorber's kinetic energy over that of beam and absorber | 1 |
    | 7 | frequency ratio to the resonance, less 1 | 1 / 0.1 |
    | 8 | share of the time budget that is left | 1 |
    | 9 | RMS of the tip over the last interval | m / half-clearance |
    | 10 | half-clearance in use | m / half-clearance of the scene |

    ## Rewards
    The sum of all rewards is the score: minus the mean over the intervals of the tip's RMS relative to the stationary RMS of a beam without absorber
    under the same force at the same frequency. With ``objective="fatigue"`` it is the mean of the tip's displacement to the power
    ``fatigue_exponent``, relative to the same of that stationary response.

    ## Starting State
    At rest, the absorber in the middle of the cavity, whose half-clearance is the scene's. The phase of the force, its schedule, and where a range is
    given the frequency are drawn. The schedule is piecewise constant: forces from the range ``force``, each held for a time from the range ``hold``.

    ## Episode End
    Truncated when the time budget is spent.

    ## Arguments
    - ``gap_limits`` (default 0.1 mm to 3 mm): half-clearances in m; ``hold`` (default 100 to 300): range of pseudo periods for which a force lasts
    - ``frequency_ratio`` to the resonance, or a pair (low, high) from which each episode draws (default 0.97 to 1.01)
    - ``time_budget`` (default 1000) in pseudo periods, rounded up to whole intervals
    - ``objective``: "rms" or "fatigue"; ``fatigue_exponent``
    - ``force`` (default 0.5 to 6): in N, or a pair (low, high) from which the schedule draws; ``absorber_options`` (default restitution 0.7)
    - those of every environment: `impact_env.envs.settings.Settings` describes scene, method, interval and observation
    - ``render_mode``: None, "rgb_array" or "human"

    The absorber must be an impact absorber with rigid walls. Bad values raise `impact_env.ParameterError`, a step before a reset or after the end
    `gymnasium.error.ResetNeeded`.

    ## Version History
    - v1: feature 5 is cut off at 4 (``impacts_limit=4``); chatter reaches tens
    - v0: first version
    """

    kind = KIND


class GapChoiceVectorEnv(TaskVectorEnv):
    """Native vector of `GapChoiceEnv`, see `TaskVectorEnv`; lane i is the single one with seed + i."""

    kind = KIND
