"""Environments with an actuator: set every quarter of a period, or with slow walls on a passage; some of them on scenes that are drawn."""

from functools import partial
from typing import Any

from impact_env.envs.active_task import (
    ActiveFrictionTask,
    ActiveGapTask,
    ActiveSettings,
    RawSensorsTask,
    WallActuator,
)
from impact_env.envs.adaptive_task import FrictionRange
from impact_env.envs.choices import SEMI_ACTIVE
from impact_env.envs.drawn_task import (
    LimitedPassageTask,
    RandomisedSettings,
    StructurePool,
    StructuresTask,
)
from impact_env.envs.settings import TaskSettings
from impact_env.envs.shells import TaskEnv, TaskSpec, one_number_space
from impact_env.envs.vector_shell import environment

SCENE: dict[str, Any] = SEMI_ACTIVE | {"interval": 0.25}


@environment
class ActiveFrictionEnv(TaskEnv):
    """When to hold an absorber, and when to let it go, within a period.

    ## Description
    A machine starts from rest near a resonance, under a force that nobody announces, and its absorber's friction can be set every quarter of a
    period. Held at the right time and let go at the right time the absorber takes more energy than with any friction that stays.

    ## Action Space
    A ``Box`` of one float32 number a in [-1, 1]: the friction limit mu f_N for the next control interval is ``low * (high/low)**((a + 1)/2)`` of
    ``friction_range``, in units of m_a g0 omega^2 (absorber's mass, half-clearance, resonance). Numbers outside are cut to [-1, 1]. Info's
    ``friction_limit`` (N) says what was set.

    ## Observation Space
    A ``Box`` of 11 float32 numbers, cut off at +-100: the state at the interval's end. The unit of displacement is the scene's half-clearance (1 mm
    without walls), that of velocity this times the resonance's circular frequency. The force is not among them; info's ``force`` has it.

    (features)

    ## Rewards
    The sum of all rewards is the score: minus the mean over the intervals of the tip's RMS, relative to the stationary RMS of the beam without
    absorber under the same force at the same frequency, minus ``price`` for every unit that the action moves. Info's ``costs`` (5,) has what the last
    interval cost: relative RMS and time, each over the number of intervals; the mean of (displacement / half-clearance)^``fatigue_exponent``; how
    far the actuator moved; mean force of wall and friction on the absorber over the force's amplitude. With ``vector_reward=True`` minus these
    costs are the reward, in the form of MO-Gymnasium (``reward_space``).

    ## Starting State
    At rest, the absorber in the middle of the cavity. Force, phase and frequency are drawn; ``reset(options={"force": ..., "frequency_ratio": ...})``
    chooses instead. The friction shown is the scene's; that of the first interval is chosen already.

    ## Episode End
    Truncated when the time budget is spent.

    ## Arguments
    - ``frequency_ratio`` to the resonance, or a pair (low, high) from which each episode draws (default 0.96 to 1.02)
    - ``time_budget`` (default 40) in pseudo periods, ``interval`` (default 0.25); ``fatigue_exponent`` (default 5)
    - ``price`` (default 0.00005) of moving the action by 1; to switch over the whole range in every interval costs 0.016
    - ``friction_error`` and ``damping_error`` (default 0): by which share the friction limit and all damping ratios are above those that the
      control takes them for (0.2: 20 % more), or a pair (low, high) from which each episode draws; of the damping, one of 16 values. The score's
      reference has the true damping
    - ``friction_range`` (default 0.02 to 20): lowest and highest friction limit in units of m_a g0 omega^2 (0.72 N in the default scene), above 0
    - ``vector_reward`` (default False); those of every environment: `impact_env.envs.settings.TaskSettings` has scene, force (default 0.5 to 6 N),
      method, interval and observation; here ``modes`` 2 and a friction limit of 0.1 N, which is only the one shown at the start

    The absorber must have rigid friction.

    ## Version History
    - v0: first version
    """

    kind = TaskSpec(
        ActiveFrictionTask,
        (TaskSettings, ActiveSettings, FrictionRange),
        SCENE | {"price": 5e-5},
        one_number_space,
    )


