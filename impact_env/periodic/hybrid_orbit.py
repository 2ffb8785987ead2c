"""Periodic orbits with any contact.

Orbits are found by shooting with the exact map, confirmed, and their stability is given by Floquet
multipliers.

The unknown is the state at a section: a phase of the force at which no absorber touches a wall.
With elastic friction the slider's spring has no force at the section, as at the start of runs, and
the section's phase is a further unknown.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import count, finite, require
from impact_env.periodic.hybrid_case import HybridCase
from impact_env.periodic.hybrid_flow import LinearPiece, relative_rows
from impact_env.periodic.hybrid_trajectory import (
    CONTACT,
    IMPACT,
    HybridEvent,
    HybridTrajectory,
    follow_hybrid,
    piece_lengths,
    record_of,
)
from impact_env.periodic.motion import piece_extremes
from impact_env.periodic.passage import TrajectoryError
from impact_env.periodic.schedule import count_turns
from impact_env.periodic.shooting import (
    CLOSING_TOL,
    MOST_HALVINGS,
    MOST_SHOOTING_STEPS,
    NEUTRAL_TOL,
    SUFFICIENT_TOL,
)
from impact_env.plain import from_scene, to_scene
from impact_env.scene import InitialState
from impact_env.sweep import simulate

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
HYBRID_RESIDUAL_BAR = 1e-9  # of the units: how closely the exact method must come back
SETTLING_PERIODS = 400
MOST_MULTIPLE = 8
RETURN_TOL = 1e-3  # of the units: a run that comes back as close as this is taken for periodic
SAME_ORBIT_TOL = 1e-7  # of displacements and impulses: two orbits closer than this are one
SLIDER_PERIODS = 40  # of the force: after them nothing is left of a disturbance of the slider


@dataclass(frozen=True, eq=False)
class NoHybridOrbit:
    """The ``reason`` why there is no orbit at a ``case``."""

    case: HybridCase
    reason: str


@dataclass(frozen=True, eq=False)
class HybridOrbit:
    """A periodic orbit with contact of any kind, confirmed by the exact method.

    Attributes
    ----------
    case : HybridCase
        Scene, force and frequency.
    phase : float
        Phase of the force at the section in rad.
    state : array, (2 N_m + 2 n,)
        State at the section, as `InitialState.vector`.
    symmetric : bool
        Whether the second half is the mirror image of the first.
    period_multiple : int
        Period in periods of the force.
    trajectory : HybridTrajectory
        Motion over the period, or over half of one if ``symmetric``.
    residual : float
        Largest difference to the start after an exact run over the trajectory's time:
        displacements over `HybridCase.length`, velocities over that times the force's frequency.
    """

    case: HybridCase
    phase: float
    state: Array
    symmetric: bool
    period_multiple: int
    trajectory: HybridTrajectory
    residual: float

    @property
    def turn(self) -> float:
        """Phase of the force in rad over the trajectory."""
        return count_turns(self.symmetric, self.period_multiple)

    @cached_property
    def multipliers(self) -> Complex:
        """Floquet multipliers over the trajectory, the largest first.

        If the orbit is symmetric they are those of half a period with the mirror image. With
        elastic friction the slider's position adds one multiplier.
        """
        values = np.linalg.eigvals(self.mirror * self.trajectory.derivative).astype(complex)
        return values[np.argsort(-np.abs(values), kind="stable")]

    @property
    def mirror(self) -> float:
        """-1 for a symmetric orbit, else 1."""
        return -1.0 if self.symmetric else 1.0

    @property
    def stable(self) -> bool:
        """Whether all multipliers lie inside the unit circle, so that small disturbances decay."""
        return bool(np.max(np.abs(self.multipliers)) < 1)

    @cached_property
    def events(self) -> tuple[HybridEvent, ...]:
        """Events of a whole period by ascending time in s after the section.

        The mirrored half of a symmetric orbit is included.
        """
        own = self.trajectory.events
        if not self.symmetric:
            return tuple(own)
        half = self.turn / self.case.omega
        return (
            *own,
            *(e._replace(time=e.time + half, wall=-e.wall, impulse=-e.impulse) for e in own),
        )

    @property
    def impacts(self) -> tuple[HybridEvent, ...]:
        """Impacts of a period; with compliant walls the beginnings of wall contacts."""
        return tuple(event for event in self.events if event.kind in (IMPACT, CONTACT))

    @cached_property
    def level(self) -> tuple[float, float]:
        """Largest |displacement| and its RMS in m at the place of the response level."""
        return compute_level(self.trajectory)

    @property
    def tip_max(self) -> float:
        """Largest |displacement| in m at the place of the response level."""
        return self.level[0]

    @property
    def tip_rms(self) -> float:
        """RMS of the displacement in m at the place of the response level."""
        return self.level[1]

    def states(self, phases: ArrayLike) -> Array:
        """Return the states (K, S) at phases (K,) of the force in rad.

        The phases may be outside of one period. The last entry of a state is the slider's position,
        if there is a slider.
        """
        angles = np.asarray(phases, dtype=float)
        require(
            angles.ndim == 1 and bool(np.all(np.isfinite(angles))),
            "phases",
            phases,
            "a row of finite numbers in rad",
        )
        rounds = np.floor((angles - self.phase) / self.turn)
        times = (angles - self.phase - rounds * self.turn) / self.case.omega
        states = self.trajectory.states(np.clip(times, 0.0, self.trajectory.span))
        return np.where(rounds % 2 == 1, self.mirror, 1.0)[:, None] * states


def compute_level(trajectory: HybridTrajectory) -> tuple[float, float]:
    """Return the largest |displacement| and the RMS in m at the place of the response level."""
    case = trajectory.case
    shape = case.scene.model.level_shape
    n = len(shape)
    half = n + case.scene.places
    peaks = [0.0]
    area = 0.0
    for piece, length in piece_lengths(trajectory):
        if length <= 0:
            continue

        def motion(dts: Array, piece: LinearPiece = piece) -> tuple[Array, Array]:
            states = piece.states(dts)
            return states[:, :n] @ shape, states[:, half : half + n] @ shape

        fastest = max(float(np.max(np.abs(piece.model.values))), case.omega)
        peak, square = piece_extremes(motion, length, fastest)
        peaks.append(peak)
        area += square
    return max(peaks), float(np.sqrt(area / trajectory.span))


@dataclass(frozen=True, eq=False)
class ReturnCondition:
    """Condition that a state returns: the residual and its derivatives, in the units of a case.

    Unknowns (m,) are the state at the section over ``units``, and with elastic friction the
    section's phase in rad.
    """

    case: HybridCase
    phase: float
    symmetric: bool
    period_multiple: int
    units: Array

    @property
    def turn(self) -> float:
        """Phase of the force in rad after which the state must return."""
        return count_turns(self.symmetric, self.period_multiple)

    @property
    def mirror(self) -> float:
        """-1 if the mirror image of the state returns, else 1."""
        return -1.0 if self.symmetric else 1.0

    @property
    def free_phase(self) -> bool:
        """Whether the section's phase is unknown."""
        return self.case.laws.has_slider

    def unknowns(self, phase: float, state: Array) -> Array:
        """Return the unknowns (m,) of a phase (rad) and a state (2 N_m + 2 n,)."""
        scaled = state / self.units
        return np.append(scaled, phase) if self.free_phase else scaled

    def plain(self, unknowns: Array) -> tuple[float, Array]:
        """Return phase (rad) and state (2 N_m + 2 n,) of unknowns (m,)."""
        core = len(self.units)
        phase = float(unknowns[-1]) if self.free_phase else self.phase
        return phase, unknowns[:core] * self.units

    def follow(self, unknowns: Array, case: HybridCase | None = None) -> HybridTrajectory:
        """Return the trajectory of unknowns (m,).

        If ``case`` is given, the trajectory is that of this case of the same scene.
        """
        case = self.case if case is None else case
        phase, state = self.plain(unknowns)
        return follow_hybrid(case, phase, state, self.turn / case.omega)

    def residual(self, unknowns: Array, trajectory: HybridTrajectory) -> Array:
        """Return the residual (m,)."""
        core = len(self.units)
        miss = self.mirror * trajectory.end[:core] / self.units - unknowns[:core]
        if not self.free_phase:
            return np.asarray(miss)
        stretch = float(relative_rows(self.case)[0][0] @ trajectory.end) - trajectory.end[-1]
        return np.append(miss, stretch / self.case.length)

    def jacobian(self, trajectory: HybridTrajectory) -> Array:
        """Return the derivatives (m, m + 2) of the residual.

        They are with respect to the unknowns, the force (N) and the frequency (rad/s).
        """
        case = trajectory.case
        core = len(self.units)
        derivative = trajectory.derivative
        by_state = derivative[:, :core]
        # the section lies at a phase, not at a time: the end moves with the frequency
        columns = trajectory.columns - np.outer(
            trajectory.end_rate, [0.0, trajectory.span / case.omega]
        )
        if self.free_phase:
            row = relative_rows(self.case)[0][0]
            by_state = by_state + np.outer(derivative[:, -1], row[:core])
            by_phase = (trajectory.end_rate - derivative @ trajectory.start_rate) / case.omega
            columns = np.column_stack([by_phase, columns])
        whole = np.column_stack([by_state * self.units, columns])
        miss = self.mirror * whole[:core] / self.units[:, None]
        miss[:, :core] -= np.eye(core)
        if not self.free_phase:
            return np.asarray(miss)
        row = relative_rows(self.case)[0][0].copy()
        row[-1] = -1.0
        return np.vstack([miss, row @ whole / self.case.length])


