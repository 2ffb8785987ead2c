"""The symmetric orbit with one impact a wall in closed form, its fold force over frequency, and maps of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.kernels.periodic.closed_form import closed_forms, fold_forces, fold_of, impulses_of, line_of, phase_of
from impact_env.periodic.case import Case
from impact_env.periodic.schedule import EventSchedule, flying_schedule

Array = NDArray[np.float64]


def symmetric_schedule(friction: bool) -> EventSchedule:
    """Return one impact on the lower wall in each half period, and its mirror image."""
    return flying_schedule([-1], friction, symmetric=True)


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """One branch of the closed form: ``impulse`` (N s) on the absorber at the lower wall and the force's ``phase`` (rad) there."""

    case: Case
    impulse: float
    phase: float

    @property
    def pushes(self) -> bool:
        """Whether the wall pushes: else it is no orbit."""
        return self.impulse > 0


def closed_form(case: Case) -> tuple[ClosedForm, ...]:
    """Return the branches with the smaller and the larger impulse, or none below the fold force. Friction is taken as one-signed between impacts.

    Whether the wall pushes, nothing is passed and nothing turns in between is not asked here: `impact_env.periodic.orbit` does.
    """
    line = line_of(case.structure, case.point)
    roots = impulses_of(line, case.force)
    return tuple(ClosedForm(case, p, phase_of(line, case.force, p)) for p in roots if np.isfinite(p))


def closed_form_branches(case: Case, omegas: ArrayLike) -> Array:
    """Return impulse (N s) and phase (rad) of both branches, (M, 4), at frequencies (M,) in rad/s; nan where there is no orbit."""
    at = np.ascontiguousarray(omegas, dtype=float)
    out = np.empty((len(at), 4))
    closed_forms(case.structure, case.point, at, out)
    return out


def fold_force(case: Case, omegas: ArrayLike) -> Array:
    """Return the smallest force (N), (M,), with a symmetric orbit at frequencies (M,) in rad/s, from the discriminant of the closed form."""
    return _fold_table(case, omegas)[:, 0]


def fold_impulse(case: Case) -> float:
    """Return the impulse (N s) at the fold of the case's frequency; the wall pulls, and there is no orbit, unless it is above 0."""
    return float(fold_of(line_of(case.structure, case.point))[1])


def _fold_table(case: Case, omegas: ArrayLike) -> Array:
    at = np.ascontiguousarray(omegas, dtype=float)
    out = np.empty((len(at), 2))
    fold_forces(case.structure, case.point, at, out)
    return out
