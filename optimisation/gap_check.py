"""The design rule put to the test: response levels at the rule's gap and at its neighbours, by simulation of an ensemble."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impact_env.curve import DEFAULT_MEMBERS, CurveCase, PerformanceCurve, performance_curves
from impact_env.drive import default_rate
from impact_env.ensemble import Executor, LaneProgress
from impact_env.modes import ModalModel
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    RigidWalls,
    SlidingAbsorber,
    count,
    impact_absorber,
    instance,
    require,
)
from impact_env.scene import Scene
from optimisation.bounds import (
    design_gap,
    gap_unit,
    reach,
    resonance_limit,
    share_reached,
)
from optimisation.extremes import (
    LEAST_RATIO,
    stationary_level,
    usable_force,
    usable_mass_ratio,
    usable_rate,
)
from optimisation.friction_rule import scaled_friction
from optimisation.sweep_range import find_sweep_range

Array = NDArray[np.float64]

RESTITUTION = 0.7  # of the paper's best absorber
SPAN = 2.5  # gaps reach from the rule's over this to the rule's times this


@dataclass(frozen=True, eq=False)
class GapCheck:
    """Levels over the gap at one force. ``gaps`` (G,) in m, rising; ``rule`` in m is one of them; ``limits`` of the sweep over omega_r.

    ``reach`` is `optimisation.bounds.reach`, ``rate`` that of the sweeps in % of the resonance per 100 pseudo periods.
    ``curves`` has one performance curve for each gap, ``without`` is that of the beam without absorber; each is at the one force (N).
    """

    model: ModalModel
    resonance: int
    force: float
    absorber: SlidingAbsorber
    rule: float
    gaps: Array
    limits: tuple[float, float]
    curves: tuple[PerformanceCurve, ...]
    without: PerformanceCurve
    reach: float
    rate: float

    @property
    def sweep_ratio(self) -> float:
        """Level of the sweeps without absorber over the stationary one; NaN where nothing is finished. Below `LEAST_RATIO` shares are left out."""
        return float(self.without.median[0]) / (
            self.force * stationary_level(self.model, self.resonance, self.limits)
        )

    @property
    def mass(self) -> float:
        """Absorber mass in kg."""
        return self.absorber.mass_ratio * self.model.beam_mass

    @property
    def complete(self) -> bool:
        """Whether all runs were made."""
        return self.without.complete and all(curve.complete for curve in self.curves)

    @property
    def level(self) -> Array:
        """Median level in m at each gap, (G,); NaN where nothing is finished."""
        return np.array([curve.median[0] for curve in self.curves])

    @property
    def band(self) -> Array:
        """5 and 95 % quantiles of the level in m, (2, G)."""
        return np.array([curve.band[:, 0] for curve in self.curves]).reshape(-1, 2).T

    @property
    def relative(self) -> Array:
        """Median level over that without absorber, (G,)."""
        return np.asarray(self.level / self.without.median[0])

    @cached_property
    def limit(self) -> Array:
        """Limit in m of the stationary level over the sweep's range at each gap, (G,)."""
        return np.array([float(self.limit_at(gap)) for gap in self.gaps])

    def limit_at(self, gap: float) -> float:
        """Return the limit in m for a gap in m."""
        return float(
            resonance_limit(self.model, self.mass, gap, self.force, self.resonance, *self.limits)
        )

    @property
    def out_of_reach(self) -> NDArray[np.bool_]:
        """Gaps whose limit is not below the stationary level without absorber, (G,): the response is near a node of the resonance."""
        without = self.force * stationary_level(self.model, self.resonance, self.limits)
        return np.asarray(self.limit >= without)

    @cached_property
    def share(self) -> Array:
        """Share of the possible reduction that each gap reached, (G,).

        NaN where nothing is finished or nothing is possible (`out_of_reach`), and all NaN for sweeps too fast to tell.
        """
        shares = np.full(len(self.gaps), np.nan)
        if not self.sweep_ratio >= LEAST_RATIO:
            return shares
        for k in np.flatnonzero(~np.isnan(self.level) & ~self.out_of_reach):
            shares[k] = share_reached(
                self.model,
                self.mass,
                float(self.gaps[k]),
                self.force,
                self.level[k],
                self.resonance,
                *self.limits,
            )
        return shares

    @property
    def at_rule(self) -> int:
        """Index of the rule's gap."""
        return int(np.argmin(np.abs(self.gaps - self.rule)))

    @property
    def best(self) -> int | None:
        """Index of the gap with the smallest median level, None if nothing is finished."""
        return None if np.isnan(self.level).all() else int(np.nanargmin(self.level))


