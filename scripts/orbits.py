"""Exact periodic orbits of the impact absorber: two impacts a period and what a run settles to, folds, births and mergers of isolas."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
import numpy as np

from impact_env.modes import modal_model
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, RigidWalls, count
from impact_env.periodic.case import Case
from impact_env.periodic.green import NoOrbit
from impact_env.periodic.isolas import LocatedFold, Threshold, folds, thresholds
from impact_env.periodic.orbit import Orbit
from impact_env.periodic.survey import Found, attractors, different, orbits_over
from optimisation.command_line import BadInput, check_target, end_early, plain_errors
from optimisation.files import write_json
from optimisation.progress import counting_bar
from optimisation.report.markdown import markdown

FORCE = 1.5  # N, the paper's moderate level of excitation
FROM, TO = 0.9, 1.06  # of the first resonance, the paper's range
POINTS, AROUND, RANGE = 81, 21, 0.02  # frequencies listed, and those from which branches lead to a single one, with its neighbourhood
Told = Callable[[int, int], None]


def pairs(values: np.ndarray) -> list[list[float]]:
    return [[float(value.real), float(value.imag)] for value in values]


def plain_orbit(orbit: Orbit) -> dict[str, Any]:
    """The contract of the JSON file: these names do not change."""
    schedule, motion = orbit.schedule, orbit.motion
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
    }


def plain_fold(fold: LocatedFold) -> dict[str, Any]:
    assert isinstance(fold.orbit, Orbit)
    return {"omega_ratio": fold.omega_ratio, "force_N": fold.force, "tip_max_m": fold.orbit.motion.tip_max}


def plain_threshold(threshold: Threshold) -> dict[str, Any]:
    return {"kind": threshold.kind, "force_N": threshold.force, "omega_ratio": threshold.omega_ratio}


def orbit_table(orbits: list[Orbit]) -> str:
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
    if not refused:
        return []
    lines = [f"{len(refused)} {what} no orbit:"]
    seen = sorted({orbit.reason for orbit in refused}, key=lambda reason: -sum(reason == orbit.reason for orbit in refused))
    return lines + [f"  {sum(reason == orbit.reason for orbit in refused)} x {reason}" for reason in seen[:8]] + (["  ..."] if len(seen) > 8 else [])


@contextmanager
def kept(complete: list[bool]) -> Iterator[None]:
    """Let Ctrl-C end what is under way, and keep what is finished."""
    try:
        yield
    except KeyboardInterrupt:
        complete[0] = False


def listed(case: Case, given: dict[str, Any], told: Told, complete: list[bool]) -> list[Found]:
    """Orbits at the frequencies asked for. At a single one branches come from its neighbourhood, and a run adds what it settles to."""
    found: list[Found] = []
    at = given["at"]
    with kept(complete):
        if at is None:
            found += orbits_over(case, np.linspace(given["start"], given["stop"], given["points"]), told)
            return found
        low, high = max(given["start"], at - RANGE), min(given["stop"], at + RANGE)
        ratios = np.union1d(np.linspace(low, high, AROUND), [at])
        here = next(group for group in orbits_over(case, ratios, told) if abs(group.case.omega_ratio - at) < 1e-12)
        found.append(here)
        for settled in attractors(here.case, here.orbits):
            if isinstance(settled, NoOrbit):
                found[0] = Found(here.case, found[0].orbits, (*found[0].refused, settled))
            else:
                found[0] = Found(here.case, tuple(different([*found[0].orbits, settled])), found[0].refused)
    return found


def fold_text(located: tuple[LocatedFold, ...]) -> str:
    good = [(fold, fold.orbit) for fold in located if isinstance(fold.orbit, Orbit)]
    rows = [[f"{f.omega_ratio:.10f}", f"{f.force:g}", f"{1e3 * o.motion.tip_max:.6f}", str(2 * o.schedule.reversals)] for f, o in good]
    text = markdown(("omega/omega_1", "force, N", "tip max, mm", "reversals"), rows)
    return "\n".join([text, *refusals([f.orbit for f in located if isinstance(f.orbit, NoOrbit)], "folds of the closed form lead to")])


def threshold_text(found: tuple[Threshold, ...]) -> str:
    good = [(threshold, threshold.orbit) for threshold in found if isinstance(threshold.orbit, Orbit)]
    rows = [[t.kind, f"{t.force:.8f}", f"{t.omega_ratio:.8f}", str(2 * orbit.schedule.reversals)] for t, orbit in good]
    text = markdown(("kind", "force, N", "omega/omega_1", "reversals"), rows)
    return "\n".join([text, *refusals([t.orbit for t in found if isinstance(t.orbit, NoOrbit)], "level places of the closed form lead to")])


def check(given: dict[str, Any]) -> None:
    if given["folds"] and given["thresholds"]:
        raise BadInput("--folds does not go with --thresholds: the JSON file has one list")
    if given["at"] is not None and (given["folds"] or given["thresholds"]):
        raise BadInput("--at does not go with --folds or --thresholds: they are sought from --from to --to")
    if not 0 < given["start"] < given["stop"]:
        raise BadInput(f"--from = {given['start']} is not allowed: a ratio above 0 and below --to = {given['stop']}")
    if given["at"] is not None and not given["start"] <= given["at"] <= given["stop"]:
        raise BadInput(f"--at = {given['at']} is not allowed: a ratio from --from = {given['start']} to --to = {given['stop']}")
    count("points", given["points"], 2)
    check_target("--json", given["json"], (".json",))


def run(given: dict[str, Any]) -> tuple[str, list[dict[str, Any]], bool]:
    """Return the text, the contents of the JSON file, and whether the work came to its end."""
    check(given)
    model = modal_model(Beam(modes=given["modes"], damping_ratio=given["damping"]))
    first, limit = float(model.omega[0]), given["friction_limit"]
    case = Case(model, first, given["force"], given["gap"], given["restitution"], limit, given["mass_ratio"])
    low, high = given["start"], given["stop"]
    if given["thresholds"]:
        levels = thresholds(case, low, high)
        return threshold_text(levels), [plain_threshold(t) for t in levels if isinstance(t.orbit, Orbit)], True
    if given["folds"]:
        located = folds(case, low, high)
        return fold_text(located), [plain_fold(fold) for fold in located if isinstance(fold.orbit, Orbit)], True
    complete = [True]
    with counting_bar("orbits", "frequencies", leave=False) as told:
        found = listed(case, given, told, complete)
    orbits = [orbit for group in found for orbit in group.orbits]
    notes = refusals([orbit for group in found for orbit in group.refused], "solutions or runs are")
    stable = sum(orbit.stability.stable for orbit in orbits)
    text = "\n".join([orbit_table(orbits), "", f"{len(orbits)} orbits, {stable} of them stable.", *notes])
    return text, [plain_orbit(orbit) for orbit in orbits], complete[0]


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 150})
@click.option("--modes", type=int, default=Beam.modes, show_default=True, help="Number of modes kept.")
@click.option("--damping", type=float, default=Beam.damping_ratio, show_default=True, help="Modal damping ratio, the same for all modes.")
@click.option("--mass-ratio", type=float, default=DEFAULT_MASS_RATIO, show_default=True, help="Absorber mass over beam mass.")
@click.option("--gap", type=float, default=RigidWalls.gap, show_default=True, help="Clearance to either wall in m.")
@click.option("--restitution", type=float, default=RigidWalls.restitution, show_default=True, help="Coefficient of restitution, 0 to 1.")
@click.option("--friction-limit", type=float, default=0.0, show_default=True, help="Friction limit in N; 0: no friction.")
@click.option("--force", type=float, default=FORCE, show_default=True, help="Amplitude of the harmonic force in N; not used for thresholds.")
@click.option("--from", "start", type=float, default=FROM, show_default=True, help="First frequency over that of the first resonance.")
@click.option("--to", "stop", type=float, default=TO, show_default=True, help="Last frequency over that of the first resonance.")
@click.option("--at", type=float, help="One frequency only; also what runs settle to there, of any period up to eight of the force's.")
@click.option("--points", type=int, default=POINTS, show_default=True, help="Frequencies listed from the first to the last.")
@click.option("--folds", is_flag=True, help="The folds of the branches at this force instead of orbits.")
@click.option("--thresholds", is_flag=True, help="The forces at which isolas are born and merge instead of orbits.")
@click.option("--json", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Write the list, in SI units.")
def main(**given: Any) -> None:
    """List exact periodic orbits of the impact absorber at the tip of the paper's beam under a harmonic force, each confirmed by the exact method.

    Symmetric orbits with one impact a wall are found in closed form, with all reversals of friction, and along their branches. Multipliers of
    symmetric orbits are those of half a period: +1 is a fold, -1 breaks the symmetry. Columns slow and fast: the largest of the pair that lives as
    long as the beam's vibration, and of all others. Held: friction or a wall holds the absorber for a while.
    """
    with plain_errors():
        text, content, complete = run(given)
        if given["json"] is not None:
            write_json(given["json"].resolve(), content)
    click.echo(text)
    end_early(complete, "what was finished is shown.")


if __name__ == "__main__":
    main(prog_name="scripts/run orbits")