@environment
class ActiveGapEnv(TaskEnv):
    """Where to move the walls of an absorber within a period.

    ## Description
    The task of `ActiveFrictionEnv`, with an actuator that moves the walls of the cavity towards a target, with a lag and no faster than a limit:
    above it a moving wall would do work that is not modelled.

    ## Action Space
    A ``Box`` of one float32 number a in [-1, 1]: the target of the half-clearance is ``low * (high/low)**((a + 1)/2)`` of ``gap_limits``. Numbers
    outside are cut to [-1, 1]. The walls never close onto the absorber. Info's ``gap`` (m) says what was set.

    ## Observation Space
    A ``Box`` of 11 float32 numbers, cut off at +-100: the state at the interval's end, with the units of `ActiveFrictionEnv`. The force is not among
    them; info's ``force`` has it.

    (features)

    ## Rewards
    Those of `ActiveFrictionEnv`; the price is that of moving the walls by one half-clearance of the scene.

    ## Starting State
    That of `ActiveFrictionEnv`, the cavity as the scene has it.

    ## Episode End
    Truncated when the time budget is spent.

    ## Arguments
    All of `ActiveFrictionEnv` but ``friction_range``, with ``price`` 0.0005 (per half-clearance of the scene, 1 mm), ``friction_error`` of the
    scene's friction limit, and

    - ``gap_limits`` (default 0.1 mm to 3 mm): half-clearances in m
    - ``gap_speed`` (default 0.3 mm): how far the walls move at most in a pseudo period, in m; ``gap_lag`` (default 0.1 pseudo periods)

    The absorber must be an impact absorber with rigid walls.

    ## Version History
    - v0: first version
    """

    kind = TaskSpec(
        ActiveGapTask,
        (TaskSettings, ActiveSettings, WallActuator),
        SCENE | {"price": 5e-4},
        one_number_space,
    )


@environment
class RawSensorsEnv(TaskEnv):
    """`ActiveFrictionEnv` by two accelerometers with noise and drift.

    ## Description
    What an agent sees is what sensors give: the mean accelerations of tip and absorber over the last quarter of a period, with noise and a bias
    that drifts. Displacements, velocities and the place in the cavity are not measured; an agent that needs them has to integrate, so it needs a
    memory.

    ## Action Space
    That of `ActiveFrictionEnv`: one float32 number in [-1, 1].

    ## Observation Space
    A ``Box`` of 7 float32 numbers, cut off at +-100.

    (features)

    ## Rewards
    Those of `ActiveFrictionEnv`.

    ## Starting State
    That of `ActiveFrictionEnv`; the bias is 0.

    ## Episode End
    Truncated when the time budget is spent.

    ## Arguments
    All of `ActiveFrictionEnv`, here with ``observation_noise`` 0.05 and ``observation_drift`` 0.01

    ## Version History
    - v0: first version
    """

    kind = TaskSpec(
        RawSensorsTask,
        (TaskSettings, ActiveSettings, FrictionRange),
        SCENE | {"price": 5e-5, "observation_noise": 0.05, "observation_drift": 0.01},
        one_number_space,
    )


PASSAGE: dict[str, Any] = SEMI_ACTIVE | {"gap_speed": 0.01e-3, "gap_lag": 0.0}


