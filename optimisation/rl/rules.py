"""Baselines of all tasks that need no learning.

They are families of rules and schedules, and the parameters that `admit_tasks` chose for them.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from impact_env.checks import require
from optimisation.rl import families
from optimisation.rl.families import Array, Family, Observations

# Rules of few numbers for tasks within a period and for the limited passage: what needs no learning
# and sees what an agent sees.
#
# The scene and its mirror image are one, so an action is even in displacements and velocities:
# rules take products of two of them, over the mean square of the tip. Friction and gap that suit a
# response go in proportion to its size (scaling law), so each family has its logarithm.


# columns of a task within a period
X = 0
V = 1
R = 2
W = 3
COS = 5
SIN = 6
RATIO = 7
LEFT = 8
RMS = 9
# of the limited passage
PAIR_IMPACTS = 4
PAIR_RATIO = 6
PAIR_SIZE = 8
PAIR_WAY = 9
PAIR = (
    "gap",
    "gap per size",
    "friction",
    "friction per size",
    "gap over frequency",
    "friction over frequency",
)
SMALL = 1e-3  # of the RMS: half-clearances


def _columns(observations: Observations) -> tuple[Array, Array, Array]:
    """Return the features, their logarithm of size, and the inverse of the mean square (L,)."""
    features = observations.astype(np.float64)
    size = np.maximum(features[:, RMS], 0) + SMALL  # noise of a sensor may be below 0
    return features, np.log(size), 1 / size**2


class Switch(Family):
    """A rule with one action while the slip takes energy from a motion, another otherwise.

    The motion has a given phase. There are eight parameters; the first four define a rule by
    themselves, with the others at `neutral`.
    """

    few = 4
    begins = (
        lambda c: (c[0], 0.5, 0.0, 0.0),
        lambda c: (c[0], -0.5, 0.0, 0.0),
        lambda c: (c[0], 0.5, 0.5, 0.3),
    )
    names = (
        "middle",
        "half step",
        "phase",
        "per size",
        "frequency",
        "time",
        "softness",
        "per place",
    )
    neutral = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0, 0.0)

    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return the actions (L,)."""
        middle, step, phase, size, ratio, time, softness, place = parameters.T
        features, log_size, per_square = _columns(observations)
        power = (
            features[:, W]
            * (features[:, V] * np.cos(math.pi * phase) + features[:, X] * np.sin(math.pi * phase))
            * per_square
        )
        rest = (
            size * log_size
            + ratio * features[:, RATIO]
            + time * features[:, LEFT]
            + place * (np.abs(features[:, R]) - 0.5)
        )
        return middle + step * np.tanh(np.exp(softness) * power) + rest


class Phase(Family):
    """An action that oscillates twice a period with the force's phase.

    It depends on the motion only through the size of the response.
    """

    few = 4
    begins = (lambda c: (c[0], 0.3, 0.0, 0.3), lambda c: (c[0], 0.3, 1.0, 0.0))
    names = (
        "middle",
        "swing",
        "phase",
        "per size",
        "frequency",
        "time",
        "phase over the frequency",
        "swing over size",
    )
    neutral = (0.0,) * 8

    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return the actions (L,)."""
        middle, swing, phase, size, ratio, time, bent, grown = parameters.T
        features, log_size, _ = _columns(observations)
        angle = 2 * np.arctan2(features[:, SIN], features[:, COS]) + math.pi * (
            phase + bent * features[:, RATIO]
        )
        return (
            middle
            + (swing + grown * log_size) * np.sin(angle)
            + size * log_size
            + ratio * features[:, RATIO]
            + time * features[:, LEFT]
        )


class Products(Family):
    """An action that is linear in products of the state."""

    few = 4
    begins = (lambda c: (c[0], 0.0, 0.0, 0.0), lambda c: (c[0], 0.3, 0.3, -0.1))
    names = (
        "middle",
        "per size",
        "slip with velocity",
        "slip with place",
        "slip with displacement",
        "place with displacement",
        "frequency",
        "time",
    )
    neutral = (0.0,) * 8

    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return the actions (L,)."""
        features, log_size, square = _columns(observations)
        x, v, r, w = (features[:, k] for k in (X, V, R, W))
        terms = np.column_stack(
            [
                np.ones(len(x)),
                log_size,
                v * w * square,
                r * w,
                x * w * square,
                x * r * square,
                features[:, RATIO],
                features[:, LEFT],
            ]
        )
        return np.einsum("lk,lk->l", parameters, terms)


