"""Level distributions of ensembles of different kinds, to explain the meaning of a band.

Members differ in the force's phase, by at most a millionth in its amplitude, or in both. A further
sample measures the share of the scatter that the phase explains.
"""

import itertools
from collections.abc import Iterator
from functools import partial
from operator import itemgetter
from typing import get_args

import numpy as np
import scipy.stats
from numpy.typing import ArrayLike

from impact_env import Beam, beam_scene
from impact_env.drive import PAPER_LIMITS, linear_sweep
from impact_env.ensemble import Lane, MemberKind, Members, draw_members, run_lanes
from optimisation.files import markdown
from studies.accuracy.cases import AccuracySettings, Cases, Row, kind_named, unique
from studies.study import Array

NAME = "bands"
KIND = "impact, e = 0.7, with friction"
MODES = 10
CROSSED = "phases x forces"
KINDS: tuple[MemberKind, ...] = get_args(MemberKind)
DIRECTIONS = ("up", "down")


def _plans(settings: AccuracySettings) -> Iterator[tuple[str, Members, int]]:
    """Yield kind, members, and the number of members that share a phase.

    No member belongs to two of the samples, since the statistical test between them requires
    independence.
    """
    for k, kind in enumerate(KINDS):
        yield kind, draw_members(settings.band_members + 1, settings.seed + k, kind)[1:], 1
    phases = settings.band_phases
    repeats = settings.band_repeats
    seed = settings.seed + len(KINDS)
    drawn = draw_members(phases + 1, seed, "phase").phases[1:]
    yield (
        CROSSED,
        Members(
            np.repeat(drawn, repeats), draw_members(phases * repeats + 1, seed, "force").factors[1:]
        ),
        repeats,
    )


key = itemgetter("direction", "kind")  # of a row: its case


def cases(settings: AccuracySettings) -> Cases:
    """Return a case for each direction and kind of members."""
    plans = itertools.product(DIRECTIONS, _plans(settings))
    return {
        (direction, name): partial(_measured, direction, name, members, shared)
        for direction, (name, members, shared) in plans
    }


def _measured(direction: str, name: str, members: Members, shared: int) -> list[Row]:
    """Return a row for each run of the exact method."""
    kind = kind_named(KIND)
    scene = beam_scene(Beam(modes=MODES), kind.absorber())
    limits = PAPER_LIMITS if direction == DIRECTIONS[0] else PAPER_LIMITS[::-1]
    schedule = linear_sweep(scene.model.resonance_omega(1), *limits)
    levels = run_lanes([Lane(scene, drive) for drive in members.drives(kind.force, schedule)])
    if not levels.complete:
        raise KeyboardInterrupt
    return [
        {
            "direction": direction,
            "kind": name,
            "member": m,
            "group": m // shared,
            "phase_rad": phase,
            "force_factor": factor,
            "level_m": level,
        }
        for m, (phase, factor, level) in enumerate(
            zip(
                *(values.tolist() for values in (members.phases, members.factors, levels.level)),
                strict=True,
            )
        )
    ]


def between_groups(values: ArrayLike) -> tuple[float, float, float]:
    """Return the share of the variance between groups, and its 95 % interval.

    ``values`` has the shape (groups, repeats).

    One-way random effects: the intraclass correlation ICC(1,1) (P. E. Shrout, J. L. Fleiss,
    Psychological Bulletin 86, 1979). It is near 0, and may be below, where the group does not
    matter.
    """
    rows = np.asarray(values, dtype=float)
    groups, repeats = rows.shape
    free = groups - 1, groups * (repeats - 1)
    between = repeats * float(np.var(rows.mean(axis=1), ddof=1))
    ratio = between / float(rows.var(axis=1, ddof=1).mean())
    ratios = (
        ratio,
        ratio / scipy.stats.f.ppf(0.975, *free),
        ratio * scipy.stats.f.ppf(0.975, *free[::-1]),
    )
    share, low, high = (float((r - 1) / (r + repeats - 1)) for r in ratios)
    return share, low, high


def _difference(one: Array, other: Array) -> str:
    """Return statistic and p-value of the two-sample Kolmogorov-Smirnov test."""
    result = scipy.stats.ks_2samp(one, other)
    return f"{result.statistic:.2f} ({result.pvalue:.1g})"


def band_table(rows: list[Row]) -> str:
    """Return a line for each direction and kind of members."""
    header = (
        "sweep",
        "members differ in",
        "runs",
        "median, mm",
        "5 to 95 %, mm",
        *(f"D (p) against {kind}" for kind in KINDS),
        "between phases",
    )
    lines = []
    for direction in unique(row["direction"] for row in rows):
        own = [row for row in rows if row["direction"] == direction]
        result = {
            kind: np.array([row["level_m"] for row in own if row["kind"] == kind])
            for kind in (*KINDS, CROSSED)
        }
        crossed = result.pop(CROSSED).reshape(
            len({row["group"] for row in own if row["kind"] == CROSSED}) or 1, -1
        )
        share = (
            "{:.0f} % ({:.0f} to {:.0f})".format(*(100 * x for x in between_groups(crossed)))
            if crossed.size
            else ""
        )
        for kind, levels in result.items():
            if levels.size:
                low, middle, high = 1e3 * np.quantile(levels, (0.05, 0.5, 0.95))
                tests = [
                    "" if name == kind or not other.size else _difference(levels, other)
                    for name, other in result.items()
                ]
                words = (
                    f"{middle:.4f}",
                    f"{low:.4f} to {high:.4f}",
                    *tests,
                    share if kind == KINDS[0] else "",
                )  # members that differ in both
                lines.append((direction, kind, str(len(levels)), *words))
    return markdown(header, lines)
