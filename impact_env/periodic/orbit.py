"""An orbit that the exact method has confirmed, and its computation.

The steps are: solve the conditions at the events, check the motion between events, reorder events,
propagate with the exact method, and compute the stability.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.periodic.case import Case, case_of
from impact_env.periodic.green import NoOrbit, Solution, read_unknowns, solve
from impact_env.periodic.motion import (
    AnyMotion,
    Motion,
    ShotMotion,
    Stability,
    motion_of,
    stability_of,
)
from impact_env.periodic.schedule import EventSchedule, Regime, flying_schedule
from impact_env.periodic.shooting import shoot, units_of
from impact_env.periodic.validation import (
    JOINED_FOR_A_WHILE,
    Validation,
    chatters,
    joins_for_a_while,
    validate,
)
from impact_env.plain import from_scene, to_scene

Array = NDArray[np.float64]
MOST_SHOOTING_REORDERINGS = 12
REVERSAL_HOLDS = "friction would hold the absorber at a reversal"
VELOCITY_TURNS = "the relative velocity turns"
REORDERABLE = (REVERSAL_HOLDS, JOINED_FOR_A_WHILE, VELOCITY_TURNS)  # what shooting may reorder
# of gap and gap times omega: how far from the motion that it starts with the orbit may lie then
NEIGHBOUR = 0.05


@dataclass(frozen=True, eq=False)
class Impact:
    """One impact.

    ``phase`` is that of the force in rad, ``impulse`` acts on the absorber in N s, ``wall`` is -1
    or 1.
    """

    phase: float
    impulse: float
    wall: int


@dataclass(frozen=True, eq=False)
class Orbit:
    """A periodic orbit that the exact method has confirmed.

    Attributes
    ----------
    motion : Motion or ShotMotion
        The motion over a period, or over half a period of a symmetric orbit.
    stability : Stability
        Its Floquet multipliers.
    residual : float
        Largest scaled difference to the start after a run of the exact method, see
        `validation.Validation`.
    recorded : tuple of Impact or None
        Impacts of this run if a chatter is complete, whose number depends on rounding; else None.
    """

    motion: AnyMotion
    stability: Stability
    residual: float
    recorded: tuple[Impact, ...] | None = None

    @property
    def solution(self) -> Solution:
        """The events of the orbit."""
        return self.motion.solution

    @property
    def case(self) -> Case:
        """Structure, absorber, force and frequency."""
        return self.motion.solution.case

    @property
    def schedule(self) -> EventSchedule:
        """Kinds and order of the events."""
        return self.motion.solution.schedule

    @property
    def impacts(self) -> tuple[Impact, ...]:
        """All impacts of a whole period, in ascending order of the phase from 0.

        The mirrored half of a symmetric orbit is included. A complete chatter has the impacts of
        the exact method's run. It ends with an impact without rebound, after which the heights of
        all further bounces would add up to less than the rounding of the distance.
        """
        schedule = self.schedule
        solution = self.solution
        whole = 2 * np.pi * self.schedule.period_multiple
        result = [
            Impact(float(p % whole), float(i), event.wall)
            for p, i, event in zip(solution.phases, solution.impulses, schedule.events, strict=True)
            if event.is_impact
        ]
        if self.recorded is not None:
            result = [
                Impact(impact.phase % whole, impact.impulse, impact.wall)
                for impact in self.recorded
            ]
        if schedule.symmetric:
            result += [
                Impact((impact.phase + schedule.turn) % whole, -impact.impulse, -impact.wall)
                for impact in result
            ]
        return tuple(sorted(result, key=lambda impact: impact.phase))


def confirm_orbit(motion: AnyMotion) -> Orbit | NoOrbit:
    """Return the orbit of a motion if the exact method confirms it, or the reason why not."""
    solution = motion.solution
    reason = find_physical_objection(motion) if isinstance(motion, Motion) else None
    if reason is None:
        validation = validate(motion)
        if validation.reason is None:
            return Orbit(
                motion, stability_of(motion), validation.residual, _is_chatter(motion, validation)
            )
        reason = validation.reason
    return NoOrbit(solution.case, solution.schedule, reason, solution.phases)


def _is_chatter(motion: AnyMotion, validation: Validation) -> tuple[Impact, ...] | None:
    """Return the impacts of a validation's run if a chatter ends in wall contact, else None."""
    impacts = None if validation.response is None else validation.response.impacts
    if (
        impacts is None
        or validation.response is None
        or not chatters(motion.solution.case, validation.response)
    ):
        return None
    phases = validation.start + motion.solution.case.omega * impacts.time
    return tuple(
        Impact(float(p), float(i), int(-np.sign(i)))
        for p, i in zip(phases, impacts.impulse, strict=True)
    )


