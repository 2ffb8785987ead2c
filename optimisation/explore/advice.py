"""Recommended parameters of an absorber at the load that is marked on the explorer's page.

They come from a search with short ensembles of sweeps, or from a closed form.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from impact_env.checks import require
from impact_env.curve import CurveCase, Pass, curve_passes
from impact_env.loads import Loads
from impact_env.modes import ModalModel, Structure
from impact_env.parameters import TunedAbsorber
from impact_env.scene import Scene
from impact_env.sweep import IntegrationError, Stop
from optimisation.absorber_rules import best_friction, scaled_absorber
from optimisation.explore.control import ControlValues
from optimisation.explore.loading import Loading
from optimisation.explore.settings import replace_numbers, scene_of, sweep_range_of
from optimisation.explore.waiting import Newer
from optimisation.gap_advice import search_gap
from optimisation.load_cases import AppliedLoads, swept_force
from optimisation.measures import LABELS
from optimisation.sweep_range import find_sweep_range
from optimisation.tuned import smallest_amplitude

MEMBERS = 1  # ensemble members of a level, as in `design gap --quick`
# ratio of neighbouring gaps in a search for two absorbers; also the change of load for which the
# level of the recommended gaps must remain low
GAP_STEP = 1.15
GAP_STEPS = range(-2, 10)  # exponents of GAP_STEP: 0.76 to 3.5 times the gap of the design rule
SAME_RATIO_TOL = 0.1  # two modal amplitudes whose ratio differs by less from 1 count as equal

Report = Callable[[int, int], None]
_TUNED: dict[tuple[object, ...], TunedAbsorber] = {}


class Recommendation(NamedTuple):
    """New values in SI units, by the names of the page's controls, and their reason as a text."""

    values: dict[str, float]
    why: str


def tune_absorber(model: ModalModel, mass_ratio: float, resonance: int) -> TunedAbsorber:
    """Return the tuned absorber with the smallest largest amplitude over the sweep's range.

    The result is cached, because the optimisation takes seconds.
    """
    shapes = (
        model.omega,
        model.damping_ratio,
        model.one_phase_force_shape,
        model.tip_shape,
        model.level_shape,
    )
    key = (*(x.tobytes() for x in shapes), mass_ratio, resonance)
    if key not in _TUNED:
        limits = find_sweep_range(model, mass_ratio, resonance)
        _TUNED[key] = smallest_amplitude(model, mass_ratio, resonance, *limits)
    return _TUNED[key]


def recommend_values(
    values: ControlValues, structure: Structure, model: ModalModel, stop: Stop, report: Report
) -> Recommendation:
    """Return the recommended values for the page's absorber concept at the marked load.

    ``values`` are those of the page's controls, and ``structure`` is its structure; ``model`` are
    the structure's modes with their shapes at the place of the first absorber. ``report`` is called
    with the numbers of finished and of all runs. Raises `Newer` after a ``stop`` or if no gap is
    found, and ParameterError for a friction damper under a random load.
    """
    mass = values["mass_ratio"] * model.beam_mass
    loading = Loading(values.load, model, values.resonance)
    if values.concept == "tuned":
        tuned = tune_absorber(model, values["mass_ratio"], values.resonance)
        springs = {"stiffness": tuned.stiffness, "damper": tuned.damping}
        return Recommendation(springs, "the smallest peak of the linear response")
    if values.concept == "friction":
        allowed = "for a swept load: there is no closed form for a random force"
        require(loading.swept, "Recommended", "friction damper", allowed)
        force = values.intensity * loading.worth
        limit, _ = best_friction(model, mass, force, values.resonance)
        return Recommendation(
            {"damper_friction": limit}, "most energy lost in a cycle at this force"
        )
    if values.concept == "two":
        return search_two_gaps(
            values, structure, loading.rule_gap(mass, values.intensity), stop, report
        )

    def watch(done: int, total: int) -> None:
        """Report progress, or end the search after a stop."""
        if stop.given:
            raise KeyboardInterrupt  # search_gap then returns the result of the finished runs
        report(done, total)

    if values.load != "force":
        return search_gap_for_load(values, loading, watch)
    own = scaled_absorber(
        model, values.intensity, values.resonance, values["mass_ratio"], values["restitution"]
    )
    case = swept_force(model, values.intensity, values.resonance, values["mass_ratio"])
    advice = search_gap(case, own, members=MEMBERS, progress=watch)
    best = advice.recommended or advice.sharp
    if stop.given or best is None:
        raise Newer
    why = (
        f"the lowest level over ±{100 * advice.tolerance:.0f} % of the force, by "
        f"{advice.sweeps} sweeps; "
        f"the design rule begins at {1e3 * advice.check.rule:.3g} mm"
    )
    return Recommendation({"gap": best.gap, "friction": best.friction_limit}, why)


