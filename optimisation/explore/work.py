"""What the explorer computes for one setting of its page, piece by piece: rough points first, then finer ones, then what they are compared with.

Each piece is a message, plain data that the page draws. `Work.pieces` runs in a thread of its own and is ended by a `Stop`.
"""

from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import cached_property, partial
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.curve import CurveCase, Pass, PerformanceCurve, curve_passes
from impact_env.ensemble import Lane
from impact_env.frequency import tip_response
from impact_env.laws import describe_absorber
from impact_env.level import HALF_WINDOW_PERIODS
from impact_env.loads import Loads
from impact_env.methods import Exact
from impact_env.modes import ModalModel, Structure, mode_shapes
from impact_env.parameters import (
    Beam,
    ParameterError,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    friction_damper,
)
from impact_env.prepare import is_ready, prepare
from impact_env.results import Record, Response
from impact_env.scene import Scene
from impact_env.solvers import kernel_key
from impact_env.sweep import Stop, simulate
from optimisation.absorber_rules import best_friction, scaled_absorber
from optimisation.bounds import design_gap, reach, resonance_limit, share_reached
from optimisation.comparison import force_grid
from optimisation.explore.settings import (
    BAND,
    LOADS,
    ControlValues,
    Loading,
    controls,
    places_of,
    scene_of,
    structure_of,
    sweep_range_of,
)
from optimisation.explore.waiting import Kernels, Newer, followed, tuned_to
from optimisation.files import number
from optimisation.measures import impact_measures, read, settled_after
from optimisation.mounting import scene_on
from optimisation.signals import spectrum
from optimisation.statistics import prediction_band, prediction_interval

Array = NDArray[np.float64]
Message = dict[str, Any]
FORCES = 24
ROUGH = Pass(4, 5.0)
SPAN = (0.06, 5.0)  # of the force in the middle of the curve
# of the envelope, of linear responses, of the drawn beam
BINS = 600
POINTS = 401
ALONG = 41
PERIODS = 6.0  # pseudo periods to either side of the instant
MOST_MARKS = 2000  # impacts that are drawn


