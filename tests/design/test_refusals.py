"""Design refuses wrong parameters.

A table has the calls, and the text that each message must contain: the parameter, its value or the
allowed values.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from core import STEEL
from design_studies import problem as study_problem
from design_studies import search_swept, settings

from impact_env import (
    Beam,
    Drive,
    ModalModel,
    ParameterError,
    Response,
    Scene,
    constant_frequency,
    friction_damper,
    modal_model,
    simulate,
)
from impact_env.ensemble import Lane, Threads
from impact_env.loads import Loads, Random, Shock
from impact_env.parameters import TunedAbsorber
from impact_env.periodic.stationary import cut_window
from optimisation.bounds import (
    common_gap,
    design_force,
    design_gap,
    resonance_limit,
    stroke_limit_rms,
)
from optimisation.bounds.relaxation import passive_limit
from optimisation.cli.design_options import load_conditions
from optimisation.comparison import compare
from optimisation.contact import estimate, material
from optimisation.gap_advice import check_gap
from optimisation.load_cases import AppliedLoads
from optimisation.measures import STROKE, impact_measures, of_motion
from optimisation.mounting import scene_on
from optimisation.objectives import Condition, Constraint, Objective
from optimisation.problem import Problem
from optimisation.report.sweep_report import SweepResult, draw_sweep, number_lines, sweep_numbers
from optimisation.report.tuning_report import tuning_table
from optimisation.search.settings import Rung, SearchSettings, default_settings
from optimisation.signals import SignalOptions, signal_measures
from optimisation.space import DesignSpace, design_space
from optimisation.tolerances import on_another_structure, require_parts, spreads
from optimisation.tuned import PAPER, minimax, peak, peaks

pytest.importorskip("cvxpy")
MODEL = modal_model(Beam())
TWO = modal_model(Beam(modes=2))
MASS = 0.02 * MODEL.beam_mass
GAP = 1e-3
FIRST = Condition(1, 3.5)
BOTH = (FIRST, Condition(2, 35.0))
NOISE = Loads((Random(np.array([[35.0, 0.5], [46.0, 0.5]]), 4.0, 1),), MODEL.omega[0])
SHOCK = Loads((Shock("half-sine", 20.0, 0.0125, 0.5),), MODEL.omega[0])


def problem(
    beam: Beam | ModalModel = TWO,
    space: DesignSpace | None = None,
    conditions: tuple[Condition, ...] = BOTH,
    **more: object,
) -> Problem:
    return Problem(
        **(
            {
                "space": space or design_space("impact"),
                "conditions": conditions,
                "beam": beam,
                "members": 3,
                "rate": 40.0,
            }
            | more
        )
    )


def under(loads: Loads, **more: object) -> Problem:
    return problem(MODEL, design_space("impact", ["gap"]), load_conditions(loads), **more)


def response() -> Response:
    """Return a short run that records its level only."""
    return simulate(Scene(TWO), Drive(1.0, constant_frequency(TWO.omega[0], 1.0, 4.0)))


def space(*arguments: object) -> Callable[[], DesignSpace]:
    return lambda: design_space(*arguments)


REFUSED: list[tuple[Callable[[], object], str]] = [
    # limits and the rule
    (lambda: stroke_limit_rms(MODEL, 0.0, GAP, 1.0, 250.0), "mass"),
    (lambda: stroke_limit_rms(MODEL, MASS, -GAP, 1.0, 250.0), "gap"),
    (lambda: stroke_limit_rms(MODEL, MASS, GAP, [1.0, -1.0], 250.0), "force_amplitude"),
    (lambda: stroke_limit_rms(MODEL, MASS, GAP, 1.0, -1.0), "omega"),
    (lambda: stroke_limit_rms(MODEL, [MASS, MASS], GAP, 1.0, 250.0), "mass"),
    (lambda: stroke_limit_rms(MODEL, MASS, GAP, 1.0, 250.0, [1.0]), "tip_shape"),
    (lambda: resonance_limit(MODEL, MASS, GAP, 1.0, 11), "resonance"),
    (lambda: resonance_limit(MODEL, MASS, GAP, 1.0, low=1.1), "high"),
    (lambda: common_gap(MODEL, MASS, {}), "forces"),
    (lambda: design_force(MODEL, MASS, GAP, low=0.98), "range"),
    (lambda: design_force(MODEL, 10 * MASS, GAP, low=0.93), "range"),
    (lambda: design_gap(MODEL, MASS, 0.0), "force"),
    (lambda: design_force(ModalModel([1.0], [0.01], [0.0], [1.0], 1.0), 0.01, GAP), "force_shape"),
    (lambda: passive_limit(modal_model(Beam(), [1.0, 0.5]), MASS, GAP, 1.0, 250.0), "one absorber"),
    # tunings
    (
        lambda: peak(MODEL, PAPER, low=0.9, high=1.06),
        (
            "scoring range (low, high) = (0.9, 1.06) is not allowed: a scoring range that holds "
            "both peaks"
        ),
    ),
    (
        lambda: minimax(MODEL, 0.25),
        "scoring range",
    ),  # a heavy absorber splits wider than the default range
    (lambda: peaks(MODEL, PAPER, high=1.06), "both peaks"),
    (lambda: tuning_table(MODEL, low=0.9, high=1.06), "both peaks"),
    (lambda: peaks(ModalModel([1.0], [0.0], [1.0], [1.0], 1.0), None), "damping_ratio"),
    # gaps and comparisons
    (lambda: check_gap(TWO, 3.5, absorber=friction_damper()), "rigid walls"),
    (lambda: check_gap(TWO, 3.5, factors=[0.5, 2.0]), "factors"),
    (lambda: search_swept(TWO, 6.0, tolerance=0.5), "force_tolerance"),
    (lambda: search_swept(TWO, 6.0, free=["mass"]), "free"),
    (
        lambda: AppliedLoads(ModalModel([250.0], [0.01], [0.0], [2.6], 0.5), NOISE).free_size,
        "moves the absorber",
    ),
    (lambda: compare(resonances=[True]), "resonances"),
    (lambda: compare(gap=True), "gap"),
    # spaces
    (space("spring"), "concept = 'spring' is not allowed"),
    (space("impact", ["gaps"]), "'gaps'"),
    (space("impact", ["gap", "gap"]), "once"),
    (space("impact", ["gap"], {"gap": (2e-3, 1e-3)}), "bounds of gap"),
    (space("impact", ["gap"], {"restitution": (0.1, 0.2)}), "free variables"),
    (space("impact", ["restitution"], {"restitution": (0.5, 1.5)}), "0 to 1"),
    (space("impact", ["position"], {"position": (0.5, 1.5)}), "absorber_position"),
    (space("friction", ["mass_ratio"], None, {"friction_limit": -1.0}), "friction limit"),
    (space("friction", ["mass_ratio"], None, {"mass_ratio": 0.01}), "not both"),
    (
        lambda: problem(STEEL).space.design(
            {"gap": 1.0, "restitution": 0.5, "friction_limit": 0.01}
        ),
        "gap = ",
    ),  # a metre
    # problems
    (lambda: Objective("beauty"), "objective = 'beauty'"),
    (lambda: Objective("nowhere:f"), "MODULE:FUNCTION"),
    (lambda: Objective(over="sum"), "worst, mean"),
    (lambda: Objective("range"), "limit of the relative level"),
    (lambda: Condition(1, -1.0), "force = -1.0"),
    (lambda: Condition(1, 1.0, (1.1, 0.9)), "limits of the sweep"),
    (lambda: Condition(1, 1.0, detuning=0.7), "detuning = 0.7"),
    (lambda: Constraint("noise", 1.0), "constraint = 'noise'"),
    (lambda: problem(conditions=()), "conditions"),
    (lambda: problem(conditions=(Condition(3, 1.0),)), "resonance = 3"),
    (lambda: problem(objectives=(Objective(resonance=4),)), "resonance of an objective"),
    (lambda: problem(objectives=(Objective("range", limit=0.3),)), "forces of the objective range"),
    (lambda: problem(constraints=(Constraint("stroke", 1.0), Constraint("stroke", 2.0))), "once"),
    (lambda: problem(space=design_space("tuned")), "holds both peaks"),
    (
        lambda: problem(space=design_space("impact", ["gap", "position"])),
        "left out on a modal model with one place",
    ),
    (
        lambda: problem(space=design_space("several")),
        "position_2 = 'free' is not allowed: left out on a modal model with one place",
    ),
    (
        lambda: problem(objectives=(Objective("damage"),)),
        "for a beam that is clamped at its left end, or a modal model",
    ),
    (
        lambda: scene_on(TWO, design_space("several").default.absorber()),
        "absorber_shapes of the modal model = 0 is not allowed",
    ),
    (
        lambda: problem(MODEL, conditions=(*load_conditions(NOISE), FIRST)),
        "loads in all of them, or in none",
    ),
    (lambda: under(SHOCK, objectives=(Objective("absolute"),)), "another under shocks"),
    (lambda: under(NOISE, uncertain={"gap": (0.9e-3, 1.1e-3)}), "left out under loads"),
    (lambda: problem(uncertain={"gap": (1e-3, 2e-3)}), "is not allowed: in %"),
    (
        lambda: problem(conditions=(FIRST, Condition(1, 5.0)), uncertain={"force": (3, 4)}),
        "uncertain force",
    ),
    # searches
    (lambda: default_settings(study_problem(), "annealing"), "sampler = 'annealing'"),
    (lambda: default_settings(study_problem(2), "cma"), "nsga2"),
    (
        lambda: default_settings(study_problem(space=design_space("impact", ["gap"])), "cma"),
        "two or more",
    ),
    (lambda: default_settings(study_problem(), batch=1), "batch = 1"),
    (lambda: Rung(0), "members of a rung"),
    (lambda: SearchSettings("cma", 4, (Rung(4, 2.0),)).check(study_problem()), "own sweep rate"),
    (
        lambda: SearchSettings("cma", 4, (Rung(3),)).check(study_problem()),
        "members of the last rung = 3",
    ),
    (
        lambda: SearchSettings("random", 4, (Rung(1), Rung(4))).check(study_problem(2)),
        "several objectives",
    ),
    (lambda: settings().whole_batches(0), "designs = 0"),
    (lambda: Threads(0), "threads = 0"),
    # what is uncertain, and materials
    *(
        (
            lambda name=name: (
                spreads({name: "5%"}) and require_parts(spreads({name: "5%"}), TunedAbsorber())
            ),
            f"uncertain {name}",
        )
        for name in ("gap", "friction")
    ),
    (lambda: spreads({"colour": "5%"}), "uncertain = 'colour'"),
    (lambda: spreads({"gap": "5"}), "uncertain gap = '5' is not allowed: a standard deviation"),
    (
        lambda: spreads({"gap": "40%"}),
        "uncertain gap = '40%' is not allowed: above 0 and at most 33.3%",
    ),
    (lambda: spreads({"gap": (2, 1)}), "the lower one first"),
    (lambda: spreads({"gap": ("1%", 2)}), "both in %"),
    (lambda: spreads({"gap": (1, 2, 3)}), "two numbers"),
    (lambda: spreads({"restitution": (0.5, 1.5)}), "at most 1"),
    *(
        (lambda name=name: material(name), "is not allowed: one of steel, aluminium")
        for name in ("wood", "1e9", "-1:0.3", "1e9:0.7", "a:b")
    ),
    (lambda: estimate("steel", "steel", 0.0, 1.0, 1.0), "radius"),
    (lambda: on_another_structure(Lane(Scene(TWO), NOISE), 1.1, 1.0), "one force"),
    # responses that lack what is read from them
    (lambda: impact_measures(response()), "impacts = None is not allowed: recorded: simulate(..."),
    (lambda: of_motion(STROKE, response()), "history = None"),
    (lambda: signal_measures(response(), SignalOptions(8, False, None)), "history = None"),
    (lambda: draw_sweep("", response(), 1), "history = None"),
    (lambda: number_lines(SweepResult(replace(response(), level=None), None, 1)), "level = None"),
    (lambda: sweep_numbers(SweepResult(response(), None, 1)), "impacts = None"),
    (lambda: cut_window(Scene(TWO), response(), 250.0), "history = None"),
]


@pytest.mark.parametrize(("call", "words"), REFUSED, ids=[words for _, words in REFUSED])
def test_what_is_not_allowed_is_named(call: Callable[[], object], words: str) -> None:
    with pytest.raises(ParameterError) as raised:
        call()
    assert words in str(raised.value)