def search_gap_for_load(values: ControlValues, loading: Loading, watch: Report) -> Recommendation:
    """Return the robust optimum of the gap under a load, with the present friction limit.

    ``watch`` is called with the numbers of finished and of all runs. Raises `Newer` if the search
    was stopped or found no gap.
    """
    limits = find_sweep_range(loading.model, values["mass_ratio"], loading.resonance)
    case = CurveCase(Scene(loading.model), np.ones(1), loading.resonance, limits)
    loads = loading.act(values.intensity, case.schedules()[0])
    assert isinstance(loads, Loads)
    applied = AppliedLoads(loading.model, loads, loading.resonance)
    absorber = applied.absorber(values["mass_ratio"], values["restitution"], values["friction"])
    advice = search_gap(applied, absorber, friction_fixed=True, members=MEMBERS, progress=watch)
    if not advice.complete or advice.recommended is None:
        raise Newer
    why = (
        f"the lowest {LABELS[applied.measure]} over ±{100 * advice.tolerance:.0f} % of the load, "
        f"at {len(advice.check.gaps)} gaps"
    )
    return Recommendation({"gap": advice.recommended.gap}, why)


def search_two_gaps(
    values: ControlValues, structure: Structure, rule: float, stop: Stop, report: Report
) -> Recommendation:
    """Return the gaps of two absorbers with the lowest worst level within a factor of the load.

    The load is divided or multiplied by up to `GAP_STEP`. By the scaling law, the level at such a
    load follows from that of a neighbouring gap at the marked load. The first gap is ``rule`` (m)
    times powers of `GAP_STEP`. The second gap is equal to it or, in a second series, in proportion
    to the mode's amplitudes at the two places. If no gap has a finite level, the present gaps are
    returned. ``report`` is called with the numbers of finished and of all pairs. Raises `Newer`
    after a ``stop``.
    """
    ratios = [1.0]
    mode = values.resonance - 1
    first, second = np.abs(scene_of(values, structure).absorber_shapes[:, mode])
    if first > 0 and second > 0 and abs(second / first - 1) > SAME_RATIO_TOL:
        ratios.append(float(second / first))
    gaps_before = {name: values[name] for name in ("gap", "second_gap")}
    total = len(ratios) * len(GAP_STEPS)
    best: tuple[float, dict[str, float]] = np.inf, gaps_before
    for n, ratio in enumerate(ratios):
        gaps = [rule * GAP_STEP**step for step in GAP_STEPS]
        levels = []
        for k, gap in enumerate(gaps):
            tried = replace_numbers(values, {"gap": gap, "second_gap": ratio * gap})
            levels.append(find_level(tried, structure, stop))
            report(n * len(gaps) + k + 1, total)
        for k in range(1, len(gaps) - 1):
            worst = max(levels[j] * (gaps[k] / gaps[j]) for j in (k - 1, k, k + 1))
            if worst < best[0]:
                best = worst, {"gap": gaps[k], "second_gap": ratio * gaps[k]}
    why = (
        f"the lowest level that ±{100 * (GAP_STEP - 1):.0f} % of the load leaves low, of {total} "
        f"pairs of gaps by {2 * total} sweeps"
    )
    return Recommendation(best[1], why)


def find_level(values: ControlValues, structure: Structure, stop: Stop) -> float:
    """Return the level in m at the marked load, of `MEMBERS` ensemble members.

    A swept load passes the resonance in both directions. The level is infinite if a run fails.
    Raises `Newer` after a ``stop``.
    """
    scene = scene_of(values, structure)
    loading = Loading(values.load, scene.model, values.resonance)
    case = CurveCase(
        scene,
        np.array([values.intensity]),
        values.resonance,
        sweep_range_of(values, structure),
        load=loading.act,
        steady_start=True,
    )
    passes = curve_passes(
        case, [Pass(members=MEMBERS)], stop, measure=loading.measure, both_ways=loading.swept
    )
    try:
        (*_, (_, curve)) = passes
    except IntegrationError:  # these gaps are no candidates
        return math.inf
    if stop.given:
        raise Newer
    return float(curve.median[0])
