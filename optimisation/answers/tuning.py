"""Tuned linear absorbers of one mass, with proofs of their peaks, or for loads."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from impact_env.checks import instance
from impact_env.loads import Loads
from impact_env.modes import Structure
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam
from optimisation.mounting import model_with_absorber_at
from optimisation.report.comparison_report import make_tuned_report
from optimisation.report.report import CompleteAnswer, Report
from optimisation.report.tuning_report import Tuning, TuningTable, make_report, tuning_table
from optimisation.tuned import HIGH, LOW
from optimisation.tuned.under_loads import TunedForLoads, tune_under_loads


@dataclass(frozen=True, eq=False)
class TuningAnswer(CompleteAnswer):
    """Tunings of a tuned absorber of one mass.

    Attributes
    ----------
    tunings : TuningTable or TunedForLoads
        All tunings to a resonance with their scores, or the two tunings for loads.
    bounds : dict
        Proved amplitude in m/N by the key of a tuning.
    """

    tunings: TuningTable | TunedForLoads
    bounds: Mapping[str, float] = field(default_factory=dict)

    def make_report(self) -> Report:
        """Return the content of the answer; under loads there is no card."""
        if isinstance(self.tunings, TunedForLoads):
            return make_tuned_report(self.tunings)
        return make_report(self.tunings, self.bounds)


def prove_peaks(
    table: TuningTable,
    report_failure: Callable[[str], None] = lambda _: None,
    progress: Callable[[list[Tuning]], Iterable[Tuning]] = iter,
) -> dict[str, float]:
    """Return the proved largest amplitude in m/N of each tuning by its key.

    Tunings without proof are left out, and ``report_failure`` is called with a line of text;
    ``progress`` wraps the iteration over tunings.
    """
    from optimisation.bounds.relaxation import NotOptimalError  # needs cvxpy, slow to import
    from optimisation.tuned.certificate import certify

    bounds = {}
    for tuning in progress([one for one in table.tunings if math.isfinite(one.peak)]):
        case = (tuning.absorber, table.resonance, table.low, table.high)
        try:
            bounds[tuning.key] = certify(table.model, *case).bound
        except NotOptimalError as error:
            report_failure(f"Not proved, {tuning.label}: {error}")
    return bounds


def tune(
    structure: Structure | None = None,
    mass_ratio: float = DEFAULT_MASS_RATIO,
    resonance: int = 1,
    *,
    low: float = LOW,
    high: float = HIGH,
    proofs: bool = False,
    loads: Loads | None = None,
) -> TuningAnswer:
    """Tune the linear absorber to a resonance or for loads, as the command `design tune` does.

    Parameters
    ----------
    structure : Beam or ModalModel, optional
        Structure without absorber; default: the paper's beam.
    mass_ratio : float
        Mass of the absorber over that of the structure.
    resonance : int
        Resonance to which the absorber is tuned, from 1.
    low, high : float
        Range of frequencies in which the tuning is scored, over the resonance.
    proofs : bool
        Whether the peaks are proved, which takes seconds and needs the extra `optimise`.
    loads : Loads, optional
        Loads whose measure is minimised, instead of the peak near a resonance.

    Returns
    -------
    TuningAnswer
        Result with `str`, `to_json`, `to_markdown`, `to_html`, `plot` and `save`; under loads
        without card and figure.

    Raises
    ------
    ParameterError
        A number is out of range, or an absorber at its place has no effect on the resonance.

    Examples
    --------
    >>> answer = tune(Beam(modes=2))
    >>> list(answer.to_json()["tunings"])[0]
    'none'
    """
    model = model_with_absorber_at(Beam() if structure is None else structure)
    if loads is not None:
        return TuningAnswer(tune_under_loads(model, instance("loads", loads, Loads), mass_ratio))
    table = tuning_table(model, mass_ratio, resonance, low, high)
    return TuningAnswer(table, prove_peaks(table) if proofs else {})
