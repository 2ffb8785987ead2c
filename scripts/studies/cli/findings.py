"""Results of the workbench for the paper's beam, as figures and tables of docs/findings.md.

They are best designs, optima, place, robustness and limits.
"""

# needs: optimise, cluster

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import click
import numpy as np

from impact_env.curve import DEFAULT_MEMBERS
from impact_env.drive import PAPER_RATE
from impact_env.ensemble import Executor
from optimisation.checkpoint import peak_memory
from optimisation.cli.common import cluster_option, command, seed_option, threads_option
from optimisation.cli.design_options import QUICK_MEMBERS, QUICK_SPEED
from optimisation.executors import executor
from optimisation.files import markdown, publication_folder, require_writable
from optimisation.measures import ratio_of_quantiles
from studies.findings import parts
from studies.findings.figures import FIGURES
from studies.findings.parts import FindingsSettings
from studies.study import (
    Json,
    Measurement,
    Part,
    Saver,
    Study,
    add_sources,
    format_table,
    make_whole_part,
    paths_next_to_page,
    run,
)

UNITS = {
    "gap": ("mm", 1e3),
    "friction_limit": ("N", 1.0),
    "restitution": ("", 1.0),
    "stiffness": ("N/m", 1.0),
    "damping": ("N s/m", 1.0),
}
SYMBOLS = {"restitution": "e", "friction_limit": "muN", "stiffness": "k", "damping": "c"}


def _percent(value: float | None, digits: int = 1) -> str:
    return "-" if value is None else f"{100 * value:.{digits}f}"


def _band(band: Sequence[float], scale: float = 100.0, form: str = ".1f") -> str:
    return f"{scale * band[0]:{form}} to {scale * band[1]:{form}}"


def _design(result: Json) -> str:
    """Return the free values; of several absorbers the number of each stands behind its names."""
    parts = []
    for name in result["problem"]["space"]["free"]:
        kind, _, which = name.rpartition("_") if name[-1].isdigit() else (name, "", "")
        unit, scale = UNITS.get(kind, ("", 1.0))
        symbol = SYMBOLS.get(kind, kind) + (f" {which}" if which else "")
        parts.append(
            (
                f"{symbol}{':' if which else ''} {scale * result['winner']['values'][name]:.3g} "
                f"{unit}"
            ).rstrip()
        )
    return ", ".join(parts)


def _judged(judged: Json) -> str:
    return f"{_percent(judged['score'][0])} ({_band(judged['score_5_to_95_percent'][0])})"


def _over(
    one: Json,
    other: Json,
    digits: int,
    names: tuple[str, str] = ("members_winner", "members_winner"),
) -> str:
    """Return one judged level over another, ratio of the medians with its 95 % interval."""
    members = [
        np.array(result[name], dtype=float)
        for result, name in zip((one, other), names, strict=True)
    ]
    gain = ratio_of_quantiles(members[0], members[1])
    return f"{gain.ratio:.{digits}f} ({_band((gain.low, gain.high), 1.0, f'.{digits}f')})"


def _gain(result: Json, digits: int = 3) -> str:
    return _over(result, result, digits, ("members_winner", "members_paper"))


def _list_other_findings(result: Json) -> Iterator[str]:
    """Yield notes on a winner other than its level.

    They concern branches of its members, bounds that it lies at, and its level with more modes.
    """
    for condition in result["conditions"]:
        for name, label in (("winner", "the found"), ("paper", "the paper's")):
            two = condition[name]["branches"]
            if two is not None:
                pairs = zip(two["relative"], two["shares_of_members"], strict=True)
                low, high = (
                    f"{_percent(level)} % ({_percent(share, 0)} % of the members)"
                    for level, share in pairs
                )
                yield (
                    f"near resonance {condition['resonance']} {label} has two branches, {low} and "
                    f"{high}"
                )
    yield from (f"it lies at a bound, {line}" for line in result["winner_at_bounds"])
    wider = result.get("with_more_modes")
    if wider is not None:
        change = wider["change"]
        yield (
            f"with {wider['modes']} modes its level is {change['ratio']:.3f} "
            f"({_band(change['95_percent'], 1.0, '.3f')}) times that"
        )


def _besides(named: Mapping[str, Json]) -> str:
    """Return a list of `_list_other_findings`, by name."""
    lines = [
        f"- *{name}*: {'; '.join(remarks)}."
        for name, result in named.items()
        if (remarks := list(_list_other_findings(result)))
    ]
    return "\n\n" + "\n".join(lines) if lines else ""