def shoot_hybrid(
    case: HybridCase,
    phase: float,
    state: ArrayLike,
    symmetric: bool = False,
    period_multiple: int = 1,
) -> HybridOrbit | NoHybridOrbit:
    """Return the orbit whose state at a phase of the force is near a given state.

    Parameters
    ----------
    case : HybridCase
        Scene, force and frequency.
    phase : float
        Phase of the force at the section in rad; with elastic friction only a start.
    state : array_like, (2 N_m + 2 n,)
        Start of Newton's method.
    symmetric : bool, optional
        Seek an orbit whose second half mirrors the first.
    period_multiple : int, optional
        Period in periods of the force.

    Returns
    -------
    HybridOrbit or NoHybridOrbit
        The orbit, confirmed by the exact method, or the reason why none was found.

    Raises
    ------
    ParameterError
        The state has another length or is not finite, or no symmetric orbit has such a period.
    """
    phase = finite("phase", phase)
    size = len(case.units)
    start = np.array(state, dtype=float)
    require(
        start.shape == (size,) and bool(np.all(np.isfinite(start))),
        "state",
        state,
        f"{size} finite numbers: modes, absorbers, and their velocities",
    )
    count_turns(symmetric, period_multiple)
    condition = ReturnCondition(case, phase, symmetric, period_multiple, case.units)
    z = condition.unknowns(phase, start)
    steps = 0
    try:
        trajectory = condition.follow(z)
        miss = condition.residual(z, trajectory)
        for _ in range(MOST_SHOOTING_STEPS):
            if np.max(np.abs(miss)) <= CLOSING_TOL:
                break
            matrix = condition.jacobian(trajectory)[:, : len(z)]
            step = np.asarray(np.linalg.lstsq(matrix, -miss, rcond=NEUTRAL_TOL)[0], dtype=float)
            better = _damped_step(condition, z, step, float(np.max(np.abs(miss))))
            if better is None:
                break
            z, trajectory, miss = better
            steps += 1
    except (TrajectoryError, np.linalg.LinAlgError) as error:
        return NoHybridOrbit(case, str(error))
    left = float(np.max(np.abs(miss)))
    if not left <= SUFFICIENT_TOL:
        return NoHybridOrbit(
            case, f"shooting did not converge (residual {left:.1e} after {steps} steps)"
        )
    return confirm_hybrid(condition, z, trajectory)


