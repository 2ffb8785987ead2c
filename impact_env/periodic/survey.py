"""All symmetric two-impact orbits of a case at a frequency or over a range: from the closed form, and along the branches that it leads to."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import require
from impact_env.periodic.case import Case
from impact_env.periodic.corrector import NoConvergenceError
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.orbit import Orbit, mirrored, orbit_at
from impact_env.periodic.starts import MOST_MULTIPLE, SETTLE, initial_of, least_multiple, orbit_of_simulation
from impact_env.periodic.symmetric import closed_form, symmetric_schedule
from impact_env.periodic.tracing import OrbitBranch, orbit_branch
from impact_env.scene import InitialState

Array = NDArray[np.float64]
SAME = 1e-7  # rad and units of impulse: two orbits closer than this are one
FAINTEST = 1e-5  # units of impulse: bounces below are not compared
NUDGE = 1e-3  # of gap times omega: a disturbance that a run starts with beside an orbit
Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Found:
    """What a search found at one frequency: confirmed ``orbits``, and ``refused`` solutions with the reason why they are none."""

    case: Case
    orbits: tuple[Orbit, ...]
    refused: tuple[NoOrbit, ...]


def closed_form_orbits(case: Case) -> Found:
    """Return the orbits that start from the closed form's branches where the wall pushes, their reversals mended."""
    schedule = symmetric_schedule(case.friction_limit > 0)
    orbits: list[Orbit] = []
    refused: list[NoOrbit] = []
    for branch in closed_form(case):
        if branch.pushes:
            found = orbit_at(case, schedule, np.array([branch.phase, branch.impulse / case.scale.impulse]))
            if isinstance(found, NoOrbit):
                refused.append(found)
            else:
                orbits.append(found)
    return Found(case, tuple(different(orbits)), tuple(refused))


def different(orbits: Iterable[Orbit]) -> list[Orbit]:
    """Return orbits of one case without those that are in the list already, the larger response first."""
    kept: list[Orbit] = []
    for orbit in orbits:
        if not any(same(orbit, other) for other in kept):
            kept.append(orbit)
    return sorted(kept, key=lambda orbit: -orbit.motion.tip_max)


def same(one: Orbit, other: Orbit) -> bool:
    """Return whether two orbits of one case are the same, whatever their schedules are counted from.

    The faintest bounces of a chatter do not count. Orbits without impacts are told by their states.
    """
    unit = one.case.scale.impulse
    a, b = ([impact for impact in orbit.impacts if abs(impact.impulse) > FAINTEST * unit] for orbit in (one, other))
    if len(a) != len(b) or one.schedule.period_multiple != other.schedule.period_multiple:
        return False
    if len(a) == 0:
        return abs(one.motion.tip_max / other.motion.tip_max - 1) < SAME and abs(one.motion.tip_rms / other.motion.tip_rms - 1) < SAME
    whole = 2 * np.pi * one.schedule.period_multiple
    shifts = {2 * np.pi * k for k in range(one.schedule.period_multiple)}
    for shift in shifts:
        moved = sorted(((impact.phase + shift) % whole, impact.impulse) for impact in a)
        if all(abs(p - y.phase) < SAME and abs(i - y.impulse) < SAME * unit for (p, i), y in zip(moved, b, strict=True)):
            return True
    return False


def branches_from(found: Iterable[Found], low: float, high: float) -> Iterator[OrbitBranch]:
    """Yield the branches in frequency (rad/s) through the orbits found that lie on no branch before."""
    known: list[OrbitBranch] = []
    for group in found:
        for orbit in group.orbits:
            if not orbit.schedule.flies or any(lies_on(orbit, branch) for branch in known):
                continue  # one with a joined phase lies between two numbers of reversals, on a branch through its neighbours
            try:
                known.append(orbit_branch(orbit.solution, "omega", (low, high)))
            except NoConvergenceError:
                continue
            yield known[-1]


