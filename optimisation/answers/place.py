"""Choice of place, mass and gap of an absorber, and the recommended device in service."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from impact_env.ensemble import Executor, Threads
from impact_env.modes import Structure
from impact_env.parameters import Beam
from optimisation.absorber_rules import simulate_baselines
from optimisation.contact import MaterialPair
from optimisation.frequency_levels import (
    NO_ABSORBER,
    RECOMMENDED,
    ResonanceCurves,
    WorstRun,
    find_worst_run,
    record_worst_run,
    resonance_curves,
)
from optimisation.mounting import device_scene
from optimisation.place_advice import PlaceAdvice, advise_place
from optimisation.place_map import find_places
from optimisation.report.place_report import PlaceService, make_report
from optimisation.report.report import CompleteAnswer, Json, Report
from optimisation.service import impact_loads


@dataclass(frozen=True, eq=False)
class PlaceAnswer(CompleteAnswer):
    """The search of place, mass and gap, with further simulations of the recommended device.

    Attributes
    ----------
    advice : PlaceAdvice
        Places, masses and gaps that ran, and the recommended device.
    frequency : tuple of ResonanceCurves
        Levels over the frequency of its worst member and without absorber, near each resonance.
    service : PlaceService, optional
        Impacts, and levels with other absorbers of its mass; None if not simulated.
    """

    advice: PlaceAdvice
    frequency: tuple[ResonanceCurves, ...] = ()
    service: PlaceService | None = None

    def make_report(self) -> Report:
        """Return the content of the answer; without the device in service there is no card."""
        return make_report(self.advice, self.frequency, self.service)

    @property
    def worst_resonance(self) -> int:
        """Resonance at which the device's level relative to that without absorber is highest."""
        best = self.advice.recommended
        assert best is not None
        return max(best.parts, key=lambda part: part.share).resonance

    def device_scene(self) -> Json | None:
        """Return structure and recommended device as plain data; None without one."""
        best = self.advice.recommended
        if best is None:
            return None
        places = self.advice.places
        structure = places.structure
        if isinstance(structure, Beam):
            structure = replace(structure, absorber_position=float(places.names[best.place]))
        else:
            structure = places.model_at(best.place)
        return device_scene(structure, best.absorber)

    def worst_run(self) -> WorstRun | None:
        """Return the recommended device's recorded run with the highest level.

        The run is near the worst resonance of the device. The result is None without a device.
        """
        best = self.advice.recommended
        if best is None:
            return None
        r = self.worst_resonance
        return record_worst_run(self.advice.case_of(best, r), best.runs[r])


def frequency_levels_of(advice: PlaceAdvice, executor: Executor) -> tuple[ResonanceCurves, ...]:
    """Return the levels over the frequency of the recommended device and without absorber.

    The device's level is that of its worst member. There is a pair of curves near each resonance.
    """
    best = advice.recommended
    assert best is not None
    curves = []
    for r in advice.forces:
        member, _ = find_worst_run(best.runs[r])
        model = advice.places.model_at(best.place)
        cases = {
            RECOMMENDED: (advice.case_of(best, r), member),
            NO_ABSORBER: (advice.study.case(model, None, r), 0),
        }
        curves.append(resonance_curves(cases, best.runs[r].members, executor))
    return tuple(curves)


def complete_place_answer(
    advice: PlaceAdvice,
    executor: Executor,
    card: bool = True,
    contact: MaterialPair | None = None,
) -> PlaceAnswer:
    """Simulate the recommended device of a search; a search that was stopped is returned as it is.

    ``card``: whether service loads are simulated; ``contact``: materials for an estimate of its
    contact. Raises KeyboardInterrupt if the runs are stopped.
    """
    best = advice.recommended
    if best is None or not advice.complete:
        return PlaceAnswer(advice)
    answer = PlaceAnswer(advice, frequency_levels_of(advice, executor))
    if not card:
        return answer
    impacts = impact_loads(advice.case_of(best, answer.worst_resonance), executor)
    model = advice.places.model_at(best.place)
    baselines = {
        part.resonance: simulate_baselines(
            model,
            best.mass_ratio,
            (part.force, part.resonance),
            part.sweep_range,
            part.rate,
            executor,
        )
        for part in best.parts
    }
    return PlaceAnswer(advice, answer.frequency, PlaceService(impacts, baselines, contact))


def choose_place(
    structure: Structure,
    forces: Mapping[int, float],
    *,
    card: bool = True,
    contact: MaterialPair | None = None,
    executor: Executor | None = None,
    **options: Any,
) -> PlaceAnswer:
    """Choose the place, the mass and the gap of an impact absorber.

    The command `design place` does the same.

    Parameters
    ----------
    structure : Beam or ModalModel
        Structure without absorber. Candidates are places along a beam, or the places of a model.
    forces : dict
        Amplitude of the harmonic force in N by resonance, from 1.
    card : bool
        Whether service loads are simulated.
    contact : tuple, optional
        Two materials and the radius in m of the rounder body, for an estimate of the contact on the
        card.
    executor : Executor, optional
        Where the runs are made; default: threads of this process.
    **options
        As in `optimisation.place_advice.advise_place`: ``mass_ratios``, ``restitution``,
        ``friction_limit``, ``limits``, ``limit_level``, ``tolerance``, ``members``,
        ``trial_places``, ``seed``, ``percent_per_100_periods``, ``progress``.

    Returns
    -------
    PlaceAnswer
        Result with `str`, `to_json`, `to_markdown`, `to_html`, `plot` and `save`.

    Raises
    ------
    ParameterError
        A number is out of range, or the absorber does not reach its walls at any place.
    KeyboardInterrupt
        The runs after the search were stopped.

    Examples
    --------
    >>> answer = choose_place(Beam(modes=2), {1: 3.5}, members=1)  # doctest: +SKIP
    >>> answer.save("results/place")  # doctest: +SKIP
    """
    executor = Threads() if executor is None else executor
    places = find_places(structure)
    checked = {places.model.check_resonance(r): force for r, force in forces.items()}
    advice = advise_place(places, checked, executor=executor, **options)
    return complete_place_answer(advice, executor, card, contact)