@environment
class PassageEnv(TaskEnv):
    """Walls that move slowly and friction that is free, on a passage of which nearly all is drawn.

    ## Description
    A machine passes a resonance up or down, at a rate, from a start, with a gap, a damping, a restitution and under a force that are all drawn;
    nobody announces force, damping and restitution. Walls move so slowly, and at such a price, that where they should be has to be known before it is
    needed; friction can be another one in every interval.

    ## Action Space
    A ``Box`` of two float32 numbers in [-1, 1]. The first, b, is the target of the half-clearance, ``low * (high/low)**((b + 1)/2)`` of
    ``gap_limits``, towards which the walls move at ``gap_speed`` at most; they never close onto the absorber. The second, a, is the friction limit
    for the next control interval, ``low * (high/low)**((a + 1)/2)`` of ``friction_range``. Numbers outside are cut to [-1, 1].

    ## Observation Space
    A ``Box`` of 13 float32 numbers, cut off at +-100. The unit of displacement is the scene's half-clearance (1 mm unless given). Force, damping and
    restitution are not among them; info's ``force`` has the first, its ``scene`` the number of the other two.

    (features)

    ## Rewards
    The sum of all rewards is the score: minus the level of the passage (as in `SweepRateEnv`) over that of the same beam without absorber under the
    same force in a sweep of the whole range at the rate that suits its damping, minus ``price`` for every half-clearance of the scene that the
    walls move. Info's ``costs`` (5,) has what the last interval cost: rise of the relative level, below 0 where it falls; time over the time budget;
    (displacement / half-clearance)^``fatigue_exponent``, summed over samples, over their number in a whole interval; half-clearances that the walls
    moved; impacts, over the pseudo periods of a whole interval. The last stand in the place of the contact force of `ActiveFrictionEnv`, which is
    read from the absorber's momentum: over several periods pushes to either side cancel. With ``vector_reward=True`` minus these costs are the
    reward, in the form of MO-Gymnasium (``reward_space``).

    ## Starting State
    At rest, the absorber in the middle of the cavity. What is drawn: direction; start, up to ``start_spread`` behind the near end of ``limits``; rate
    of the range ``sweep_rates``; gap of ``gap_starts``; one of ``scenes`` pairs of damping and restitution; force and phase.
    ``reset(options={"force": ..., "scene": ...})`` chooses instead.

    ## Episode End
    Terminated when the far frequency is reached.

    ## Arguments
    - ``limits`` (default 0.93 to 1.03), ``start_spread`` (default 0.01), ``sweep_rates`` (default 2 to 6) in % per 100 pseudo periods
    - ``gap_limits`` (default 0.1 mm to 3 mm), ``gap_starts`` (default 0.3 mm to 2 mm), ``gap_speed`` (default 0.01 mm, in m) a pseudo period,
      ``gap_lag`` (default 0) in pseudo periods; ``friction_range`` (default 0.02 to 20) in units of m_a g0 omega^2
    - ``price`` (default 0.01); ``fatigue_exponent`` (default 5) and ``vector_reward`` (default False)
    - ``damping`` (default 0.005 to 0.02) of all modes, ``restitution`` (default 0.6 to 1), ``scenes`` (default 12): so many pairs of them are spread
      evenly
    - those of every environment: `impact_env.envs.settings.TaskSettings` has scene, force (default 0.5 to 6 N), method, interval (5) and
      observation;
      here ``modes`` 2 and a friction limit of 0.1 N, which is only the one shown at the start

    The absorber must be an impact absorber with rigid walls and friction.

    ## Version History
    - v0: first version
    """

    kind = TaskSpec(
        LimitedPassageTask,
        (TaskSettings, RandomisedSettings, WallActuator, FrictionRange),
        PASSAGE,
        partial(one_number_space, 2),
    )


@environment
class StructuresEnv(TaskEnv):
    """`ActiveFrictionEnv` on a structure that is drawn, and judged on families that were not trained on.

    ## Description
    What holds and lets go of an absorber should do so on any structure. Each episode has another one, with another place of force and absorber:
    cantilevers, beams on hinges and plates to train on and to validate, beams clamped at both ends and pairs of modes that belong to nothing to test.

    ## Action Space
    That of `ActiveFrictionEnv`: one float32 number in [-1, 1].

    ## Observation Space
    A ``Box`` of 14 float32 numbers, cut off at +-100; the first 11 are those of `ActiveFrictionEnv`. The last three are absent with
    ``observe_structure=False``.

    (features)

    ## Rewards
    Those of `ActiveFrictionEnv`, each structure with its own stationary response.

    ## Starting State
    That of `ActiveFrictionEnv`. The structure is drawn, too; ``reset(options={"structure": ...})`` chooses its number. All structures have the mass
    and the first frequency of the default beam, which is a choice of units, and two modes. The force that is drawn is that on the default beam:
    another structure has the force that moves it as far at its resonance.

    ## Episode End
    Truncated when the time budget is spent.

    ## Arguments
    All of `ActiveFrictionEnv`, and

    - ``split`` (default "train"): "train", "validation" or "test"; ``structures`` (default 24): how many there are to draw from
    - ``observe_structure`` (default True): whether the last three features are there

    Pictures show the structure as a straight line.

    ## Version History
    - v0: first version
    """

    kind = TaskSpec(
        StructuresTask,
        (TaskSettings, ActiveSettings, FrictionRange, StructurePool),
        SCENE | {"price": 5e-5},
        one_number_space,
    )
