"""Comparison of absorbers of one mass: levels over force and frequency, and service loads.

The service loads are those of the impact absorber.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from impact_env.checks import instance, require
from impact_env.curve import CurveCase
from impact_env.ensemble import Executor, Threads
from impact_env.loads import Loads
from impact_env.modes import Structure
from impact_env.parameters import Beam
from impact_env.scene import Scene
from optimisation import comparison as concepts
from optimisation.comparison import (
    IMPACT,
    LTVA_PAPER_WIDE,
    LTVA_TUNED_WIDE,
    Comparison,
    LoadComparison,
    compare_loads,
)
from optimisation.frequency_levels import (
    ResonanceCurves,
    WorstRun,
    find_worst_run,
    record_worst_run,
    resonance_curves,
)
from optimisation.load_cases import AppliedLoads
from optimisation.mounting import model_with_absorber_at
from optimisation.report.comparison_report import make_load_report, make_report
from optimisation.report.report import CompleteAnswer, Report
from optimisation.service import ImpactLoads, impact_loads

WITH_LOADS = ("mass_ratio", "gap", "forces", "members", "seed")  # options of `compare`
SAME_ABSORBER = (LTVA_PAPER_WIDE, LTVA_TUNED_WIDE)  # as another one, over a wider range


@dataclass(frozen=True, eq=False)
class ComparisonAnswer(CompleteAnswer):
    """A comparison of absorbers, with further simulations at its force.

    Attributes
    ----------
    comparison : Comparison or LoadComparison
        Levels of each absorber over the force near each resonance, or over the loads' intensity.
    impacts : ImpactLoads, optional
        Impacts of the impact absorber near the first resonance.
    frequency : tuple of ResonanceCurves
        Levels over the frequency of each absorber's worst member, near each resonance.
    conditions : dict
        Further content of summary.json: versions, times.
    """

    comparison: Comparison | LoadComparison
    impacts: ImpactLoads | None = None
    frequency: tuple[ResonanceCurves, ...] = ()
    conditions: Mapping[str, object] = field(default_factory=dict)

    def make_report(self) -> Report:
        """Return the content of the answer."""
        if isinstance(self.comparison, LoadComparison):
            return make_load_report(self.comparison, self.conditions)
        return make_report(self.comparison, self.impacts, self.frequency, self.conditions)

    def worst_run(self) -> WorstRun | None:
        """Return the impact absorber's recorded run with the highest level near resonance 1.

        None if the runs were stopped, and under loads.
        """
        if isinstance(self.comparison, LoadComparison):
            return None
        part = self.comparison.resonances[0]
        if part.reported_index is None or not self.comparison.complete:
            return None
        return record_worst_run(part.cases[IMPACT], part.curves[IMPACT], part.reported_index)


def find_impact_loads(comparison: Comparison, executor: Executor) -> ImpactLoads | None:
    """Return the impacts of the impact absorber near the first resonance.

    They are computed at the force of the comparison. The result is None if the comparison is not
    finished.
    """
    part = comparison.resonances[0]
    k = part.reported_index
    if k is None or not comparison.complete:
        return None
    concept = {one.key: one for one in comparison.concepts}[IMPACT]
    case = CurveCase(
        Scene(comparison.model, concept.absorber),
        part.forces[k : k + 1],
        part.resonance,
        part.limits_of(concept),
        comparison.percent_per_100_periods,
        steady_start=True,
    )
    return impact_loads(case, executor)


def frequency_levels_of(comparison: Comparison, executor: Executor) -> list[ResonanceCurves]:
    """Return the levels over the frequency of the worst member of each absorber.

    They are computed near each resonance at the force of the comparison.
    """
    curves = []
    for part in comparison.resonances:
        k = part.reported_index
        if k is None or not comparison.complete:
            continue
        cases = {
            concept.label: (
                replace(part.cases[concept.key], forces=part.forces[k : k + 1]),
                find_worst_run(part.curves[concept.key], k)[0],
            )
            for concept in comparison.concepts
            if concept.key not in SAME_ABSORBER
        }
        curves.append(resonance_curves(cases, part.curves[IMPACT].members, executor))
    return curves


def complete_comparison(
    comparison: Comparison, executor: Executor, with_impacts: bool = False
) -> ComparisonAnswer:
    """Run the further simulations of a comparison of absorbers.

    ``with_impacts``: whether the impacts of the impact absorber are simulated as well.

    Raises KeyboardInterrupt if the runs are stopped.
    """
    impacts = find_impact_loads(comparison, executor) if with_impacts else None
    frequency = frequency_levels_of(comparison, executor)
    return ComparisonAnswer(comparison, impacts, tuple(frequency))


def compare(
    structure: Structure | None = None,
    *,
    loads: Loads | None = None,
    executor: Executor | None = None,
    **options: Any,
) -> ComparisonAnswer:
    """Compare absorbers of one mass over the force near resonances, or over the size of loads.

    The command `compare` does the same.

    Parameters
    ----------
    structure : Beam or ModalModel, optional
        Structure without absorber; default: the paper's beam.
    loads : Loads, optional
        Loads instead of swept forces; each absorber is optimised for them.
    executor : Executor, optional
        Where the runs are made; default: threads of this process.
    **options
        As in `optimisation.comparison.compare`: ``resonances``, ``mass_ratio``, ``force`` (N),
        ``gap`` (m), ``device``, ``forces``, ``members``, ``seed``, ``percent_per_100_periods``,
        ``progress``. With ``loads``: ``mass_ratio``, ``gap``, ``forces`` (number of intensities),
        ``members`` and ``seed``.

    Returns
    -------
    ComparisonAnswer
        Result with `str`, `to_json`, `plot` and `save`.

    Raises
    ------
    ParameterError
        A number is out of range, or an option is not allowed with loads.

    Examples
    --------
    >>> answer = compare(forces=8, members=2)  # doctest: +SKIP
    >>> answer.save("results/comparison")  # doctest: +SKIP
    """
    executor = Threads() if executor is None else executor
    if loads is None:
        comparison = concepts.compare(structure, executor=executor, **options)
        return complete_comparison(comparison, executor, options.get("device") is not None)
    loads = instance("loads", loads, Loads)
    for name, value in options.items():
        require(
            name in WITH_LOADS,
            name,
            value,
            f"left out under loads, beside which {', '.join(WITH_LOADS)} may be",
        )
    if "forces" in options:
        options["factors"] = options.pop("forces")
    model = model_with_absorber_at(Beam() if structure is None else structure)
    return ComparisonAnswer(compare_loads(AppliedLoads(model, loads), executor=executor, **options))
