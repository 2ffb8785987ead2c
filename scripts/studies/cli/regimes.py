"""Regimes of a response: duration of impacts, jumps of sweeps, kinds of motion.

The study measures how long impacts last at each frequency, predicts P(jump) of a sweep from that,
and finds where the response is periodic and where chaotic.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import click
import numpy as np
from matplotlib.axes import Axes

from impact_env.checks import positive, require
from impact_env.ensemble import Executor
from impact_env.periodic.residence import ExitRate, Hazard, Jumps, Range, hazard
from impact_env.periodic.stationary import ResponseKind
from optimisation.checkpoint import sources
from optimisation.cli.common import BadInput, cluster_option, command, seed_option, threads_option
from optimisation.cli.scene_options import (
    SLIDING_VALUES,
    SceneOptions,
    make_scene,
    refuse_parts,
    structure_option,
)
from optimisation.executors import workers
from optimisation.files import markdown, publication_folder
from optimisation.report.report import figure_of, write_figure
from studies.regimes.measured import (
    RESPONSE,
    STAY,
    SWEEP,
    WAYS,
    Key,
    RegimeCase,
    RegimeSettings,
    Row,
    cases,
    grid,
    jump_cases,
    key,
    kind_cases,
)
from studies.study import (
    CsvTable,
    Json,
    Measurement,
    OutputPaths,
    Part,
    Saver,
    Study,
    make_rows_part,
    paths_next_to_page,
    run,
)

NAMES = {
    ResponseKind.LINEAR: "no impacts",
    ResponseKind.PERIODIC: "periodic",
    ResponseKind.SUSTAINED: "sustained",
    ResponseKind.MODULATED: "strongly modulated",
}


def of_case(rows: list[Row], what: str, case: str) -> list[Row]:
    """Return a case's rows of one sort."""
    return [row for row in rows if (row["what"], row["case"]) == (what, case)]


def names(rows: list[Row]) -> list[str]:
    """Return the names of cases, in the order of the rows."""
    return list(dict.fromkeys(row["case"] for row in rows))


def hazard_of(stays: list[Row], first: float = np.inf, last: float = -np.inf) -> Hazard | None:
    """Return the integral of the exit rates between two frequency ratios.

    It is None if fewer than two frequencies have a rate.
    """
    earlier = [row for row in stays if row["rate"] is not None and last <= row["at"] <= first]
    if len(earlier) < 2:
        return None
    rates = [
        ExitRate(row["exits"], row["exposure"], row["rate"], row["low"], row["high"])
        for row in earlier
    ]
    return hazard([row["at"] for row in earlier], rates)


RATES_ON_PAGE = 8  # frequencies of a case's rates on the page


