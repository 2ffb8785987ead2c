"""Computations of the explorer for one setting of its page, in pieces.

Coarse points come first, then finer ones, then the curves with which they are compared.

Each piece is a message, plain data that the page draws. `Work.pieces` runs in a thread of its own
and is ended by a `Stop`.
"""

from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, replace
from functools import cached_property, partial
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError
from impact_env.curve import CurveCase, Measure, Pass, PerformanceCurve, curve_passes
from impact_env.ensemble import Lane
from impact_env.frequency import tip_response
from impact_env.laws import describe_absorber
from impact_env.level import HALF_WINDOW_PERIODS
from impact_env.loads import Loads
from impact_env.methods import Exact
from impact_env.modes import ModalModel, mode_shapes
from impact_env.parameters import (
    Beam,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    friction_damper,
)
from impact_env.prepare import is_ready, prepare
from impact_env.results import Record, Response, require_recorded
from impact_env.scene import Scene
from impact_env.solvers import kernel_key
from impact_env.sweep import IntegrationError, Stop, simulate
from optimisation.absorber_rules import best_friction, scaled_absorber
from optimisation.bounds import design_gap, reach, resonance_limit, share_reached
from optimisation.comparison import force_grid
from optimisation.explore.advice import tune_absorber
from optimisation.explore.control import ControlValues
from optimisation.explore.loading import BAND, LOADS, Loading
from optimisation.explore.settings import (
    PageModel,
    controls,
    places_of,
    scene_of,
    structure_of,
    sweep_range_of,
    sweeps_of,
)
from optimisation.explore.verdict import judge_level
from optimisation.explore.waiting import Kernels, Newer, follow_branches
from optimisation.files import number
from optimisation.frequency_levels import frequency_curve
from optimisation.measures import (
    impact_measures,
    prediction_band,
    prediction_interval,
    read,
    settled_after,
)
from optimisation.mounting import scene_on
from optimisation.signals import spectrum

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
INSTANTS = 90  # of the run, whose motion is drawn over a period each
INSTANT_SAMPLES = 24


