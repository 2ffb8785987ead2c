"""Environments with an actuator that acts within a period or during a passage.

Friction or walls are set every quarter of a period, or slow walls move during a passage. Some of
the environments draw their scenes.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from impact_env.checks import require
from impact_env.controlled import friction_limit
from impact_env.envs.actuators import (
    FrictionActuator,
    FrictionRange,
    MovingWallsActuator,
    WallSettings,
    require_cavity,
    require_friction,
)
from impact_env.envs.choices import SEMI_ACTIVE
from impact_env.envs.observation import (
    ACCELERATIONS,
    DISTANCE_TO_END,
    FRICTION_IN_USE,
    GAP_IN_USE,
    KNOWN_TO_CONTROL,
    RMS,
    STATE,
    STATE_IN_PERIOD,
    STRUCTURE_NUMBERS,
    SWEEP_RATE,
    Feature,
)
from impact_env.envs.one_frequency import (
    AccelerometerColumns,
    ActiveSettings,
    MachineErrors,
    PeriodColumns,
    PeriodReward,
    SteadySchedule,
    vary_damping,
)
from impact_env.envs.passages import (
    PER_PERIOD,
    PassageSettings,
    RandomisedSettings,
    RandomPassageReward,
    RandomPassageSchedule,
)
from impact_env.envs.reference import stationary_amplitude
from impact_env.envs.settings import TaskSettings
from impact_env.envs.shells import TaskEnv, TaskSpec
from impact_env.envs.structure_families import StructureNumbers, StructurePool
from impact_env.envs.task import LaneState, StateColumns, Task
from impact_env.envs.vector_shell import environment

SCENE: dict[str, Any] = SEMI_ACTIVE | {"interval": 0.25}
ACTIVE_FRICTION_COLUMNS = (*STATE_IN_PERIOD, FRICTION_IN_USE)


def compose_active_friction(
    settings: TaskSettings,
    cycle: ActiveSettings,
    friction: FrictionRange,
    count: int,
    columns: Sequence[Feature] = ACTIVE_FRICTION_COLUMNS,
    state: type[StateColumns] = PeriodColumns,
) -> Task:
    """Return lanes at one frequency each, with a friction limit that is set."""
    require_friction(settings.scene)
    scenes = vary_damping([settings.scene], cycle.damping_error)
    lanes = LaneState(settings, count, cycle.fatigue_exponent, scenes)
    schedule = SteadySchedule(lanes, cycle)
    actuator = FrictionActuator(lanes, friction)
    return Task(
        lanes,
        schedule,
        PeriodReward(schedule, actuator, cycle.price),
        actuators=(actuator,),
        columns=columns,
        state=state,
        machine=(MachineErrors(lanes, cycle, actuator, draws_damping=len(scenes) > 1),),
        arguments=(cycle, friction),
    )


@environment
class ActiveFrictionEnv(TaskEnv):
    """Friction limit of an absorber, set four times a period at one frequency.

    ## Description
    A machine starts from rest and runs at one frequency near a resonance. The force is random and
    not observed. The agent sets the friction limit of the absorber every quarter of a pseudo
    period. An absorber that is held and released at the right phase lowers the response more than
    any constant friction limit.

    ## Action Space
    A ``Box`` of one float32 number a in [-1, 1]: the friction limit mu f_N for the next control
    interval is ``low * (high/low)**((a + 1)/2)`` of ``friction_range``, in units of m_a g0 omega^2
    (mass of the absorber, half-clearance, resonance). Values outside are clipped. Info has the
    ``friction_limit`` in N.

    ## Observation Space
    A ``Box`` of 11 float32 numbers, clipped at +-100: the state at the end of the interval. The
    unit of displacement is the scene's half-clearance (1 mm without walls), the unit of velocity is
    this times the resonance's circular frequency. The force is not observed; info has it as
    ``force``.

    (features)

    ## Rewards
    The sum of all rewards is the score: minus the mean over the intervals of the tip's RMS relative
    to the stationary RMS of the structure without absorber (same force, same frequency), minus
    ``price`` for each change of the action by 1.

    Info has a vector ``costs`` (5,) of the last interval: relative RMS and time, each over the
    number of intervals; mean of (displacement / half-clearance)^``fatigue_exponent``; change of the
    action (of the half-clearance where walls move); mean force of walls and friction on the
    absorber over the force amplitude. With ``vector_reward=True`` the reward is minus this vector,
    as in MO-Gymnasium (``reward_space``).

    ## Starting State
    At rest, with the absorber in the middle of the cavity. Force, phase and frequency are random;
    ``reset(options={"force": ..., "frequency_ratio": ...})`` sets them. The first observation has
    the friction limit of the scene; the first action applies from the first interval.

    ## Episode End
    Truncated when the time budget is spent.

    ## Arguments
    The absorber must have rigid friction. With the default ``price``, a change over the whole range
    in every interval costs 0.016.

    (arguments)

    ## Version History
    - v0: first version
    """

    kind = TaskSpec(
        compose_active_friction,
        (TaskSettings, ActiveSettings, FrictionRange),
        SCENE | {"price": 5e-5},
        ACTIVE_FRICTION_COLUMNS,
    )


ACTIVE_GAP_COLUMNS = (*STATE_IN_PERIOD, GAP_IN_USE)


def compose_active_gap(
    settings: TaskSettings, cycle: ActiveSettings, walls: WallSettings, count: int
) -> Task:
    """Return lanes at one frequency each, with walls that are moved."""
    require_cavity(settings.scene)
    require(
        cycle.friction_error == (0.0, 0.0) or math.isfinite(friction_limit(settings.scene)),
        "friction_error",
        cycle.friction_error,
        "0 for an absorber without rigid friction",
    )
    scenes = vary_damping([settings.scene], cycle.damping_error)
    lanes = LaneState(settings, count, cycle.fatigue_exponent, scenes)
    schedule = SteadySchedule(lanes, cycle)
    actuator = MovingWallsActuator(lanes, walls)
    return Task(
        lanes,
        schedule,
        PeriodReward(schedule, actuator, cycle.price),
        actuators=(actuator,),
        columns=ACTIVE_GAP_COLUMNS,
        state=PeriodColumns,
        machine=(MachineErrors(lanes, cycle, draws_damping=len(scenes) > 1),),
        arguments=(cycle, walls),
    )


@environment
class ActiveGapEnv(TaskEnv):
    """Target of the moving walls of an absorber, set four times a period at one frequency.

    ## Description
    The task of `ActiveFrictionEnv` with another actuator: it moves the walls of the cavity towards
    a target, with a lag and a speed limit. Faster walls would do work that the model does not have.

    ## Action Space
    A ``Box`` of one float32 number a in [-1, 1]: the target of the half-clearance is ``low *
    (high/low)**((a + 1)/2)`` of ``gap_limits``. Values outside are clipped. The walls never close
    onto the absorber. Info has the half-clearance as ``gap`` in m.

    ## Observation Space
    A ``Box`` of 11 float32 numbers, clipped at +-100: the state at the end of the interval, in the
    units of `ActiveFrictionEnv`. The force is not observed; info has it as ``force``.

    (features)

    ## Rewards
    As in `ActiveFrictionEnv`; ``price`` is the price of moving the walls by one half-clearance of
    the scene.

    ## Starting State
    As in `ActiveFrictionEnv`, with the half-clearance of the scene.

    ## Episode End
    Truncated when the time budget is spent.

    ## Arguments
    The absorber must be an impact absorber with rigid walls. ``friction_error`` applies to the
    friction limit of the scene.

    (arguments)

    ## Version History
    - v0: first version
    """

    kind = TaskSpec(
        compose_active_gap,
        (TaskSettings, ActiveSettings, WallSettings),
        SCENE | {"price": 5e-4},
        ACTIVE_GAP_COLUMNS,
    )


RAW_COLUMNS = (*ACCELERATIONS, *KNOWN_TO_CONTROL, FRICTION_IN_USE)


def compose_raw_sensors(
    settings: TaskSettings, cycle: ActiveSettings, friction: FrictionRange, count: int
) -> Task:
    """Return lanes whose friction limit is set from the signals of two accelerometers."""
    return compose_active_friction(
        settings, cycle, friction, count, RAW_COLUMNS, AccelerometerColumns
    )


@environment
class RawSensorsEnv(TaskEnv):
    """Friction limit by two accelerometers with noise and drift.

    ## Description
    The task of `ActiveFrictionEnv` with real sensors: the observation has the mean accelerations of
    tip and absorber over the last quarter of a period, with noise and a drifting bias.
    Displacements, velocities and the place of the absorber in the cavity are not measured. A policy
    that needs them must integrate, so it needs a memory.

    ## Action Space
    As in `ActiveFrictionEnv`: one float32 number in [-1, 1].

    ## Observation Space
    A ``Box`` of 7 float32 numbers, clipped at +-100.

    (features)

    ## Rewards
    As in `ActiveFrictionEnv`.

    ## Starting State
    As in `ActiveFrictionEnv`; the bias is 0.

    ## Episode End
    Truncated when the time budget is spent.

    ## Arguments
    The absorber must have rigid friction.

    (arguments)

    ## Version History
    - v0: first version
    """

    kind = TaskSpec(
        compose_raw_sensors,
        (TaskSettings, ActiveSettings, FrictionRange),
        SCENE | {"price": 5e-5, "observation_noise": 0.05, "observation_drift": 0.01},
        RAW_COLUMNS,
    )


PASSAGE: dict[str, Any] = SEMI_ACTIVE | {"gap_speed": 0.01e-3, "gap_lag": 0.0}
RANDOM_PASSAGE_COLUMNS = (
    *STATE[:-1],
    RMS,
    DISTANCE_TO_END,
    GAP_IN_USE,
    FRICTION_IN_USE,
    SWEEP_RATE,
)
PASSAGE_FREQUENCY_UNIT = 0.05


def compose_random_passage(
    settings: TaskSettings,
    randomised: RandomisedSettings,
    walls: WallSettings,
    friction: FrictionRange,
    count: int,
) -> Task:
    """Return lanes that pass through a resonance, each in a random scene and at a random rate."""
    require_cavity(settings.scene)
    require_friction(settings.scene)
    low, high = randomised.limits
    longest = (high - low) / (randomised.sweep_rates[0] * PER_PERIOD)
    passage = PassageSettings(
        direction="random",
        limits=randomised.limits,
        rates=randomised.sweep_rates,
        time_price=0.0,
        frequency_unit=PASSAGE_FREQUENCY_UNIT,
        level_unit="gap",
        time_budget=1.01 * longest + 1,
    )
    scenes = randomised.pool(settings.scene)
    lanes = LaneState(settings, count, randomised.fatigue_exponent, scenes, "scene")
    schedule = RandomPassageSchedule(lanes, passage, randomised)
    gap = MovingWallsActuator(lanes, walls, starts=randomised.gap_starts)
    return Task(
        lanes,
        schedule,
        RandomPassageReward(schedule, gap, randomised.price),
        actuators=(gap, FrictionActuator(lanes, friction)),
        columns=RANDOM_PASSAGE_COLUMNS,
        arguments=(randomised, walls, friction),
    )


@environment
class PassageEnv(TaskEnv):
    """Slow walls and friction during a random passage through the resonance.

    ## Description
    A machine passes a resonance up or down. Direction, start, rate, gap, damping, restitution and
    force are random; force, damping and restitution are not observed. The walls are slow and have a
    price, so the gap must be right before it is needed. The friction limit may change in every
    interval, without a price.

    ## Action Space
    A ``Box`` of two float32 numbers in [-1, 1]. The first, b, is the target of the half-clearance,
    ``low * (high/low)**((b + 1)/2)`` of ``gap_limits``; the walls move towards it with at most
    ``gap_speed`` and never close onto the absorber. The second, a, is the friction limit for the
    next control interval, ``low * (high/low)**((a + 1)/2)`` of ``friction_range``. Values outside
    are clipped.

    ## Observation Space
    A ``Box`` of 13 float32 numbers, clipped at +-100. The unit of displacement is the scene's
    half-clearance (1 mm by default). Info has the force as ``force`` and the number of the pair of
    damping and restitution as ``scene``.

    (features)

    ## Rewards
    The sum of all rewards is the score: minus the response level of the passage (as in
    `SweepRateEnv`) over the level of the same beam without absorber, minus ``price`` for every
    half-clearance of the scene that the walls move. The reference has the same force in a sweep
    over the whole range at the rate that suits its damping.

    Info has a vector ``costs`` (5,) of the last interval: rise of the relative level, negative
    where it falls; time over the time budget; (displacement / half-clearance)^``fatigue_exponent``,
    summed over samples, over their number in a whole interval; travel of the walls in
    half-clearances; impacts over the pseudo periods of a whole interval. With
    ``vector_reward=True`` the reward is minus this vector, as in MO-Gymnasium (``reward_space``).
    There is no contact force as in `ActiveFrictionEnv`: it is computed from the absorber's
    momentum, and over several periods impacts on both sides cancel.

    ## Starting State
    At rest, with the absorber in the middle of the cavity. Random are: direction; start, up to
    ``start_spread`` behind the near end of ``limits``; rate; gap; one of ``scenes`` pairs of
    damping and restitution; force and phase. ``reset(options={"force": ..., "scene": ...})`` sets
    two of them.

    ## Episode End
    Terminated when the far frequency is reached.

    ## Arguments
    The absorber must be an impact absorber with rigid walls and friction. Its friction limit is
    only that of the first observation.

    (arguments)

    ## Version History
    - v0: first version
    """

    kind = TaskSpec(
        compose_random_passage,
        (TaskSettings, RandomisedSettings, WallSettings, FrictionRange),
        PASSAGE,
        RANDOM_PASSAGE_COLUMNS,
        numbers=2,
        frequency_unit=PASSAGE_FREQUENCY_UNIT,
    )


STRUCTURE_COLUMNS = (*ACTIVE_FRICTION_COLUMNS, *STRUCTURE_NUMBERS)


def compose_structures(
    settings: TaskSettings,
    cycle: ActiveSettings,
    friction: FrictionRange,
    pool: StructurePool,
    count: int,
) -> Task:
    """Return lanes with a random structure each, and a friction limit that is set."""
    standard = settings.scene.model
    require(
        standard.modes == 2, "modes", standard.modes, "2: structures that are drawn have as many"
    )
    require_friction(settings.scene)
    models = pool.models(standard)
    amplitudes = [
        stationary_amplitude(model, model.omega[0], settings.moves_base)
        for model in (standard, *models)
    ]
    nominal = [replace(settings.scene, model=model) for model in models]
    scenes = vary_damping(nominal, cycle.damping_error)
    lanes = LaneState(settings, count, cycle.fatigue_exponent, scenes, "structure")
    force_scale = [amplitudes[0] / amplitude for amplitude in amplitudes[1:]]
    schedule = SteadySchedule(lanes, cycle, force_scale)
    actuator = FrictionActuator(lanes, friction)
    errors = MachineErrors(lanes, cycle, actuator, draws_damping=False)
    return Task(
        lanes,
        schedule,
        PeriodReward(schedule, actuator, cycle.price),
        actuators=(actuator,),
        columns=STRUCTURE_COLUMNS if pool.observe_structure else ACTIVE_FRICTION_COLUMNS,
        state=PeriodColumns,
        machine=(errors, StructureNumbers(lanes, models)),
        arguments=(cycle, friction, pool),
    )


@environment
class StructuresEnv(TaskEnv):
    """Friction limit on a random structure, tested on other families than those of training.

    ## Description
    The task of `ActiveFrictionEnv` on a random structure with random places of force and absorber.
    Structures for training and validation are cantilevers, hinged beams and plates. Those for the
    test are beams clamped at both ends, and pairs of modes without a structure.

    ## Action Space
    As in `ActiveFrictionEnv`: one float32 number in [-1, 1].

    ## Observation Space
    A ``Box`` of 14 float32 numbers, clipped at +-100; the first 11 are those of
    `ActiveFrictionEnv`. The last three are absent with ``observe_structure=False``.

    (features)

    ## Rewards
    As in `ActiveFrictionEnv`, with the stationary response of each structure.

    ## Starting State
    As in `ActiveFrictionEnv`, with a random structure; ``reset(options={"structure": ...})`` sets
    its number. All structures have two modes, and the mass and the first frequency of the default
    beam, which is a choice of units. The random force is a force on the default beam: another
    structure has the force that moves it as far at its resonance.

    ## Episode End
    Truncated when the time budget is spent.

    ## Arguments
    The absorber must have rigid friction. Images show the structure as a straight line.

    (arguments)

    ## Version History
    - v0: first version
    """

    kind = TaskSpec(
        compose_structures,
        (TaskSettings, ActiveSettings, FrictionRange, StructurePool),
        SCENE | {"price": 5e-5},
        STRUCTURE_COLUMNS,
    )