def confirm_hybrid(
    condition: ReturnCondition, z: Array, trajectory: HybridTrajectory
) -> HybridOrbit | NoHybridOrbit:
    """Return the orbit of a trajectory that returns to its start, if it is confirmed.

    The run of the exact method must return as well, and a contact must occur.
    """
    case = trajectory.case
    phase, state = condition.plain(z)
    if not any(trajectory.events):
        return NoHybridOrbit(case, "absorbers and structure do not touch")
    miss = np.abs(condition.mirror * trajectory.exact_end - state) / case.units
    residual = float(np.max(miss))
    if not residual <= HYBRID_RESIDUAL_BAR:
        return NoHybridOrbit(
            case,
            (
                f"the exact method comes back with a residual of {residual:.1e}, more than "
                f"{HYBRID_RESIDUAL_BAR:g}"
            ),
        )
    whole = 2 * np.pi * condition.period_multiple
    return HybridOrbit(
        case,
        phase % whole,
        state,
        condition.symmetric,
        condition.period_multiple,
        trajectory,
        residual,
    )


def _damped_step(
    condition: ReturnCondition, z: Array, step: Array, size: float
) -> tuple[Array, HybridTrajectory, Array] | None:
    """Return unknowns, trajectory and residual after a damped step, or None.

    The step is shortened until the residual is smaller than ``size``.
    """
    share = 1.0
    for _ in range(MOST_HALVINGS):
        new = z + share * step
        try:
            trajectory = condition.follow(new)
        except TrajectoryError:
            share /= 2
            continue
        miss = condition.residual(new, trajectory)
        if np.max(np.abs(miss)) < size:
            return new, trajectory, miss
        share /= 3
    return None


