"""The cards of the comparison, the tunings, a search and a front: what `optimisation.report.card` writes of them."""

from __future__ import annotations

import numpy as np

from impact_env.frequency import tip_response
from optimisation.comparison import IMPACT, NONE, Comparison, ResonanceComparison
from optimisation.designs import VARIABLES
from optimisation.insight import Levels
from optimisation.load_measures import SHOWN, TOLD
from optimisation.report.card import Card, Chart, Curve, Row, numbers
from optimisation.report.design_tables import compared, kept
from optimisation.report.front_tables import Front
from optimisation.report.service_tables import service_lines
from optimisation.search.result import Findings
from optimisation.sweep_rate import LEAST_RATIO
from optimisation.tuned.table import TuningTable

MM = 1e3
POINTS = 601  # of a curve over the frequency


def comparison_card(found: Comparison) -> Card:
    """Return levels at the impact absorber's best force, and all curves."""
    labels = {concept.key: concept.label for concept in found.concepts}
    groups: list[tuple[str, tuple[Row, ...]]] = [
        ("Compared", (Row("mass of each", found.mass_ratio * found.model.beam_mass, "kg"), Row("gap", MM * found.gap, "mm")))
    ]
    warnings, charts = [], []
    for part in found.resonances:
        name = f"Resonance {part.resonance}, {part.omega / (2 * np.pi):.4g} Hz"
        if part.best is not None:
            groups.append((f"{name}, at {part.forces[part.best]:.3g} N", _levels(part, labels, part.best)))
        charts.append(_comparison_chart(part, labels, name))
        if part.sweep_ratio < LEAST_RATIO:
            warnings.append(f"{name}: sweeps show {part.sweep_ratio:.3f} of the stationary level; sweep more slowly")
        if part.reach < 1:
            warnings.append(f"{name}: the structure does not move as far as the rule's gap, and no wall is touched there")
    return Card("Absorbers of one mass compared", tuple(groups), tuple(charts), tuple(warnings))


def _levels(part: ResonanceComparison, labels: dict[str, str], k: int) -> tuple[Row, ...]:
    rows = []
    for key, curve in part.curves.items():
        level, (low, high), none = MM * curve.median[k], MM * curve.band[:, k], MM * part.curves[NONE].median[k]
        rows.append(Row(labels[key], f"{level:.4g} mm ({low:.4g} to {high:.4g}), {100 * level / none:.3g} %"))
    return (*rows, Row("no impact absorber in this cavity comes below", MM * float(part.limit[k]), "mm"))


def _comparison_chart(part: ResonanceComparison, labels: dict[str, str], name: str) -> Chart:
    curves = [
        Curve(labels[key], numbers(part.forces), numbers(MM * curve.median), numbers(MM * curve.band[0]), numbers(MM * curve.band[1]))
        for key, curve in part.curves.items()
    ]
    best = () if part.best is None else ((f"best of the {labels[IMPACT]}", float(part.forces[part.best])),)
    return Chart(name, "force in N", "level in mm (RMS)", tuple(curves), best, log_x=True, log_y=True)


def tuning_card(table: TuningTable, bounds: dict[str, float]) -> Card:
    """Return all tunings with their peaks, and the amplitude over the frequency."""
    rows, curves = [], []
    ratios = np.unique(np.concatenate([np.linspace(table.low, table.high, POINTS), [t.peak_ratio for t in table.tunings]]))
    for tuning in table.tunings:
        own = tuning.absorber
        what = "" if own is None else f", {own.stiffness:.6g} N/m, {own.damping:.4g} N s/m"
        proved = f", proved {100 * bounds[tuning.key] / table.tunings[0].peak:.4g} %" if tuning.key in bounds else ""
        rows.append(Row(tuning.label, f"peak {100 * table.relative_peak(tuning):.4g} % at {tuning.peak_ratio:.4g}{proved}{what}"))
        amplitude = 100 * np.abs(tip_response(table.model, own, ratios * table.omega)) / table.tunings[0].peak
        curves.append(Curve(tuning.label, numbers(ratios), numbers(amplitude)))
    mass = Row("absorber mass", table.mass_ratio * table.model.beam_mass, "kg")
    assumed = (mass, Row("resonance", f"{table.resonance}, {table.omega / (2 * np.pi):.4g} Hz"), Row("modes kept", str(table.model.modes)))
    chart = Chart("Amplitude", "frequency over the resonance's", "% of the peak without absorber", tuple(curves), log_y=True)
    return Card("Tuned absorbers of one mass", (("Tunings", tuple(rows)), ("Assumptions", assumed)), (chart,))