def _concepts(result: Json) -> str:
    header = (
        "concept",
        "found from scratch",
        "worse of both, %",
        "the paper's choice, %",
        "found over paper's",
        "first, %",
        "second, %",
        "share, %",
    )
    rows = []
    searches = []
    best = result["impact"]
    for concept, results in result.items():
        winners = [condition["winner"] for condition in results["conditions"]]
        shares = " and ".join(
            _percent(winner["share_of_possible_reduction"], 0) for winner in winners
        )
        levels = (_percent(winner["relative"]) for winner in winners)
        rows.append(
            (
                concept,
                _design(results),
                _judged(results["winner"]),
                _judged(results["paper"]),
                _gain(results),
                *levels,
                shares,
            )
        )
        searches.append(
            f"{concept} {results['designs']} designs, {results['problem']['members']} members"
        )
    others = [
        f"{_over(results, best, 2)} times for the concept {concept}"
        for concept, results in result.items()
        if results is not best
    ]
    text = (
        "The worse level over that of the impact absorber found, ratio of the medians with its "
        f"95 % interval: {'; '.join(others)}."
    )
    return f"{markdown(header, rows)}\n\n{text} Searches: {', '.join(searches)}." + _besides(result)


def _optima(result: Json) -> str:
    friction = {
        "friction damper at": "resonance {resonance}, {force_n:g} N",
        "found, N": "{winner[values][friction_limit]:.3g}",
        "energy argument, N": "{argued_n:.3g}",
        "paper, N": "{paper[values][friction_limit]:g}",
        "level found, %": "{level}",
        "with the paper's, %": "{papers}",
        "found over paper's": "{gain}",
    }
    impact = {
        "impact absorber at": "resonance {resonance}",
        "best force for 1 mm, N": "{best_force_n:.3g} ({band})",
        "rule, N": "{rule_force_n:.3g}",
        "paper, N": "{force_n:g}",
        "found for that force": "{design}",
        "rule's gap, mm": "{gap_mm:.3g}",
        "level, %": "{level}",
        "paper's, %": "{papers}",
        "found over paper's": "{gain}",
    }

    def to_row(result: Json, digits: int = 3) -> Json:
        return {
            **result,
            "level": _judged(result["winner"]),
            "papers": _judged(result["paper"]),
            "gain": _gain(result, digits),
        }

    dampers = format_table(friction, map(to_row, result["friction"]))
    absorbers = [
        to_row(x, 2)
        | {
            "band": _band(x["best_force_5_to_95_percent_n"], 1.0, ".3g"),
            "design": _design(x),
            "gap_mm": 1e3 * x["rule_gap_m"],
        }
        for x in result["impact"]
    ]
    besides = _besides({f"Resonance {x['resonance']}": x for x in result["impact"]})
    return f"{dampers}\n\n{format_table(impact, absorbers)}{besides}"


def _place(result: Json) -> str:
    levels_of = ("worse of both, %", "limit, %", "first alone, %", "second alone, %")
    header = ("position x/l", "mass ratio to mode 1", "to mode 2", "best gap, mm", *levels_of)
    rows = []
    for x, shapes, *both in zip(
        *(result[name] for name in ("positions", "shapes", "relative", "limit")), strict=True
    ):
        levels, bounds = map(np.array, both)
        best = int(levels.max(axis=1).argmin())
        ratios = [f"{result['mass_kg'] * shape**2:.4f}" for shape in shapes]
        cells = [_percent(v) for v in (levels[best].max(), bounds[best].max(), *levels.min(axis=0))]
        rows.append((f"{x:g}", *ratios, f"{1e3 * result['gaps_m'][best]:.2f}", *cells))
    results = result["free"]
    place = results["winner"]["values"]["position"]
    text = (
        f"With the position free among four variables the search ends at x/l = {place:.3g} "
        f"({_design(results)}): {_judged(results['winner'])} %."
    )
    return f"{markdown(header, rows)}\n\n{text}"


