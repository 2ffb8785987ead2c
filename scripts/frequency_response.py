"""Frequency response of periodic motions: exact branches with their stability, harmonic balance, linear curves, and sweeps over them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from _sweep_scene import make_scene, refuse_parts
from tqdm import tqdm

from impact_env.drive import PAPER_RATE
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, RigidWalls, positive, require
from impact_env.periodic.harmonic_balance import PAPER_DAMPER, WEIGHT, harmonic_balance
from impact_env.periodic.overview import Overview, overview, sliding
from impact_env.periodic.response_curve import COLUMNS
from optimisation.command_line import check_target, end_early, name_files, plain_errors
from optimisation.files import replacing, write_csv, write_json
from optimisation.report.markdown import markdown

FIGURES = (".png", ".pdf", ".svg")
EXACT, BALANCE, BOTH = "exact", "balance", "both"


@contextmanager
def following(reference: float) -> Iterator[Callable[[str, int, float], None]]:
    with tqdm(total=None, bar_format="{desc} [{elapsed}]", disable=None, leave=False) as bar:

        def show(label: str, points: int, omega: float) -> None:
            bar.set_description_str(f"{label}: {points} points, at {omega / reference:.4f}")
            bar.update()

        yield show


def computed(given: dict[str, Any]) -> Overview:
    """Do what the options ask for. Raises BadInput or ParameterError before anything long is done."""
    scene, _ = make_scene(given)
    reference, walls = scene.model.resonance_omega(given["resonance"]), sliding(scene).walls
    low, high = positive("--from", given["start"]), positive("--to", given["stop"])
    require(high > low, "--to", high, f"above --from = {low}")
    inelastic = isinstance(walls, RigidWalls) and walls.restitution < 1
    require(not (inelastic and given["method"] == BALANCE), "--method", BALANCE, "exact below a restitution of 1: harmonic balance has no impact law")
    balance = None
    if given["method"] != EXACT and not inelastic:
        damper = PAPER_DAMPER if given["grounded_damper"] else 0.0
        balance = harmonic_balance(scene, low * reference, given["force"], given["harmonics"], given["weight"], grounded_damper=damper)
    sweeps = ((low, high), (high, low)) if given["sweeps"] else ()
    rate = given["percent_per_100_periods"]
    with following(reference) as show:
        return overview(scene, given["force"], reference, low, high, given["method"] != BALANCE, balance, sweeps, rate, show, given["pairs"])


def text(result: Overview) -> str:
    """Return a table of the curves, and what was refused."""
    rows, notes = [], []
    for number, curve in enumerate(result.curves, 1):
        peak = curve.peak
        folds = ", ".join(f"{fold.omega_ratio:.9g}" for fold in sorted(curve.folds, key=lambda point: point.omega_ratio))
        stable = "" if curve.stable is None else f"{100 * curve.stable.mean():.0f}"
        where = ["", ""] if peak is None else [f"{1e3 * peak.tip_max:.4f}", f"{peak.omega_ratio:.4f}"]
        rows.append([str(number), curve.method, "closed" if curve.closed else "open", str(len(curve.tip_max)), *where, folds, stable])
        notes += [f"Curve {number}: {curve.message}." if not curve.closed else ""]
        notes += [f"Curve {number}: {points} points are no orbit: {reason}." for reason, points in curve.refused]
    header = ("curve", "method", "", "points", "peak, mm", "at", "folds", "stable, %")
    return "\n".join([str(result.scene) + f", {result.force:g} N", "", markdown(header, rows), "", *[note for note in notes if note]])


def written(result: Overview, given: dict[str, Any]) -> list[Path]:
    files = []
    if given["json"] is not None:
        write_json(given["json"], result.to_plain())
        files.append(given["json"])
    if given["csv"] is not None:
        write_csv(given["csv"], COLUMNS, (row for number, curve in enumerate(result.curves, 1) for row in curve.rows(number)))
        files.append(given["csv"])
    if given["figure"] is not None:
        from optimisation.report.frequency_figure import save_figure  # matplotlib is slow to import

        with replacing(given["figure"]) as temporary:
            save_figure(temporary, result)
        files.append(given["figure"])
    return files


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 130})
@click.option("--absorber", type=click.Choice(["impact", "friction"]), help="Impact absorber or friction damper.  [default: impact]")
@click.option("--scene", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Beam and absorber from a .toml or .json file.")
@click.option("--modes", type=int, help=f"Number of modes kept.  [default: {Beam.modes}]")
@click.option("--damping", type=float, help=f"Modal damping ratio, the same for all modes.  [default: {Beam.damping_ratio}]")
@click.option("--mass-ratio", type=float, help=f"Absorber mass over beam mass.  [default: {DEFAULT_MASS_RATIO}]")
@click.option("--gap", type=float, help=f"Clearance to either wall in m.  [default: {RigidWalls.gap}]")
@click.option("--restitution", type=float, help=f"Coefficient of restitution; below 1 exact orbits only.  [default: {RigidWalls.restitution}]")
@click.option("--friction-limit", type=float, help="Friction limit in N; 0: no friction.")
@click.option("--contact-stiffness", type=float, help="Makes the walls springs of this stiffness in N/m: harmonic balance only.")
@click.option("--friction-stiffness", type=float, help="Makes friction elastic with this stiffness in N/m.")
@click.option("--force", type=float, default=1.5, show_default=True, help="Amplitude of the harmonic force in N.")
@click.option("--resonance", type=int, default=1, show_default=True, help="Resonance, counted from 1, that frequencies refer to.")
@click.option("--from", "start", type=float, default=0.88, show_default=True, help="Lowest frequency over the resonance frequency.")
@click.option("--to", "stop", type=float, default=1.06, show_default=True, help="Highest frequency over the resonance frequency.")
@click.option("--method", type=click.Choice([EXACT, BALANCE, BOTH]), default=BOTH, show_default=True, help="Exact orbits, harmonic balance, both.")
@click.option("--pairs", is_flag=True, help="With the pairs of exact orbits without symmetry that leave the symmetric branches.")
@click.option("--harmonics", type=int, default=20, show_default=True, help="Highest harmonic of harmonic balance.")
@click.option("--weight", type=float, default=WEIGHT, show_default=True, help="Weight of the rigid contact in harmonic balance, in m_a omega_1^2.")
@click.option("--grounded-damper", is_flag=True, help=f"With the paper's damper of {PAPER_DAMPER} N s/m between absorber and ground (balance only).")
@click.option("--sweeps/--no-sweeps", default=True, show_default=True, help="With a sweep up and one down by the exact method.")
@click.option("--percent-per-100-periods", type=float, default=PAPER_RATE, show_default=True, help="Rate of the sweeps.")
@click.option("--json", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Write all curves, in SI units.")
@click.option("--csv", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Write a row for each point of a curve.")
@click.option("--figure", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Draw it: .png, .pdf or .svg.")
def main(**given: Any) -> None:
    """Follow all periodic responses over the frequency, and print their peaks and folds.

    Exact orbits are the symmetric ones with one impact a wall in each period; each point is confirmed by the exact method, which also gives its
    stability. Harmonic balance has the responses without impacts too. Ctrl-C writes what is known so far.
    """
    with plain_errors():
        for option, suffixes in (("json", (".json",)), ("csv", (".csv",)), ("figure", FIGURES)):
            check_target(f"--{option}", given[option], suffixes)
        given |= {"stiffness": None, "absorber_damping": None}
        refuse_parts(given)
        result = computed(given)
        files = written(result, given)
    click.echo(text(result))
    if files:
        name_files(files)
    end_early(result.complete)


if __name__ == "__main__":
    main(prog_name="scripts/run frequency_response")