def find_section(trajectory: HybridTrajectory) -> float:
    """Return the best time (s) in a trajectory for a section.

    It is the middle of the longest piece with the fewest absorbers joined or at a wall. With
    elastic friction it is the last time at which the slider's spring has no force; raises
    `TrajectoryError` if there is no such time.
    """
    if trajectory.case.laws.has_slider:
        return _find_unloaded_slider(trajectory)
    lengths = piece_lengths(trajectory)
    held = [sum(piece.regime.joined) + abs(piece.regime.wall) for piece, _ in lengths]
    fewest = min(h for h, (_, length) in zip(held, lengths, strict=True) if length > 0)
    longest = max(
        (k for k, h in enumerate(held) if h == fewest), key=lambda k: float(lengths[k][1])
    )
    piece, length = lengths[longest]
    return piece.time + 0.5 * length


def _find_unloaded_slider(trajectory: HybridTrajectory) -> float:
    row = relative_rows(trajectory.case)[0][0].copy()
    row[-1] = -1.0
    for piece, length in reversed(piece_lengths(trajectory)):
        if not piece.regime.sticks or length <= 0:
            continue
        dts = np.linspace(0.0, length, 65)
        values = piece.states(dts) @ row
        crossings = np.flatnonzero(values[:-1] * values[1:] < 0)
        if len(crossings) == 0:
            continue
        low = dts[crossings[-1]]
        high = dts[crossings[-1] + 1]
        sign = np.sign(float(piece.states(np.array([low]))[0] @ row))
        for _ in range(60):
            middle = 0.5 * (low + high)
            same = sign * float(piece.states(np.array([middle]))[0] @ row) > 0
            low, high = (middle, high) if same else (low, middle)
        return piece.time + 0.5 * (low + high)
    raise TrajectoryError("the slider's spring always has a force: no section")


def hybrid_orbit_of_simulation(
    case: HybridCase,
    settle: int = SETTLING_PERIODS,
    most_multiple: int = MOST_MULTIPLE,
    initial: InitialState | None = None,
    phase: float = 0.0,
) -> HybridOrbit | NoHybridOrbit:
    """Return the orbit to which a run converges, or the reason why there is none.

    Parameters
    ----------
    case : HybridCase
        Scene, force and frequency.
    settle : int, optional
        Periods of the force after which the run is examined.
    most_multiple : int, optional
        Longest period, in periods of the force.
    initial : InitialState, optional
        Start of the run. None: rest.
    phase : float, optional
        Phase of the force at the start in rad.

    Returns
    -------
    HybridOrbit or NoHybridOrbit
        The orbit with the smallest period after which the state returns. Only a stable orbit is
        found.
    """
    settle = count("settle", settle, 1)
    most_multiple = count("most_multiple", most_multiple, 1)
    try:
        start, state = _settled_section(case, settle, initial, phase)
        symmetric, multiple, miss = _find_return(case, start, state, most_multiple)
    except TrajectoryError as error:
        return NoHybridOrbit(case, str(error))
    if multiple == 0:
        return NoHybridOrbit(
            case, f"the run does not come again within {most_multiple} periods (miss {miss:.1e})"
        )
    return shoot_hybrid(case, start, state, symmetric, multiple)


