"""Environments whose agent decides once in several periods.

They are passages through a resonance, and a machine at one frequency under changing forces.
"""

from typing import Any

from impact_env.envs.actuators import (
    FrictionActuator,
    FrictionRange,
    GapActuator,
    GapRange,
    require_cavity,
    require_friction,
)
from impact_env.envs.observation import (
    DISTANCE_TO_END,
    FEW_IMPACTS,
    FRICTION_IN_USE,
    GAP_IN_USE,
    LENGTH_UNIT,
    LEVEL_FEATURE,
    RMS,
    STATE,
    Feature,
)
from impact_env.envs.one_frequency import ChangingForceSchedule, GapControl, ResponseReward
from impact_env.envs.passages import (
    OneRateSettings,
    PassageReward,
    PassageSchedule,
    PassageSettings,
    RateActuator,
)
from impact_env.envs.settings import TaskSettings
from impact_env.envs.shells import TaskEnv, TaskSpec
from impact_env.envs.task import LaneState, Task
from impact_env.envs.vector_shell import environment

# The paper's example of a jump during a sweep (section 3.1), where the rate decides. Range, rates,
# budget and price are chosen such that a slow passage pays in a part of the range only.
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

PASSAGE_COLUMNS = (*STATE, DISTANCE_TO_END)


def compose_passive(settings: TaskSettings, way: OneRateSettings, count: int) -> Task:
    """Return lanes that pass at one rate, without a choice and so without costs."""
    passage = way.passage(settings)
    lanes = LaneState(settings, count, passage.damage_exponent)
    schedule = PassageSchedule(lanes, passage)
    return Task(
        lanes, schedule, PassageReward(schedule), columns=PASSAGE_COLUMNS, arguments=(passage,)
    )


@environment
class PassiveEnv(TaskEnv):
    """A passage through the resonance without a choice.

    ## Description
    A passage through the resonance at one rate, for benchmarks, films and as a reference of agents.

    ## Action Space
    ``Discrete(1)``: 0, continue.

    ## Observation Space
    As in `SweepRateEnv`.

    ## Rewards
    As in `SweepRateEnv`; the default ``time_price`` is 0.

    ## Starting State
    As in `SweepRateEnv`.

    ## Episode End
    Terminated when the far frequency is reached.

    ## Arguments
    (arguments)

    ## Version History
    - v0: first version
    """

    kind = TaskSpec(
        compose_passive,
        (TaskSettings, OneRateSettings),
        {"time_price": 0.0},
        PASSAGE_COLUMNS,
        numbers=0,
    )


def compose_sweep(settings: TaskSettings, passage: PassageSettings, count: int) -> Task:
    """Return lanes that pass at a rate that is set."""
    lanes = LaneState(settings, count, passage.damage_exponent)
    schedule = PassageSchedule(lanes, passage)
    rate = RateActuator(schedule)
    return Task(
        lanes,
        schedule,
        PassageReward(schedule, rate),
        actuators=(rate,),
        columns=PASSAGE_COLUMNS,
        arguments=(passage,),
    )


