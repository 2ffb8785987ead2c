"""A front of level against impact severity by pymoo's NSGA-II.

`Problem.evaluate` takes a population and gives its F and G.

pip install "impact-absorber-workbench[examples]"
python docs/examples/optimise_with_pymoo.py
"""

import sys

import numpy as np
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.core.problem import Problem as PymooProblem
from pymoo.optimize import minimize

from impact_env import Beam
from optimisation.objectives import Condition, Constraint, Objective
from optimisation.problem import Problem
from optimisation.space import design_space

# a steel strip of 40 x 8 mm and 1.2 m, shaken at a quarter of its length: not the paper's beam
STEEL = Beam(
    length=1.2,
    bending_stiffness=358.4,
    mass_per_length=2.512,
    force_position=0.25,
    damping_ratio=0.005,
)
FAILED = 1e3  # pymoo knows no NaN: what a design costs that failed


class Absorber(PymooProblem):
    """The workbench's problem in pymoo's words."""

    def __init__(self, problem: Problem) -> None:
        # ratios matter, not differences
        low = np.log(problem.space.low)
        high = np.log(problem.space.high)
        super().__init__(
            n_var=len(low),
            n_obj=len(problem.objectives),
            n_ieq_constr=len(problem.constraints),
            xl=low,
            xu=high,
        )
        self.problem = problem

    def _evaluate(self, x, out, *_args, **_kwargs):
        F, G, _ = self.problem.evaluate(np.exp(x))
        out["F"], out["G"] = np.nan_to_num(F, nan=FAILED), np.nan_to_num(G, nan=FAILED)


def main(
    population: int = 16, generations: int = 10, members: int = 4, rate: float | None = None
) -> np.ndarray:
    """Search, judge the front on fresh members, and return its (level, W) rows."""
    problem = Problem(
        design_space("impact", ["gap", "friction_limit"]),
        (Condition(1, 0.5),),
        objectives=(Objective(), Objective("severity")),
        constraints=(Constraint("impact_speed", 0.5),),
        beam=STEEL,
        members=members,
        rate=rate,
    )
    result = minimize(Absorber(problem), NSGA2(pop_size=population), ("n_gen", generations), seed=1)
    X = np.exp(np.atleast_2d(result.X))
    fresh, _, spread = problem.evaluate(X, problem.fresh_ensemble(4 * members, 0))
    for x, (level, power), (error, _) in sorted(
        zip(X, fresh, spread, strict=True), key=lambda row: row[1][0]
    ):
        values = problem.space.decoded(
            dict(zip(("gap", "friction_limit"), map(float, x), strict=True))
        ).values
        design = (
            f"gap {1e3 * values['gap']:.3g} mm, friction {1e3 * values['friction_limit']:.3g} mN"
        )
        print(
            f"{design}: level {100 * level:.1f} % (+- {100 * error:.1f}) of no absorber, "
            f"{1e3 * power:.3g} mW lost in impacts"
        )
    return fresh


if __name__ == "__main__":
    main(8, 2, 2, rate=40.0) if "--quick" in sys.argv else main()
