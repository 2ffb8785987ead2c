"""The motion of a periodic orbit whose events are known, and its monodromy matrix.

In: an orbit's phases and impulses (green.py). Out: the flights between its events, states, samples,
reversals of the relative velocity, the tip's extremes, and the derivative of the return map.

A flight is the motion between two consecutive events. The monodromy matrix is a product of the
linear maps of flights and the saltation matrices of events. A disturbance shifts an event in time,
so its saltation matrix is the derivative of the jump, plus the shift times the difference of the
vector fields before and after. Times are those at which the force's phase is omega t.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import jit, jit_allocating, jit_inline
from impact_env.kernels.periodic.green import compute_exponentials, new_orbit_workspace
from impact_env.kernels.periodic.structure import divide_complex

PANEL_PHASE = 1.0  # rad of the fastest exponential in one panel of nodes
NODES = 6  # Gauss-Legendre nodes in a panel; their positions lie in 0 to 1
NODE_PLACES, NODE_WEIGHTS = np.polynomial.legendre.leggauss(NODES)
NODE_PLACES = 0.5 * (1.0 + NODE_PLACES)
NODE_WEIGHTS = 0.5 * NODE_WEIGHTS


class Flights(NamedTuple):
    """The flights after each of n events."""

    amplitude: NDArray[np.complex128]  # (n, J) of the exponentials just after the event (N s)
    force: NDArray[np.float64]  # (n,) friction force on the absorber after the event (N)
    place: NDArray[np.float64]  # (n,) displacement of the absorber at the event (m)
    velocity: NDArray[np.float64]  # (n,) velocity of the absorber after the event (m/s)
    time: NDArray[np.float64]  # (n + 1,) of the events, then of the next span's first event (s)


class Extremes(NamedTuple):
    """Extremes of an orbit."""

    tip: float  # largest |displacement| of the tip (m)
    square: float  # mean square of the tip's displacement (m^2)
    distance: float  # largest |relative displacement| (m)


@jit_inline
def compute_modal_motion(structure, omega, force, rest, amplitude, phase, out):
    """Write modal displacements, velocities and accelerations into ``out`` (3, N_m).

    The motion is the sum of three responses: to the harmonic force with amplitude ``force`` (N),
    frequency ``omega`` (rad/s) and current ``phase`` (rad); to the constant friction force ``rest``
    (N, on the absorber); and the exponentials with the current ``amplitude`` (J,) in N s.
    """
    turning = force * np.exp(1j * phase)
    for i in range(structure.omega.shape[0]):
        q = divide_complex(
            structure.push[i] * turning,
            complex(
                structure.omega[i] * structure.omega[i] - omega * omega, structure.rate[i] * omega
            ),
        )
        out[0, i] = q.real - structure.tip[i] * rest / (structure.omega[i] * structure.omega[i])
        out[1, i] = (1j * omega * q).real
        out[2, i] = (-omega * omega * q).real
    for j in range(structure.s.shape[0]):
        i = structure.mode[j]
        s = structure.s[j]
        share = structure.weight[j] * amplitude[j] * structure.tip[i]
        out[0, i] -= share.real
        out[1, i] -= (s * share).real
        out[2, i] -= (s * s * share).real


@jit_allocating
def compute_flights(structure, point, order, z, impulses):
    """Return the `Flights` of an orbit whose first event is an impact.

    ``z`` (n,) are the events' phases (rad), without the other unknowns, and ``impulses`` (n,) are
    in N s, with 0 at reversals.
    """
    workspace = new_orbit_workspace(structure, order)
    compute_exponentials(structure, order, point.omega, z, workspace)
    n = z.shape[0]
    count = structure.s.shape[0]
    omega = point.omega
    amplitude = np.zeros((n, count), np.complex128)
    force = np.zeros(n)
    place = np.zeros(n)
    velocity = np.zeros(n)
    time = np.zeros(n + 1)
    for i in range(n):
        time[i], force[i] = z[i] / omega, -point.limit * order.sign[i]
    time[n] = (z[0] + order.turn) / omega
    for j in range(count):
        total = 0j
        for i in range(1, n + 1):  # one span from just after the first event: its contribution
            k = i if i < n else 0
            total *= workspace.steps[k, j]
            turn = 1.0 if i < n else order.mirror
            total += turn * (
                impulses[k] + complex(workspace.jump[k] * point.limit) / complex(structure.s[j])
            )
        amplitude[0, j] = order.mirror * workspace.first[j] * total
        for i in range(1, n):
            amplitude[i, j] = (
                amplitude[i - 1, j] * workspace.steps[i, j]
                + impulses[i]
                + complex(workspace.jump[i] * point.limit) / complex(structure.s[j])
            )
    flights = Flights(amplitude, force, place, velocity, time)
    fill_absorber_motion(structure, point, order, impulses, z[0], flights)
    return flights


@jit_allocating
def fill_absorber_motion(structure, point, order, impulses, phase, flights):
    """Fill ``flights.place`` and ``flights.velocity``, the absorber's motion at the events.

    The absorber starts on the wall of the first event, at the force's ``phase`` (rad). Its initial
    velocity follows from periodicity.
    """
    force = flights.force
    place = flights.place
    velocity = flights.velocity
    time = flights.time
    n = time.shape[0] - 1
    modal = np.zeros((3, structure.omega.shape[0]))
    mass = structure.mass
    x = 0.0
    v = 0.0
    for i in range(n):
        dt = time[i + 1] - time[i]
        pushed = impulses[i + 1] if i + 1 < n else order.mirror * impulses[0]
        x += dt * (v + 0.5 * dt * force[i] / mass)
        v += (dt * force[i] + pushed) / mass
    compute_modal_motion(
        structure, point.omega, point.force, force[0], flights.amplitude[0], phase, modal
    )
    place[0] = order.wall[0] * point.gap
    for i in range(structure.omega.shape[0]):
        place[0] += structure.tip[i] * modal[0, i]
    velocity[0] = -0.5 * v if order.mirror < 0.0 else -x / (time[n] - time[0])
    for i in range(1, n):
        dt = time[i] - time[i - 1]
        place[i] = place[i - 1] + dt * (velocity[i - 1] + 0.5 * dt * force[i - 1] / mass)
        velocity[i] = velocity[i - 1] + (dt * force[i - 1] + impulses[i]) / mass


@jit
def compute_state_in_flight(structure, point, flights, i, dt, amplitude, modal, state):
    """Write the state at ``dt`` (s) after event ``i``, within its flight, into ``state``.

    ``state`` (2 N_m + 2,) has modal displacements, absorber displacement, modal velocities,
    absorber velocity. ``amplitude`` (J,) is scratch memory, and ``modal`` (3, N_m) contains modal
    displacements, velocities and accelerations afterwards.
    """
    n = structure.omega.shape[0]
    for j in range(structure.s.shape[0]):
        amplitude[j] = flights.amplitude[i, j] * np.exp(structure.s[j] * dt)
    force = flights.force[i]
    mass = structure.mass
    compute_modal_motion(
        structure,
        point.omega,
        point.force,
        force,
        amplitude,
        point.omega * (flights.time[i] + dt),
        modal,
    )
    for k in range(n):
        state[k], state[n + 1 + k] = modal[0, k], modal[1, k]
    state[n] = flights.place[i] + dt * (flights.velocity[i] + 0.5 * dt * force / mass)
    state[2 * n + 1] = flights.velocity[i] + dt * force / mass


@jit_allocating
def compute_states(structure, point, flights, times, out):
    """Write the states at rising ``times`` (S,) into ``out`` (S, 2 N_m + 2).

    The times (s) are on the scale of ``flights.time`` and lie between its first and last entry.
    """
    amplitude = np.zeros(structure.s.shape[0], np.complex128)
    modal = np.zeros((3, structure.omega.shape[0]))
    i = 0
    for k in range(times.shape[0]):
        while i + 2 < flights.time.shape[0] and times[k] >= flights.time[i + 1]:
            i += 1
        compute_state_in_flight(
            structure, point, flights, i, times[k] - flights.time[i], amplitude, modal, out[k]
        )


@jit
def compute_tip_in_flight(structure, point, h, flights, i, dt):
    """Return (displacement in m, velocity in m/s, acceleration in m/s^2) of the tip in a flight.

    The time is ``dt`` (s) after event ``i``; ``h`` (m/N) is the receptance at ``point.omega``.
    """
    omega = point.omega
    forced = point.force * h * np.exp(1j * omega * (flights.time[i] + dt))
    q = forced.real - structure.static * flights.force[i]
    v = -omega * forced.imag
    a = -omega * omega * forced.real
    for j in range(structure.s.shape[0]):
        e = flights.amplitude[i, j] * np.exp(structure.s[j] * dt)
        q -= (structure.powers[1, j] * e).real
        v -= (structure.powers[2, j] * e).real
        a -= (structure.powers[3, j] * e).real
    return q, v, a


@jit
def find_peak_near(structure, point, h, flights, i, dt, reach):
    """Return the |tip displacement| (m) at its maximum near ``dt`` (s) after event ``i``.

    Newton's method moves the time by at most ``reach`` (s) and within the event's flight.
    """
    length = flights.time[i + 1] - flights.time[i]
    best = abs(compute_tip_in_flight(structure, point, h, flights, i, dt)[0])
    start = dt
    for _ in range(8):
        q, v, a = compute_tip_in_flight(structure, point, h, flights, i, dt)
        if a == 0.0 or q * a > 0.0:
            break
        dt = min(max(dt - v / a, 0.0, start - reach), length, start + reach)
        best = max(best, abs(compute_tip_in_flight(structure, point, h, flights, i, dt)[0]))
    return best


@jit_allocating
def scan_flights(structure, point, h, flights, order, turns):
    """Scan all flights of an orbit; return (`Extremes`, number of reversals, whether signs fit).

    The times (s) at which the computed relative velocity changes its sign between impacts are
    written into ``turns`` (capacity,), also those of reversals that are not in the order; the
    number counts reversals beyond the capacity too. The signs fit if the relative velocity points
    towards the wall of the order before each impact. ``h`` (m/N) is the receptance.
    """
    count = structure.s.shape[0]
    n = order.wall.shape[0]
    omega = point.omega
    mass = structure.mass
    shift = np.zeros((NODES, count), np.complex128)
    panel_factor = np.zeros(count, np.complex128)
    e = np.zeros(count, np.complex128)
    fastest = omega
    for j in range(count):
        fastest = max(fastest, abs(structure.s[j]))
    tip = 0.0
    square = 0.0
    distance = 0.0
    turn_count = 0
    fits = True
    sign = 0
    last_rate = 0.0
    last_time = 0.0
    at = 0
    at_dt = 0.0
    for i in range(n):
        length = flights.time[i + 1] - flights.time[i]
        if order.wall[i] != 0:
            fits = fits and (sign == 0 or sign == order.wall[i])
            sign = -order.wall[i]
            last_rate = 0.0
            last_time = flights.time[i]
        start = abs(compute_tip_in_flight(structure, point, h, flights, i, 0.0)[0])
        if start > tip:
            tip = start
            at = i
            at_dt = 0.0
        panels = max(1, int(np.ceil(length * fastest / PANEL_PHASE)))
        step = length / panels
        for j in range(count):
            panel_factor[j], e[j] = np.exp(structure.s[j] * step), flights.amplitude[i, j]
            for k in range(NODES):
                shift[k, j] = np.exp(structure.s[j] * step * NODE_PLACES[k])
        for p in range(panels):
            for k in range(NODES):
                dt = (p + NODE_PLACES[k]) * step
                forced = point.force * h * np.exp(1j * omega * (flights.time[i] + dt))
                q = forced.real - structure.static * flights.force[i]
                v = -omega * forced.imag
                for j in range(count):
                    moved = e[j] * shift[k, j]
                    q -= (structure.powers[1, j] * moved).real
                    v -= (structure.powers[2, j] * moved).real
                rate = flights.velocity[i] + dt * flights.force[i] / mass - v
                place = (
                    flights.place[i]
                    + dt * (flights.velocity[i] + 0.5 * dt * flights.force[i] / mass)
                    - q
                )
                distance = max(distance, abs(place))
                square += NODE_WEIGHTS[k] * step * q * q
                if abs(q) > tip:
                    tip = abs(q)
                    at = i
                    at_dt = dt
                if rate * sign < 0.0:
                    time = flights.time[i] + dt
                    if turn_count < turns.shape[0]:
                        past = abs(rate) if last_rate == 0.0 else abs(last_rate)
                        turns[turn_count] = time - (time - last_time) * abs(rate) / (
                            abs(rate) + past
                        )
                    turn_count = turn_count + 1
                    sign = -sign
                last_rate = rate
                last_time = flights.time[i] + dt
            for j in range(count):
                e[j] *= panel_factor[j]
    fits = fits and sign == order.mirror * order.wall[0]
    tip = max(tip, find_peak_near(structure, point, h, flights, at, at_dt, PANEL_PHASE / fastest))
    return Extremes(tip, square / (flights.time[n] - flights.time[0]), distance), turn_count, fits


@jit
def apply_flight(structure, dt, block, matrix):
    """Multiply ``matrix`` from the left by the linear map of a flight of ``dt`` (s), in place.

    ``matrix`` has the shape (2 N_m + 2, columns); ``block`` (2, N_m) is scratch memory.
    """
    n = structure.omega.shape[0]
    columns = matrix.shape[1]
    block[:, :] = 0.0
    for j in range(structure.s.shape[0]):
        e = structure.weight[j] * np.exp(structure.s[j] * dt)
        i = structure.mode[j]
        block[0, i] += e.real  # h, the response to a unit impulse, and its rate
        block[1, i] += (structure.s[j] * e).real
    for i in range(n):
        h = block[0, i]
        rate = block[1, i]
        direct = rate + structure.rate[i] * h
        stiff = -structure.omega[i] * structure.omega[i] * h
        for c in range(columns):
            q = matrix[i, c]
            v = matrix[n + 1 + i, c]
            matrix[i, c] = direct * q + h * v
            matrix[n + 1 + i, c] = stiff * q + rate * v
    for c in range(columns):
        matrix[n, c] += dt * matrix[2 * n + 1, c]


@jit
def compute_relative_rows(structure, matrix, c):
    """Return (relative displacement, relative velocity) of the state in column ``c``."""
    n = structure.omega.shape[0]
    d = matrix[n, c]
    v = matrix[2 * n + 1, c]
    for i in range(n):
        d -= structure.tip[i] * matrix[i, c]
        v -= structure.tip[i] * matrix[n + 1 + i, c]
    return d, v


@jit
def apply_saltation(structure, wall, restitution, impulse, jump, rate, bend, matrix):
    """Multiply ``matrix`` from the left by the saltation matrix of an event, in place.

    ``wall`` is -1 or 1 at an impact, 0 at a reversal. ``impulse`` (N s) acts on the absorber, 0 at
    a reversal. ``jump`` (N) is the change of the friction force on the absorber; ``rate`` (m/s) and
    ``bend`` (m/s^2) are relative velocity and acceleration before the event.
    """
    n = structure.omega.shape[0]
    mass = structure.mass
    bounce = (1.0 + restitution) / structure.compliance
    for c in range(matrix.shape[1]):
        d, v = compute_relative_rows(structure, matrix, c)
        if wall == 0:
            push = jump * v / bend
            shift = 0.0
        else:
            shift = d / rate
            push = -bounce * (v - bend * shift) + jump * shift
            matrix[n, c] += impulse * shift / mass
        matrix[2 * n + 1, c] += push / mass
        for i in range(n):
            # the impulse changes a mode's damping force at once, for the time of the shift
            matrix[i, c] -= structure.tip[i] * impulse * shift
            matrix[n + 1 + i, c] -= structure.tip[i] * (push - structure.rate[i] * impulse * shift)


@jit_allocating
def compute_monodromy(structure, point, order, flights, impulses, jumps, matrix, turning):
    """Write the derivative of the map over one span into ``matrix`` (2 N_m + 2, 2 N_m + 2).

    The span goes from just after the first event to just after its return. The derivative is
    multiplied by -1 if the order is mirrored. ``impulses`` (n,) are in N s; ``jumps`` (n,) are the
    changes of the friction force on the absorber (N). Written too is ``turning`` (n,): at each
    reversal the relative acceleration before it over the change by the friction jump. At -1 or
    below the absorber slides in the other direction, above -1 friction holds it. At impacts, and
    at reversals without a jump, the entry is -inf.
    """
    n = order.wall.shape[0]
    size = matrix.shape[0]
    modes = size // 2 - 1
    block = np.zeros((2, modes))
    modal = np.zeros((3, modes))
    amplitude = np.zeros(structure.s.shape[0], np.complex128)
    state = np.zeros(size)
    matrix[:, :] = np.eye(size)
    turning[:] = -np.inf
    for k in range(1, n + 1):
        i, turn = (k, 1.0) if k < n else (0, order.mirror)
        dt = flights.time[k] - flights.time[k - 1]
        apply_flight(structure, dt, block, matrix)
        compute_state_in_flight(structure, point, flights, k - 1, dt, amplitude, modal, state)
        rate = state[size - 1]
        bend = flights.force[k - 1] / structure.mass
        for m in range(modes):
            rate -= structure.tip[m] * state[modes + 1 + m]
            bend -= structure.tip[m] * modal[2, m]
        if order.wall[i] == 0:
            turning[i] = (
                bend / (turn * jumps[i] * structure.compliance) if jumps[i] != 0.0 else -np.inf
            )
        apply_saltation(
            structure,
            order.wall[i],
            point.restitution,
            turn * impulses[i],
            turn * jumps[i],
            rate,
            bend,
            matrix,
        )
    if order.mirror < 0.0:
        matrix[:, :] = -matrix