class SideAndSlip(Family):
    """An action by the tip's phase, the slip speed and the size of the response.

    The tip's phase is taken relative to the absorber's side of the cavity.

    Its twelve numbers were fitted to agents: a family of eight that has the same terms was not
    found by hand.
    """

    names = (
        "middle",
        "per size",
        "per size squared",
        "step over side and phase",
        "its phase",
        "its softness",
        "step per size",
        "slip speed",
        "slip speed per size",
        "slip with velocity",
        "its phase",
        "time",
    )
    neutral = (0.0,) * 12

    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return the actions (L,)."""
        (
            middle,
            size,
            size_squared,
            step,
            phase,
            softness,
            step_size,
            slip,
            slip_size,
            along,
            along_phase,
            time,
        ) = parameters.T
        features, log_size, per_square = _columns(observations)
        per_size = np.sqrt(per_square)
        displacement, velocity, place, rate = (features[:, k] for k in (X, V, R, W))

        def at_phase(angle: Array) -> Array:
            turned = displacement * np.cos(math.pi * angle) + velocity * np.sin(math.pi * angle)
            return np.asarray(turned * per_size)

        side = np.tanh(2 * place) * at_phase(phase)
        speed = np.tanh(np.abs(rate) * per_size)
        direction = np.tanh(4 * rate * per_size)
        return np.asarray(
            middle
            + size * log_size
            + size_squared * log_size**2
            + (step + step_size * log_size) * np.tanh(np.exp(softness) * side)
            + (slip + slip_size * log_size) * speed
            + along * direction * at_phase(along_phase)
            + time * features[:, LEFT]
        )


class Blind(Family):
    """A schedule over time that looks at nothing: actions at equidistant knots."""

    knots = 6
    names = tuple(f"action at {share:.1f} of the time" for share in np.linspace(0, 1, knots))
    begins = (lambda c: (c[0],) * Blind.knots,)

    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return the actions (L,)."""
        at = np.clip(1 - observations[:, LEFT].astype(np.float64), 0, 1) * (self.knots - 1)
        left = np.minimum(at.astype(np.int64), self.knots - 2)
        lanes = np.arange(len(at))
        return parameters[lanes, left] * (1 - at + left) + parameters[lanes, left + 1] * (at - left)


