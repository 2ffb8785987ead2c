"""Environments whose agent decides once in several periods: passages through a resonance, and a machine at one frequency under forces that change."""

from functools import partial
from typing import Any

from impact_env.envs.adaptive_task import (
    FrictionRange,
    FrictionTask,
    GapControl,
    GapRange,
    GapTask,
    SweepGapTask,
)
from impact_env.envs.observation import FEW_IMPACTS
from impact_env.envs.settings import TaskSettings
from impact_env.envs.shells import TaskEnv, TaskSpec, one_number_space
from impact_env.envs.sweep_task import OneRateSettings, PassageSettings, PassiveTask, SweepTask
from impact_env.envs.vector_shell import environment
from impact_env.extras import optional

with optional():
    from gymnasium.spaces import Discrete

# The paper's example of a jump during a sweep (section 3.1), where the rate decides. Range, rates, budget and price are chosen such that a
# slow passage pays in a part of the range only.
RANGE_SETTINGS: dict[str, Any] = {"limits": (0.93, 1.03)}
HARD_SETTINGS: dict[str, Any] = {
    "modes": 2,
    "absorber_options": {"friction_limit": 0.025},
    **RANGE_SETTINGS,
}
FROM_MIDDLE: dict[str, Any] = {
    **RANGE_SETTINGS,
    "budget_end": "terminated",
    "frequency_origin": "middle",
    "frequency_unit": 0.0125,
}
RATE_V1 = (
    HARD_SETTINGS | FROM_MIDDLE | {"interval": 25.0, "backward_rate": 4.0, "time_budget": 8000.0}
)
# forces that are drawn, and walls or friction that are set
RANDOM_FORCE_SETTINGS: dict[str, Any] = {"force": (0.5, 6.0), "impacts_limit": FEW_IMPACTS}
GAP_SETTINGS = RANDOM_FORCE_SETTINGS | {"absorber_options": {"restitution": 0.7}}
RATE_AND_GAP = (
    GAP_SETTINGS | FROM_MIDDLE | {"interval": 10.0, "time_budget": 4000.0, "level_unit": "gap"}
)
SEMI_ACTIVE = RANDOM_FORCE_SETTINGS | {"modes": 2, "absorber_options": {"friction_limit": 0.1}}
FRICTION_SETTINGS = SEMI_ACTIVE | RANGE_SETTINGS | {"rate": 4.0, "level_unit": "gap"}


@environment
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
    - those of every environment: `impact_env.envs.settings.TaskSettings` describes scene, force, method, interval and observation

    ## Version History
    - v0: first version
    """

    kind = TaskSpec(
        PassiveTask, (TaskSettings, OneRateSettings), {"time_price": 0.0}, partial(Discrete, 1)
    )


@environment
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

    (features)

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
    - ``vector_reward`` (default False): minus the costs are the reward, in the form of MO-Gymnasium (``reward_space``). Info's ``costs`` (4,) has
      what the last interval cost: rise of the relative level (or damage); time over the time budget; way of the actuator, 0 for a rate, in
      half-clearances of the scene for walls, over the range of limits, which is 2 wide, for friction; impacts over the pseudo periods of a whole
      interval
    - those of every environment: `impact_env.envs.settings.TaskSettings` has scene, force, method, interval and observation; here ``modes`` 2 and
      a friction limit of 0.025 N
    - ``render_mode``: None, "rgb_array" or "human"

    ## Version History
    - v0: first version, also named ``ImpactAbsorber/SweepRateHard-v0``: the task of exploration, which v1 does not replace
    """

    kind = TaskSpec(SweepTask, (TaskSettings, PassageSettings), HARD_SETTINGS, one_number_space)


@environment
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

    (features)

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

    kind = TaskSpec(SweepTask, (TaskSettings, PassageSettings), RATE_V1, one_number_space)


@environment
class SweepAndGapEnv(TaskEnv):
    """How quickly to run through a resonance, and which clearance to give the cavity on the way.

    ## Description
    A machine with an adaptive impact absorber runs down through a resonance under a force that nobody announces: it is drawn for each passage. The
    absorber works where its clearance fits the force and the frequency, so the response has to be looked at while there is time. A clearance
    that fits the middle of the forces serves few of them.

    ## Action Space
    A ``Box`` of two float32 numbers in [-1, 1]. The first is the rate, as in `SweepRateEnv`. The second, b, is the half-clearance for the next
    control interval, ``low * (high/low)**((b + 1)/2)`` of ``gap_limits``. Numbers outside are cut to [-1, 1]. The walls never close onto the
    absorber: a half-clearance below its distance from the middle is raised to that distance. Info's ``gap`` (m) says what was set,
    ``gap_limited`` whether it was raised.

    ## Observation Space
    A ``Box`` of 11 float32 numbers, cut off at +-100. The unit of displacement is the scene's half-clearance (1 mm unless given). The force is not
    among them; info's ``force`` has it.

    (features)

    ## Rewards
    Those of `SweepRateEnv`: minus the level relative to that of the beam without absorber under the same force, minus a price of time, minus
    ``unfinished_price`` if the time budget is spent before the far frequency is reached.

    ## Starting State
    At rest, the absorber in the middle of the cavity, whose half-clearance is the scene's, the frequency at one end of ``limits``. Force and phase
    are drawn.

    ## Episode End
    Terminated when the far frequency is reached, and when the time budget is spent. With ``budget_end="truncated"`` the latter is a truncation.

    ## Arguments
    All of `SweepRateV1Env`, with these defaults, and one more:

    - ``gap_limits`` (default 0.1 mm to 3 mm): half-clearances in m; ``level_unit`` (default "gap") of feature 9, or "reference"
    - ``force`` (default 0.5 to 6) in N; ``absorber_options`` (default restitution 0.7, no friction), ``modes`` 3; ``interval`` 10,
      ``time_budget`` 4000, ``backward_rate`` 0

    The absorber must be an impact absorber with rigid walls.

    ## Version History
    - v1: the level is in half-clearances, and feature 5 is cut off at 4. It is v0 with ``level_unit="gap"`` and ``impacts_limit=4``
    - v0: first version; its level is over that of the beam without absorber under the same force (``level_unit="reference"``), so that features 1, 2
      and 9 together tell the force after one interval
    """

    kind = TaskSpec(
        SweepGapTask,
        (TaskSettings, PassageSettings, GapRange),
        RATE_AND_GAP,
        partial(one_number_space, 2),
    )


