"""The gap by the design rule and its check by simulation: what scripts/run design_gap computes, prints and writes."""

from __future__ import annotations

from pathlib import Path

from impact_env.modes import ModalModel
from impact_env.parameters import SlidingAbsorber, positive
from optimisation.bounds import LARGE_REACH, SMALL_REACH, design_gap, expected_gap, require_reach
from optimisation.executors import workers
from optimisation.files import replacing, write_csv, write_json
from optimisation.gap_check import GapCheck, check_gap, gap_factors, sweep_limits
from optimisation.progress import sweeps_bar
from optimisation.sweep_rate import LEAST_RATIO, sweep_ratio

QUICK_GAPS, QUICK_MEMBERS = 5, 2
DEFAULT_GAPS = 11


def simulated(
    model: ModalModel,
    force: float,
    resonance: int,
    absorber: SlidingAbsorber,
    *,
    gaps: int,
    members: int,
    seed: int,
    rate: float,
    threads: int | None,
    cluster: str | None = None,
) -> GapCheck:
    """Simulate the rule's gap and its neighbours under a bar, on a ``cluster`` (host:port) if there is one; the rest as in `check_gap`."""
    factors = gap_factors(gaps)
    with workers(threads, cluster) as executor, sweeps_bar("simulating") as show:
        return check_gap(
            model,
            force,
            resonance,
            absorber,
            factors=factors,
            members=members,
            seed=seed,
            percent_per_100_periods=rate,
            threads=threads,
            progress=show,
            executor=executor,
        )


def answer(model: ModalModel, mass_ratio: float, force: float, resonance: int, rate: float) -> list[str]:
    """Return what is known without a simulation of the absorber; raises ParameterError where the rule says nothing."""
    mass = positive("mass_ratio", mass_ratio) * model.beam_mass
    rule, found = design_gap(model, mass, force, resonance), require_reach(model, mass, force, resonance)
    lines = [
        f"Design rule: a clearance of {1e3 * rule:.4g} mm to either wall for {force:g} N near resonance {resonance}.",
        f"Free amplitude over that gap: {found:.3g}.",
    ]
    expected = expected_gap(model, mass, force, resonance)
    lines.append(f"From simulations of other structures the best gap is expected at {1e3 * expected:.4g} mm, {expected / rule:.3g} times the rule's.")
    if found < SMALL_REACH:
        lines.append(f"Warning: below {SMALL_REACH:g} the rule's gap is too wide (docs/design_rule.md).")
    if found > LARGE_REACH:
        lines.append(f"Warning: above {LARGE_REACH:g} the rule's gap is too narrow, and that side is the steep one (docs/design_rule.md).")
    ratio = sweep_ratio(model, rate, resonance, sweep_limits(model, mass, resonance))
    lines.append(f"Sweeps at {rate:.3g} % per 100 pseudo periods show {ratio:.3f} of the stationary level without absorber.")
    if ratio < LEAST_RATIO:
        lines.append(f"Warning: below {LEAST_RATIO:g} shares of the possible are left out; sweep more slowly.")
    return lines


def write(out: Path, check: GapCheck) -> list[Path]:
    """Write the figure and the tables into a folder, and return the files."""
    from optimisation.report.gap_report import COLUMNS, rows, save_figure, summary  # matplotlib is slow to import

    files = [out / name for name in ("levels.csv", "summary.json", "levels.png")]
    write_csv(files[0], COLUMNS, rows(check))
    write_json(files[1], summary(check))
    with replacing(files[2]) as temporary:
        save_figure(temporary, check)
    return files