class PairBySize(Family):
    """Gap and friction of the limited passage by the size of the response and the frequency.

    If all parameters are free, they also depend on the remaining way.

    Both in proportion to a power of the size (scaling law); the first four numbers are two places
    and two powers.
    """

    few = 4
    feature = PAIR_WAY
    names = (*PAIR, "gap over way", "friction over way")
    neutral = (0.0,) * 8
    begins: Sequence[families.Start] = (
        lambda c: (c[0], 0.0, c[1], 0.0),
        lambda c: (c[0], 0.3, c[1], 0.3),
    )

    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return gap and friction actions (L, 2)."""
        features = observations.astype(np.float64)
        size = np.log(np.maximum(features[:, PAIR_SIZE], 0) + SMALL)
        ratio = features[:, PAIR_RATIO]
        other = np.abs(features[:, self.feature])
        (
            gap,
            gap_size,
            friction,
            friction_size,
            gap_ratio,
            friction_ratio,
            gap_other,
            friction_other,
        ) = parameters.T
        friction = friction + friction_size * size + friction_ratio * ratio + friction_other * other
        return np.stack(
            [gap + gap_size * size + gap_ratio * ratio + gap_other * other, friction], axis=1
        )


class PairByImpacts(PairBySize):
    """The same with impacts in place of the way."""

    feature = PAIR_IMPACTS
    names = (*PAIR, "gap and impacts", "friction and impacts")
    begins = PairBySize.begins[:1]


class BlindPair(Family):
    """A schedule of gap and friction as parabolas over the remaining way.

    It does not depend on the response.
    """

    names = ("gap", "gap's slope", "gap's bend", "friction", "friction's slope", "friction's bend")
    begins = (lambda c: (c[0], 0.0, 0.0, c[1], 0.0, 0.0),)

    def act(self, parameters: Array, observations: Observations) -> Array:
        """Return gap and friction actions (L, 2)."""
        way = np.abs(observations[:, PAIR_WAY].astype(np.float64)) - 0.5
        gap, gap_slope, gap_bend, friction, friction_slope, friction_bend = parameters.T
        return np.stack(
            [
                gap + gap_slope * way + gap_bend * way * way,
                friction + friction_slope * way + friction_bend * way * way,
            ],
            axis=1,
        )


# at most so many numbers
CONSTANT = "best constant"
BLIND = "blind schedule"
FOUR = "rule of 4"
EIGHT = "rule of 8"
READ = "rule of 12"  # read off an agent
CHOSEN = Path(__file__).with_name("rules.json")  # by task and what it is: family and numbers
OF_AGENTS = Path(__file__).with_name("agent_rules.json")  # the same, of rules read off agents


class Families(NamedTuple):
    """Families of policies of a task.

    Attributes
    ----------
    constant : type
        Policies with a constant action.
    blind : type
        Schedules that do not depend on the response.
    feedback : tuple of type
        Rules that depend on the response.
    planned : bool
        Whether a planner over such a rule is promising.
    """

    constant: type[Family]
    blind: type[Family]
    feedback: tuple[type[Family], ...]
    planned: bool = False

    @property
    def numbers(self) -> int:
        """Number of values in an action."""
        return len(self.constant.names)


WITHIN = Families(families.ConstantAction, Blind, (Switch, Phase, Products), planned=True)
RATE = Families(families.ConstantAction, families.FrequencyWindow, (families.SmallRule,))
TASKS = {
    "ActiveFriction-v0": WITHIN,
    "ActiveGap-v0": WITHIN,
    "Structures-v0": WITHIN,
    "Passage-v0": Families(
        families.ConstantPair, BlindPair, (PairBySize, PairByImpacts), planned=True
    ),
    "FrictionChoice-v1": Families(
        families.ConstantAction, families.LimitOverFrequency, (families.FeedbackFriction,)
    ),
    "SweepAndGap-v1": Families(
        families.ConstantPair,
        families.RateAndGapOverFrequency,
        (families.RateAndGapByEstimatedForce,),
    ),
    "GapChoice-v1": Families(
        families.ConstantAction, families.GapOverFrequency, (families.GapByEstimatedForce,)
    ),
    "SweepRate-v1": RATE,
    "SweepRateNoisy-v1": RATE,
    "SweepRateDelayed-v1": RATE,
}  # in the newest version; those with a planner are the ones with room


def env_of(task: str) -> str:
    """Return the environment of a task; raises ParameterError for one that is not in the table."""
    require(task in TASKS, "task", task, f"one of {', '.join(TASKS)}")
    return f"ImpactAbsorber/{task}"


def chosen(file: Path = CHOSEN) -> dict[str, dict[str, Any]]:
    """Return the chosen rules and schedules by task: each one's family and numbers."""
    return dict(json.loads(file.read_text(encoding="utf-8")))


def read_off_agents(file: Path = OF_AGENTS) -> dict[str, dict[str, Any]]:
    """Return the rules that were read off agents by task: family and numbers of each."""
    return dict(json.loads(file.read_text(encoding="utf-8")))


def policies(
    task: str, arguments: Mapping[str, Any] | None = None
) -> dict[str, families.FamilyPolicy]:
    """Return the chosen policies of a task by their labels.

    The label of the rule with eight parameters holds the rule with four if the two do not differ.
    """
    behind = families.task_of(env_of(task), arguments)
    own = TASKS[task]
    known: dict[str, Callable[[Any], Family]] = {
        family.__name__: family for family in (own.constant, own.blind, *own.feedback)
    }
    chosen_policies = {}
    for label, rule in chosen()[task].items():
        family = known[rule["family"]](behind)
        numbers = [*rule["numbers"], *family.neutral[len(rule["numbers"]) :]]
        chosen_policies[label] = families.FamilyPolicy(label, family, numbers)
    if task in (rules := read_off_agents()):
        rule = SideAndSlip(behind)
        chosen_policies[READ] = families.FamilyPolicy(READ, rule, rules[task][READ]["numbers"])
    return chosen_policies
