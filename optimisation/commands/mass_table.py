"""The best gap over the rule's for several masses of the absorber: what scripts/run mass_ratios computes and prints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impact_env.ensemble import Executor
from impact_env.modes import ModalModel
from optimisation.gap_check import GapCheck, check_gap, scaled_absorber
from optimisation.progress import runs_bar
from optimisation.report.markdown import markdown

MARKER = "masses"
RATIOS = (0.01, 0.02, 0.05, 0.1)
FACTORS = 1.12 ** np.arange(-8, 5.0)  # of the rule's gap, 12 % apart, from 0.40 to 1.57
FORCE = 1.0  # N: any would do, as gap and friction are in proportion to it


def checks(
    model: ModalModel,
    ratios: Sequence[float],
    resonances: Sequence[int],
    members: int,
    rate: float | None,
    threads: int | None,
    executor: Executor | None,
) -> list[GapCheck]:
    """Simulate the rule's gap and its neighbours for each mass ratio near each resonance, by mass. Raises KeyboardInterrupt if it is stopped."""
    found = []
    for ratio in ratios:
        for resonance in resonances:
            absorber = scaled_absorber(model, FORCE, resonance, ratio)
            given = {"members": members, "percent_per_100_periods": rate, "threads": threads, "executor": executor}
            with runs_bar(f"mass ratio {ratio:g}, resonance {resonance}") as show:
                check = check_gap(model, FORCE, resonance, absorber, factors=FACTORS, everywhere=True, progress=show, **given)  # type: ignore[arg-type]
            if not check.complete:
                raise KeyboardInterrupt
            found.append(check)
    return found


def _cells(check: GapCheck) -> tuple[str, ...]:
    best = check.best
    assert best is not None
    price = float(check.level[check.at_rule] / check.level[best])
    edge = " or less" if best == 0 else " or more" if best == len(check.gaps) - 1 else ""
    return (
        f"{100 * check.absorber.mass_ratio:g} %",
        str(check.resonance),
        f"{check.reach:.3g}",
        f"{check.gaps[best] / check.rule:.2f}{edge}",
        f"{100 * check.relative[best]:.1f}",
        f"{100 * check.relative[check.at_rule]:.1f}",
        f"{price:.2f}",
    )


def text(found: Sequence[GapCheck]) -> str:
    """Return a line for each mass and resonance."""
    header = ("mass ratio", "resonance", "free amplitude over gap", "best gap over the rule's")
    return markdown((*header, "level there, %", "level at the rule's, %", "rule's over best"), [_cells(check) for check in found])
