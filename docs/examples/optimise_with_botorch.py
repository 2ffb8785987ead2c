"""Bayesian optimisation of a noisy level by BoTorch.

`Problem.evaluate` gives each design's value and its standard error.

    pip install "impact-absorber-workbench[examples]"
    python docs/examples/optimise_with_botorch.py

The Gaussian process knows the noise of every design, and noisy expected improvement chooses the
next batch.
"""

import sys
import warnings

import numpy as np
import torch
from botorch import fit_gpytorch_mll
from botorch.acquisition.logei import qLogNoisyExpectedImprovement
from botorch.models import SingleTaskGP
from botorch.models.transforms import Standardize
from botorch.optim import optimize_acqf
from gpytorch.mlls import ExactMarginalLogLikelihood

from impact_env import Beam
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.space import design_space

STEEL = Beam(
    length=1.2,
    bending_stiffness=358.4,
    mass_per_length=2.512,
    force_position=0.25,
    damping_ratio=0.005,
)
LEAST_ERROR = 0.01  # of the logarithm: what a few members' bootstrap may miss


def coordinates(problem: Problem, shares: np.ndarray) -> np.ndarray:
    """Return rows of coordinates at shares (0 to 1) of their ranges.

    Ranges in which ratios matter are divided on a logarithmic scale.
    """
    return np.array(
        [
            [v.value_at(float(x)) for v, x in zip(problem.space.free, row, strict=True)]
            for row in shares
        ]
    )


def proposed(shares: np.ndarray, F: np.ndarray, spread: np.ndarray, batch: int) -> np.ndarray:
    """Return the shares of the next batch from designs that were run; failed ones are left out."""
    known = np.isfinite(F[:, 0])
    x = torch.tensor(shares[known])
    y = -torch.tensor(np.log(F[known]))  # BoTorch maximises
    error = torch.tensor(np.maximum(np.nan_to_num(spread[known] / F[known]), LEAST_ERROR))
    model = SingleTaskGP(x, y, train_Yvar=error**2, outcome_transform=Standardize(m=1))
    fit_gpytorch_mll(ExactMarginalLogLikelihood(model.likelihood, model))
    bounds = torch.tensor([[0.0] * x.shape[1], [1.0] * x.shape[1]], dtype=torch.double)
    found, _ = optimize_acqf(
        qLogNoisyExpectedImprovement(model, x, prune_baseline=True),
        bounds,
        q=batch,
        num_restarts=4,
        raw_samples=64,
    )
    return found.numpy()


def main(
    first: int = 16, batches: int = 8, batch: int = 4, members: int = 4, rate: float | None = None
) -> float:
    """Search, judge the best design on fresh members, and return its level over no absorber."""
    warnings.filterwarnings("ignore", module="botorch|gpytorch|linear_operator")
    torch.manual_seed(0)
    problem = Problem(
        design_space("impact"), (Condition(1, 0.5),), beam=STEEL, members=members, rate=rate
    )
    shares = (
        torch.quasirandom.SobolEngine(len(problem.space.free), scramble=True, seed=0)
        .draw(first, dtype=torch.double)
        .numpy()
    )
    F, _, spread = problem.evaluate(coordinates(problem, shares))
    for number in range(batches):
        new = proposed(shares, F, spread, batch)
        values, _, errors = problem.evaluate(coordinates(problem, new))
        shares = np.vstack([shares, new])
        F = np.vstack([F, values])
        spread = np.vstack([spread, errors])
        print(
            f"batch {number + 1} of {batches}: best so far {100 * np.nanmin(F):.1f} % of no "
            "absorber"
        )
    finalists = coordinates(problem, shares[np.argsort(F[:, 0])[:4]])
    fresh, _, _ = problem.evaluate(finalists, problem.fresh_ensemble(4 * members, 0))
    best = finalists[np.nanargmin(fresh)]
    level, _, error = problem.evaluate(best, problem.fresh_ensemble(4 * members, 1))
    design = problem.space.decoded(
        dict(zip((v.name for v in problem.space.free), map(float, best), strict=True))
    )
    print(
        f"{design}\non fresh members: {100 * level[0, 0]:.1f} % (+- {100 * error[0, 0]:.1f}) "
        "of no absorber"
    )
    return float(level[0, 0])


if __name__ == "__main__":
    main(6, 1, 2, 2, rate=40.0) if "--quick" in sys.argv else main()
