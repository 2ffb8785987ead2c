"""What the explorer computes for one setting of its page, piece by piece: rough points first, then finer ones, then what they are compared with.

Each piece is a message, plain data that the page draws. `Work.pieces` runs in a thread of its own and is ended by a `Stop`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from functools import cached_property, partial
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.budget import Stop
from impact_env.curve import CurveCase, Pass, PerformanceCurve, curve_passes
from impact_env.drive import Drive
from impact_env.ensemble import Lane, run_lanes
from impact_env.families import kernel_key
from impact_env.frequency import tip_response
from impact_env.laws import words
from impact_env.methods import Exact
from impact_env.modes import ModalModel, Structure, mode_shapes
from impact_env.parameters import Beam, ParameterError, SeveralAbsorbers, SlidingAbsorber, StuckAbsorber, TunedAbsorber, friction_damper
from impact_env.prepare import is_ready, prepare
from impact_env.response import Record, Response
from impact_env.scene import Scene
from impact_env.sweep import simulate
from optimisation.bounds import design_gap, reach, resonance_limit, share_reached
from optimisation.comparison import force_grid
from optimisation.explore.advice import tuned_to
from optimisation.explore.branches import followed
from optimisation.explore.settings import Asked, places_of, scene_of, structure_of
from optimisation.explore.waiting import Kernels, Newer
from optimisation.friction_rule import best_friction
from optimisation.gap_check import scaled_absorber
from optimisation.mounting import scene_on
from optimisation.sweep_rate import stationary_level

Array = NDArray[np.float64]
Message = dict[str, Any]
FORCES, ROUGH = 24, Pass(4, 5.0)
SPAN = (0.06, 5.0)  # of the force in the middle of the curve
BINS, POINTS, ALONG = 600, 401, 41  # of the envelope, of linear responses, of the drawn beam
PERIODS = 6.0  # pseudo periods to either side of the instant
MOST_MARKS = 2000  # impacts that are drawn
FULL = Record(events=True, series=True)


def rounded(values: Any, digits: int = 6) -> list[Any]:
    """Return numbers with so many digits, None for what is no number, in lists as deep as the array."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim > 1:
        return [rounded(row, digits) for row in array]
    return [float(f"{x:.{digits}g}") if np.isfinite(x) else None for x in array]