@environment
class SweepRateEnv(TaskEnv):
    """Rate at which a machine passes a resonance: a hard exploration task.

    ## Description
    A machine passes a resonance of the beam, and the agent sets the rate. A slow passage catches
    the high response branch; a very slow or a very fast one may avoid it (section 3.1 of the
    paper). The fastest rate is limited, the time budget does not suffice to be very slow
    everywhere, and time has a price. Exploration is hard: a much lower rate pays in a tenth of the
    range, a slightly lower rate pays nowhere, and one decision of up to 800 has almost no effect.
    `SweepRateV1Env` is the same passage without these obstacles.

    ## Action Space
    A ``Box`` of one float32 number a in [-1, 1]: the rate for the next control interval is ``slow *
    (fast/slow)**((a + 1)/2)`` of ``rates``, in % of the resonance frequency per 100 pseudo periods.
    With ``backward_rate`` above 0 the rate is ``slow * (fast/slow)**a`` for a >= 0; for a < 0 the
    frequency goes back at the rate ``backward_rate * |a|``, at most to the start. Values outside
    are clipped.

    ## Observation Space
    A ``Box`` of 10 float32 numbers, clipped at +-100. The unit of displacement is the scene's
    half-clearance (1 mm without walls).

    (features)

    ## Rewards
    The sum of all rewards is the score: minus the paper's response level of the whole passage (RMS
    over 10 pseudo periods to either side of the largest displacement) relative to a reference,
    minus ``time_price`` for every 100 pseudo periods, minus ``unfinished_price`` if the time budget
    is spent before the far frequency is reached. The reward of an interval is the change of this
    score. The reference is the level of the beam without absorber under the same force, over the
    same range in the same direction, at the rate that suits its damping (1 % per 100 pseudo periods
    for the paper's beam), in closed form.

    With ``objective="fatigue"`` damage replaces the level: the sum over time of the displacement to
    the power ``fatigue_exponent``, relative to that of the reference.

    With ``vector_reward=True`` the reward is minus the vector ``costs`` (4,) of info, as in
    MO-Gymnasium (``reward_space``): rise of the relative level (or damage) in the interval; time
    over the time budget; travel of the actuator (0 for a rate, half-clearances of the scene for
    walls, and for friction the change of the action); impacts over the pseudo periods of a whole
    interval.

    ## Starting State
    At rest, with the absorber in the middle of the cavity and the frequency at one end of
    ``limits``. The phase of the force is random, and so are direction and force where the arguments
    have a range.

    ## Episode End
    Terminated when the far frequency is reached, truncated when the time budget is spent.

    ## Arguments
    (arguments)

    ## Version History
    - v0: first version, also registered as ``ImpactAbsorber/SweepRateHard-v0``: the exploration
      task, which v1 does not replace
    """

    kind = TaskSpec(compose_sweep, (TaskSettings, PassageSettings), HARD_SETTINGS, PASSAGE_COLUMNS)


@environment
class SweepRateV1Env(TaskEnv):
    """Rate at which a machine passes a resonance, with the option to go back.

    ## Description
    The passage of `SweepRateEnv` with settings that show what feedback is worth. Below the
    resonance a response with impacts is on the high branch and grows. Where impacts stop, the
    response has dropped to the low branch and stays there. The drop is random and rare outside
    frequency ratios from about 0.965 to 0.98. A policy with feedback can wait there, go back and
    try again, and hurry on once impacts have stopped; an open-loop schedule cannot. Decisions are
    fewer (every 25 pseudo periods), frequencies are observed in the unit of the decisive range, and
    the time budget suffices for several attempts.

    ## Action Space
    A ``Box`` of one float32 number a in [-1, 1]: for a >= 0 the rate for the next control interval
    is ``slow * (fast/slow)**a`` of ``rates``, in % of the resonance frequency per 100 pseudo
    periods; for a < 0 the frequency goes back at the rate ``backward_rate * |a|``, at most to the
    start. Values outside are clipped.

    ## Observation Space
    A ``Box`` of 10 float32 numbers, clipped at +-100. The unit of displacement is the scene's
    half-clearance (1 mm without walls).

    (features)

    ## Rewards
    As in `SweepRateEnv`: minus the level relative to the beam without absorber, minus a price of
    time, minus ``unfinished_price`` if the time budget is spent before the far frequency is
    reached.

    ## Starting State
    As in `SweepRateEnv`.

    ## Episode End
    Terminated when the far frequency is reached, and when the time budget is spent: this is a
    failure with a price, which the observation announces. With ``budget_end="truncated"`` it is a
    truncation.

    ## Arguments
    ``ImpactAbsorber/SweepRateNoisy-v1`` has ``observation_noise`` 0.3.
    ``ImpactAbsorber/SweepRateDelayed-v1`` has ``observation_delay`` 4, which is 100 pseudo periods.

    (arguments)

    ## Version History
    - v1: longer interval, features in another unit, end of the budget is a termination, going back;
      v0 is `SweepRateEnv`
    """

    kind = TaskSpec(compose_sweep, (TaskSettings, PassageSettings), RATE_V1, PASSAGE_COLUMNS)


RATE_AND_GAP_COLUMNS = (*PASSAGE_COLUMNS, GAP_IN_USE)