def findings_card(found: Findings) -> Card:
    """Return a search's winner beside paper and rule, with its constraints, and what it bears."""
    problem, verdict = found.problem, found.verdict
    rate = () if problem.under_loads else (Row("rate", problem.rate, "% per 100 pseudo periods"),)
    search = (Row("designs", str(found.cost.designs)), Row("runs", str(found.cost.runs)), *rate)
    groups: list[tuple[str, tuple[Row, ...]]] = []
    warnings = [] if found.finished else ["stopped early"]
    if verdict is not None:
        values = [judged.design.values for judged in compared(verdict).values()]
        rows = [
            Row(v.name, "{:.4g} (paper {:.4g}, rule {:.4g}) ".format(*(x[v.name] for x in values)) + v.si) for v in VARIABLES[problem.space.concept]
        ]
        groups.append(("Winner", tuple(rows)))
        judged = [
            Row(name, "{:.4g} ({:.4g} to {:.4g})".format(one.score.values[0], *one.bands[0]) + kept(problem, one.score))
            for name, one in compared(verdict).items()
        ]
        groups.append((f"{problem.objectives[0].label}, on fresh members", tuple(judged)))
        if not verdict.feasible:
            warnings.append("no feasible design: the winner breaks the constraints least")
        warnings += [f"the winner lies at a bound: {line}" for line in problem.space.at_bounds(verdict.winner.design)]
    if found.service is not None:
        groups.append(("In service", tuple(Row(line.strip(), "") for line in service_lines(found.service))))
    charts = [_over_force(part) for part in found.curves or ()]
    return Card(f"Search for the best design: {problem.space.concept}", (*groups, ("Search", search)), tuple(charts), tuple(warnings))


def _over_force(part: Levels) -> Chart:
    forces, own = [condition.force for condition in part.conditions], part.conditions[0]
    name, (scale, unit) = own.told[0], SHOWN[own.told[1]]
    curves = [
        Curve(who, numbers(forces), numbers(scale * part.median[d]), numbers(scale * part.low[d]), numbers(scale * part.high[d]))
        for d, who in enumerate(("winner", "paper"))
    ]
    curves.append(Curve("no absorber", numbers(forces), numbers(scale * part.without)))
    x, y = ("force in N", "level in mm (RMS)") if own.loads is None else ("factor on the loads", f"{TOLD[name]} in {unit}")
    return Chart(own.place[0].upper() + own.place[1:], x, y, tuple(curves), log_x=True, log_y=True)


def front_card(found: Front) -> Card:
    """Return the designs of a front, and all that were tried."""
    problem, names = found.problem, [o.label for o in found.problem.objectives]
    rows = [
        Row(
            f"design {e.number}",
            ", ".join(f"{v.name} {e.design.values[v.name]:.4g}" for v in problem.space.free) + ": {:.4g} and {:.4g}".format(*e.score.values),
        )
        for e in found.members
    ]
    warnings = () if found.members else ("no design kept all constraints",)
    parts = [("tried", found.told), ("on the front", found.members)]
    curves = [Curve(name, numbers(e.score.values[0] for e in part), numbers(e.score.values[1] for e in part), points=True) for name, part in parts]
    cost = (Row("designs", str(found.cost.designs)), Row("runs", str(found.cost.runs)))
    return Card(" against ".join(names), (("Front", tuple(rows)), ("Search", cost)), (Chart("Front", names[0], names[1], tuple(curves)),), warnings)