def shoot_orbit(
    case: Case, phase: float, state: ArrayLike, symmetric: bool = False, period_multiple: int = 1
) -> Orbit | NoOrbit:
    """Return the confirmed orbit found by shooting, or the reason why there is none.

    Shooting starts from a ``state`` (2 N_m + 2,) at a ``phase`` (rad) at which the absorber is not
    joined. The other arguments are as in `EventSchedule`.
    """
    result = shoot(case, phase, np.asarray(state, dtype=float), symmetric, period_multiple)
    return result if isinstance(result, NoOrbit) else confirm_orbit(result)


def shoot_held_orbit(motion: Motion) -> Orbit | NoOrbit:
    """Return the orbit next to a motion in which friction would hold the absorber briefly.

    Between two numbers of reversals lie orbits with a short joined phase. Shooting finds them from
    the motion without this phase. If the motion has another fault, or no orbit is found, the reason
    is returned.
    """
    result = confirm_orbit(motion)
    case = motion.solution.case
    if (
        isinstance(result, Orbit)
        or case.friction_limit == 0
        or not any(reason in result.reason for reason in REORDERABLE)
    ):
        return result
    schedule = motion.solution.schedule
    (phase, state) = motion.mid_flight()
    held = shoot_orbit(case, phase, state, schedule.symmetric, schedule.period_multiple)
    reason = held.reason if isinstance(held, NoOrbit) else "shooting leads elsewhere"
    if (
        isinstance(held, Orbit)
        and np.max(np.abs(held.motion.state_at(phase) - state) / units_of(case)) < NEIGHBOUR
    ):
        return held
    return NoOrbit(case, result.schedule, f"{result.reason}; {reason}", result.phases)


def mirror_orbit(orbit: Orbit) -> Orbit | NoOrbit:
    """Return the mirror image of an orbit.

    Its signs are reversed, and it is shifted by half a period of the force. A symmetric orbit is
    its own mirror image.
    """
    if isinstance(orbit.motion, ShotMotion):
        phase, state = orbit.motion.mid_flight()
        return shoot_orbit(
            orbit.case,
            phase + np.pi,
            -state,
            orbit.schedule.symmetric,
            orbit.schedule.period_multiple,
        )
    solution = orbit.solution
    old = orbit.schedule
    schedule = EventSchedule(
        tuple(event.mirrored for event in old.events), old.symmetric, old.period_multiple
    )
    z = read_unknowns(solution)
    z[: len(old.events)] += np.pi
    z[len(old.events) :] *= -1
    return find_orbit_at(solution.case, schedule, z)


def find_physical_objection(motion: Motion) -> str | None:
    """Return the reason why a motion is not an orbit, None if there is none.

    Reasons are an impulse that pulls, a wall that is passed, or friction in the wrong direction.
    The motion is not propagated by the exact method.
    """
    solution = motion.solution
    schedule = motion.solution.schedule
    if np.any(solution.impulses * schedule.order.wall > 0):
        return "a wall would have to pull"
    if motion.penetration > 0:
        return f"the absorber passes a wall by {motion.penetration:.3g} m"
    if solution.case.friction_limit > 0 and not is_consistent(motion):
        return (
            f"{VELOCITY_TURNS} {len(motion.turns)} times between impacts, not "
            f"{schedule.reversals} times as in the schedule"
        )
    return REVERSAL_HOLDS if has_held_phase(motion) else None


def find_orbit_at(
    case: Case, schedule: EventSchedule, start: ArrayLike, reorder: bool = True
) -> Orbit | NoOrbit:
    """Return the confirmed orbit near ``start`` (unknowns, or phases in rad), or why there is none.

    If ``reorder``, the reversals of the schedule may be wrong at the start: they are replaced by
    those of the motion until both agree, and if friction would hold the absorber, shooting
    continues from there. Raises ParameterError for a schedule with joined segments.
    """
    result = (
        reorder_events(case, schedule, start) if reorder else settle_order(case, schedule, start)
    )
    if isinstance(result, NoOrbit):
        return result
    return shoot_held_orbit(result) if reorder else confirm_orbit(result)


