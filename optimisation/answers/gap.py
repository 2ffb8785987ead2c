"""Choice of a gap, and the properties of the recommended device.

The properties are service loads, uncertainty, tolerances and levels over the frequency.

Under loads other than a swept force the answer is the search alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from impact_env.checks import instance, positive, require
from impact_env.curve import PerformanceCurve
from impact_env.ensemble import Executor, LaneProgress, Threads
from impact_env.loads import Loads
from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, SlidingAbsorber
from optimisation.absorber_rules import RESTITUTION, rigid_walls, scaled_absorber
from optimisation.calibration.posterior import Posterior, read_posterior
from optimisation.contact import MaterialPair, check_contact
from optimisation.frequency_levels import (
    NO_ABSORBER,
    RECOMMENDED,
    ResonanceCurves,
    WorstRun,
    find_worst_run,
    record_worst_run,
    resonance_curves,
)
from optimisation.gap_advice import MEMBERS, TOLERANCE, Advice, Answer, Limits, search_gap
from optimisation.insight import Sensitivity, device_box, device_sensitivity
from optimisation.load_cases import AppliedLoads, swept_force
from optimisation.mounting import device_scene, model_with_absorber_at
from optimisation.report import gap_report, load_gap_report
from optimisation.report.design_figures import draw_sensitivity
from optimisation.report.frequency_report import (
    frequency_charts,
    frequency_figures,
    frequency_tables,
)
from optimisation.report.gap_report import UncertaintyResult
from optimisation.report.precision_report import (
    sensitivity_data,
    sensitivity_lines,
    sensitivity_rows,
    tolerance_data,
    tolerance_lines,
    tolerance_rows,
)
from optimisation.report.report import (
    Chart,
    CompleteAnswer,
    Draw,
    Group,
    Json,
    Report,
    Stages,
    silent_stages,
)
from optimisation.service import ServiceLoads, change_with_modes, service_loads, uncertain_levels
from optimisation.sweep_range import usable_force
from optimisation.tolerances import (
    DRAWS_ALONE,
    DRAWS_CHECKED,
    DRAWS_TOGETHER,
    FRICTION,
    GAP,
    POSTERIOR,
    Distribution,
    Tolerances,
    UncertainInput,
    find_tolerances,
    posterior_spreads,
    require_parts,
    spreads,
)

SOBOL_SAMPLES = 64
TOLERANCE_DRAWS = (DRAWS_ALONE, DRAWS_TOGETHER, DRAWS_CHECKED)


@dataclass(frozen=True)
class DevicePrecision:
    """Manufacturing tolerances of a device, and the shares of its parameters in its level.

    A field is None if it was not computed.
    """

    absorber: SlidingAbsorber
    tolerances: Tolerances | None = None
    sobol: Sensitivity | None = None

    @property
    def lines(self) -> list[str]:
        """Lines of a text."""
        lines = []
        if self.tolerances is not None:
            lines += tolerance_lines(self.tolerances, self.absorber)
        if self.sobol is not None:
            lines += sensitivity_lines(self.sobol)
        return lines

    @property
    def groups(self) -> list[Group]:
        """Groups of a card."""
        groups: list[Group] = []
        if self.tolerances is not None:
            heading = (
                "How precisely it must be made for a level below "
                f"{1e3 * self.tolerances.limit:.4g} mm"
            )
            groups.append((heading, tolerance_rows(self.tolerances, self.absorber)))
        if self.sobol is not None:
            heading = "Sobol shares of the level's variance (95 % interval)"
            groups.append((heading, sensitivity_rows(self.sobol)))
        return groups

    @property
    def figures(self) -> dict[str, Draw]:
        """Figures by the names of their files."""
        if self.sobol is None:
            return {}
        return {"sensitivity.png": partial(draw_sensitivity, self.sobol, "the recommended device")}

    def to_json(self) -> Json:
        """Return plain data in SI units."""
        content: Json = {}
        if self.tolerances is not None:
            content["tolerances"] = tolerance_data(self.tolerances, self.absorber)
        if self.sobol is not None:
            content["sobol"] = sensitivity_data(self.sobol)
        return content


@dataclass(frozen=True)
class GapQuestions:
    """Analyses of the recommended device after the search.

    Attributes
    ----------
    uncertain : tuple of Distribution
        Uncertain quantities; empty for none.
    limit_level : float, optional
        Level in m whose probability of exceedance is computed, and for which tolerances are
        computed.
    contact : tuple, optional
        Two materials and the radius in m of the rounder body, for an estimate of the contact on the
        card.
    tolerance_draws : tuple of int, optional
        Draws of each quantity alone, of all together and of the check; None: no tolerances.
    sobol_samples : int, optional
        A power of 2; None: no Sobol shares.
    card : bool
        Whether service loads and other absorbers of the same mass are simulated.
    seed : int
        Seed of the runs with more modes and of the Sobol samples.
    """

    uncertain: tuple[Distribution, ...] = ()
    limit_level: float | None = None
    contact: MaterialPair | None = None
    tolerance_draws: tuple[int, int, int] | None = None
    sobol_samples: int | None = None
    card: bool = True
    seed: int = 0


@dataclass(frozen=True, eq=False)
class GapAnswer(CompleteAnswer):
    """The gap of an impact absorber, and analyses of the device; None for those that were not made.

    Attributes
    ----------
    advice : Advice
        The search: the gap with the lowest level, the recommended one, and all runs.
    structure : Beam or ModalModel
        Structure without absorber.
    questions : GapQuestions
        Analyses after the search.
    uncertainty : UncertaintyResult, optional
        Quantiles of the level with all uncertain quantities drawn.
    precision : DevicePrecision, optional
        Tolerances and Sobol shares.
    frequency : ResonanceCurves, optional
        Levels over the frequency of the worst member, and without absorber.
    service : ServiceLoads, optional
        Impacts, forces at which the device helps, and other absorbers of the same mass.
    more_modes : str
        Text about the effect of twice the number of modes.
    """

    advice: Advice
    structure: Structure
    questions: GapQuestions = field(default_factory=GapQuestions)
    uncertainty: UncertaintyResult | None = None
    precision: DevicePrecision | None = None
    frequency: ResonanceCurves | None = None
    service: ServiceLoads | None = None
    more_modes: str = ""

    @property
    def under_loads(self) -> bool:
        """Whether other loads than a swept force act."""
        return isinstance(self.advice.case, AppliedLoads)

    def make_report(self) -> Report:
        """Return the content of the answer; without the device in service there is no card."""
        advice = self.advice
        if self.under_loads:
            return load_gap_report.make_report(advice, self.questions.card)
        lines = gap_report.answer(advice)
        lines += gap_report.probability(advice, self.questions.limit_level)
        numbers = gap_report.summary(advice)
        figures: dict[str, Draw] = {"levels.png": partial(gap_report.draw_levels, advice)}
        tables = {"levels.csv": gap_report.gap_table(advice)}
        groups: list[Group] = []
        charts: tuple[Chart, ...] = ()
        warnings: list[str] = []
        curves = () if self.frequency is None else (self.frequency,)
        if self.service is not None:
            contact = self.questions.contact
            lines.append(gap_report.baselines(self.service))
            groups, warnings = gap_report.device_groups(
                advice, self.service, self.uncertainty, contact, self.more_modes
            )
            charts = (*frequency_charts(curves), *gap_report.level_charts(advice, self.service))
        if self.uncertainty is not None:
            lines.append(self.uncertainty.words)
            numbers["uncertain"] = self.uncertainty.plain()
        if self.precision is not None:
            lines += self.precision.lines
            numbers |= self.precision.to_json()
            groups += self.precision.groups if groups else []
            figures |= self.precision.figures
        return Report(
            title=gap_report.title(advice),
            verdict=lines[0],
            text=[lines, [gap_report.printed_table(advice)], gap_report.warnings(advice)],
            numbers=numbers,
            tables=tables | frequency_tables(curves),
            figures=figures | frequency_figures(curves),
            groups=tuple(groups),
            charts=charts,
            warnings=tuple(warnings),
            prints_card=True,
        )

    def device_scene(self) -> Json | None:
        """Return structure and recommended device as plain data.

        The result is None if no gap was run in full.
        """
        best = self.advice.recommended
        return None if best is None else device_scene(self.structure, best.absorber)

    def worst_run(self) -> WorstRun | None:
        """Return the recorded run of the recommended device with the highest level.

        The result is None if the search did not end, and under loads.
        """
        best = self.advice.recommended
        if best is None or not self.advice.complete or self.under_loads:
            return None
        case = self.advice.check.swept.curve_case(best.absorber)
        return record_worst_run(case, curve_of(self.advice, best))


def curve_of(advice: Advice, answer: Answer) -> PerformanceCurve:
    """Return the runs of an answer."""
    return advice.check.curves[int(np.argmin(np.abs(advice.check.gaps - answer.gap)))]


def frequency_levels_of(advice: Advice, answer: Answer, executor: Executor) -> ResonanceCurves:
    """Return the level over the frequency of an answer's worst member and without absorber."""
    curve = curve_of(advice, answer)
    member, _ = find_worst_run(curve)
    cases = {
        RECOMMENDED: (advice.check.swept.curve_case(answer.absorber), member),
        NO_ABSORBER: (advice.check.swept.curve_case(None), 0),
    }
    return resonance_curves(cases, curve.members, executor)


