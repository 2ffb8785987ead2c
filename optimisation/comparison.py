"""The main study: absorber concepts compared over the force, near two resonances (paper, section 6 and its last figure).

All concepts have the same mass. The impact absorber and the friction damper have the paper's parameters, the linear tuned absorber
(LTVA) has them too and stands beside a well-tuned one, since the paper's is mistuned (see `optimisation.tuned`). A well-tuned LTVA
splits the resonance into two peaks that lie outside the paper's sweep, so both LTVAs are also swept over the wide range in which
they are tuned: only there is the comparison a fair one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impact_env.curve import DEFAULT_MEMBERS, CurveCase, PerformanceCurve, performance_curves
from impact_env.drive import PAPER_LIMITS
from impact_env.ensemble import Executor, Progress
from impact_env.methods import Method
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import DEFAULT_MASS_RATIO, Absorber, Beam, RigidWalls, TunedAbsorber, count, friction_damper, impact_absorber
from impact_env.scene import Scene
from optimisation.bounds import design_force, resonance_limit
from optimisation.sweep_rate import default_rate, stationary_level
from optimisation.tuned import HIGH, LOW, minimax

Array = NDArray[np.float64]
WIDE_LIMITS = (LOW, HIGH)
DEFAULT_FORCES = 24
RESONANCES = (1, 2)
# range of forces over the design force of the resonance: from where no wall is reached to where the absorber is almost an added mass
FORCE_SPAN = (0.06, 5.0)
# four in ten forces lie this close around the design force, where the optimum is
OPTIMUM_SPAN = (0.5, 1.6)


@dataclass(frozen=True)
class Concept:
    """An absorber under comparison: a short ``key`` for files, a ``label`` for people, and the sweep's limits over the resonance."""

    key: str
    label: str
    absorber: Absorber | None
    limits: tuple[float, float] = PAPER_LIMITS


NONE, IMPACT, FRICTION = "none", "impact", "friction"
LTVA_PAPER, LTVA_TUNED = "ltva_paper", "ltva_tuned"
LTVA_PAPER_WIDE, LTVA_TUNED_WIDE = "ltva_paper_wide", "ltva_tuned_wide"


def concepts(model: ModalModel) -> tuple[Concept, ...]:
    """Return the concepts with the paper's parameters; the well-tuned LTVA is tuned to the first resonance of ``model``."""
    paper, tuned = TunedAbsorber(), minimax(model)
    wide = f"swept {LOW:g} to {HIGH:g}"
    return (
        Concept(NONE, "no absorber", None),
        Concept(IMPACT, "impact absorber", impact_absorber(restitution=0.7, friction_limit=0.1)),
        Concept(FRICTION, "friction damper", friction_damper()),
        Concept(LTVA_PAPER, "LTVA, paper's values", paper),
        Concept(LTVA_TUNED, "LTVA, well tuned", tuned),
        Concept(LTVA_PAPER_WIDE, f"LTVA, paper's values, {wide}", paper, WIDE_LIMITS),
        Concept(LTVA_TUNED_WIDE, f"LTVA, well tuned, {wide}", tuned, WIDE_LIMITS),
    )


@dataclass(frozen=True, eq=False)
class ResonanceComparison:
    """Curves near one resonance, by the concepts' keys. ``forces`` (F,) in N, ``design_force`` in N."""

    model: ModalModel
    resonance: int
    forces: Array
    curves: dict[str, PerformanceCurve]
    design_force: float

    @property
    def omega(self) -> float:
        """Resonance frequency of the free beam in rad/s."""
        return self.model.resonance_omega(self.resonance)

    def limit_at(self, forces: Array) -> Array:
        """Return the limit in m at forces in N: no device of this mass and gap has a smaller stationary maximum (`optimisation.bounds`)."""
        return resonance_limit(self.model, DEFAULT_MASS_RATIO * self.model.beam_mass, RigidWalls.gap, forces, self.resonance)

    @cached_property
    def limit(self) -> Array:
        """The limit in m at the curves' forces, (F,)."""
        return self.limit_at(self.forces)

    @property
    def sweep_ratio(self) -> float:
        """Level of the sweeps without absorber over the stationary one; NaN if nothing is finished."""
        none = self.curves[NONE]
        return float(none.median[0] / self.forces[0]) / stationary_level(self.model, self.resonance)

    @property
    def best(self) -> int | None:
        """Index of the impact absorber's best force, relative to no absorber; None if nothing is finished."""
        optimum = self.curves[IMPACT].optimum(self.curves[NONE])
        return None if optimum is None else int(np.flatnonzero(self.forces == optimum.force)[0])


@dataclass(frozen=True, eq=False)
class Comparison:
    """The whole study."""

    model: ModalModel
    concepts: tuple[Concept, ...]
    resonances: tuple[ResonanceComparison, ...]
    members: int
    seed: int
    percent_per_100_periods: float

    @property
    def complete(self) -> bool:
        """Whether all runs were made."""
        return all(curve.complete for resonance in self.resonances for curve in resonance.curves.values())


def force_grid(design: float, forces: int = DEFAULT_FORCES) -> Array:
    """Return rising forces in N, (forces,), over `FORCE_SPAN` times the design force (N), denser around it; at least 2."""
    count("forces", forces, 2)
    marks = np.log([FORCE_SPAN[0], OPTIMUM_SPAN[0], OPTIMUM_SPAN[1], FORCE_SPAN[1]])
    return np.asarray(design * np.exp(np.interp(np.linspace(0, 1, forces), [0, 0.4, 0.8, 1], marks)))


def compare(
    beam: Beam | None = None,
    *,
    forces: int = DEFAULT_FORCES,
    members: int = DEFAULT_MEMBERS,
    seed: int = 0,
    percent_per_100_periods: float | None = None,
    method: Method | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> Comparison:
    """Compute all curves near both resonances; arguments and interruption as in `performance_curves`, a rate of None is `default_rate`."""
    model = modal_model(Beam() if beam is None else beam)
    rate = default_rate(model, RESONANCES) if percent_per_100_periods is None else percent_per_100_periods
    compared = concepts(model)
    scenes = [Scene(model, concept.absorber) for concept in compared]
    mass, gap = DEFAULT_MASS_RATIO * model.beam_mass, RigidWalls.gap
    design = [design_force(model, mass, gap, resonance) for resonance in RESONANCES]
    grids = [force_grid(f, forces) for f in design]
    cases = [
        CurveCase(scene, grid, resonance, concept.limits, rate)
        for resonance, grid in zip(RESONANCES, grids, strict=True)
        for concept, scene in zip(compared, scenes, strict=True)
    ]
    curves = iter(performance_curves(cases, members, seed, method, threads=threads, progress=progress, executor=executor))
    parts = tuple(
        ResonanceComparison(model, resonance, grid, {concept.key: next(curves) for concept in compared}, f)
        for resonance, grid, f in zip(RESONANCES, grids, design, strict=True)
    )
    return Comparison(model, compared, parts, members, seed, rate)
