"""Periodic orbits, folds and thresholds of isolas: tables to print, and the plain values of the JSON file."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from impact_env.periodic.case import case_of
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.isolas import LocatedFold, Threshold
from impact_env.periodic.orbit import Orbit, shot_orbit
from impact_env.periodic.validation import held
from impact_env.plain import from_scene, to_scene
from optimisation.report.markdown import markdown


def pairs(values: np.ndarray) -> list[list[float]]:
    """Return complex numbers as pairs of real and imaginary part."""
    return [[float(value.real), float(value.imag)] for value in values]


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
        "half_multipliers" if schedule.symmetric else "multipliers": pairs(orbit.stability.multipliers),
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
    """Return the orbit of a JSON file's entry, confirmed anew by shooting from its ``start``; KeyError or ParameterError if it is something else."""
    scene, start = to_scene(plain["scene"]), plain["start"]
    state = [*start["modal_displacement"], start["absorber_displacement_m"], *start["modal_velocity"], start["absorber_velocity_m_s"]]
    return shot_orbit(case_of(scene, plain["force_N"], plain["omega_rad_s"]), start["phase_rad"], state, plain["symmetric"], plain["period_multiple"])


def plain_fold(fold: LocatedFold) -> dict[str, Any]:
    """Return a fold whose orbit was found as the JSON file holds it."""
    assert isinstance(fold.orbit, Orbit)
    return {"omega_ratio": fold.omega_ratio, "force_N": fold.force, "tip_max_m": fold.orbit.motion.tip_max}


def plain_threshold(threshold: Threshold) -> dict[str, Any]:
    """Return a birth or a merger as the JSON file holds it."""
    return {"kind": threshold.kind, "force_N": threshold.force, "omega_ratio": threshold.omega_ratio}


def orbit_table(orbits: list[Orbit]) -> str:
    """Return a line for each orbit."""
    rows = []
    for orbit in orbits:
        slow, fast = (float(np.max(np.abs(values))) for values in (orbit.stability.slow_multipliers, orbit.stability.fast_multipliers))
        schedule = orbit.schedule
        kind = ("symmetric" if schedule.symmetric else "one-sided") + (
            "" if schedule.period_multiple == 1 else f", period {schedule.period_multiple}"
        )
        kind += "" if schedule.flies else ", held"
        sides = 2 if schedule.symmetric else 1
        rows.append(
            [
                f"{orbit.case.omega_ratio:.6f}", kind, str(len(orbit.impacts)), str(sides * schedule.reversals), f"{1e3 * orbit.motion.tip_max:.6f}",
                f"{1e3 * orbit.motion.tip_rms:.6f}", f"{slow:.4f}", f"{fast:.4f}", "yes" if orbit.stability.stable else "no", f"{orbit.residual:.0e}",
            ]
        )  # fmt: skip
    header = ("omega/omega_1", "kind", "impacts", "reversals", "tip max, mm", "tip RMS, mm", "slow", "fast", "stable", "residual")
    return markdown(header, rows)


def refusals(refused: list[NoOrbit], what: str) -> list[str]:
    """Say how many are no orbit, and why, the commonest reasons first; nothing if there are none."""
    if not refused:
        return []
    seen = Counter(orbit.reason.split(" (")[0] for orbit in refused)  # what is in brackets are numbers, each time others
    lines = [f"  {number} x {reason}" for reason, number in seen.most_common(8)]
    return [f"{len(refused)} {what} no orbit:", *lines, *(["  ..."] if len(seen) > 8 else [])]


def fold_text(located: tuple[LocatedFold, ...]) -> str:
    """Return the table of folds, and why others are none."""
    good = [(fold, fold.orbit) for fold in located if isinstance(fold.orbit, Orbit)]
    rows = [[f"{f.omega_ratio:.10f}", f"{f.force:g}", f"{1e3 * o.motion.tip_max:.6f}", str(2 * o.schedule.reversals)] for f, o in good]
    text = markdown(("omega/omega_1", "force, N", "tip max, mm", "reversals"), rows)
    return "\n".join([text, *refusals([f.orbit for f in located if isinstance(f.orbit, NoOrbit)], "folds of the closed form lead to")])


def threshold_text(found: tuple[Threshold, ...]) -> str:
    """Return the table of births and mergers, and why others are none."""
    good = [(threshold, threshold.orbit) for threshold in found if isinstance(threshold.orbit, Orbit)]
    rows = [[t.kind, f"{t.force:.8f}", f"{t.omega_ratio:.8f}", str(2 * orbit.schedule.reversals)] for t, orbit in good]
    text = markdown(("kind", "force, N", "omega/omega_1", "reversals"), rows)
    return "\n".join([text, *refusals([t.orbit for t in found if isinstance(t.orbit, NoOrbit)], "level places of the closed form lead to")])