def find_precision(
    advice: Advice,
    structure: Structure,
    questions: GapQuestions,
    executor: Executor,
    stages: Stages = silent_stages,
) -> DevicePrecision:
    """Return the requested tolerances and Sobol shares of the recommended device."""
    best = advice.recommended
    assert best is not None
    case = advice.check.swept.curve_case(best.absorber)
    precision = DevicePrecision(best.absorber)
    if questions.tolerance_draws is not None:
        assert questions.limit_level is not None
        alone, together, checked = questions.tolerance_draws
        with stages("tolerances", 2 * (3 * alone + together + checked)) as show:
            tolerances = find_tolerances(
                case,
                questions.limit_level,
                questions.uncertain,
                draws=questions.tolerance_draws,
                progress=show,
                executor=executor,
            )
        precision = replace(precision, tolerances=tolerances)
    if questions.sobol_samples is not None:
        samples = questions.sobol_samples
        with stages("Sobol shares", 2 * samples * (len(device_box(case, structure)) + 2)) as show:
            sobol = device_sensitivity(
                case, structure, samples, seed=questions.seed, progress=show, executor=executor
            )
        precision = replace(precision, sobol=sobol)
    return precision


def complete_gap_answer(
    advice: Advice,
    structure: Structure,
    questions: GapQuestions,
    executor: Executor,
    stages: Stages = silent_stages,
) -> GapAnswer:
    """Run the requested analyses of the recommended device of a search.

    A search that was stopped is returned without further analyses.

    Raises KeyboardInterrupt if the runs are stopped.
    """
    answer = GapAnswer(advice, structure, questions)
    best = advice.recommended
    if best is None or not advice.complete or answer.under_loads:
        return answer
    every = questions.uncertain
    if every:
        levels = uncertain_levels(advice, best, every, executor)
        answer = replace(answer, uncertainty=UncertaintyResult(every, *levels))
    answer = replace(
        answer,
        precision=find_precision(advice, structure, questions, executor, stages),
        frequency=frequency_levels_of(advice, best, executor),
    )
    if not questions.card:
        return answer
    return replace(
        answer,
        service=service_loads(advice, best, executor),
        more_modes=change_with_modes(advice, best, structure, questions.seed, executor),
    )