def _settled_section(
    case: HybridCase, settle: int, initial: InitialState | None, phase: float
) -> tuple[float, Array]:
    """Return phase (rad) and state (2 N_m + 2 n,) of a run at a section after ``settle`` periods.

    A run that is continued starts with zero force in the slider's spring. This disturbs the run
    once; later it is continued only at sections, where the spring has no force.
    """
    run = simulate(
        case.scene,
        case.drive(settle * case.period, phase),
        initial=initial,
        record=record_of(case),
    )
    state = run.end_state
    core = len(case.units)
    for _ in range(SLIDER_PERIODS if case.laws.has_slider else 1):
        trajectory = follow_hybrid(case, phase, state, case.period)
        time = find_section(trajectory)
        state = trajectory.states(np.array([time]))[0][:core]
        phase = float((phase + case.omega * time) % (2 * np.pi))
    return phase, state


def _states_later(case: HybridCase, phase: float, first: Array, most: int) -> Iterator[Array]:
    """Yield the states (2 N_m + 2 n,) after each half period of the force."""
    core = len(case.units)
    if not case.laws.has_slider:
        state = first
        for half in range(2 * most):
            run = simulate(
                case.scene,
                case.drive(0.5 * case.period, phase + half * np.pi),
                initial=InitialState.from_vector(case.scene, state),
                record=record_of(case),
            )
            state = run.end_state
            yield state
        return
    done = 0
    span = 1
    while done < 2 * most:
        try:
            trajectory = follow_hybrid(case, phase, first, span * case.period)
        except TrajectoryError:  # too unstable to be followed so long: nothing that attracts
            return
        for half in range(done + 1, 2 * span + 1):
            time = min(0.5 * half * case.period, trajectory.span)
            yield trajectory.states(np.array([time]))[0][:core]
        done = 2 * span
        span = min(2 * span, most)


def _find_return(
    case: HybridCase, phase: float, first: Array, most: int
) -> tuple[bool, int, float]:
    """Return whether the motion is symmetric, its period, and the smallest deviation.

    A symmetric motion mirrors itself after half of its period. The period is in periods of the
    force (0: none).
    """
    least = np.inf
    for half, state in enumerate(_states_later(case, phase, first, most), 1):
        symmetric = half % 2 == 1
        miss = float(np.max(np.abs((-1.0 if symmetric else 1.0) * state - first) / case.units))
        least = min(least, miss)
        if miss < RETURN_TOL and (half <= most or not symmetric):
            return symmetric, half if symmetric else half // 2, miss
    return False, 0, least


def mirror_hybrid(orbit: HybridOrbit) -> HybridOrbit | NoHybridOrbit:
    """Return the mirror image of an orbit: all signs reversed, half a period of the force later.

    The mirror image of a symmetric orbit is the orbit itself.
    """
    if orbit.symmetric:
        return orbit
    return shoot_hybrid(orbit.case, orbit.phase + np.pi, -orbit.state, False, orbit.period_multiple)


def is_same_hybrid(one: HybridOrbit, other: HybridOrbit) -> bool:
    """Return whether two orbits of one case are the same, for any sections.

    They have the same period and level, and the same states at the same phases.
    """
    if (one.symmetric, one.period_multiple) != (other.symmetric, other.period_multiple):
        return False
    if abs(one.tip_max / other.tip_max - 1) > SAME_ORBIT_TOL:
        return False
    core = len(one.case.units)
    state = one.state
    phases = one.phase + 2 * np.pi * np.arange(one.period_multiple)
    miss = np.abs(other.states(phases)[:, :core] - state) / one.case.units
    return bool(np.min(np.max(miss, axis=1)) < 10 * SAME_ORBIT_TOL)


def find_hybrid_orbits(
    case: HybridCase, starts: int = 8, seed: int = 0, settle: int = SETTLING_PERIODS
) -> Iterator[HybridOrbit | NoHybridOrbit]:
    """Yield the orbits to which runs converge, each once, with mirror images.

    The runs start from rest and from random initial states. For runs that do not converge to an
    orbit the reason is yielded.

    Random states are uniform: displacements of the absorbers in their cavities, and velocities of
    the first mode and of the absorbers up to 1.5 times `HybridCase.length` times the frequency.
    """
    starts = count("starts", starts, 0)
    rng = np.random.default_rng(count("seed", seed, 0))
    known: list[HybridOrbit] = []
    for k in range(starts + 1):
        initial = None if k == 0 else _draw_state(case, rng)
        phase = 0.0 if k == 0 else float(rng.uniform(0, 2 * np.pi))
        result = hybrid_orbit_of_simulation(case, settle, initial=initial, phase=phase)
        if isinstance(result, NoHybridOrbit):
            yield result
            continue
        if any(is_same_hybrid(result, other) for other in known):
            continue
        known.append(result)
        yield result
        if not result.symmetric:
            image = mirror_hybrid(result)
            if isinstance(image, HybridOrbit):
                known.append(image)
                yield image