def rounded(values: Any, digits: int = 6) -> list[Any]:
    """Return numbers with so many digits, None for what is no number, in lists as deep as the array."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim > 1:
        return [rounded(row, digits) for row in array]
    return [float(f"{x:.{digits}g}") if np.isfinite(x) else None for x in array]


class Work:
    """One setting of a page: `pieces` yields messages until all is known or ``stop`` is given; the curve has a stop of its own, ``first``."""

    def __init__(self, values: ControlValues, structure: Structure, kernels: Kernels) -> None:
        self.values = values
        self.own = structure
        self.structure = structure_of(values, structure)
        self.kernels = kernels
        self.stop = Stop()
        self.first = Stop()
        self.rough_done = False
        self.scene = scene_of(values, structure)
        self.model = self.scene.model
        self.intensity = values.intensity
        self.resonance = values.resonance
        self.limits = sweep_range_of(values, structure)
        self.loading = Loading(values.load, self.model, self.resonance)
        self.density: tuple[Array, Array] | None = (
            None  # in Hz and m^2/Hz, of a random force after the start, from the sweep on
        )
        self.impacts: dict[str, float] = {}  # what the absorber bears in the run that is shown

    @property
    def curve_key(self) -> tuple[Any, ...]:
        """What the curve and what it is compared with depend on: all but the load's intensity, direction and instant."""
        return (
            self.values.concept,
            self.values.load,
            *(item for item in sorted(self.values.numbers.items()) if item[0] not in LOADS),
        )

    @property
    def mass(self) -> float:
        """Mass in kg that others are compared with: the absorber's, or that which it would have."""
        return self.values["mass_ratio"] * self.model.beam_mass

    def middle(self) -> float:
        """Return the intensity in the middle of the curve: the rule's for the gap, or the marked one where there is none."""
        gap = self.gap()
        if gap is not None and (rule := self.rule(1.0)) is not None and 0 < rule < np.inf:
            return gap / rule
        usual = self.default_force
        return usual * 10 ** round(
            np.log10(self.intensity / usual)
        )  # decades: it stays while the marked intensity moves

    @cached_property
    def default_force(self) -> float:
        """Return the intensity at which the page begins."""
        return next(
            control.value for control in controls(self.own) if control.name == self.values.load
        )

    def rule(self, intensity: float) -> float | None:
        """Return the gap in m from which a search would begin, None where the rule says nothing."""
        says = reach(self.alone, self.mass, self.resonance) > 0.5 and np.isfinite(
            self.loading.worth
        )
        return (
            replace(self.loading, model=self.alone).rule_gap(self.mass, intensity)
            if says or not self.loading.swept
            else None
        )

    def gap(self) -> float | None:
        """Return the gap in m, that of the first of two."""
        return self.values["gap"] if self.values.concept in ("impact", "two") else None

    @cached_property
    def alone(self) -> ModalModel:
        """The model with the first absorber's place."""
        return scene_on(self.structure, None, *places_of(self.values)[:1]).model

    def case(self) -> CurveCase:
        """Return the curve's case."""
        return CurveCase(
            self.scene,
            force_grid(self.middle(), FORCES),
            self.resonance,
            self.limits,
            load=self.loading.act,
            steady_start=True,
        )

    def passes(
        self, case: CurveCase, passes: Sequence[Pass], stop: Stop
    ) -> Generator[tuple[Pass, PerformanceCurve], None, None]:
        """Return `curve_passes` by the load's measure."""
        return curve_passes(
            case, passes, stop, measure=self.loading.measure, both_ways=self.loading.swept
        )

    @cached_property
    def loads(self) -> Loads | None:
        """Return the load that kernels are compiled for, None for the one force."""
        case = CurveCase(self.scene, np.ones(1), self.resonance, self.limits)
        acts = self.loading.act(self.intensity, case.schedules()[0])
        return acts if isinstance(acts, Loads) else None

    def ready(self, scene: Scene, record: Record, what: str, stop: Stop) -> Iterator[Message]:
        """Yield messages about compilation until a scene's kernels are ready."""
        record = self.loading.record if self.loading.measure else record
        key = (
            kernel_key(scene, Exact(), self.loads),
            record,
            self.values.load,
        )
        seconds = None
        arguments = (scene, None, record, self.loads)
        for seconds in self.kernels.waited(
            key, partial(is_ready, *arguments), partial(prepare, *arguments), stop
        ):
            yield {"type": "compiling", "what": what, "seconds": round(seconds, 1)}
        if seconds is not None:
            yield {"type": "compiling", "what": what, "seconds": None}

    def messages(self, known: dict[tuple[Any, ...], list[Message]]) -> Iterator[Message]:
        """Yield all messages. ``known``: finished curves by their keys, and what they are compared with; it is added to."""
        again = known.get(self.curve_key)
        responses = self.responses()
        yield next(responses)  # the linear ones, which need no kernels
        yield from self.ready(self.scene, Record(), "curve", self.stop)
        case = self.case()
        finished = list[Message]()
        with closing(
            self.passes(case, [ROUGH, Pass(), Pass(members=self.values.members)], self.first)
        ) as passes:
            if again is None:
                yield from self._one_pass(passes)
            self.rough_done = True
            self._go_on()
            yield from self.sweep()
            for message in again or chain(self._one_pass(passes), self._quick_lines(case)):
                yield self._append(message, finished)
            yield from self.card(case)
            if again is None:
                for message in chain(self._one_pass(passes), self._slow_lines(case)):
                    yield self._append(message, finished)
                known.clear()  # one is enough: back and forth between two is no use of a page
                known[self.curve_key] = [
                    message for message in finished if message.get("complete", True)
                ]
        yield from responses
        yield {"type": "done"}

    def before_advice(self) -> Iterator[Message]:
        """Yield messages about compilation until advice can be asked for."""
        if self.values.concept == "impact":
            own = self.scene.absorber
            if self.loads is None:
                own = scaled_absorber(
                    self.alone,
                    self.intensity,
                    self.resonance,
                    self.values["mass_ratio"],
                    self.values["restitution"],
                )
            yield from self.ready(Scene(self.alone, own), Record(), "advice", self.stop)

    def _append(self, message: Message, finished: list[Message]) -> Message:
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
        up, down = (
            np.array(
                [
                    np.nanmedian(row) if not np.isnan(row).all() else np.nan
                    for row in curve.level[..., d]
                ]
            )
            for d in (0, 1)
        )
        low, high = prediction_band(curve.combined)
        about = {
            "type": "curve",
            "rough": one.faster != 1.0,
            "members": one.members,
            "complete": curve.complete,
        }
        lines = {"force": rounded(curve.forces, 17), "both": rounded(curve.median, 17)}
        return (
            about
            | lines
            | {"low": rounded(low), "high": rounded(high), "up": rounded(up), "down": rounded(down)}
        )

    def sweep(self) -> Iterator[Message]:
        """Yield the sweep at the marked force, and the motion around the chosen instant."""
        yield from self.ready(self.scene, self.loading.record, "sweep", self.stop)
        up, down = self.case().schedules()
        drive = self.loading.act(self.intensity, down if self.values.direction == "down" else up)
        response = simulate(
            self.scene,
            drive,
            initial=Lane(self.scene, drive, steady_start=True).start,
            record=replace(self.loading.record, envelope=BINS),
            stop=self.stop,
        )
        yield self._sweep(response)
        yield self._motion(response)
        if self.gap() is not None:
            self.impacts = dict(
                zip(
                    ("largest_speed", "rms_speed", "impacts_a_second", "power"),
                    impact_measures(response),
                    strict=True,
                )
            )
        if not self.loading.swept:
            history = response.history
            assert history is not None
            values = (history.modal_displacement @ self.model.level_shape)[
                history.time >= settled_after(response)
            ]
            self.density = spectrum(values, 1 / float(history.time[1]))

    def _sweep(self, response: Response) -> Message:
        level = response.level
        envelope = response.envelope
        impacts = response.impacts
        schedule = response.drive.schedule
        assert level is not None
        end = float(schedule.times[-1])
        reach_s = HALF_WINDOW_PERIODS * schedule.pseudo_period
        swept = self.loading.swept
        assert envelope is not None
        times = np.zeros(0) if impacts is None else impacts.time
        centres = (envelope.edges[1:] + envelope.edges[:-1]) / 2
        return {
            "type": "sweep",
            "force": self.intensity,
            "time": rounded(centres),
            "swept": swept,
            "ratio": rounded(schedule.omega_at(centres) / schedule.reference if swept else centres),
            "low": rounded(envelope.low),
            "high": rounded(envelope.high),
            "level": read(response),
            "at": level.time,
            "window": [max(level.time - reach_s, 0), min(level.time + reach_s, end)]
            if swept
            else [settled_after(response), end],
            "impacts": response.impact_count,
            "marks": rounded(times[:: -(-len(times) // MOST_MARKS) or 1]),
        }

    def _motion(self, response: Response) -> Message:
        history = response.history
        schedule = response.drive.schedule
        beam = self.structure
        assert history is not None
        assert response.level is not None
        at = (
            response.level.time
            if self.values.instant is None
            else min(self.values.instant, float(schedule.times[-1]))
        )
        reach_s = PERIODS * schedule.pseudo_period
        part = slice(*np.searchsorted(history.time, (at - reach_s, at + reach_s)))
        moved = isinstance(self.scene.absorber, SlidingAbsorber | TunedAbsorber | SeveralAbsorbers)
        along = np.linspace(0, 1, ALONG) if isinstance(beam, Beam) else None
        absorbers = (
            history.absorber_displacement[part].reshape(-1, self.scene.places) if moved else None
        )
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
            "places": list(places_of(self.values))
            if isinstance(beam, Beam)
            else [1.0] * len(shapes),
            "place_shapes": rounded(shapes),
            "gaps": [
                None if (w := self.scene.cavity(a)) is None else w.gap for a in range(len(shapes))
            ],
            "along": None if along is None else rounded(along),
            "shapes": rounded(mode_shapes(beam, along))
            if along is not None and isinstance(beam, Beam)
            else None,
            "level_shape": rounded(self.model.level_shape),
            "impacts": rounded(times[struck][:MOST_MARKS], 9),
            "struck": []
            if response.impacts is None
            else response.impacts.absorber[struck][:MOST_MARKS].tolist(),
        }

    def card(self, case: CurveCase) -> Iterator[Message]:
        """Yield the numbers at the marked force."""
        here, free = (
            self._last(replace(case, scene=scene, forces=np.array([self.intensity])), members)
            for scene, members in (
                (self.scene, self.values.members),
                (Scene(_at_level(self.model)), 1),
            )
        )
        level = float(here.median[0])
        without = float(free.median[0])
        gap = self.gap()
        omega = self.model.resonance_omega(self.resonance)
        low, high = prediction_interval(here.combined[0])
        numbers: Message = {
            "type": "card",
            "force": self.intensity,
            "members": self.values.members,
            "level": level,
            "band": [number(low), number(high)],
            "without": without,
            "mass": self.scene.absorber_mass,
            "resonance_hz": omega / (2 * np.pi),
            "impacts_a_period": float(np.nanmean(here.lanes.impacts)) / case.schedules()[0].periods,
            "words": describe_absorber(self.scene.absorber),
            "rate": case.percent_per_100_periods if self.loading.swept else None,
            "acceleration": np.sqrt(2)
            * level
            * (float(np.max(here.lanes.frequency_ratio)) * omega) ** 2
            if self.loading.swept
            else None,
        }
        if gap is not None:
            numbers |= {"gap": gap, "rule_gap": self.rule(self.intensity)} | self.impacts
        if gap is not None and self.values.load == "force":
            rule = design_gap(self.alone, self.mass, self.intensity, self.resonance)
            numbers["reach"] = reach(self.alone, self.mass, self.resonance) * rule / gap
            if self.values.concept == "impact":
                numbers["limit"] = float(
                    resonance_limit(
                        self.model, self.mass, gap, self.intensity, self.resonance, *self.limits
                    )
                )
                numbers["share"] = float(
                    share_reached(
                        self.model,
                        self.mass,
                        gap,
                        self.intensity,
                        level,
                        self.resonance,
                        *self.limits,
                    )
                )
        yield {
            name: None if isinstance(x, float) and not np.isfinite(x) else x
            for name, x in numbers.items()
        }

    def _last(self, case: CurveCase, members: int = 1) -> PerformanceCurve:
        """Return a whole curve."""
        (*_, (_, curve)) = self.passes(case, [Pass(members=members)], self.stop)
        self._go_on()
        return curve

    def _quick_lines(self, case: CurveCase) -> Iterator[Message]:
        """Yield the curves to compare with that take no time: no absorber, and the limit."""
        forces = case.forces
        yield from self._line("none", Scene(_at_level(self.model)), case)
        gap = self.gap()
        if self.values.concept == "impact" and gap is not None and self.values.load == "force":
            level = rounded(
                resonance_limit(self.model, self.mass, gap, forces, self.resonance, *self.limits)
            )
            yield {"type": "line", "which": "limit", "force": rounded(forces), "level": level}

    def _slow_lines(self, case: CurveCase) -> Iterator[Message]:
        """Yield the curves of a friction damper and of a tuned absorber of the same mass at the same place."""
        model = self.alone
        if (
            self.values.concept not in ("friction", "none")
            and self.loading.swept
            and np.isfinite(self.loading.worth)
        ):
            try:
                force = self.middle() * self.loading.worth
                damper = friction_damper(
                    best_friction(model, self.mass, force, self.resonance)[0],
                    self.values["mass_ratio"],
                )
            except ParameterError:  # the force, or the damper, is at a node
                damper = None
            if damper is not None:
                yield from self._line("friction", Scene(model, damper), case)
        if self.values.concept not in ("tuned", "none"):
            self._go_on()
            yield from self._line(
                "tuned",
                Scene(model, tuned_to(model, self.values["mass_ratio"], self.resonance)),
                case,
            )

    def _line(self, which: str, scene: Scene, case: CurveCase) -> Iterator[Message]:
        yield from self.ready(scene, Record(), which, self.stop)
        curve = self._last(replace(case, scene=scene))
        yield {
            "type": "line",
            "which": which,
            "of": describe_absorber(scene.absorber),
            "force": rounded(curve.forces),
            "level": rounded(curve.median),
        }

    def responses(self) -> Iterator[Message]:
        """Yield stationary amplitudes over the frequency: without absorber, with it stuck or as the linear one that it is, and periodic branches."""
        low, high = self.limits if self.loading.swept else BAND
        ratios = np.linspace(low, high, POINTS)
        reference = self.model.resonance_omega(self.resonance)
        absorber = self.scene.absorber
        lines = {"without": None} | (
            {} if absorber is None or isinstance(absorber, SeveralAbsorbers) else {"with": absorber}
        )
        amplitudes = {}
        model, unit = self.loading.driven(ratios * reference)
        if self.values.load == "base":
            lines.pop("with", None)  # the base moves the absorber's mass as well
        for name, own in lines.items():
            linear = (
                own
                if isinstance(own, TunedAbsorber | None)
                else StuckAbsorber(self.values["mass_ratio"])
            )
            amplitude = (
                self.intensity * unit * np.abs(tip_response(model, linear, ratios * reference))
            )
            amplitudes["stuck" if isinstance(own, SlidingAbsorber) else name] = rounded(amplitude)
        branches: list[Message] = []
        message = {
            "type": "response",
            "force": self.intensity,
            "swept": self.loading.swept,
            "ratio": rounded(ratios),
            **amplitudes,
        }
        message |= {"branches": branches, "complete": False}
        yield dict(message)
        if self.density is not None:
            hertz, density = self.density
            part = slice(*np.searchsorted(2 * np.pi * hertz, [low * reference, high * reference]))
            message["run"] = [
                rounded(2 * np.pi * hertz[part] / reference),
                rounded(np.sqrt(density[part])),
            ]
        if self.values.load != "force":
            yield dict(message, complete=True)
            return
        try:
            for curve in followed(
                self.scene, self.intensity, self.resonance, low, high, self.stop, self.kernels
            ):
                if isinstance(curve, float):
                    yield {"type": "compiling", "what": "response", "seconds": round(curve, 1)}
                    continue
                stable = (
                    np.zeros(len(curve.tip_max), dtype=bool)
                    if curve.stable is None
                    else curve.stable
                )
                branches.append(
                    {
                        "ratio": rounded(curve.omega_ratio),
                        "amplitude": rounded(curve.tip_max),
                        "stable": stable.tolist(),
                    }
                )
                yield dict(message, branches=list(branches))
        except ParameterError as error:
            message["note"] = str(error)
        yield dict(message, branches=list(branches), complete=True)


def _at_level(model: ModalModel) -> ModalModel:
    """Return the model for a scene without absorber, whose place then is free: where the level is read, so that levels stream."""
    return replace(model, tip_shape=model.level_shape, absorber_shapes=None, response_shape=None)