def compose_sweep_and_gap(
    settings: TaskSettings, passage: PassageSettings, cavity: GapRange, count: int
) -> Task:
    """Return lanes that pass at a rate that is set, each with a cavity that is set."""
    require_cavity(settings.scene)
    lanes = LaneState(settings, count, passage.damage_exponent)
    schedule = PassageSchedule(lanes, passage)
    gap = GapActuator(lanes, cavity.gap_limits)
    return Task(
        lanes,
        schedule,
        PassageReward(schedule, gap),
        actuators=(RateActuator(schedule), gap),
        columns=RATE_AND_GAP_COLUMNS,
        arguments=(passage, cavity),
    )


@environment
class SweepAndGapEnv(TaskEnv):
    """Rate of a passage through the resonance and gap of the absorber, under a random force.

    ## Description
    A machine with an adaptive impact absorber runs down through a resonance. The force is random
    and not observed. The absorber works where its gap suits force and frequency, so the agent must
    infer the force from the response in time. A gap for the middle of the force range suits few
    forces.

    ## Action Space
    A ``Box`` of two float32 numbers in [-1, 1]. The first is the rate, as in `SweepRateEnv`. The
    second, b, is the half-clearance for the next control interval, ``low * (high/low)**((b +
    1)/2)`` of ``gap_limits``. Values outside are clipped. The walls never close onto the absorber:
    a half-clearance below its distance from the middle is raised to that distance. Info has the
    half-clearance as ``gap`` in m, and ``gap_limited`` where it was raised.

    ## Observation Space
    A ``Box`` of 11 float32 numbers, clipped at +-100. The unit of displacement is the scene's
    half-clearance (1 mm by default). The force is not observed; info has it as ``force``.

    (features)

    ## Rewards
    As in `SweepRateEnv`: minus the level relative to the beam without absorber under the same
    force, minus a price of time, minus ``unfinished_price`` if the time budget is spent before the
    far frequency is reached.

    ## Starting State
    At rest, with the absorber in the middle of the cavity, the half-clearance of the scene and the
    frequency at one end of ``limits``. Force and phase are random.

    ## Episode End
    Terminated when the far frequency is reached, and when the time budget is spent. With
    ``budget_end="truncated"`` the latter is a truncation.

    ## Arguments
    The absorber must be an impact absorber with rigid walls.

    (arguments)

    ## Version History
    - v1: the level is in half-clearances, and feature 5 is clipped at 4
    - v0: first version, with ``level_unit="reference"`` and ``impacts_limit=100``: features 1, 2
      and 9 together reveal the force after one interval
    """

    kind = TaskSpec(
        compose_sweep_and_gap,
        (TaskSettings, PassageSettings, GapRange),
        RATE_AND_GAP,
        RATE_AND_GAP_COLUMNS,
        numbers=2,
    )


FRICTION_COLUMNS = (*PASSAGE_COLUMNS, FRICTION_IN_USE)


def compose_friction_choice(
    settings: TaskSettings, way: OneRateSettings, friction: FrictionRange, count: int
) -> Task:
    """Return lanes that pass at one rate, each with a friction limit that is set."""
    require_friction(settings.scene)
    passage = way.passage(settings)
    lanes = LaneState(settings, count, passage.damage_exponent)
    schedule = PassageSchedule(lanes, passage)
    actuator = FrictionActuator(lanes, friction)
    return Task(
        lanes,
        schedule,
        PassageReward(schedule, actuator),
        actuators=(actuator,),
        columns=FRICTION_COLUMNS,
        arguments=(passage, way, friction),
    )