def _robustness(result: Json) -> str:
    detunings = result["designs"][0]["detuning"]
    visible = sorted(
        {0, len(detunings) // 4, len(detunings) // 2, -1 - len(detunings) // 4, -1},
        key=lambda k: k % len(detunings),
    )
    rows = []
    for x in result["designs"]:
        relative = [
            level / without for level, without in zip(x["median"], x["without"], strict=True)
        ]
        rows.append(
            (
                f"{x['concept']}, {x['name']}",
                *(_percent(relative[k]) for k in visible),
                _percent(max(relative)),
            )
        )
    return markdown(
        ("level, %", *(f"{100 * detunings[k]:+.1f} %" for k in visible), "largest"), rows
    )


def _front(result: Json) -> str:
    columns = {
        "seed": "{seed}",
        "NSGA-II": "{method:.4f}",
        "random search": "{random:.4f}",
        "difference, %": "{off:+.1f}",
    }
    seeds = [{**x, "off": 100 * (x["method"] / x["random"] - 1)} for x in result["against_random"]]
    won = result["seeds_won_against_random"]
    text = (
        f"{result['designs']} designs each. NSGA-II has the larger hypervolume in {won} of "
        f"{len(seeds)} seeds."
    )
    figure = (
        "![Level at the second resonance over that at the first: all designs, the front, the "
        "paper's design, limits](findings/front.png)"
    )
    return "\n\n".join([format_table(columns, seeds), text, figure])


def _scaling(result: Json) -> str:
    rows = []
    for kind, speedup in result["speedup"].items():
        one, two = (x["seconds"] for x in result["rows"] if x["kind"] == kind)
        rows.append((kind, f"{one:.2f}", f"{two:.2f}", f"{speedup:.2f}"))
    text = (
        f"{result['designs']} random designs, {result['runs']} sweeps; median of three rounds in "
        "turn."
    )
    return markdown(("workers", "one, s", "two, s", "times as fast"), rows) + "\n\n" + text


def _full(result: Json) -> str:
    behind = result["left_behind"]
    what = (
        f"{result['variables']} variables, {result['designs']} designs, {result['members']} "
        f"members, both directions, {result['modes']} modes"
    )
    rows = [
        ("study", what),
        ("sweeps", f"{result['runs']:,}"),
        ("time of the search", f"{result['search_s']:.0f} s"),
        ("with judging and audit", f"{result['with_judging_s']:.0f} s"),
        ("share of the search outside the runs", f"{_percent(result['overhead'])} %"),
        ("largest resident memory", f"{result['memory_bytes'] / 2**30:.2f} GiB"),
        (
            "rejected designs, run in full, that beat the best found",
            f"{behind['better_than_best_found']} of {behind['run_in_full']}",
        ),
        (
            "winner, worse of both resonances",
            f"{_percent(result['score'])} ({_band(result['score_5_to_95_percent'])}) %",
        ),
    ]
    return markdown(("", "value"), rows)


NAME = "findings"
QUICK_OUT = Path("results/findings")
OUT = publication_folder(Path("docs"), QUICK_OUT)
JOURNALS = Path("results/findings/journals")
# odd: the study's own force is one of the points
DESIGNS = 160
FEW = 4
POINTS = 13
QUICK_DESIGNS = 20
QUICK_POINTS = 6


def settings(quick: bool, executor: Executor, seed: int, out: Path) -> FindingsSettings:
    """Return the size of the searches, with the folder of their journals.

    With the journals the same command continues after an interruption.
    """
    journals = JOURNALS / ("quick" if quick else "full") / str(seed)
    data = out / NAME
    sizes = (
        (QUICK_DESIGNS, QUICK_MEMBERS, QUICK_MEMBERS, QUICK_POINTS)
        if quick
        else (DESIGNS, DEFAULT_MEMBERS, FEW, POINTS)
    )
    return FindingsSettings(
        executor,
        journals,
        *sizes,
        data,
        (QUICK_SPEED if quick else 1.0) * PAPER_RATE,
        seed,
        quick=quick,
    )


# a title, what measures it, what tells it
PARTS: dict[str, tuple[str, Callable[[FindingsSettings], Json], Callable[[Json], str]]] = {
    "concepts": ("the best design of each concept for two resonances", parts.concepts, _concepts),
    "optima": (
        "the best friction limit, gap and force at each resonance alone",
        parts.optima,
        _optima,
    ),
    "place": ("where along the beam", parts.place, _place),
    "robustness": ("a beam that is not what it was thought to be", parts.robustness, _robustness),
    "front": ("first against second resonance", parts.front, _front),
    "scaling": ("one worker and two", parts.scaling, _scaling),
    "full": ("a study of full size", parts.full, _full),
}


def _part(name: str) -> Part[FindingsSettings]:
    marker = f"{NAME}:{name}"
    title, compute, words = PARTS[name]

    def drawn(measured: Measurement) -> dict[str, Saver]:
        return {name: lambda path: FIGURES[name](path, measured.values)} if name in FIGURES else {}

    text = add_sources(lambda measured: words(measured.values))
    return make_whole_part(name, f"{name}: {title}", compute, text, marker, figures=drawn)


STUDY: Study[FindingsSettings] = Study(
    tuple(map(_part, PARTS)),
    notes=lambda options: {
        "memory_bytes": peak_memory(),
        "quick": options.quick,
        "seed": options.seed,
    },
    stopped_message="finished parts are written; the same command goes on from here.",
)


@command()
@click.option(
    "--part",
    "parts",
    type=click.Choice(list(PARTS)),
    multiple=True,
    help="Part to do; may be repeated.  [default: all]",
)
@click.option(
    "--quick",
    is_flag=True,
    help=(
        f"A look: few designs, fast sweeps, into {QUICK_OUT} unless told otherwise; the numbers "
        "mean little."
    ),
)
@seed_option
@threads_option
@cluster_option
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help=f"Folder for findings.md and its folder findings.  [default: {OUT}]",
)
@click.option(
    "--redraw",
    is_flag=True,
    help="Draw figures and tables again from the numbers in the folder; nothing is computed.",
)
def main(
    parts: tuple[str, ...],
    quick: bool,
    seed: int,
    threads: int | None,
    cluster: str | None,
    out: Path | None,
    redraw: bool,
) -> None:
    """Search, judge and explain the best absorbers for the paper's beam.

    The command writes docs/findings.md with its figures and tables.

    The text of the page is written by hand; what stands between markers is written by this command.
    Ctrl-C ends a part; finished parts are written, and the same command goes on inside the searches
    of the other.
    """
    out = out or (QUICK_OUT if quick else OUT)
    with executor(threads, None if redraw else cluster) as where:
        options = settings(quick, where, seed, out)
        require_writable("results", options.folder)
        run(STUDY, options, paths_next_to_page(out, NAME, out / NAME), only=parts, redraw=redraw)
