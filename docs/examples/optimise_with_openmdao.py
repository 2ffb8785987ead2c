"""An impact absorber as a component of OpenMDAO.

The model is a small structure whose thickness is chosen together with the absorber.

pip install "impact-absorber-workbench[examples]"
python docs/examples/optimise_with_openmdao.py
"""

import sys

import numpy as np
import openmdao.api as om

from impact_env import Beam
from optimisation.objectives import Condition, Constraint, Objective
from optimisation.problem import Problem
from optimisation.space import design_space

WIDTH = 0.04  # m
DENSITY = 7850.0  # kg/m^3
MODULUS = 210e9  # N/m^2
FORCE = 0.5  # N
LARGEST_SPEED = 0.5  # m/s, of an impact


def steel_strip(thickness: float) -> Beam:
    """Return a steel strip of 1.2 m that is forced at a quarter of its length.

    ``thickness`` is in m.
    """
    return Beam(
        length=1.2,
        bending_stiffness=MODULUS * WIDTH * thickness**3 / 12,
        mass_per_length=DENSITY * WIDTH * thickness,
        force_position=0.25,
        damping_ratio=0.005,
    )


class ImpactAbsorber(om.ExplicitComponent):
    """Median level and impact speed of a structure with an impact absorber over several runs.

    Inputs: thickness of the strip (m), gap over the design rule's, friction limit over absorber
    mass times gap times frequency squared. Outputs: level over that without absorber, and impact
    speed over its limit less 1 (0 or below: kept). The ensemble is the same at every evaluation, so
    that the outputs are functions of the inputs; they are not smooth, so no derivatives are
    declared.
    """

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("members", 4, desc="runs of the ensemble")
        self.options.declare("rate", None, desc="sweep rate in % per 100 periods")

    def setup(self) -> None:
        """Add inputs and outputs."""
        self.add_input("thickness", 0.008, units="m")
        self.add_input("gap", 1.0)
        self.add_input("friction", 0.05)
        self.add_output("level", 1.0)
        self.add_output("speed_margin", 0.0)

    def compute(self, inputs, outputs):
        """Run the ensemble of one design."""
        problem = Problem(
            design_space("impact", ["gap", "friction_limit"]),
            (Condition(1, FORCE),),
            objectives=(Objective(),),
            constraints=(Constraint("impact_speed", LARGEST_SPEED),),
            beam=steel_strip(float(inputs["thickness"][0])),
            members=self.options["members"],
            rate=self.options["rate"],
        )
        point = np.array([float(inputs["gap"][0]), float(inputs["friction"][0])])
        F, G, _ = problem.evaluate(np.clip(point, problem.space.low, problem.space.high)[None, :])
        if not np.all(np.isfinite(F)):
            raise om.AnalysisError("the runs of this design broke down")
        outputs["level"] = F[0, 0]
        outputs["speed_margin"] = G[0, 0]


def main(evaluations: int = 60, members: int = 4, rate: float | None = None) -> float:
    """Minimise level plus a price of mass under a limit of the impact speed; return the level."""
    model = om.Group()
    options = {"members": members, "rate": rate}
    model.add_subsystem("absorber", ImpactAbsorber(**options), promotes=["*"])
    cost = om.ExecComp("cost = level + 20 * thickness", thickness={"units": "m", "val": 0.008})
    model.add_subsystem("cost_of_both", cost, promotes=["*"])
    model.set_input_defaults("thickness", 0.008, units="m")
    # a derivative-free method: the response over the gap has steps
    driver = om.ScipyOptimizeDriver(optimizer="COBYLA", maxiter=evaluations, disp=False)
    problem = om.Problem(model, driver)
    model.add_design_var("thickness", lower=0.006, upper=0.012, units="m", ref=0.01)
    model.add_design_var("gap", lower=0.5, upper=2.0)
    model.add_design_var("friction", lower=0.01, upper=0.3, ref=0.1)
    model.add_constraint("speed_margin", upper=0.0)
    model.add_objective("cost")
    problem.setup()
    problem.run_driver()
    level = float(problem.get_val("level")[0])
    print(
        f"thickness {problem.get_val('thickness', units='mm')[0]:.3g} mm, "
        f"gap {problem.get_val('gap')[0]:.3g} times the rule's, friction "
        f"{problem.get_val('friction')[0]:.3g}: "
        f"level {100 * level:.1f} % of no absorber, impact speed "
        f"{LARGEST_SPEED * (1 + problem.get_val('speed_margin')[0]):.3g} m/s"
    )
    return level


if __name__ == "__main__":
    main(6, 2, rate=40.0) if "--quick" in sys.argv else main()