def read_uncertain(
    uncertain: UncertainInput, absorber: SlidingAbsorber, friction_fixed: bool
) -> tuple[Distribution, ...]:
    """Return the uncertain quantities of a search.

    Raises ParameterError for quantities that the absorber lacks, and for absolute values (SI units)
    of quantities that are searched.
    """
    words = dict(uncertain)
    posterior = measured_posterior(words)
    words.pop(POSTERIOR, None)
    measured = () if posterior is None else posterior_spreads(posterior, absorber)
    every = spreads(words)
    require_parts((*every, *measured), absorber)
    for one in every:
        searched = one.name == GAP or (one.name == FRICTION and not friction_fixed)
        require(
            one.relative or not searched,
            f"uncertain {one.name}",
            one.words,
            "in %, as the number itself is searched",
        )
        require(
            one.name not in {other.name for other in measured},
            f"uncertain {one.name}",
            one.words,
            "left out beside a posterior, which has it",
        )
    return (*every, *measured)


def measured_posterior(uncertain: UncertainInput) -> Posterior | None:
    """Return the posterior of a calibration that the uncertain input contains, or None.

    The value under the key "posterior" is a file or a `Posterior`.
    """
    value: Any = uncertain.get(POSTERIOR)
    if value is None or isinstance(value, Posterior):
        return value
    name = value if isinstance(value, str | Path) else next(iter(value))
    return read_posterior(Path(name), "uncertain posterior")


def model_for_gap(structure: Structure) -> ModalModel:
    """Return a structure's modal model for the choice of a gap.

    The response level is that at the absorber's place unless the structure has a response place.
    """
    return (
        modal_model(structure) if isinstance(structure, Beam) else model_with_absorber_at(structure)
    )


