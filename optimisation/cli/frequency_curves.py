"""What scripts/run frequency_response computes, prints and writes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from impact_env.drive import default_rate
from impact_env.ensemble import Executor
from impact_env.parameters import RigidWalls, positive, require
from impact_env.periodic.harmonic_balance import PAPER_DAMPER, harmonic_balance
from impact_env.periodic.overview import Asked, Overview, overview, sliding
from impact_env.periodic.response_curve import COLUMNS
from impact_env.periodic.stationary import StationaryRuns
from impact_env.plain import from_scene
from optimisation.cli.common import BadInput
from optimisation.cli.structure_option import is_given
from optimisation.cli.sweep_scene import make_scene
from optimisation.files import replacing, write_csv, write_json
from optimisation.pieces import Pieces
from optimisation.progress import Bar

FORCE = 1.5  # N, the paper's moderate level of excitation
FIGURES = (".png", ".pdf", ".svg")
EXACT, BALANCE, BOTH = "exact", "balance", "both"


@contextmanager
def following(reference: float) -> Iterator[Callable[[str, int, float], None]]:
    """Give a function that shows how far a curve has been followed, over a ``reference`` frequency in rad/s."""
    with Bar(total=None, bar_format="{desc} [{elapsed}]", leave=False) as bar:

        def show(label: str, points: int, omega: float) -> None:
            bar.set_description_str(f"{label}: {points} points, at {omega / reference:.4f}")
            bar.update()

        yield show


def computed(given: dict[str, Any], executor: Executor | None = None) -> Overview:
    """Do what the options ask for, the envelope's runs by an executor as in `run_lanes`.

    Raises BadInput or ParameterError before anything long is done.
    """
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
    rate = given["rate"]
    rate = default_rate(scene.model, (given["resonance"],)) if rate is None else rate
    asked = Asked(given["method"] != BALANCE, given["pairs"], balance, sweeps, rate, stationary_runs(given, executor))
    keep = Pieces(given["resume"], {"scene": from_scene(scene), "force": float(given["force"]), "reference": reference})
    with following(reference) as show:
        return overview(scene, given["force"], reference, low, high, asked, show, keep)


def stationary_runs(given: dict[str, Any], executor: Executor | None = None) -> StationaryRuns | None:
    """Return what the options say of the stationary responses, None if there are none; BadInput for options of theirs without --envelope."""
    if given["envelope"] is None:
        for name in ("members", "settle", "window", "approach", "threads", "cluster"):
            if is_given(name):
                raise BadInput(f"--{name} does not go without --envelope: it is about the runs of the envelope")
        return None
    lengths = given["members"], given["settle"], given["window"]
    return StationaryRuns(given["envelope"], *lengths, given["approach"], threads=given["threads"], executor=executor)


def written(result: Overview, given: dict[str, Any]) -> list[Path]:
    """Write the files that the options ask for, and return them."""
    files = []
    if given["json"] is not None:
        write_json(given["json"], result.to_plain())
        files.append(given["json"])
    if given["csv"] is not None:
        write_csv(given["csv"], COLUMNS, (row for number, curve in enumerate(result.curves, 1) for row in curve.rows(number)))
        files.append(given["csv"])
    if given["plot"] is not None:
        from optimisation.report.frequency_figure import save_figure  # matplotlib is slow to import

        with replacing(given["plot"]) as temporary:
            save_figure(temporary, result)
        files.append(given["plot"])
    return files