@environment
class FrictionChoiceEnv(TaskEnv):
    """Which friction limit to give an absorber on the way through a resonance.

    ## Description
    A machine with a semi-active impact absorber runs down through a resonance at one rate, under a force that nobody announces: it is drawn for
    each passage. Friction serves in proportion to the force: too little of it and the absorber does not come to rest in the cavity, too much and
    it moves with the beam. The response has to be looked at, and the limit set by it, before the resonance is reached.

    ## Action Space
    A ``Box`` of one float32 number a in [-1, 1]: the friction limit mu f_N for the next control interval is ``low * (high/low)**((a + 1)/2)`` of
    ``friction_range``, in units of m_a g0 omega^2 (absorber's mass, half-clearance, resonance): by this share friction counts on any structure.
    Numbers outside are cut to [-1, 1]. A sliding absorber slides on with the new friction; one that moves with the beam begins to slide if its
    inertia is more than the new limit holds. Info's ``friction_limit`` (N) says what was set.

    ## Observation Space
    A ``Box`` of 11 float32 numbers, cut off at +-100. The unit of displacement is the scene's half-clearance (1 mm without walls). The force is not
    among them; info's ``force`` has it.

    (features)

    ## Rewards
    Those of `SweepRateEnv`: minus the level relative to that of the beam without absorber under the same force, minus a price of time.

    ## Starting State
    At rest, the absorber in the middle of the cavity, the frequency at one end of ``limits``. Force and phase are drawn. The friction shown is the
    scene's; that of the first interval is chosen already.

    ## Episode End
    Terminated when the far frequency is reached.

    ## Arguments
    - ``friction_range`` (default 0.02 to 20): lowest and highest friction limit in units of m_a g0 omega^2 (0.72 N in the default scene), above 0
    - ``rate`` (default 4) in % per 100 pseudo periods; ``limits`` (default 0.93 to 1.03), ``interval`` (default 5)
    - ``force`` (default 0.5 to 6) in N; ``absorber_options`` (default friction_limit 0.1 N, which is only the one shown at the start), ``modes`` 2
    - ``level_unit`` (default "gap") of feature 9, or "reference"
    - ``direction``, ``time_price``, ``objective``, ``fatigue_exponent`` and all arguments of scene, method, interval and observation: as in
      `SweepRateEnv`

    The absorber must have rigid friction: an impact absorber with rigid walls and a ``friction_limit``, or a friction damper.

    ## Version History
    - v1: the level is in half-clearances, and feature 5 is cut off at 4. It is v0 with ``level_unit="gap"`` and ``impacts_limit=4``
    - v0: first version; its level is over that of the beam without absorber under the same force (``level_unit="reference"``), so that features 1, 2
      and 9 together tell the force after one interval
    """

    kind = TaskSpec(
        FrictionTask,
        (TaskSettings, OneRateSettings, FrictionRange),
        FRICTION_SETTINGS,
        one_number_space,
    )


@environment
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

    (features)

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
    - ``vector_reward`` (default False): minus the costs are the reward, in the form of MO-Gymnasium (``reward_space``). Info's ``costs`` (4,) has
      what the last interval cost: relative RMS (or damage) over the number of intervals; time over the time budget; half-clearances that the
      walls moved; impacts over the pseudo periods of a whole interval
    - ``force`` (default 0.5 to 6): in N, or a pair (low, high) from which the schedule draws; ``absorber_options`` (default restitution 0.7)
    - those of every environment: `impact_env.envs.settings.TaskSettings` describes scene, method, interval and observation
    - ``render_mode``: None, "rgb_array" or "human"

    The absorber must be an impact absorber with rigid walls.

    ## Version History
    - v1: feature 5 is cut off at 4 (``impacts_limit=4``); chatter reaches tens
    - v0: first version
    """

    kind = TaskSpec(GapTask, (TaskSettings, GapControl), GAP_SETTINGS, one_number_space)