FACTORS = "an odd number, 3 or more (the rule's gap is the middle one)"
MOST_GAPS = 1001  # a curve is simulated for each


def gap_factors(number: int) -> Array:
    """Return an odd number of factors of the rule's gap, geometric, 1 in the middle."""
    number = count("gaps", number, 3, MOST_GAPS, FACTORS)
    require(number % 2 == 1, "gaps", number, FACTORS)
    half = np.geomspace(1, SPAN, number // 2 + 1)
    return np.concatenate([1 / half[:0:-1], half])


def scaled_absorber(
    model: ModalModel,
    force: float,
    resonance: int = 1,
    mass_ratio: float = DEFAULT_MASS_RATIO,
    restitution: float = RESTITUTION,
) -> SlidingAbsorber:
    """Return an impact absorber with the rule's gap for a force in N, and the paper's friction by the scaling law (`scaled_friction`)."""
    model = instance("model", model, ModalModel)
    mass = usable_mass_ratio("mass_ratio", mass_ratio) * model.beam_mass
    friction = scaled_friction(model, mass, gap_unit(model, mass, force, resonance))
    return impact_absorber(
        design_gap(model, mass, force, resonance), restitution, friction, mass_ratio
    )


def rigid_walls(absorber: SlidingAbsorber) -> RigidWalls:
    """Return an absorber's rigid walls; raises ParameterError for one that has none."""
    absorber = instance("absorber", absorber, SlidingAbsorber)
    if not isinstance(absorber.walls, RigidWalls):
        require(
            False, "absorber", absorber, "one with rigid walls, since the rule is about their gap"
        )
        raise AssertionError
    return absorber.walls


def check_gap(
    model: ModalModel,
    force: float,
    resonance: int = 1,
    absorber: SlidingAbsorber | None = None,
    *,
    factors: Sequence[float] | Array | None = None,
    members: int = DEFAULT_MEMBERS,
    seed: int = 0,
    percent_per_100_periods: float | None = None,
    threads: int | None = None,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> GapCheck:
    """Simulate sweeps up and down at one force (N) for gaps around the rule's.

    ``absorber`` gives mass, restitution and friction (default: `scaled_absorber`); its gap is replaced. ``factors`` of the rule's gap must
    contain 1. ``percent_per_100_periods``: None is `default_rate`. Interruption and the other arguments as in `performance_curves`.
    Raises ParameterError for numbers out of range, and for an absorber without rigid walls.
    """
    force = usable_force("force", force)
    rate = (
        default_rate(model, (resonance,))
        if percent_per_100_periods is None
        else percent_per_100_periods
    )
    absorber = scaled_absorber(model, force, resonance) if absorber is None else absorber
    walls = rigid_walls(absorber)
    mass = absorber.mass_ratio * model.beam_mass
    free_over_rule = reach(model, mass, resonance)
    rule = design_gap(model, mass, force, resonance)
    limits = find_sweep_range(model, absorber.mass_ratio, resonance)
    multiples = np.sort(
        np.asarray(gap_factors(11) if factors is None else factors, dtype=np.float64)
    )
    require(
        bool(np.all(multiples > 0)) and 1.0 in multiples,
        "factors",
        factors,
        "numbers above 0, one of them 1",
    )
    scenes = [
        Scene(model, replace(absorber, walls=replace(walls, gap=float(rule * factor))))
        for factor in multiples
    ]
    rate = usable_rate("rate", rate, [limits])
    cases = [
        CurveCase(scene, np.array([force]), resonance, limits, rate, steady_start=True)
        for scene in [Scene(model), *scenes]
    ]
    without, *curves = performance_curves(
        cases, members, seed, threads=threads, progress=progress, executor=executor
    )
    return GapCheck(
        model,
        resonance,
        force,
        absorber,
        rule,
        rule * multiples,
        limits,
        tuple(curves),
        without,
        free_over_rule,
        rate,
    )