def round_values(values: Any, digits: int = 6) -> list[Any]:
    """Return numbers with ``digits`` significant digits, in lists as deep as the array.

    A value that is not a number becomes None.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim > 1:
        return [round_values(row, digits) for row in array]
    return [float(f"{x:.{digits}g}") if np.isfinite(x) else None for x in array]


class Work:
    """Computation of one setting of a page.

    `pieces` yields messages until everything is computed or ``stop`` is given. The curve has a stop
    of its own, ``first``.
    """

    def __init__(self, values: ControlValues, structure: PageModel, kernels: Kernels) -> None:
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
        """Values on which the curve and the curves for comparison depend.

        They are all values except the load's intensity, direction, instant and view.
        """
        return (
            id(self.own),
            self.values.concept,
            self.values.load,
            *(item for item in sorted(self.values.numbers.items()) if item[0] not in LOADS),
        )

    @property
    def mass(self) -> float:
        """Mass in kg that others are compared with: the absorber's, or that which it would have."""
        return self.values["mass_ratio"] * self.model.beam_mass

    def middle(self) -> float:
        """Return the intensity in the middle of the curve.

        It is that of the design rule for the gap, or near the marked intensity if the rule gives
        none.
        """
        gap = self.gap()
        if gap is not None and (rule := self.rule(1.0)) is not None and 0 < rule < np.inf:
            return gap / rule
        usual = next(
            control.value for control in controls(self.own) if control.name == self.values.load
        )
        return usual * 10 ** round(
            np.log10(self.intensity / usual)
        )  # decades: it stays while the marked intensity moves

    def rule(self, intensity: float) -> float | None:
        """Return the gap in m from which a search would begin, None if the rule does not apply."""
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

    @property
    def reference_omega(self) -> float:
        """Circular frequency in rad/s of the resonance to which frequencies refer."""
        return self.model.resonance_omega(self.resonance)

    @property
    def measure(self) -> Measure | None:
        """What a curve shows, None for the response level."""
        return self.loading.measure

    @property
    def first_pass(self) -> Pass:
        """The runs from which a curve is drawn at first."""
        return ROUGH

    @property
    def forces(self) -> int:
        """Number of points of the curve."""
        return FORCES

    @cached_property
    def free_scene(self) -> Scene:
        """The scene without absorber."""
        # no absorber needs the place at its absorber, so levels are read there and stream
        at_level = replace(
            self.model,
            tip_shape=self.model.level_shape,
            absorber_shapes=None,
            response_shape=None,
        )
        return Scene(at_level)

    def case(self) -> CurveCase:
        """Return the curve's case."""
        return CurveCase(
            self.scene,
            force_grid(self.middle(), self.forces),
            self.resonance,
            self.limits,
            load=self.loading.act,
            steady_start=True,
        )

    def passes(
        self, case: CurveCase, passes: Sequence[Pass], stop: Stop
    ) -> Generator[tuple[Pass, PerformanceCurve], None, None]:
        """Return `curve_passes` by the load's measure."""
        return curve_passes(case, passes, stop, measure=self.measure, both_ways=self.loading.swept)

    @cached_property
    def loads(self) -> Loads | None:
        """Return the load that kernels are compiled for, None for the one force."""
        case = CurveCase(self.scene, np.ones(1), self.resonance, self.limits)
        acts = self.loading.act(self.intensity, case.schedules()[0])
        return acts if isinstance(acts, Loads) else None

    def ready(self, scene: Scene, record: Record, what: str, stop: Stop) -> Iterator[Message]:
        """Yield messages about compilation until a scene's kernels are ready."""
        record = self.loading.record if self.measure else record
        key = (
            kernel_key(scene, Exact(), self.loads),
            record,
            self.values.load,
        )
        seconds = None
        arguments = (scene, None, record, self.loads)
        for seconds in self.kernels.wait_for_kernels(
            key, partial(is_ready, *arguments), partial(prepare, *arguments), stop
        ):
            yield {"type": "compiling", "what": what, "seconds": round(seconds, 1)}
        if seconds is not None:
            yield {"type": "compiling", "what": what, "seconds": None}

    def messages(self, known: dict[tuple[Any, ...], list[Message]]) -> Iterator[Message]:
        """Yield all messages.

        ``known``: finished curves by their keys, with the curves for comparison. New ones are
        added.
        """
        again = known.get(self.curve_key)
        responses = self.responses()
        yield next(responses)  # the linear ones, which need no kernels
        yield from self.ready(self.scene, Record(), "curve", self.stop)
        case = self.case()
        finished = list[Message]()
        with closing(
            self.passes(
                case, [self.first_pass, Pass(), Pass(members=self.values.members)], self.first
            )
        ) as passes:
            if again is None:
                yield from self._one_pass(passes)
            self.rough_done = True
            self._go_on()
            yield from self.sweep()
            for message in again or chain(self._one_pass(passes), self._quick_lines(case)):
                yield self._append(message, finished)
            yield from self._report_problems("card", self.card(case))
            if again is None:
                slow = self._report_problems("curve", self._slow_lines(case))
                for message in chain(self._one_pass(passes), slow):
                    yield self._append(message, finished)
                known.clear()  # one is enough: back and forth between two is no use of a page
                known[self.curve_key] = [
                    message for message in finished if message.get("complete", True)
                ]
        yield from self._report_problems("response", responses)
        yield {"type": "done"}

    def _report_problems(self, panel: str, messages: Iterable[Message]) -> Iterator[Message]:
        """Yield a part's messages, or the reason why it cannot be computed.

        The reason is shown in the part's panel, and the other parts are computed nevertheless.
        """
        try:
            yield from messages
        except (ParameterError, IntegrationError) as error:
            yield {"type": "problem", "what": panel, "error": str(error)}

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
        lines = {"force": round_values(curve.forces, 17), "both": round_values(curve.median, 17)}
        return (
            about
            | lines
            | {
                "low": round_values(low),
                "high": round_values(high),
                "up": round_values(up),
                "down": round_values(down),
            }
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
        yield self._whole_run(response)
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
            "time": round_values(centres),
            "swept": swept,
            "ratio": round_values(
                schedule.omega_at(centres) / schedule.reference if swept else centres
            ),
            "low": round_values(envelope.low),
            "high": round_values(envelope.high),
            "level": read(response),
            "at": level.time,
            "window": [max(level.time - reach_s, 0), min(level.time + reach_s, end)]
            if swept
            else [settled_after(response), end],
            "impacts": response.impact_count,
            "marks": round_values(times[:: -(-len(times) // MOST_MARKS) or 1]),
        }

    def _motion(self, response: Response) -> Message:
        """Return the motion around the chosen instant, of `PERIODS` to either side."""
        history = require_recorded("history", response.history)
        level = require_recorded("level", response.level)
        schedule = response.drive.schedule
        chosen = self.values.instant
        at = level.time if chosen is None else min(chosen, float(schedule.times[-1]))
        reach_s = PERIODS * schedule.pseudo_period
        first, last = np.searchsorted(history.time, (at - reach_s, at + reach_s))
        rows = np.arange(first, last)
        return {
            "type": "motion",
            "at": at,
            **self._shapes(),
            **self._samples(response, rows, (at - reach_s, at + reach_s)),
        }

    def _whole_run(self, response: Response) -> Message:
        """Return the motion over a period at each of `INSTANTS` of the whole run.

        The periods follow each other. ``part``: number of samples of each.
        """
        history = require_recorded("history", response.history)
        schedule = response.drive.schedule
        end = float(schedule.times[-1]) - schedule.pseudo_period
        starts = np.linspace(0.0, max(end, 0.0), INSTANTS)
        offsets = np.arange(INSTANT_SAMPLES + 1) / INSTANT_SAMPLES * schedule.pseudo_period
        times = (starts[:, None] + offsets).ravel()
        rows = np.minimum(np.searchsorted(history.time, times), len(history.time) - 1)
        return {
            "type": "whole_run",
            "part": INSTANT_SAMPLES + 1,
            **self._shapes(),
            **self._samples(response, rows, None, digits=4),
        }

    def _samples(
        self,
        response: Response,
        rows: NDArray[np.int_],
        limits: tuple[float, float] | None,
        digits: int = 6,
    ) -> Message:
        """Return a run's states at some rows of its history, and its impacts.

        ``limits``: times in s between which impacts are returned (None: those near the rows).
        """
        history = require_recorded("history", response.history)
        schedule = response.drive.schedule
        moves = not isinstance(self.scene.absorber, StuckAbsorber | None)
        absorbers = None
        if moves:
            absorbers = history.absorber_displacement[rows].reshape(-1, self.scene.places)
        times = np.zeros(0)
        struck = np.zeros(0, dtype=int)
        if response.impacts is not None:
            times = response.impacts.time
            struck = response.impacts.absorber
            if limits is None:
                flash = schedule.pseudo_period / INSTANT_SAMPLES
                before = np.clip(np.searchsorted(history.time[rows], times), 1, len(rows) - 1)
                distance = np.minimum(
                    np.abs(history.time[rows][before] - times),
                    np.abs(history.time[rows][before - 1] - times),
                )
                near = distance <= flash
            else:
                near = (times >= limits[0]) & (times <= limits[1])
            times, struck = times[near], struck[near]
        return {
            "period": schedule.pseudo_period,
            "time": round_values(history.time[rows], 9),
            "modal": round_values(history.modal_displacement[rows], digits),
            "absorbers": None if absorbers is None else round_values(absorbers, digits),
            "impacts": round_values(times[:MOST_MARKS], 9),
            "struck": struck[:MOST_MARKS].tolist(),
        }

    def _shapes(self) -> Message:
        """Return the shapes by which states are drawn, and the absorbers' places and gaps."""
        beam = self.structure
        shapes = self.scene.absorber_shapes
        cavities = [self.scene.cavity(a) for a in range(len(shapes))]
        along = np.linspace(0, 1, ALONG) if isinstance(beam, Beam) else None
        return {
            "places": list(places_of(self.values))
            if isinstance(beam, Beam)
            else [1.0] * len(shapes),
            "place_shapes": round_values(shapes),
            "gaps": [None if walls is None else walls.gap for walls in cavities],
            "along": None if along is None else round_values(along),
            "shapes": round_values(mode_shapes(beam, along))
            if along is not None and isinstance(beam, Beam)
            else None,
            "level_shape": round_values(self.model.level_shape),
        }

    def card(self, case: CurveCase) -> Iterator[Message]:
        """Yield the numbers at the marked load, and the verdict."""
        members = self.values.members
        own = self._last(
            replace(case, scene=self.scene, forces=np.array([self.intensity])), members
        )
        free = own
        if self.values.concept != "none":
            # a linear scene: members differ only under a random force, whose records do
            free = self._last(
                replace(case, scene=self.free_scene, forces=np.array([self.intensity])),
                1 if self.loading.swept else members,
            )
        levels = self._levels(own)
        level = float(np.median(levels))
        without = float(np.median(self._levels(free)))
        band = prediction_interval(levels)
        omega = self.reference_omega
        ratio = float(np.max(own.lanes.frequency_ratio))
        impacts = float(np.nanmean(own.lanes.impacts))
        numbers: Message = {
            "level": level,
            "band": [number(end) for end in band],
            "without": without,
            "mass": self.scene.absorber_mass,
            "resonance_hz": omega / (2 * np.pi),
            "impacts_a_period": impacts / case.schedules()[0].periods / self.scene.places,
            "rate": case.percent_per_100_periods if self.loading.swept else None,
            "acceleration": np.sqrt(2) * level * (ratio * omega) ** 2
            if self.loading.swept
            else None,
            **self._cavity_numbers(level),
        }
        verdict = judge_level(self.values.concept, level, without, band, numbers)
        about: Message = {
            "type": "card",
            "force": self.intensity,
            "members": members,
            "direction": self.values.direction,
            "words": describe_absorber(self.scene.absorber),
            "verdict": asdict(verdict),
        }
        yield about | {
            name: None if isinstance(x, float) and not np.isfinite(x) else x
            for name, x in numbers.items()
        }

    def _levels(self, curve: PerformanceCurve) -> Array:
        """Return the members' levels in m at a curve's first load, in the direction of the page."""
        sweeps = sweeps_of(self.values)
        if len(sweeps) == 2:
            return np.asarray(curve.combined[0])
        return np.asarray(curve.level[0, :, ("up", "down").index(sweeps[0])])

    def _cavity_numbers(self, level: float) -> Message:
        """Return the numbers of masses between walls."""
        gap = self.gap()
        if gap is None:
            return {}
        numbers: Message = {"gap": gap, "rule_gap": self.rule(self.intensity)} | self.impacts
        if self.values.load != "force":
            return numbers
        rule = design_gap(self.alone, self.mass, self.intensity, self.resonance)
        numbers["reach"] = reach(self.alone, self.mass, self.resonance) * rule / gap
        if self.values.concept == "impact":
            place = self.model, self.mass, gap, self.intensity
            limit = float(resonance_limit(*place, self.resonance, *self.limits))
            numbers["limit"] = limit
            try:
                share = share_reached(*place, level, self.resonance, *self.limits)
                numbers["share"] = float(share)
            except ParameterError:  # the cavity is so small that nothing can be gained
                numbers["share"] = None
        return numbers

    def _last(self, case: CurveCase, members: int = 1) -> PerformanceCurve:
        """Return a whole curve."""
        (*_, (_, curve)) = self.passes(case, [Pass(members=members)], self.stop)
        self._go_on()
        return curve

    def _quick_lines(self, case: CurveCase) -> Iterator[Message]:
        """Yield the curves to compare with that take no time: no absorber, and the limit."""
        forces = case.forces
        yield from self._line("none", self.free_scene, case)
        gap = self.gap()
        if self.values.concept == "impact" and gap is not None and self.values.load == "force":
            level = round_values(
                resonance_limit(self.model, self.mass, gap, forces, self.resonance, *self.limits)
            )
            yield {"type": "line", "which": "limit", "force": round_values(forces), "level": level}

    def _slow_lines(self, case: CurveCase) -> Iterator[Message]:
        """Yield the curves of a friction damper and of a tuned absorber.

        They have the absorber's mass and place.
        """
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
                Scene(model, tune_absorber(model, self.values["mass_ratio"], self.resonance)),
                case,
            )

    def _line(self, which: str, scene: Scene, case: CurveCase) -> Iterator[Message]:
        yield from self.ready(scene, Record(), which, self.stop)
        curve = self._last(
            replace(case, scene=scene), 1 if self.loading.swept else self.values.members
        )
        yield {
            "type": "line",
            "which": which,
            "of": describe_absorber(scene.absorber),
            "force": round_values(curve.forces),
            "level": round_values(curve.median),
        }

    def responses(self) -> Iterator[Message]:
        """Yield stationary amplitudes over the frequency, and periodic branches.

        The amplitudes are those without absorber and with the absorber stuck, or with it if it is
        linear.
        """
        low, high = self.limits if self.loading.swept else BAND
        ratios = np.linspace(low, high, POINTS)
        reference = self.model.resonance_omega(self.resonance)
        absorber = self.scene.absorber
        lines = {"without": None} | (
            {} if absorber is None or isinstance(absorber, SeveralAbsorbers) else {"with": absorber}
        )
        amplitudes = {}
        model, unit = self.loading.force_model(ratios * reference)
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
            amplitudes["stuck" if isinstance(own, SlidingAbsorber) else name] = round_values(
                amplitude
            )
        branches: list[Message] = []
        message = {
            "type": "response",
            "force": self.intensity,
            "swept": self.loading.swept,
            "ratio": round_values(ratios),
            **amplitudes,
        }
        message |= {"branches": branches, "complete": False}
        yield dict(message)
        if self.density is not None:
            hertz, density = self.density
            part = slice(*np.searchsorted(2 * np.pi * hertz, [low * reference, high * reference]))
            message["run"] = [
                round_values(2 * np.pi * hertz[part] / reference),
                round_values(np.sqrt(density[part])),
            ]
        if self.loading.swept and self.values.view == "levels":
            message["levels"] = yield from self.frequency_levels()
        if self.values.load != "force" or self.values.view != "orbits":
            yield dict(message, complete=True)
            return
        try:
            for curve in follow_branches(
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
                        "ratio": round_values(curve.omega_ratio),
                        "amplitude": round_values(curve.tip_max),
                        "stable": stable.tolist(),
                    }
                )
                yield dict(message, branches=list(branches))
        except ParameterError as error:
            message["note"] = str(error)
        yield dict(message, branches=list(branches), complete=True)

    def frequency_levels(self) -> Generator[Message, None, Message]:
        """Return the levels over the frequency with and without the absorber, (n,) each in m.

        Messages about compilation are yielded.
        """
        scenes = {"with": self.scene, "without": self.free_scene}
        if self.values.concept == "none":
            del scenes["with"]
        levels: Message = {}
        for name, scene in scenes.items():
            yield from self.ready(scene, self.loading.record, "response", self.stop)
            self._go_on()
            schedules = dict(zip(("up", "down"), self.case().schedules(), strict=True))
            lanes = [
                Lane(scene, self.loading.act(self.intensity, schedules[sweep]), steady_start=True)
                for sweep in sweeps_of(self.values)
            ]
            curve = frequency_curve(name, lanes, self.limits)
            if curve is not None:
                levels |= {"ratio": round_values(curve.ratio), name: round_values(curve.level)}
        return levels
