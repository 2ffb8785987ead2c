"""Orbits as plain values that describe themselves, for files, and back."""

from collections.abc import Iterator, Sequence
from typing import Any

from impact_env.periodic.case import case_of
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.orbit import Orbit, orbit_at, shot_orbit
from impact_env.periodic.schedule import flying_schedule
from impact_env.periodic.validation import held
from impact_env.plain import from_scene, to_scene


def plain_orbit(orbit: Orbit) -> dict[str, Any]:
    """The contract of the JSON file: these names do not change."""
    schedule, motion, case = orbit.schedule, orbit.motion, orbit.case
    phase, state = motion.mid_flight()
    n, events = case.model.modes, zip(schedule.events, orbit.solution.phases, strict=True)
    begins, ends = held(motion, phase)
    return {
        "omega_ratio": orbit.case.omega_ratio,
        "period_multiple": schedule.period_multiple,
        "symmetric": schedule.symmetric,
        "impacts": [{"phase_rad": impact.phase, "impulse_Ns": impact.impulse, "wall": impact.wall} for impact in orbit.impacts],
        "tip_max_m": motion.tip_max,
        "tip_rms_m": motion.tip_rms,
        "half_multipliers" if schedule.symmetric else "multipliers": [[float(m.real), float(m.imag)] for m in orbit.stability.multipliers],
        "stable": orbit.stability.stable,
        "residual": orbit.residual,
        "scene": from_scene(case.scene),
        "force_N": case.force,
        "omega_rad_s": case.omega,
        "period_s": schedule.period_multiple * case.period,
        "events": [{"phase_rad": float(at), "regime": event.regime.value, "wall": event.wall} for event, at in events],
        "held_rad": [[float(begin + phase), float(end + phase)] for begin, end in zip(begins, ends, strict=True)],
        "start": {
            "phase_rad": phase,
            "modal_displacement": state[:n].tolist(),
            "modal_velocity": state[n + 1 : -1].tolist(),
            "absorber_displacement_m": float(state[n]),
            "absorber_velocity_m_s": float(state[-1]),
        },
    }


def orbit_of(plain: dict[str, Any]) -> Orbit | NoOrbit:
    """Return the orbit of a JSON file's entry, confirmed anew; KeyError or ParameterError if it is something else.

    It is found from its ``events``, or where the absorber is held by shooting from its ``start``, which over many periods would lose an unstable one.
    """
    case, start = case_of(to_scene(plain["scene"]), plain["force_N"], plain["omega_rad_s"]), plain["start"]
    events, kind = plain["events"], (plain["symmetric"], plain["period_multiple"])
    if not plain["held_rad"] and plain["impacts"] and events[0]["wall"]:
        schedule = flying_schedule([event["wall"] for event in events], case.friction_limit > 0, *kind)
        found = orbit_at(case, schedule, [event["phase_rad"] for event in events], reorder=False)
        if isinstance(found, Orbit):
            return found
    state = [*start["modal_displacement"], start["absorber_displacement_m"], *start["modal_velocity"], start["absorber_velocity_m_s"]]
    return shot_orbit(case, start["phase_rad"], state, *kind)


def packed(orbits: Sequence[Orbit | NoOrbit]) -> dict[str, Any]:
    """Return the orbits of a branch or curve: ``common`` what all of them share, ``points`` the rest of each, None where there is no orbit."""
    plain = [plain_orbit(orbit) if isinstance(orbit, Orbit) else None for orbit in orbits]
    known = [one for one in plain if one is not None]
    common = {name: value for name, value in (known[0] if known else {}).items() if all(one.get(name) == value for one in known)}
    return {"common": common, "points": [one and {name: value for name, value in one.items() if name not in common} for one in plain]}


def unpacked(orbits: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the entries of `packed` that are orbits, each as `plain_orbit` wrote it but for the order, to be read by `orbit_of`."""
    return (orbits["common"] | one for one in orbits["points"] if one is not None)