def crossings(branch: OrbitBranch, omega: float) -> Iterator[Orbit | NoOrbit]:
    """Yield the orbits of a branch in frequency at ``omega`` (rad/s), or why a solution there is none."""
    values = branch.branch.parameters
    for k in np.flatnonzero((values[:-1] - omega) * (values[1:] - omega) <= 0):
        if values[k] == values[k + 1]:
            continue
        near = int(k if abs(values[k] - omega) <= abs(values[k + 1] - omega) else k + 1)
        z = np.array(branch.branch.points[near])
        if branch.schedules[k] == branch.schedules[k + 1]:
            share = (omega - values[k]) / (values[k + 1] - values[k])
            z = branch.branch.points[k] + share * (branch.branch.points[k + 1] - branch.branch.points[k])
        yield orbit_at(branch.case.changed(omega=omega), branch.schedules[near], z)


def lies_on(orbit: Orbit, branch: OrbitBranch) -> bool:
    """Return whether an orbit is one of a branch in frequency."""
    return any(isinstance(other, Orbit) and same(orbit, other) for other in crossings(branch, orbit.case.omega))


def closed_form_over(case: Case, ratios: Array, progress: Progress | None = None) -> list[Found]:
    """Return `closed_form_orbits` at each of rising frequency ``ratios`` (M,); ``progress`` is told how many are done."""
    require(len(ratios) > 0 and bool(np.all(np.diff(ratios) > 0)), "ratios", ratios, "one or more frequency ratios, rising")
    first, found = float(case.model.omega[0]), []
    for k, ratio in enumerate(ratios, 1):
        found.append(closed_form_orbits(case.changed(omega=float(ratio) * first)))
        if progress is not None:
            progress(k, len(ratios))
    return found


def joined_by(group: Found, branches: Iterable[OrbitBranch]) -> Found:
    """Return what was found at a frequency together with the orbits of branches there, and their mirror images where they have no symmetry."""
    more = [orbit for branch in branches for orbit in crossings(branch, group.case.omega)]
    good = [orbit for orbit in more if isinstance(orbit, Orbit) and least_multiple(orbit) == orbit.schedule.period_multiple]
    images = [orbit for one in good if not one.schedule.symmetric and isinstance(orbit := mirrored(one), Orbit)]
    refused = tuple(orbit for orbit in more if isinstance(orbit, NoOrbit)) if more else group.refused
    return Found(group.case, tuple(different([*group.orbits, *good, *images])), refused)


def orbits_over(case: Case, ratios: Array, progress: Progress | None = None) -> Iterator[Found]:
    """Yield the symmetric two-impact orbits of a case at each of rising frequency ``ratios`` (M,).

    Without friction the closed form has them all. With friction its starts miss some, so branches are followed between the first and the last ratio,
    through every orbit found; ``progress`` is told how many frequencies are done.
    """
    found = closed_form_over(case, ratios, progress)
    if case.friction_limit == 0 or len(ratios) < 2:
        yield from found
        return
    first = float(case.model.omega[0])
    branches = list(branches_from(found, float(ratios[0]) * first, float(ratios[-1]) * first))
    yield from (joined_by(group, branches) for group in found)


def attractors(case: Case, near: Iterable[Orbit], settle: float = SETTLE, most_multiple: int = MOST_MULTIPLE) -> Iterator[Orbit | NoOrbit]:
    """Yield what runs settle to: one from rest, and one from beside each unstable orbit in ``near``; with the mirror image where it differs.

    A symmetric orbit that loses its symmetry so leads to the pair of orbits that took over from it. See `orbit_of_simulation`.
    """
    starts: list[tuple[InitialState | None, float]] = [(None, 0.0)]
    for orbit in near:
        if not orbit.stability.stable:
            phase, state = orbit.motion.mid_flight()
            state[-1] += NUDGE * case.gap * case.omega
            starts.append((initial_of(case, state), phase))
    for initial, phase in starts:
        found = orbit_of_simulation(case, settle, most_multiple, initial, phase)
        yield found
        if isinstance(found, Orbit) and not found.schedule.symmetric:
            yield mirrored(found)
