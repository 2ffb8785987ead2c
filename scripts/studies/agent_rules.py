"""Rules of twelve parameters that are derived from trained agents.

They are fitted to the agents' actions and then refined by CMA-ES on training seeds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from impact_env.envs.evaluation import evaluate
from optimisation.rl.demonstrations import record
from optimisation.rl.families import FamilyPolicy
from optimisation.rl.rules import EIGHT, SideAndSlip, env_of, policies
from studies.admission import Search, evolve
from studies.study import Array

FIRST_FITTED = 300_000  # training seeds of the agent's episodes
FIRST_SEARCHED = 200_000  # and those of the search
BOUND = 3.0  # of the numbers
# starts of the fit: phases, with which the fit has several minima, and the other numbers
PHASES = (-0.5, 0.0, 0.5, 1.0)
OTHER_PHASES = (0.0, 0.5)
FIRST_NUMBERS = (-0.4, 0.4, 0.05, 0.3, 0.0, 0.5, 0.1, 0.3, 0.1, 0.1, 0.0, 0.1)


@dataclass(frozen=True)
class Effort:
    """Effort of the derivation of a rule.

    The number of episodes of the agent that are fitted, the number of seeds of the search (CMA-ES
    uses a third of them), and the settings of the search.
    """

    fitted: int = 64
    searched: int = 192
    search: Search = field(
        default_factory=lambda: Search(generations=90, population=16, sigma=0.04, finalists=10)
    )


QUICK = Effort(4, 12, Search(generations=2, population=6, sigma=0.04, finalists=2))


@dataclass(frozen=True)
class ReadRule:
    """A rule derived from an agent.

    Its ``numbers`` after the search, the ``fitted`` numbers before it, and the share ``explained``
    of the variance of the agent's actions that the fitted numbers explain.
    """

    numbers: tuple[float, ...]
    fitted: tuple[float, ...]
    explained: float


def fit_actions(observations: Any, actions: Array) -> tuple[Array, float]:
    """Return the parameters that fit actions best, and the explained share of variance.

    The fit is by least squares to the actions (n,) at the observations (n, features).
    """
    family = SideAndSlip()

    def errors(numbers: Array) -> Array:
        rows = np.broadcast_to(numbers, (len(observations), len(numbers)))
        return np.clip(family.act(rows, observations), -1, 1) - actions

    fits = []
    for phase in PHASES:
        for other in OTHER_PHASES:
            start = np.array(FIRST_NUMBERS)
            start[[4, 10]] = phase, other
            fits.append(least_squares(errors, start, max_nfev=60, bounds=(-BOUND, BOUND)))
    best = min(fits, key=lambda fit: fit.cost)
    explained = 1 - 2 * best.cost / ((actions - actions.mean()) ** 2).sum()
    return np.asarray(best.x), float(explained)


def read_rule(
    task: str, agent: Any, effort: Effort, progress: Callable[[int], None] | None = None
) -> ReadRule:
    """Return the rule of an agent on a task within a period."""
    seeds = range(FIRST_FITTED, FIRST_FITTED + effort.fitted)
    episodes = record(agent, env_of(task), seeds)
    observations = np.concatenate([rows[:-1] for rows in episodes.observations])
    actions = np.concatenate(episodes.actions)[:, 0].astype(np.float64)
    fitted, explained = fit_actions(observations, actions)
    best = evolve(
        SideAndSlip(),
        [fitted.tolist()],
        env_of(task),
        range(FIRST_SEARCHED, FIRST_SEARCHED + effort.searched),
        {},
        effort.search,
        progress,
    )
    return ReadRule(best.parameters, tuple(fitted.tolist()), explained)


def compare_with_rule(task: str, numbers: Sequence[float], split: str) -> Array:
    """Return the differences (E,) between a rule's scores and those of the eight-parameter rule.

    ``numbers`` are the parameters of the rule. The scores are for the seeds of a split.
    """
    own, other = (
        evaluate(policy, env_of(task), split).scores
        for policy in (FamilyPolicy("rule", SideAndSlip(), numbers), policies(task)[EIGHT])
    )
    return np.asarray(own - other)


# What an agent does over the phase of the tip's motion and the state of the absorber.


PHASE_BINS = 24
STATE_BINS = 20
LEAST_STATES = 3  # in a bin that is drawn
QUARTERS = (50, 75, 100)  # percentiles of the response size between which states are shown
STATES = {
    "place": ("place of the absorber / half-clearance", 2, (-1.0, 1.0)),
    "slip": ("slip velocity / size of the response", 3, (-2.0, 2.0)),
}


@dataclass(frozen=True)
class ActionMap:
    """Mean actions over the phase of the tip and a state of the absorber.

    ``actions`` (bins, bins) is NaN in bins with too few samples. ``phases`` and ``states`` are the
    edges of the bins.
    """

    phases: Array
    states: Array
    actions: Array


def map_actions(
    observations: Array, actions: Array, state: str, sizes: tuple[float, float]
) -> ActionMap:
    """Return the mean actions over phase and state within a range of response sizes.

    ``actions`` (n,) belong to ``observations`` (n, features), whose response size must lie within
    the two limits ``sizes``.
    """
    size = observations[:, 9]
    inside = (size >= sizes[0]) & (size < sizes[1])
    rows = observations[inside]
    phase = np.arctan2(-rows[:, 1], rows[:, 0]) / np.pi
    _, column, limits = STATES[state]
    values = rows[:, column] / (rows[:, 9] + 1e-3 if state == "slip" else 1.0)
    bins: Any = {"bins": (PHASE_BINS, STATE_BINS), "range": ((-1, 1), limits)}
    total, phases, states = np.histogram2d(phase, values, weights=actions[inside], **bins)
    count = np.histogram2d(phase, values, **bins)[0]
    means = np.full(count.shape, np.nan)
    np.divide(total, count, out=means, where=count >= LEAST_STATES)
    return ActionMap(phases, states, means)
