"""Results of training: learning curves and a table.

A curve is the evaluation score of an algorithm over the steps.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from optimisation.report.report import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PINK,
    SKY,
    YELLOW,
    draw_grid,
    draw_legend,
    figure_of,
    write_figure,
)
from optimisation.rl.agents import Run

Array = NDArray[np.float64]
COLOURS = {"ppo": BLUE, "sac": ORANGE, "rppo": SKY, "rpi": PINK}
LINES = (GREY, BLACK, GREEN, YELLOW, GREY)
STYLES = (":", "--", "-.", (0, (5, 1)), (0, (1, 1)))
COLUMNS = ("algorithm", "seed", "leg", "steps", "score", "iqm", "low", "high", "intervals")
HEADER = ("agent", "seeds", "steps", "score (IQM over seeds)", "worst seed", "best seed")


def by_algorithm(runs: Sequence[Run]) -> dict[str, list[Run]]:
    """Return the runs that have an evaluation, by algorithm."""
    groups: dict[str, list[Run]] = {}
    for run in runs:
        if run.evaluations:
            groups.setdefault(run.algorithm, []).append(run)
    return groups


def curves(runs: Sequence[Run]) -> tuple[Array, Array]:
    """Return steps (n,) and mean evaluation scores (runs, n).

    They end at the last evaluation that all runs have.
    """
    length = min(len(run.evaluations) for run in runs)
    steps = np.array([evaluation.steps for evaluation in runs[0].evaluations[:length]], dtype=float)
    return steps, np.array(
        [[evaluation.score for evaluation in run.evaluations[:length]] for run in runs]
    )


def save_learning_curve(
    path: Path, title: str, runs: Sequence[Run], baselines: Mapping[str, float]
) -> None:
    """Draw evaluation scores over the steps, with the baselines.

    Each seed has a thin line. Each algorithm has the mean of the middle half of its seeds, and a
    band of 10 to 90 % of them.
    """
    figure, panel = figure_of(7.4, 4.9)
    ends = [
        score for name, score in baselines.items() if name != "random"
    ]  # chance may lie so far below that nothing else could be told apart
    for algorithm, group in sorted(by_algorithm(runs).items()):
        steps, scores = curves(group)
        colour = COLOURS.get(algorithm, BLACK)
        panel.plot(steps, scores.T, color=colour, lw=0.5, alpha=0.35)
        if len(group) > 1:
            low, high = np.percentile(scores, (10, 90), axis=0)
            panel.fill_between(steps, low, high, color=colour, alpha=0.15, lw=0)
        panel.plot(
            steps,
            scipy.stats.trim_mean(scores, 0.25, axis=0),
            color=colour,
            lw=2.2,
            label=f"{algorithm.upper()}, {_seeds(len(group))}",
        )
        ends += [float(scores[:, -1].max()), float(np.median(scores))]
    for (name, score), colour, style in zip(baselines.items(), LINES, STYLES, strict=False):
        panel.axhline(score, color=colour, ls=style, lw=1.3, label=f"{name}, {score:.3f}")
    if ends:
        margin = 0.08 * (max(ends) - min(ends)) or 0.01
        panel.set_ylim(min(ends) - margin, max(ends) + margin)
    panel.set(
        xlabel="steps of the environment",
        ylabel="mean score on the evaluation seeds",
        title=title,
        xlim=(0, None),
    )
    panel.xaxis.set_major_formatter(lambda x, _: f"{x:,.0f}")
    draw_grid(panel)
    draw_legend(figure, panel, 3)
    write_figure(figure, path)


def _seeds(count: int) -> str:
    return "1 seed" if count == 1 else f"{count} seeds"


def learning_rows(runs: Sequence[Run]) -> list[list[object]]:
    """Return every evaluation of every run, under `COLUMNS`."""
    return [
        [run.algorithm, run.seed, *vars(evaluation).values()]
        for run in runs
        for evaluation in run.evaluations
    ]


def table_rows(runs: Sequence[Run], baselines: Mapping[str, float]) -> list[tuple[str, ...]]:
    """Return the lines of the table under `HEADER`.

    They are the baselines, followed by the algorithms at the last evaluation that all their seeds
    have.
    """
    rows: list[tuple[str, ...]] = [
        (name, "", "", f"{score:.4f}", "", "")
        for name, score in sorted(baselines.items(), key=lambda entry: entry[1])
    ]
    for algorithm, group in sorted(by_algorithm(runs).items()):
        steps, scores = curves(group)
        last = scores[:, -1]
        numbers = (
            f"{scipy.stats.trim_mean(last, 0.25):.4f}",
            f"{last.min():.4f}",
            f"{last.max():.4f}",
        )
        rows.append((algorithm.upper(), str(len(group)), f"{steps[-1]:,.0f}", *numbers))
    return rows
