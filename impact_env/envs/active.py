"""ImpactAbsorber/ActiveFriction-v0 and ActiveGap-v0: an absorber that is set every quarter of a period."""

from typing import Any

from impact_env.envs.active_task import ActiveFrictionTask, ActiveGapTask, Cycle, Drive
from impact_env.envs.adaptive_task import Grip
from impact_env.envs.observation import FEW_IMPACTS
from impact_env.envs.settings import Settings
from impact_env.envs.shells import Kind, TaskEnv, choice, with_rows
from impact_env.envs.vector_shell import vector_of

SCENE: dict[str, Any] = {
    "modes": 2,
    "absorber_options": {"friction_limit": 0.1},
    "force": (0.5, 6.0),
    "interval": 0.25,
    "impacts_limit": FEW_IMPACTS,
}


@with_rows
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

    (rows 1 to 10)
    | 11 | friction limit in use | its place in the range, as the action has it |

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
    - ``friction_range`` (default 0.02 to 20): lowest and highest friction limit in units of m_a g0 omega^2 (0.72 N in the default scene), above 0
    - ``vector_reward`` (default False); those of every environment: `impact_env.envs.settings.Settings` describes scene, force (default 0.5 to 6 N),
      method, interval and observation; here ``modes`` 2 and a friction limit of 0.1 N, which is only the one shown at the start

    The absorber must have rigid friction. Bad values raise `impact_env.ParameterError`, a step before a reset or after the end
    `gymnasium.error.ResetNeeded`.

    ## Version History
    - v0: first version
    """

    kind = Kind(ActiveFrictionTask, (Settings, Cycle, Grip), SCENE | {"price": 5e-5}, choice)


ActiveFrictionVectorEnv = vector_of(ActiveFrictionEnv)


@with_rows
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

    (rows 1 to 10)
    | 11 | half-clearance in use | m / half-clearance of the scene |

    ## Rewards
    Those of `ActiveFrictionEnv`; the price is that of moving the walls by one half-clearance of the scene.

    ## Starting State
    That of `ActiveFrictionEnv`, the cavity as the scene has it.

    ## Episode End
    Truncated when the time budget is spent.

    ## Arguments
    All of `ActiveFrictionEnv` but ``friction_range``, with ``price`` 0.0005 (per half-clearance of the scene, 1 mm), and

    - ``gap_limits`` (default 0.1 mm to 3 mm): half-clearances in m
    - ``gap_speed`` (default 0.3 mm): how far the walls move at most in a pseudo period, in m; ``gap_lag`` (default 0.1 pseudo periods)

    The absorber must be an impact absorber with rigid walls. Bad values raise `impact_env.ParameterError`, a step before a reset or after the end
    `gymnasium.error.ResetNeeded`.

    ## Version History
    - v0: first version
    """

    kind = Kind(ActiveGapTask, (Settings, Cycle, Drive), SCENE | {"price": 5e-4}, choice)


ActiveGapVectorEnv = vector_of(ActiveGapEnv)