def settle_order(case: Case, schedule: EventSchedule, start: ArrayLike) -> Motion | NoOrbit:
    """Return the motion of the solution near ``start``, without a check between events."""
    solution = solve(case, schedule, start)
    return solution if isinstance(solution, NoOrbit) else motion_of(solution)


def reorder_events(case: Case, schedule: EventSchedule, start: ArrayLike) -> Motion | NoOrbit:
    """Return the motion near ``start`` whose schedule has the reversals of the motion.

    Two reversals that exchange their order are left out. If friction would hold the absorber
    briefly, no order of reversals is consistent; the result is then a motion without the reversals
    concerned, which `confirm_orbit` refuses, or a `NoOrbit`.
    """
    start = np.asarray(start, dtype=float)
    motion = settle_order(case, schedule, start)
    for _ in range(MOST_SHOOTING_REORDERINGS):
        if isinstance(motion, NoOrbit):
            if schedule.reversals < 2 or case.friction_limit == 0:
                return motion
            schedule, start = drop_closest(schedule, start[: len(schedule.events)])
            motion = settle_order(case, schedule, start)
            continue
        if case.friction_limit == 0 or not motion.fits:
            return motion
        last = motion
        held = has_held_phase(motion)
        if is_consistent(motion):
            if not held:
                return motion
            motion = settle_order(case, *drop_held(last))
            return last if isinstance(motion, NoOrbit) else motion
        schedule, start = order_of_motion(motion)
        motion = settle_order(case, schedule, start)
        if not isinstance(motion, NoOrbit) and has_held_phase(motion) and not held:
            return last
    return motion


def has_held_phase(motion: Motion) -> bool:
    """Return whether friction would hold the absorber at one of its reversals."""
    return bool(np.max(motion.turning) > -1)


def is_consistent(motion: Motion) -> bool:
    """Return whether the motion's reversals lie between the same impacts as the schedule's."""
    solution = motion.solution
    if not motion.fits or len(motion.turns) != solution.schedule.reversals:
        return False
    hits = solution.schedule.order.wall != 0
    impacts = solution.phases[hits]
    return bool(
        np.all(
            np.searchsorted(impacts, motion.turns)
            == np.searchsorted(impacts, solution.phases[~hits])
        )
    )


def order_of_motion(motion: Motion) -> tuple[EventSchedule, Array]:
    """Return a motion's schedule and the phases (n,) of its events in rad.

    The reversals of the schedule are those that occur in the motion.
    """
    solution = motion.solution
    old = motion.solution.schedule
    hits = old.order.wall != 0
    phases = np.concatenate([solution.phases[hits], motion.turns])
    walls = np.concatenate([old.order.wall[hits], np.zeros(len(motion.turns), np.int64)])
    return _sorted(old, walls, phases)


def drop_closest(schedule: EventSchedule, phases: Array) -> tuple[EventSchedule, Array]:
    """Return the schedule and phases (n,) without the two closest reversals.

    They are the neighbouring reversals that are closest to each other. If no such pair exists, both
    are returned unchanged.
    """
    wall = schedule.order.wall
    pairs = [
        (phases[k + 1] - phases[k], k)
        for k in range(len(phases) - 1)
        if wall[k] == 0 and wall[k + 1] == 0
    ]
    if not pairs:
        return schedule, phases
    k = min(pairs)[1]
    return _sorted(schedule, np.delete(wall, [k, k + 1]), np.delete(phases, [k, k + 1]))


def drop_held(motion: Motion) -> tuple[EventSchedule, Array]:
    """Return the schedule and phases (n,) of a motion without reversals that friction would hold.

    The next reversal after or before each of them is left out, too, so that signs stay consistent.
    """
    solution = motion.solution
    old = motion.solution.schedule
    turning = motion.turning
    wall = old.order.wall
    leave: set[int] = set()
    for k in np.flatnonzero(turning > -1):
        partners = [
            j for j in (k - 1, k + 1) if 0 <= j < len(wall) and wall[j] == 0 and j not in leave
        ]
        if k not in leave and partners:
            leave |= {
                int(k),
                int(
                    min(partners, key=lambda j: abs(float(solution.phases[j] - solution.phases[k])))
                ),
            }
    keep = np.array([k not in leave for k in range(len(wall))])
    return _sorted(old, wall[keep], solution.phases[keep])