@environment
class FrictionChoiceEnv(TaskEnv):
    """Friction limit during a fast passage through the resonance, under a random force.

    ## Description
    A machine with a semi-active impact absorber runs down through a resonance at one rate. The
    force is random and not observed. The best friction limit is proportional to the force: with
    less the absorber does not come to rest in the cavity, with more it moves with the beam. The
    agent must infer the force from the response before the resonance is reached.

    ## Action Space
    A ``Box`` of one float32 number a in [-1, 1]: the friction limit mu f_N for the next control
    interval is ``low * (high/low)**((a + 1)/2)`` of ``friction_range``, in units of m_a g0 omega^2
    (mass of the absorber, half-clearance, resonance). Values outside are clipped. A sliding
    absorber slides on with the new friction; one that moves with the beam begins to slide if its
    inertia force exceeds the new limit. Info has the ``friction_limit`` in N.

    ## Observation Space
    A ``Box`` of 11 float32 numbers, clipped at +-100. The unit of displacement is the scene's
    half-clearance (1 mm without walls). The force is not observed; info has it as ``force``.

    (features)

    ## Rewards
    As in `SweepRateEnv`: minus the level relative to the beam without absorber under the same
    force, minus a price of time.

    ## Starting State
    At rest, with the absorber in the middle of the cavity and the frequency at one end of
    ``limits``. Force and phase are random. The first observation has the friction limit of the
    scene; the first action applies from the first interval.

    ## Episode End
    Terminated when the far frequency is reached.

    ## Arguments
    The absorber must have rigid friction: an impact absorber with rigid walls and a
    ``friction_limit``, or a friction damper.

    (arguments)

    ## Version History
    - v1: the level is in half-clearances, and feature 5 is clipped at 4
    - v0: first version, with ``level_unit="reference"`` and ``impacts_limit=100``: features 1, 2
      and 9 together reveal the force after one interval
    """

    kind = TaskSpec(
        compose_friction_choice,
        (TaskSettings, OneRateSettings, FrictionRange),
        FRICTION_SETTINGS,
        FRICTION_COLUMNS,
    )


GAP_COLUMNS = (
    *STATE[:-1],
    Feature(LEVEL_FEATURE.name, True, RMS.what, LENGTH_UNIT),
    GAP_IN_USE,
)


def compose_gap_choice(settings: TaskSettings, control: GapControl, count: int) -> Task:
    """Return lanes under a force that changes, each with a cavity that is set."""
    require_cavity(settings.scene)
    lanes = LaneState(settings, count, control.damage_exponent)
    schedule = ChangingForceSchedule(lanes, control)
    gap = GapActuator(lanes, control.gap_limits, is_logarithmic=False)
    return Task(
        lanes,
        schedule,
        ResponseReward(schedule, gap),
        actuators=(gap,),
        columns=GAP_COLUMNS,
        arguments=(control,),
    )


@environment
class GapChoiceEnv(TaskEnv):
    """Gap of the absorber at one frequency, under a force that changes.

    ## Description
    A machine runs at one frequency near a resonance, another one in each episode. Its force changes
    from time to time and is not observed. An impact absorber works best where its gap suits the
    force (section 3.3 of the paper), and the agent sets the gap.

    ## Action Space
    A ``Box`` of one float32 number a in [-1, 1]: the half-clearance for the next control interval,
    linear between the two of ``gap_limits``. Values outside are clipped. The walls never close onto
    the absorber: a half-clearance below its distance from the middle is raised to that distance. A
    wall at which the absorber rests does not push it. Info has the half-clearance as ``gap`` in m,
    and ``gap_limited`` where it was raised.

    ## Observation Space
    A ``Box`` of 10 float32 numbers, clipped at +-100. The unit of displacement is the scene's
    half-clearance (1 mm without walls).

    (features)

    ## Rewards
    The sum of all rewards is the score: minus the mean over the intervals of the tip's RMS relative
    to the stationary RMS of the beam without absorber under that interval's force at the same
    frequency. With ``objective="fatigue"`` it is minus the mean of the displacement to the power
    ``fatigue_exponent``, relative to that of the stationary response.

    With ``vector_reward=True`` the reward is minus the vector ``costs`` (4,) of info, as in
    MO-Gymnasium (``reward_space``): relative RMS (or damage) over the number of intervals; time
    over the time budget; travel of the walls in half-clearances; impacts over the pseudo periods of
    a whole interval.

    ## Starting State
    At rest, with the absorber in the middle of the cavity and the half-clearance of the scene.
    Phase, frequency and the schedule of the force are random. The schedule is piecewise constant:
    forces from the range ``force``, each for a time from the range ``hold``.

    ## Episode End
    Truncated when the time budget is spent.

    ## Arguments
    The absorber must be an impact absorber with rigid walls.

    (arguments)

    ## Version History
    - v1: feature 5 is clipped at 4; chatter has tens
    - v0: first version, with ``impacts_limit=100``
    """

    kind = TaskSpec(compose_gap_choice, (TaskSettings, GapControl), GAP_SETTINGS, GAP_COLUMNS)