def stay_table(stays: list[Row]) -> str:
    """Return lines for some of the frequencies, evenly chosen; the CSV file has all."""
    step = max(1, len(stays) // RATES_ON_PAGE)
    lines = []
    for row in stays[::step]:
        rates = (
            ("", "")
            if row["rate"] is None
            else (f"{1e4 * row['rate']:.3g}", f"{1e4 * row['low']:.2g} to {1e4 * row['high']:.2g}")
        )
        late = (
            f"{1e4 * row['late_exits'] / row['late_exposure']:.3g}" if row["late_exposure"] else ""
        )
        pause = "" if row["longest_pause"] is None else f"{row['longest_pause']:.1f}"
        lines.append(
            (
                f"{row['at']:g}",
                str(row["runs"] - row["absent"]),
                str(row["exits"]),
                *rates,
                late,
                pause,
                str(row["returned"]),
            )
        )
    header = (
        "frequency ratio",
        "runs there",
        "exits",
        "rate, 1e-4 per pseudo period",
        "95 %",
        "later rate",
        "longest pause",
        "returned",
    )
    return markdown(header, lines) + (
        ""
        if step == 1
        else f"\n\nAll {len(stays)} frequencies: [jump_stay.csv](regimes/jump_stay.csv)."
    )


def sweep_table(sweeps: list[Row], result: Hazard | None) -> str:
    """Return a line for each slowness: measured beside predicted."""
    lines = []
    for row in sweeps:
        columns = (
            "{:.3f}|{:.3f} to {:.3f}".format(*result.probability(row["at"])).split("|")
            if result is not None
            else ("", "")
        )
        share = "" if row["share"] is None else f"{row['share']:.3f}"
        high_level = "" if row["high_level"] is None else f"{row['high_level'] / row['runs']:.3f}"
        lines.append(
            (
                f"{row['at']:g}",
                *columns,
                share,
                f"{row['low']:.3f} to {row['high']:.3f}",
                f"{row['jumped']} of {row['present']}",
                high_level,
            )
        )
    header = (
        "pseudo periods per 1 %",
        "P(jump) predicted",
        "95 %",
        "measured",
        "95 %, Wilson",
        "runs",
        "level above the limit, of all",
    )
    return markdown(header, lines)


def about(result: Hazard | None) -> str:
    """Return the text below the table: the exit rates in words."""
    if result is None:
        return "Fewer than two frequencies have a rate: no prediction."
    reach = f"Integral of the rate from {result.first:g} to {result.last:g}: "
    if result.value == 0:
        return f"{reach}no run left."
    inverse = f"exp(-N/{1 / result.value:.0f})"
    interval = f"(95 %: {1 / result.high:.0f} to {1 / result.low:.0f})"
    if result.factor == 1:
        return f"{reach}P(jump) = {inverse} {interval}."
    factor = (
        f"A = {result.factor:.3f} (95 %: {result.factor_low:.3f} to {result.factor_high:.3f}) "
        "from the sweeps"
    )
    return f"{reach}P(jump) = A {inverse} {interval}, {factor}."


def with_sweeps(result: Hazard | None, sweeps: list[Row]) -> Hazard | None:
    """Return the hazard with the factor estimated from sweeps.

    Unchanged without suitable sweeps.
    """
    measured = {row["at"]: Jumps(row["jumped"], row["present"], row["runs"]) for row in sweeps}
    informative = [one for one in measured.values() if 0 < one.jumped < one.present]
    return result.with_sweeps(measured) if result is not None and informative else result


def ways_table(rows: list[Row], case: str) -> str:
    """Return a line for each slowness and way of sweeps through one range.

    Measured jumps are compared with the prediction from constant frequencies. The text is empty if
    there are no sweeps.
    """
    lines = []
    for row in (row for way in WAYS for row in of_case(rows, way, case)):
        high = max(row["first"], row["last"])
        low = min(row["first"], row["last"])
        rates = hazard_of(of_case(rows, STAY, case), high, low)
        share = row["left"] / row["present"]
        predicted = 0.0 if rates is None else row["at"] * rates.value
        measured = -np.log1p(-share)
        error = np.sqrt(share / (1 - share) / row["present"])
        cells = (
            f"{predicted:.4f}",
            f"{measured:.4f}",
            f"{measured - predicted:+.4f} +- {error:.4f}",
        )
        lines.append(
            (
                f"{row['what']}, {row['first']:g} to {row['last']:g}",
                f"{row['at']:g}",
                f"{row['left']} of {row['present']}",
                *cells,
            )
        )
    header = (
        "sweep",
        "pseudo periods per 1 %",
        "left",
        "exits predicted by the rates",
        "measured, -log of the share that stays",
        "excess",
    )
    return markdown(header, lines) if lines else ""


def pattern(row: Row) -> str:
    """Return the kinds of response at a frequency, each with its share.

    Periodic responses are given by their multiple of the force's period.
    """
    shares = {NAMES[ResponseKind.LINEAR]: row[ResponseKind.LINEAR.value]} | {
        f"period {multiple}": number for multiple, number in row["multiples"].items()
    }
    shares |= {
        NAMES[kind]: row[kind.value] for kind in (ResponseKind.SUSTAINED, ResponseKind.MODULATED)
    }
    return ", ".join(
        f"{name} {100 * number / row['runs']:.0f} %" for name, number in shares.items() if number
    )


# what is told of the responses: factor and digits
SHARES = ("absorber_share", "impact_loss", "friction_loss")
SPANS = (
    ("impacts_per_period", 1, "{:.2f}"),
    ("depth", 1, "{:.2f}"),
    *((name, 100, "{:.0f}") for name in SHARES),
    ("peak_50", 1e3, "{:.3f}"),
)


def kind_table(rows: list[Row]) -> str:
    """Return a line for each stretch of frequencies with the same kinds in the same shares."""
    lines = []
    for words, group_rows in groupby(rows, key=pattern):
        group = list(group_rows)
        first = group[0]["at"]
        last = group[-1]["at"]
        at = f"{first:g}" if first == last else f"{first:g} to {last:g}"
        lines.append((at, words, *(_span(group, *span) for span in SPANS)))
    header = (
        "frequency ratio",
        "kinds",
        "impacts per period",
        "depth",
        "absorber's energy, %",
        "impact losses, %",
        "friction losses, %",
        "peak, mm",
    )
    return markdown(header, lines)


def _span(group: list[Row], name: str, factor: float, form: str) -> str:
    low, high = (form.format(factor * f(row[name] for row in group)) for f in (min, max))
    return low if low == high else f"{low} to {high}"


def slownesses(rows: list[Row], case: str) -> list[Row]:
    """Return a case's sweeps, the fastest first."""
    return sorted(of_case(rows, SWEEP, case), key=lambda row: row["at"])


NAME = "regimes"
QUICK_OUT = Path("results/regimes")
OUT = publication_folder(Path("docs"), QUICK_OUT)
JUMP = "jump"
KINDS = "kinds"
NUMBERS = ("stay_members", "sweep_members", "kind_members", "seed")
TIMES = ("stay_periods", "burn_in", "silence", "settle", "window")


def place(out: Path, own: bool) -> OutputPaths:
    """Return the paths of the results.

    The page goes into the folder ``out``, and all other files into its subfolder regimes. For a
    scene of the user (``own``) all files go into ``out``, without a page.
    """
    return OutputPaths(out) if own else paths_next_to_page(out, NAME, out / NAME)


def _jump_words(rows: list[Row]) -> list[str]:
    blocks = []
    for case in names(rows):
        stays = of_case(rows, STAY, case)
        sweeps = slownesses(rows, case)
        result = with_sweeps(hazard_of(stays), sweeps)
        tables = (
            sweep_table(sweeps, result) if sweeps else "",
            ways_table(rows, case),
            stay_table(stays) if stays else "",
        )
        blocks += [f"**{case}.** {about(result)}", *filter(None, tables)]
    return blocks


def _kind_words(rows: list[Row]) -> list[str]:
    return [
        words
        for case in names(rows)
        for words in (f"**{case}**", kind_table(of_case(rows, RESPONSE, case)))
    ]


def _tables(measured: Measurement, name: str) -> list[CsvTable]:
    rows: list[Row] = measured.values["rows"]
    result = []
    for what in dict.fromkeys(row["what"] for row in rows if row["what"] not in WAYS):
        own = [row for row in rows if row["what"] == what]
        columns = [column for column in own[0] if column != "what"]
        cells = [[row[column] for column in columns] for row in own]
        words = [
            [
                " ".join(f"{k}:{v}" for k, v in x.items())
                if isinstance(x, dict)
                else ""
                if x is None
                else x
                for x in line
            ]
            for line in cells
        ]
        result.append(CsvTable(f"{name}_{what}", columns, words))
    return result


def _part(
    name: str,
    title: str,
    cases: Callable[[RegimeSettings], Mapping[Key, Callable[[], list[Row]]]],
    words: Callable[[list[Row]], list[str]],
    save: Callable[[Path, list[Row]], None],
) -> Part[RegimeSettings]:
    def text(measured: Measurement) -> str:
        made = f"{sources(measured.conditions)} {measured.conditions['wall_s']:g} s." + (
            "" if measured.complete else " Stopped early."
        )
        return "\n\n".join([*words(measured.values["rows"]), made])

    def figures(measured: Measurement) -> dict[str, Saver]:
        return {name: lambda path: save(path, measured.values["rows"])}

    return make_rows_part(
        name,
        title,
        cases,
        key,
        text,
        f"{NAME}:{name}",
        tables=partial(_tables, name=name),
        figures=figures,
    )


def _notes(settings: RegimeSettings) -> Json:
    words = [
        f"{case.name}: {case.scene}, {case.force:g} N, by {case.approach_ratio:g}"
        for case in settings.cases
    ]
    return {
        "cases": words,
        **{name: getattr(settings, name) for name in (*NUMBERS, "quick", *TIMES)},
    }


COLOURS = {
    ResponseKind.LINEAR: "#BBBBBB",
    ResponseKind.PERIODIC: "#0072B2",
    ResponseKind.SUSTAINED: "#E69F00",
    ResponseKind.MODULATED: "#CC3311",
}
DPI = 110


def save_jump(path: Path, rows: list[Row]) -> None:
    """Draw exit rates over the frequency, and jumps over the slowness.

    Each case has a row.
    """
    visible = names(rows)
    figure, panels = figure_of(11, 4.2 * len(visible), len(visible), 2)
    for case, (rates, jumps) in zip(visible, np.atleast_2d(panels), strict=True):
        _rates(rates, [row for row in of_case(rows, STAY, case) if row["rate"] is not None])
        rates.set(
            xlabel="frequency over the resonance's",
            ylabel=r"rate of leaving, $10^{-4}$ per pseudo period",
        )
        rates.set_title(f"{case}: constant frequencies")
        _jumps(jumps, slownesses(rows, case), of_case(rows, STAY, case))
        jumps.set(
            xlabel="pseudo periods per 1 %",
            ylabel="share that jumps",
            title=f"{case}: sweeps",
            ylim=(-0.02, 1.02),
        )
    write_figure(figure, path, DPI)


def _bars(
    panel: Axes, x: list[float], rows: list[Row], value: str, label: str, scale: float = 1.0
) -> None:
    y, low, high = (
        scale * np.array([row[name] for row in rows]) for name in (value, "low", "high")
    )
    panel.errorbar(
        x, y, [y - low, high - y], fmt="o", ms=4, color="#0072B2", lw=1, capsize=2, label=label
    )


def _rates(panel: Axes, rows: list[Row]) -> None:
    if rows:
        _bars(
            panel, [row["at"] for row in rows], rows, "rate", "exits over time at risk, 95 %", 1e4
        )
        panel.margins(y=0.14)
        panel.legend(frameon=False, loc="upper left")
    panel.grid(True, color="0.9", lw=0.6)


def _jumps(panel: Axes, sweeps: list[Row], stays: list[Row]) -> None:
    measured = [row for row in sweeps if row["share"] is not None]
    result = with_sweeps(hazard_of(stays), sweeps)
    if measured and result is not None:
        n = np.geomspace(measured[0]["at"] / 2, measured[-1]["at"] * 2, 200)
        curve = np.array([result.probability(each) for each in n]).T
        panel.plot(
            n,
            curve[0],
            color="0.2",
            lw=1.2,
            label=f"{result.factor:.3f} exp(-N integral of the rate)",
        )
        panel.fill_between(n, curve[1], curve[2], color="0.85", lw=0)
    if measured:
        _bars(panel, [row["at"] for row in measured], measured, "share", "measured, 95 %")
        panel.legend(frameon=False)
    panel.set_xscale("log")
    panel.grid(True, color="0.9", lw=0.6)


def save_kinds(path: Path, rows: list[Row]) -> None:
    """Draw the shares of the members' kinds of response, and below them the envelope.

    Both are over the frequency. Each case has a column.
    """
    visible = names(rows)
    figure, panels = figure_of(6.5 * len(visible), 7, 2, len(visible), sharex="col")
    for case, (top, bottom) in zip(visible, panels.T, strict=True):
        own = of_case(rows, RESPONSE, case)
        x = np.array([row["at"] for row in own])
        shares = [[row[kind.value] / row["runs"] for row in own] for kind in ResponseKind]
        top.stackplot(
            x,
            shares,
            labels=[NAMES[kind] for kind in ResponseKind],
            colors=[COLOURS[kind] for kind in ResponseKind],
            step="mid",
        )
        top.set(ylabel="share of members", title=case, ylim=(0, 1))
        low, middle, high = (
            1e3 * np.array([row[name] for row in own]) for name in ("peak_5", "peak_50", "peak_95")
        )
        bottom.fill_between(x, low, high, color="0.85", lw=0, label="5 to 95 %")
        bottom.plot(x, middle, color="#0072B2", lw=1.2, label="median")
        bottom.set(
            xlabel="frequency over the resonance's",
            ylabel=r"largest $|q_\mathrm{tip}|$ of a period in mm",
        )
        bottom.set_xlim(x[0], x[-1])
        bottom.legend(frameon=False)
        bottom.grid(True, color="0.9", lw=0.6)
    figure.legend(
        *panels[0, 0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=len(ResponseKind),
        frameon=False,
    )
    write_figure(figure, path, DPI)


STUDY: Study[RegimeSettings] = Study(
    (
        _part(JUMP, "how long impacts last, and the jump", jump_cases, _jump_words, save_jump),
        _part(KINDS, "kinds of response over the frequency", kind_cases, _kind_words, save_kinds),
    ),
    notes=_notes,
    same=("processor", "versions", "cases", *NUMBERS, *TIMES),
)


OWN = ("scene", "structure", "modes", "damping", *SLIDING_VALUES, "force")
QUICK = {
    "stay_members": 10,
    "stay_periods": 1000.0,
    "sweep_members": 10,
    "kind_members": 4,
    "settle": 200.0,
    "window": 60,
    "quick": True,
}
FAST = 300.0  # pseudo periods per percent: slower sweeps are left out of a quick look


def is_own(settings: dict[str, Any]) -> bool:
    """Return whether options describe a scene of one's own."""
    return any(settings[name] is not None for name in OWN)


def own_case(settings: dict[str, Any]) -> RegimeCase:
    """Return the case that the options describe. Raises BadInput or ParameterError."""
    options = SceneOptions(
        scene=settings["scene"],
        structure=settings["structure"],
        modes=settings["modes"],
        damping=settings["damping"],
        values={name: settings[name] for name in SLIDING_VALUES if settings[name] is not None},
        force=settings["force"],
    )
    refuse_parts(options)
    scene, _, force = make_scene(options)
    if force is None:  # only a structure has a force that follows from the rule
        raise BadInput("a scene of your own needs --force")
    first = positive("--from", settings["start"])
    last = positive("--to", settings["stop"])
    require(first != last, "--to", last, f"different from --from = {first}")
    ratios = grid(first, last, settings["points"])
    step = 0.05 * (1 if last > first else -1)
    sweep = Range(first - step / 50, first, last, last + step) if settings["slowness"] else None
    return RegimeCase(
        "own",
        str(scene),
        scene,
        force,
        settings["approach"] or first,
        ratios,
        settings["slowness"],
        sweep,
        tuple(sorted(ratios)),
    )


def chosen_settings(settings: dict[str, Any], executor: Executor | None = None) -> RegimeSettings:
    """Return the settings of a run.

    The executor is that of `run_lanes`. Raises BadInput or ParameterError.
    """
    own = is_own(settings)
    picked = (own_case(settings),) if own else cases()
    counts = (
        {}
        if settings["members"] is None
        else dict.fromkeys(("stay_members", "sweep_members", "kind_members"), settings["members"])
    )
    times = {} if settings["silence"] is None else {"silence": settings["silence"]}
    if settings["quick"] and not own:
        picked = tuple(_thinned(case) for case in picked)
    chosen = {**(QUICK if settings["quick"] else {}), **counts, **times}
    return RegimeSettings(
        picked, **chosen, seed=settings["seed"], threads=settings["threads"], executor=executor
    )


def _thinned(case: RegimeCase) -> RegimeCase:
    fast = tuple(slowness for slowness in case.slownesses if slowness <= FAST)
    return replace(
        case,
        stay_ratios=case.stay_ratios[::9],
        kind_ratios=case.kind_ratios[::20],
        slownesses=fast[::2],
    )


@command()
@click.option(
    "--scene",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Structure and absorber from a .toml or .json file.",
)
@structure_option
@click.option("--modes", type=int, help="Number of modes of the paper's beam.")
@click.option("--damping", type=float, help="Modal damping ratio.")
@click.option("--mass-ratio", type=float, help="Absorber mass over beam mass.")
@click.option("--gap", type=float, help="Clearance to either wall in m.")
@click.option("--restitution", type=float, help="Coefficient of restitution.")
@click.option("--friction-limit", type=float, help="Friction limit in N; 0: no friction.")
@click.option(
    "--force",
    type=float,
    help="Amplitude of the harmonic force in N.  [default: with --structure by the design rule]",
)
@click.option(
    "--from",
    "start",
    type=float,
    default=0.99,
    show_default=True,
    help="Your scene: first frequency over the first resonance.",
)
@click.option(
    "--to",
    "stop",
    type=float,
    default=0.95,
    show_default=True,
    help="Your scene: last frequency; sweeps go this way too.",
)
@click.option(
    "--points", type=int, default=21, show_default=True, help="Your scene: number of frequencies."
)
@click.option(
    "--slowness",
    type=float,
    multiple=True,
    help="Your scene: pseudo periods per 1 % of a sweep; may be repeated.  [default: no sweeps]",
)
@click.option(
    "--approach",
    type=float,
    help="Your scene: ratio at which runs come into impact.  [default: that of --from]",
)
@click.option(
    "--silence", type=float, help="Pseudo periods without impact that end a stay.  [default: 100]"
)
@click.option(
    "--members",
    type=click.IntRange(min=1),
    help="Runs at each frequency and slowness.  [default: 200; 40 to be classified]",
)
@click.option("--only", type=click.Choice([JUMP, KINDS]), multiple=True, help="Do this part only.")
@click.option(
    "--quick",
    is_flag=True,
    help=f"A look: few frequencies and runs, into {QUICK_OUT} unless told otherwise.",
)
@seed_option
@threads_option
@cluster_option
@click.option(
    "--redraw",
    is_flag=True,
    help="Draw figures and tables again from the numbers in --out; nothing is computed.",
)
@click.option(
    "--resume", is_flag=True, help="Go on from the files in --out where a run was stopped."
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help=f"Folder.  [default: {OUT}; {QUICK_OUT} with --quick or a scene of your own]",
)
def main(**options: Any) -> None:
    """Measure how long the impact regime lasts, and predict the jump of sweeps from that.

    The command also classifies stationary responses.

    Without options of a scene the cases of docs/regimes.md are computed and the page's tables and
    figures are written. With a scene of your own, jump.json.gz and kinds.json.gz, CSV files and
    figures go to --out. Ctrl-C keeps what is finished.
    """
    small = is_own(options) or options["quick"]
    cluster = None if options["redraw"] else options["cluster"]
    with workers(options["threads"], cluster) as executor:
        where = place(options["out"] or (QUICK_OUT if small else OUT), small)
        run(
            STUDY,
            chosen_settings(options, executor),
            where,
            only=options["only"],
            redraw=options["redraw"],
            resume=options["resume"],
        )
