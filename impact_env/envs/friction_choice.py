"""ImpactAbsorber/FrictionChoice-v1: the friction limit of the absorber during a passage through resonance under a force that is not announced."""

from typing import Any

from impact_env.envs.friction_task import FrictionTask, Grip
from impact_env.envs.kind import Kind
from impact_env.envs.observation import FEW_IMPACTS
from impact_env.envs.settings import Settings
from impact_env.envs.shells import TaskEnv, choice
from impact_env.envs.sweep_task import OneRate
from impact_env.envs.vector_shell import TaskVectorEnv

# SweepRate's passage in haste; at the start the paper's friction
DEFAULTS: dict[str, Any] = {
    "modes": 2,
    "absorber_options": {"friction_limit": 0.1},
    "limits": (0.93, 1.03),
    "rate": 4.0,
    "force": (0.5, 6.0),
    "level_unit": "gap",
    "impacts_limit": FEW_IMPACTS,
}
KIND = Kind(FrictionTask, (Settings, OneRate, Grip), DEFAULTS, choice)


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
    | 9 | response level so far | m / half-clearance of the scene |
    | 10 | far frequency less present one | ratio / 0.1 |
    | 11 | friction limit in use | its place in the range, as the action has it |

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

    The absorber must have rigid friction: an impact absorber with rigid walls and a ``friction_limit``, or a friction damper. Bad values raise
    `impact_env.ParameterError`, a step before a reset or after the end `gymnasium.error.ResetNeeded`.

    ## Version History
    - v1: the level is in half-clearances, and feature 5 is cut off at 4. It is v0 with ``level_unit="gap"`` and ``impacts_limit=4``
    - v0: first version; its level is over that of the beam without absorber under the same force (``level_unit="reference"``), so that features 1, 2
      and 9 together tell the force after one interval
    """

    kind = KIND


class FrictionChoiceVectorEnv(TaskVectorEnv):
    """Native vector of `FrictionChoiceEnv`, see `TaskVectorEnv`; lane i is the single one with seed + i."""

    kind = KIND