class Work:
    """One setting of a page: `pieces` yields messages until all is known or ``stop`` is given; the curve has a stop of its own, ``first``."""

    def __init__(self, values: Asked, structure: Structure, kernels: Kernels) -> None:
        self.values, self.structure, self.kernels = values, structure_of(values, structure), kernels
        self.stop, self.first, self.rough_done = Stop(), Stop(), False
        self.scene = scene_of(values, structure)
        self.model, self.force, self.resonance = self.scene.model, values["force"], values.resonance

    @property
    def curve_key(self) -> tuple[Any, ...]:
        """What the curve and what it is compared with depend on: all but force, direction and instant."""
        return self.values.concept, *(item for item in sorted(self.values.numbers.items()) if item[0] != "force")

    @property
    def mass(self) -> float:
        """Mass in kg that others are compared with: the absorber's, or that which it would have."""
        return self.values["mass_ratio"] * self.model.beam_mass

    def middle(self) -> float:
        """Return the force in N in the middle of the curve: the rule's for the gap, or the marked one where there is none."""
        gap = self.gap()
        if gap is not None and reach(self.alone, self.mass, self.resonance) > 0.5:
            return gap / design_gap(self.alone, self.mass, 1.0, self.resonance)
        return 3.5 * 10 ** round(np.log10(self.force / 3.5))  # decades: it stays while the marked force moves

    def gap(self) -> float | None:
        """Return the gap in m, that of the first of two."""
        return self.values["gap"] if self.values.concept in ("impact", "two") else None

    @cached_property
    def alone(self) -> ModalModel:
        """The model with the first absorber's place."""
        return scene_on(self.structure, None, *places_of(self.values)[:1]).model

    def case(self) -> CurveCase:
        """Return the curve's case."""
        return CurveCase(self.scene, force_grid(self.middle(), FORCES), self.resonance)

    def ready(self, scene: Scene, record: Record, what: str, stop: Stop) -> Iterator[Message]:
        """Yield what is being compiled until a scene's kernels are ready."""
        key, seconds = (kernel_key(scene, Exact()), record, scene.model.response_shape is None), None
        for seconds in self.kernels.waited(key, partial(is_ready, scene, None, record), partial(prepare, scene, None, record), stop):
            yield {"type": "compiling", "what": what, "seconds": round(seconds, 1)}
        if seconds is not None:
            yield {"type": "compiling", "what": what, "seconds": None}

    def pieces(self, known: dict[tuple[Any, ...], list[Message]]) -> Iterator[Message]:
        """Yield all messages. ``known``: finished curves by their keys, and what they are compared with; it is added to."""
        again = known.get(self.curve_key)
        yield from self.ready(self.scene, Record(), "curve", self.stop)
        case, finished = self.case(), list[Message]()
        with closing(curve_passes(case, [ROUGH, Pass(), Pass(members=self.values.members)], self.first)) as passes:
            if again is None:
                yield from self._one_pass(passes)
            self.rough_done = True
            self._go_on()
            yield from self.sweep()
            for message in again or chain(self._one_pass(passes), self._quick_lines(case)):
                yield self._kept(message, finished)
            yield from self.card(case)
            if again is None:
                for message in chain(self._one_pass(passes), self._slow_lines(case)):
                    yield self._kept(message, finished)
                known.clear()  # one is enough: back and forth between two is no use of a page
                known[self.curve_key] = [message for message in finished if message.get("complete", True)]
        yield from self.responses()
        yield {"type": "done"}

    def before_advice(self) -> Iterator[Message]:
        """Yield what is being compiled until advice can be asked for."""
        if self.values.concept == "impact":
            own = scaled_absorber(self.alone, self.force, self.resonance, self.values["mass_ratio"], self.values["restitution"])
            yield from self.ready(Scene(self.alone, own), Record(), "advice", self.stop)

    def _kept(self, message: Message, finished: list[Message]) -> Message:
        self._go_on()
        finished.append(message)
        return message

    def _one_pass(self, passes: Iterator[tuple[Pass, PerformanceCurve]]) -> Iterator[Message]:
        for one, curve in passes:
            yield self._curve(one, curve)
            if curve.complete:
                return

    def _go_on(self) -> None:
        if self.stop.given:
            raise Newer

    def _curve(self, one: Pass, curve: PerformanceCurve) -> Message:
        up, down = (np.array([np.nanmedian(row) if not np.isnan(row).all() else np.nan for row in curve.level[..., d]]) for d in (0, 1))
        low, high = curve.band
        return {
            "type": "curve",
            "rough": one.faster != 1.0,
            "members": one.members,
            "complete": curve.complete,
            "force": rounded(curve.forces, 17),
            "both": rounded(curve.median, 17),
            "low": rounded(low),
            "high": rounded(high),
            "up": rounded(up),
            "down": rounded(down),
        }

    def sweep(self) -> Iterator[Message]:
        """Yield the sweep at the marked force, and the motion around the chosen instant."""
        yield from self.ready(self.scene, FULL, "sweep", self.stop)
        up, down = CurveCase(self.scene, [self.force], self.resonance).schedules()  # type: ignore[arg-type]
        drive = Drive(self.force, down if self.values.direction == "down" else up)
        response = simulate(self.scene, drive, record=replace(FULL, envelope=BINS), stop=self.stop)
        yield self._sweep(response)
        yield self._motion(response)

    def _sweep(self, response: Response) -> Message:
        level, envelope, impacts, schedule = response.level, response.envelope, response.impacts, response.drive.schedule
        assert level is not None
        assert envelope is not None
        times = np.zeros(0) if impacts is None else impacts.time
        centres = (envelope.edges[1:] + envelope.edges[:-1]) / 2
        return {
            "type": "sweep",
            "force": self.force,
            "time": rounded(centres),
            "ratio": rounded(schedule.omega_at(centres) / schedule.reference),
            "low": rounded(envelope.low),
            "high": rounded(envelope.high),
            "level": level.value,
            "at": level.time,
            "at_ratio": level.frequency_ratio,
            "window": [max(level.time - 10 * schedule.pseudo_period, 0), min(level.time + 10 * schedule.pseudo_period, float(schedule.times[-1]))],
            "impacts": response.impact_count,
            "marks": rounded(times[:: -(-len(times) // MOST_MARKS) or 1]),
            "stuck_time": response.stuck_time,
            "periods": schedule.periods,
            "end": float(schedule.times[-1]),
        }

    def _motion(self, response: Response) -> Message:
        history, schedule, beam = response.history, response.drive.schedule, self.structure
        assert history is not None
        assert response.level is not None
        at = response.level.time if self.values.instant is None else min(self.values.instant, float(schedule.times[-1]))
        reach_s = PERIODS * schedule.pseudo_period
        part = slice(*np.searchsorted(history.time, (at - reach_s, at + reach_s)))
        moved = isinstance(self.scene.absorber, SlidingAbsorber | TunedAbsorber | SeveralAbsorbers)
        along = np.linspace(0, 1, ALONG) if isinstance(beam, Beam) else None
        absorbers = history.absorber_displacement[part].reshape(-1, self.scene.places) if moved else None
        shapes = self.scene.absorber_shapes
        times = np.zeros(0) if response.impacts is None else response.impacts.time
        struck = (times >= at - reach_s) & (times <= at + reach_s)
        return {
            "type": "motion",
            "at": at,
            "period": schedule.pseudo_period,
            "time": rounded(history.time[part], 9),
            "modal": rounded(history.modal_displacement[part]),
            "absorbers": None if absorbers is None else rounded(absorbers),
            "places": list(places_of(self.values)) if isinstance(beam, Beam) else [1.0] * len(shapes),
            "place_shapes": rounded(shapes),
            "gaps": [None if (w := self.scene.cavity(a)) is None else w.gap for a in range(len(shapes))],
            "along": None if along is None else rounded(along),
            "shapes": rounded(mode_shapes(beam, along)) if along is not None and isinstance(beam, Beam) else None,
            "level_shape": rounded(self.model.level_shape),
            "impacts": rounded(times[struck][:MOST_MARKS], 9),
            "struck": [] if response.impacts is None else response.impacts.absorber[struck][:MOST_MARKS].tolist(),
        }

    def card(self, case: CurveCase) -> Iterator[Message]:
        """Yield the numbers at the marked force."""
        members = Pass(members=self.values.members)
        (*_, (_, here)) = curve_passes(replace(case, forces=np.array([self.force])), [members], self.stop)
        free = run_lanes([Lane(Scene(_at_level(self.model)), Drive(self.force, schedule)) for schedule in case.schedules()], stop=self.stop)
        self._go_on()
        level, without, gap = float(here.median[0]), float(np.max(free.level)), self.gap()
        (low,), (high,) = here.band
        numbers: Message = {
            "type": "card",
            "force": self.force,
            "members": self.values.members,
            "level": level,
            "band": [float(low), float(high)],
            "without": without,
            "stationary": self.force * stationary_level(self.model, self.resonance),
            "mass": self.scene.absorber_mass,
            "resonance_hz": self.model.resonance_omega(self.resonance) / (2 * np.pi),
            "impacts_a_period": float(np.nanmean(here.lanes.impacts)) / case.schedules()[0].periods,
            "words": words(self.scene.absorber),
            "rate": case.percent_per_100_periods,
        }
        if gap is not None:
            rule = design_gap(self.alone, self.mass, self.force, self.resonance)
            numbers |= {"gap": gap, "rule_gap": rule, "reach": reach(self.alone, self.mass, self.resonance) * rule / gap}
        if self.values.concept == "impact":
            assert gap is not None
            numbers["limit"] = float(resonance_limit(self.model, self.mass, gap, self.force, self.resonance))
            numbers["share"] = float(share_reached(self.model, self.mass, gap, self.force, level, self.resonance))
        yield {name: None if isinstance(x, float) and not np.isfinite(x) else x for name, x in numbers.items()}

    def _quick_lines(self, case: CurveCase) -> Iterator[Message]:
        """Yield the curves to compare with that take no time: no absorber, and the limit."""
        forces = case.forces
        yield from self._line("none", Scene(_at_level(self.model)), case)
        gap = self.gap()
        if self.values.concept == "impact" and gap is not None:
            yield {
                "type": "line",
                "which": "limit",
                "force": rounded(forces),
                "level": rounded(resonance_limit(self.model, self.mass, gap, forces, self.resonance)),
            }

    def _slow_lines(self, case: CurveCase) -> Iterator[Message]:
        """Yield the curves of a friction damper and of a tuned absorber of the same mass at the same place."""
        model = self.alone
        if self.values.concept not in ("friction", "none"):
            try:
                damper = friction_damper(best_friction(model, self.mass, self.middle(), self.resonance)[0], self.values["mass_ratio"])
            except ParameterError:  # the force, or the damper, is at a node
                damper = None
            if damper is not None:
                yield from self._line("friction", Scene(model, damper), case)
        if self.values.concept not in ("tuned", "none"):
            self._go_on()
            yield from self._line("tuned", Scene(model, tuned_to(model, self.values["mass_ratio"], self.resonance)), case)

    def _line(self, which: str, scene: Scene, case: CurveCase) -> Iterator[Message]:
        yield from self.ready(scene, Record(), which, self.stop)
        (*_, (_, curve)) = curve_passes(replace(case, scene=scene), [Pass()], self.stop)
        self._go_on()
        yield {"type": "line", "which": which, "of": words(scene.absorber), "force": rounded(curve.forces), "level": rounded(curve.median)}

    def responses(self) -> Iterator[Message]:
        """Yield stationary amplitudes over the frequency: without absorber, with it stuck or as the linear one that it is, and periodic branches."""
        low, high = CurveCase(self.scene, [1.0], self.resonance).limits  # type: ignore[arg-type]
        ratios, reference, absorber = np.linspace(low, high, POINTS), self.model.resonance_omega(self.resonance), self.scene.absorber
        lines = {"without": None} | ({} if absorber is None or isinstance(absorber, SeveralAbsorbers) else {"with": absorber})
        amplitudes = {}
        for name, own in lines.items():
            linear = own if isinstance(own, TunedAbsorber | None) else StuckAbsorber(self.values["mass_ratio"])
            amplitudes["stuck" if isinstance(own, SlidingAbsorber) else name] = rounded(
                self.force * np.abs(tip_response(self.model, linear, ratios * reference))
            )
        found: list[Message] = []
        message = {"type": "response", "force": self.force, "ratio": rounded(ratios), **amplitudes, "branches": found, "complete": False}
        yield dict(message)
        try:
            for curve in followed(self.scene, self.force, self.resonance, low, high, self.stop, self.kernels):
                if isinstance(curve, float):
                    yield {"type": "compiling", "what": "response", "seconds": round(curve, 1)}
                    continue
                stable = np.zeros(len(curve.tip_max), dtype=bool) if curve.stable is None else curve.stable
                found.append({"ratio": rounded(curve.omega_ratio), "amplitude": rounded(curve.tip_max), "stable": stable.tolist()})
                yield dict(message, branches=list(found))
        except ParameterError as error:
            message["note"] = str(error)
        yield dict(message, branches=list(found), complete=True)


def _at_level(model: ModalModel) -> ModalModel:
    """Return the model for a scene without absorber, whose place then is free: where the level is read, so that levels stream."""
    return replace(model, tip_shape=model.level_shape, absorber_shapes=None, response_shape=None)