def _sorted(
    old: EventSchedule, walls: NDArray[np.int64], phases: Array
) -> tuple[EventSchedule, Array]:
    rank = np.argsort(phases, kind="stable")
    friction = any(event.regime is Regime.SLIDING for event in old.events)
    return flying_schedule(
        walls[rank].tolist(), friction, old.symmetric, old.period_multiple
    ), phases[rank]


def plain_orbit(orbit: Orbit) -> dict[str, Any]:
    """Return an orbit as plain values by name, as in JSON files; the names do not change."""
    schedule = orbit.schedule
    motion = orbit.motion
    case = orbit.case
    phase, state = motion.mid_flight()
    n = case.model.modes
    events = zip(schedule.events, orbit.solution.phases, strict=True)
    begins, ends = joins_for_a_while(motion, phase)
    return {
        "omega_ratio": orbit.case.omega_ratio,
        "period_multiple": schedule.period_multiple,
        "symmetric": schedule.symmetric,
        "impacts": [
            {"phase_rad": impact.phase, "impulse_Ns": impact.impulse, "wall": impact.wall}
            for impact in orbit.impacts
        ],
        "tip_max_m": motion.tip_max,
        "tip_rms_m": motion.tip_rms,
        "half_multipliers" if schedule.symmetric else "multipliers": [
            [float(m.real), float(m.imag)] for m in orbit.stability.multipliers
        ],
        "stable": orbit.stability.stable,
        "residual": orbit.residual,
        "scene": from_scene(case.scene),
        "force_N": case.force,
        "omega_rad_s": case.omega,
        "period_s": schedule.period_multiple * case.period,
        "events": [
            {"phase_rad": float(at), "regime": event.regime.value, "wall": event.wall}
            for event, at in events
        ],
        "held_rad": [
            [float(begin + phase), float(end + phase)]
            for begin, end in zip(begins, ends, strict=True)
        ],
        "start": {
            "phase_rad": phase,
            "modal_displacement": state[:n].tolist(),
            "modal_velocity": state[n + 1 : -1].tolist(),
            "absorber_displacement_m": float(state[n]),
            "absorber_velocity_m_s": float(state[-1]),
        },
    }


def orbit_of(plain: dict[str, Any]) -> Orbit | NoOrbit:
    """Return the orbit of a JSON file's entry, confirmed again.

    It is computed from its ``events``, or, if the absorber is joined for a time, by shooting from
    its ``start``. (A run over many periods would leave an unstable orbit.) Raises KeyError or
    ParameterError for any other entry.
    """
    case = case_of(to_scene(plain["scene"]), plain["force_N"], plain["omega_rad_s"])
    start = plain["start"]
    events = plain["events"]
    kind = (plain["symmetric"], plain["period_multiple"])
    if not plain["held_rad"] and plain["impacts"] and events[0]["wall"]:
        schedule = flying_schedule(
            [event["wall"] for event in events], case.friction_limit > 0, *kind
        )
        result = find_orbit_at(
            case, schedule, [event["phase_rad"] for event in events], reorder=False
        )
        if isinstance(result, Orbit):
            return result
    state = [
        *start["modal_displacement"],
        start["absorber_displacement_m"],
        *start["modal_velocity"],
        start["absorber_velocity_m_s"],
    ]
    return shoot_orbit(case, start["phase_rad"], state, *kind)


def pack_orbits(orbits: Sequence[Orbit | NoOrbit]) -> dict[str, Any]:
    """Return the orbits of a branch or curve as plain data.

    ``common`` contains the common data of all orbits, and ``points`` the remaining data of each, or
    None for a point without an orbit.
    """
    return pack_plain_orbits(
        [plain_orbit(orbit) if isinstance(orbit, Orbit) else None for orbit in orbits]
    )


def pack_plain_orbits(plain: Sequence[dict[str, Any] | None]) -> dict[str, Any]:
    """Return orbits as plain values in the form of `pack_orbits`.

    Points without an orbit are None.
    """
    known = [one for one in plain if one is not None]
    common = {
        name: value
        for name, value in (known[0] if known else {}).items()
        if all(one.get(name) == value for one in known)
    }
    return {
        "common": common,
        "points": [
            one and {name: value for name, value in one.items() if name not in common}
            for one in plain
        ],
    }


def unpack_orbits(orbits: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the entries of `pack_orbits` that are orbits, for `orbit_of`.

    Each is as `plain_orbit` wrote it, except for the order of its items.
    """
    return (orbits["common"] | one for one in orbits["points"] if one is not None)
