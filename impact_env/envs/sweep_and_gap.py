"""ImpactAbsorber/SweepAndGap-v1: rate and clearance during a passage through resonance under a force that is not announced."""

from functools import partial
from typing import Any

from impact_env.envs.kind import Kind
from impact_env.envs.observation import FEW_IMPACTS
from impact_env.envs.settings import Settings
from impact_env.envs.shells import TaskEnv, choice
from impact_env.envs.sweep_gap_task import Cavity, SweepGapTask
from impact_env.envs.sweep_task import Passage
from impact_env.envs.vector_shell import TaskVectorEnv

DEFAULTS: dict[str, Any] = {
    "force": (0.5, 6.0),
    "absorber_options": {"restitution": 0.7},
    "limits": (0.93, 1.03),
    "interval": 10.0,
    "time_budget": 4000.0,
    "budget_end": "terminated",
    "frequency_origin": "middle",
    "frequency_unit": 0.0125,
    "level_unit": "gap",
    "impacts_limit": FEW_IMPACTS,
}
KIND = Kind(SweepGapTask, (Settings, Passage, Cavity), DEFAULTS, partial(choice, 2))


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

    | # | what | unit and scale |
    | --- | --- | --- |
    | 1 | amplitude of the tip in phase with the force, over the last interval | m / half-clearance |
    | 2 | amplitude of the tip a quarter of a period behind the force | m / half-clearance |
    | 3 | absorber less tip at the interval's end | m / half-clearance |
    | 4 | its rate | m/s / (half-clearance times the resonance's circular frequency) |
    | 5 | impacts in the last interval | per pseudo period / 2, cut off at 4 |
    | 6 | absorber's kinetic energy over that of beam and absorber | 1 |
    | 7 | frequency ratio to the resonance, less the middle of ``limits`` | 1 / ``frequency_unit`` |
    | 8 | share of the time budget that is left | 1 |
    | 9 | response level so far | m / half-clearance of the scene |
    | 10 | far frequency less present one | ratio / ``frequency_unit`` |
    | 11 | half-clearance in use | m / half-clearance of the scene |

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

    The absorber must be an impact absorber with rigid walls. Bad values raise `impact_env.ParameterError`, a step before a reset or after the end
    `gymnasium.error.ResetNeeded`.

    ## Version History
    - v1: the level is in half-clearances, and feature 5 is cut off at 4. It is v0 with ``level_unit="gap"`` and ``impacts_limit=4``
    - v0: first version; its level is over that of the beam without absorber under the same force (``level_unit="reference"``), so that features 1, 2
      and 9 together tell the force after one interval
    """

    kind = KIND


class SweepAndGapVectorEnv(TaskVectorEnv):
    """Native vector of `SweepAndGapEnv`, see `TaskVectorEnv`; lane i is the single one with seed + i."""

    kind = KIND