START_REACH = 1.5  # of `HybridCase.length`: how far random initial states reach


def _draw_state(case: HybridCase, rng: np.random.Generator) -> InitialState:
    scene = case.scene
    n = scene.model.modes
    reach = START_REACH * case.length
    largest = float(np.max(np.abs(scene.absorber_shapes[:, 0]))) or 1.0
    modal = np.zeros(n)
    rates = np.zeros(n)
    modal[0] = reach / largest * rng.uniform(-1, 1)
    rates[0] = reach * case.omega / largest * rng.uniform(-1, 1)
    inside = np.minimum(case.laws.gap, case.length)
    places = scene.absorber_shapes @ modal + inside * rng.uniform(-1, 1, scene.places)
    speeds = scene.absorber_shapes @ rates + reach * case.omega * rng.uniform(-1, 1, scene.places)
    return InitialState(modal, rates, places, speeds)


def count_events(orbit: HybridOrbit, kind: str) -> int:
    """Return the number of events of a kind in a period."""
    return sum(event.kind == kind for event in orbit.events)


def plain_hybrid_orbit(orbit: HybridOrbit) -> dict[str, Any]:
    """Return an orbit as plain values with the keys of `orbit.plain_orbit`.

    Events and impacts have the number of their absorber, too.
    """
    case = orbit.case
    n = case.scene.model.modes
    half = n + case.scene.places
    state = orbit.state
    single = case.scene.places == 1
    places = state[n:half]
    speeds = state[half + n :]
    whole = 2 * np.pi * orbit.period_multiple

    def phase_of(event: HybridEvent) -> float:
        return float((orbit.phase + case.omega * event.time) % whole)

    return {
        "omega_ratio": case.omega_ratio,
        "period_multiple": orbit.period_multiple,
        "symmetric": orbit.symmetric,
        "impacts": [
            {
                "phase_rad": phase_of(e),
                "impulse_Ns": e.impulse,
                "wall": e.wall,
                "absorber": e.absorber,
            }
            for e in sorted(orbit.impacts, key=phase_of)
        ],
        "tip_max_m": orbit.tip_max,
        "tip_rms_m": orbit.tip_rms,
        "half_multipliers" if orbit.symmetric else "multipliers": [
            [float(m.real), float(m.imag)] for m in orbit.multipliers
        ],
        "stable": orbit.stable,
        "residual": orbit.residual,
        "scene": from_scene(case.scene),
        "force_N": case.force,
        "omega_rad_s": case.omega,
        "period_s": orbit.period_multiple * case.period,
        "events": [
            {"phase_rad": phase_of(e), "kind": e.kind, "wall": e.wall, "absorber": e.absorber}
            for e in orbit.events
        ],
        "start": {
            "phase_rad": orbit.phase,
            "modal_displacement": state[:n].tolist(),
            "modal_velocity": state[half : half + n].tolist(),
            "absorber_displacement_m": float(places[0]) if single else places.tolist(),
            "absorber_velocity_m_s": float(speeds[0]) if single else speeds.tolist(),
        },
    }


def hybrid_orbit_of(plain: dict[str, Any]) -> HybridOrbit | NoHybridOrbit:
    """Return the orbit of a JSON file's entry, computed again by shooting from its start.

    Raises KeyError or ParameterError for another entry.
    """
    case = HybridCase(to_scene(plain["scene"]), plain["omega_rad_s"], plain["force_N"])
    start = plain["start"]
    state = np.concatenate(
        [
            start["modal_displacement"],
            np.atleast_1d(start["absorber_displacement_m"]),
            start["modal_velocity"],
            np.atleast_1d(start["absorber_velocity_m_s"]),
        ]
    )
    return shoot_hybrid(
        case, start["phase_rad"], state, plain["symmetric"], plain["period_multiple"]
    )
