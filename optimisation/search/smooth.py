"""SciPy's search for smooth problems.

Without walls there is no chaos. A level then has hardly any noise and few minima.

Nelder-Mead over the shares of the free variables' ranges, from several starts, since the optimum is
often a kink (two equal peaks). A few members of the ensemble are enough here.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import count, require
from impact_env.ensemble import Executor
from optimisation.problem import Problem, evaluate
from optimisation.search.settings import Evaluated
from optimisation.space import WITH_IMPACTS, Design

Array = NDArray[np.float64]
STARTS = 3
SCATTERED = 16
MEMBERS = 2
_TOLERANCE = 1e-5  # in shares of the ranges, and in the objective


def smooth_search(
    problem: Problem,
    designs: int,
    executor: Executor,
    seed: int = 0,
    from_scratch: bool = False,
    progress: Callable[[int], None] | None = None,
) -> tuple[list[Evaluated], bool]:
    """Return the designs that were run, by number, and a flag.

    They are the start of the space (unless ``from_scratch``), scattered designs, and descents from
    the best of these.

    Ends after about ``designs`` of them, or when every descent has come to rest. The flag is
    False if a KeyboardInterrupt ended it early. Raises ParameterError
    for several objectives and for impact absorbers.
    """
    designs = count("designs", designs, 2)
    require(
        problem.space.concept not in WITH_IMPACTS,
        "sampler",
        "scipy",
        "a concept without walls: impacts are chaotic, and their levels noisy",
    )
    require(len(problem.objectives) == 1, "sampler", "scipy", "one objective")
    problem = replace(problem, members=min(MEMBERS, problem.members))
    evaluated: list[Evaluated] = []

    def run(batch: list[Design]) -> list[float]:
        measured = dict(evaluate(problem, batch, problem.ensemble, problem.rate, executor))
        for k, design in enumerate(batch):
            evaluated.append(
                Evaluated(
                    len(evaluated),
                    design,
                    problem.score(design, measured[k], problem.ensemble, problem.rate),
                    1,
                )
            )
        if progress is not None:
            progress(len(evaluated))
        return [problem.penalised_cost(e.score) for e in evaluated[-len(batch) :]]

    def at(shares: Array) -> float:
        return run([problem.space.at(np.clip(shares, 0, 1).tolist())])[0] + float(
            np.sum(np.abs(shares - np.clip(shares, 0, 1)))
        )

    size = len(problem.space.free)
    start = problem.space.shares(problem.space.default)
    points = scipy.stats.qmc.Halton(size, rng=np.random.default_rng(seed)).random(
        min(SCATTERED, designs - 1)
    )
    points = points if from_scratch else np.vstack([start, points])
    try:
        costs = run([problem.space.at(shares.tolist()) for shares in points])
        for k in np.argsort(costs, kind="stable")[:STARTS]:
            left = designs - len(evaluated)
            if left > 0:
                simplex = np.vstack([points[k], points[k] + 0.05 * np.eye(size)])
                options = {
                    "initial_simplex": simplex,
                    "maxfev": left,
                    "xatol": _TOLERANCE,
                    "fatol": _TOLERANCE,
                }
                scipy.optimize.minimize(at, points[k], method="Nelder-Mead", options=options)
    except KeyboardInterrupt:
        return evaluated, False
    return evaluated, True