def advise(
    structure: Structure,
    force: float | None = None,
    resonance: int = 1,
    absorber: SlidingAbsorber | None = None,
    *,
    loads: Loads | None = None,
    tolerance: float = TOLERANCE,
    free: Sequence[str] = (),
    friction_fixed: bool = False,
    factors: Sequence[float] = (),
    members: int = MEMBERS,
    seed: int = 0,
    rate: float | None = None,
    limits: Limits | None = None,
    uncertain: UncertainInput | None = None,
    limit_level: float | None = None,
    tolerances: bool = False,
    sobol: bool = False,
    contact: MaterialPair | None = None,
    card: bool = True,
    progress: LaneProgress | None = None,
    executor: Executor | None = None,
) -> GapAnswer:
    """Choose the gap of an impact absorber for a force near a resonance, or for loads.

    The command `design gap` does the same.

    Parameters
    ----------
    structure : Beam or ModalModel
        Structure without absorber.
    force : float, optional
        Amplitude of the harmonic force in N; with ``loads`` a factor of the loads, by default 1.
    resonance : int
        Resonance near which the force acts, from 1.
    absorber : SlidingAbsorber, optional
        Mass, restitution and friction; its gap is replaced. Default:
        `optimisation.absorber_rules.scaled_absorber`, or under loads
        `optimisation.load_cases.AppliedLoads.absorber`.
    loads : Loads, optional
        Loads instead of a swept force; the result minimises their measure
        (`optimisation.measures.measure_of`). Only ``tolerance``, ``friction_fixed``, ``factors``,
        ``members``, ``seed``, a limit of the stroke, ``progress`` and ``executor`` are allowed with
        loads.
    tolerance : float
        Force tolerance: relative range of the force in which the recommended gap is robust.
    free : sequence of str
        "restitution" or "friction_limit", which are then searched, too.
    friction_fixed : bool
        Whether the friction limit is the same at every gap; else it is proportional to the gap.
    factors : sequence of float
        Further gaps to run, over the design rule's.
    members, seed : int
        Runs of each gap of a result, and their seed.
    rate : float, optional
        Sweep rate in % per 100 pseudo periods.
    limits : Limits, optional
        Limits of stroke and impact speed.
    uncertain : dict, optional
        Uncertain quantities by name, as in `optimisation.tolerances.spreads`; "posterior" is that
        of a calibration, or its file.
    limit_level : float, optional
        Level in m whose probability of exceedance is computed.
    tolerances, sobol : bool
        Whether tolerances (for ``limit_level``) and Sobol shares are computed; these take about
        1000 sweeps each.
    contact : tuple, optional
        Two materials and the radius in m of the rounder body.
    card : bool
        Whether service loads are simulated.
    progress : callable, optional
        ``progress(done, total)`` is called after each run of the search.
    executor : Executor, optional
        Where the runs are made; default: threads of this process.

    Returns
    -------
    GapAnswer
        Result with `str`, `to_json`, `plot` and `save`.

    Raises
    ------
    ParameterError
        A number is out of range, an argument is not allowed with loads, or no gap helps.

    Examples
    --------
    >>> answer = advise(Beam(modes=2), 3.5, rate=40.0, members=1)  # doctest: +SKIP
    >>> answer.save("results/gap")  # doctest: +SKIP
    """
    model = model_for_gap(structure)
    executor = Threads() if executor is None else executor
    search: dict[str, Any] = {
        "tolerance": tolerance,
        "free": free,
        "friction_fixed": friction_fixed,
        "factors": factors,
        "members": members,
        "seed": seed,
        "limits": limits,
        "progress": progress,
        "executor": executor,
    }
    if loads is not None:
        others = {
            "rate": rate,
            "uncertain": uncertain,
            "limit_level": limit_level,
            "contact": contact,
            "tolerances": tolerances or None,
            "sobol": sobol or None,
        }
        for name, value in others.items():
            require(value is None, name, value, "left out under loads")
        loads = instance("loads", loads, Loads)
        applied = AppliedLoads(model, loads, resonance).times(1.0 if force is None else force)
        if absorber is None:
            absorber = applied.absorber(DEFAULT_MASS_RATIO, RESTITUTION)
        advice = search_gap(applied, absorber, **search)
        return GapAnswer(advice, structure, GapQuestions(card=card))
    force = usable_force("force", force)  # type: ignore[arg-type]  # refuses None
    own = scaled_absorber(model, force, resonance) if absorber is None else absorber
    rigid_walls(own)
    questions = GapQuestions(
        read_uncertain({} if uncertain is None else uncertain, own, friction_fixed),
        None if limit_level is None else positive("limit_level", limit_level),
        None if contact is None else check_contact(contact),
        TOLERANCE_DRAWS if tolerances else None,
        SOBOL_SAMPLES if sobol else None,
        card,
        seed,
    )
    require(
        not tolerances or limit_level is not None,
        "limit_level",
        limit_level,
        "a level in m, below which the device must stay, with tolerances",
    )
    case = swept_force(model, force, resonance, own.mass_ratio, rate)
    return complete_gap_answer(search_gap(case, own, **search), structure, questions, executor)
