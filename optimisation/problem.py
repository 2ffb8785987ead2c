"""A design problem: a space, conditions, objectives and constraints.

The measures of a design's runs give its score.

`Problem.evaluate` is for optimisers of other packages: it takes an array of designs and returns
arrays in the same order. All runs of a batch are made in one call, on the cores of this machine or
on workers of other machines.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import (
    ParameterError,
    count_from,
    each_of,
    kind_of,
    labelled,
    positive,
    require,
)
from impact_env.curve import DEFAULT_MEMBERS
from impact_env.drive import Member, default_rate, linear_sweep
from impact_env.ensemble import Executor, Lane, Members, Threads, draw_members
from impact_env.fields import check_fields
from impact_env.methods import Exact
from impact_env.modes import ModalModel, Structure
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam
from impact_env.scene import Scene
from impact_env.solvers import check_load, kernel_key
from optimisation.bounds import design_force
from optimisation.measures import (
    DAMAGE,
    DECAY,
    FATIGUES,
    LEVEL,
    LEVEL_RATIO,
    MEASURES,
    STRESS,
    STROKE,
    Chunk,
    design_gap_for,
    measure,
    measure_of,
    standard_error,
    stress_shape,
)
from optimisation.mounting import detune, model_with_absorber_at, to_dict
from optimisation.objectives import Condition, Constraint, Objective, Score, own_values
from optimisation.space import (
    GAP,
    MASS_RATIO,
    POSITION,
    SEVERAL,
    TUNED,
    Design,
    DesignSpace,
    Units,
    parts_of,
)
from optimisation.sweep_range import sweep_ratio, usable_rate
from optimisation.tolerances import (
    FORCE,
    FREQUENCY,
    Distribution,
    UncertainInput,
    draw_lane,
    plain,
    require_parts,
    shares,
    spreads,
)
from optimisation.tuned import require_wide_range

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]  # takes the number of finished runs and of all runs of a call
FORMAT = 3  # of the description: raised when the meaning of a problem changes
FATIGUE_EXPONENT = 5.0
MEMBERS_A_CHUNK = 4
GAP_MARGIN = 1e-9  # relative, below a limit on the stroke: impacts are found to rounding
FAILED = 1e6  # cost of a design with a run that the integrator gives up
# least cost of a violated constraint for methods without constraints; it grows with the violation
PENALTY = 1e3


@dataclass(frozen=True, eq=False)
class Problem:
    """Problem to find the best design of a ``space`` under ``conditions``.

    Parameters
    ----------
    space : DesignSpace
        Designs.
    conditions : tuple of Condition
        Forces or loads, one or more.
    objectives, constraints : tuple of Objective, tuple of Constraint
        One or more objectives, and any number of constraints.
    beam : Structure
        Structure; default: the paper's beam.
    members, seed : int
        Number of ensemble members of a search, and their seed.
    rate : float
        Sweep rate in % per 100 pseudo periods; default: `usual_rate`.
    fatigue_exponent : float
        Exponent of the stress in the measure of fatigue damage.
    uncertain : mapping
        Uncertain quantities, see `optimisation.tolerances`. Each member draws its own values, the
        same for every design.

    Raises
    ------
    ParameterError
        A value is not allowed, or the parameters do not fit together.
    """

    space: DesignSpace
    conditions: tuple[Condition, ...]
    objectives: tuple[Objective, ...] = (Objective(),)
    constraints: tuple[Constraint, ...] = ()
    beam: Structure = Beam()  # noqa: RUF009 - frozen, and the paper's
    members: int = DEFAULT_MEMBERS
    seed: int = 0
    rate: float = None  # type: ignore[assignment]  # replaced by `usual_rate`
    fatigue_exponent: float = FATIGUE_EXPONENT
    uncertain: UncertainInput = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_fields(
            self,
            space=kind_of(DesignSpace),
            conditions=each_of(kind_of(Condition)),
            objectives=each_of(kind_of(Objective)),
            constraints=each_of(kind_of(Constraint)),
            beam=kind_of(Structure),
            uncertain=kind_of(Mapping),
            members=count_from(1),
            seed=count_from(0),
            fatigue_exponent=labelled("fatigue exponent", positive),
        )
        require(len(self.conditions) > 0, "conditions", self.conditions, "one or more")
        require(len(self.objectives) > 0, "objectives", self.objectives, "one or more")
        self._place()
        for condition in self.conditions:
            self.model.resonance_omega(condition.resonance)
        object.__setattr__(self, "space", replace(self.space, units=self.units))
        self._cut_gaps_by_stroke()
        limits = [condition.limits for condition in self.conditions]
        object.__setattr__(
            self,
            "rate",
            self.usual_rate if self.rate is None else usable_rate("rate", self.rate, limits),
        )
        for objective in self.objectives:
            objective.chosen(self.conditions)
        names = [constraint.name for constraint in self.constraints]
        require(len(set(names)) == len(names), "constraints", names, "each of them once")
        if self.space.concept == TUNED:
            # a sweep so narrow that an optimiser could push a tuned absorber's second peak out of
            # it is refused
            mass = max(
                [v.high for v in self.space.free if v.name == MASS_RATIO]
                + [self.space.default.values[MASS_RATIO]]
            )
            for condition in self.conditions if not self.under_loads else ():
                require_wide_range(self.model, mass, condition.resonance, *condition.limits)
        self._require_loads()
        self._require_uncertain()
        for name in {DAMAGE, STRESS} & set(self.measures):
            require(
                self._beams[self.conditions[0].detuning][1] is not None,
                "objective or constraint",
                name,
                FATIGUES,
            )

    def _cut_gaps_by_stroke(self) -> None:
        """Narrow the bounds of the gap in the space to a limit on the stroke, if there is one.

        Between rigid walls the gap limits the stroke. The new bounds are in m.
        """
        strokes = [c.limit for c in self.constraints if c.name == STROKE]
        if not strokes:
            return
        most = strokes[0] * (1 - GAP_MARGIN)
        values = self.space.default.values
        free = []
        for variable in self.space.free:
            is_gap = parts_of(variable.name)[0] == GAP
            unit = 1.0
            if is_gap and variable.scaled:
                unit = self.units.of(self.space.concept, variable.name, values)
            if is_gap and most < variable.high * unit:
                lowest = min(variable.low * unit, most / 4)
                free.append(variable.within(lowest, most))
            else:
                free.append(variable)
        object.__setattr__(self, "space", replace(self.space, free=tuple(free)))

    def _require_uncertain(self) -> None:
        """Raise ParameterError if an uncertain quantity does not exist in the problem.

        The error is also raised for a distribution with absolute bounds of a quantity that has
        several nominal values, such as a free variable or different forces.
        """
        require_parts(self.spreads, self.space.default.absorber())
        several = {
            FORCE: len({c.force for c in self.conditions}) > 1,
            FREQUENCY: len({c.resonance for c in self.conditions}) > 1,
        }
        several |= {variable.name.removesuffix("_limit"): True for variable in self.space.free}
        for one in self.spreads:
            require(
                one.relative or not several.get(one.name, False),
                f"uncertain {one.name}",
                one.words,
                "in %, as there is no one number",
            )

    @cached_property
    def spreads(self) -> tuple[Distribution, ...]:
        """Distributions of the uncertain quantities in ``uncertain``."""
        return spreads(self.uncertain)

    def _require_loads(self) -> None:
        """Raise ParameterError for options that cannot be combined with loads.

        They are conditions without loads, uncertain quantities, and levels in m if a decay time is
        measured. The error is also raised for loads that the structure cannot have.
        """
        every_load = [
            condition.loads for condition in self.conditions if condition.loads is not None
        ]
        if not every_load:
            return
        require(
            len(every_load) == len(self.conditions),
            "conditions",
            self.conditions,
            "loads in all of them, or in none",
        )
        require(not self.spreads, "uncertain", plain(self.spreads), "left out under loads")
        for loads in every_load:
            check_load(self.space.default.scene(self.beam), loads, Exact())
        in_m = [
            *(o.kind for o in self.objectives if o.kind == "absolute"),
            *(c.name for c in self.constraints if c.name == LEVEL),
        ]
        require(
            not in_m or DECAY not in map(measure_of, every_load),
            "objective or constraint",
            in_m,
            "another under shocks, which are told by a time",
        )

    @property
    def under_loads(self) -> bool:
        """Whether the conditions have loads, instead of forces that are swept."""
        return self.conditions[0].loads is not None

    def _place(self) -> None:
        """Put the absorber at the structure's own place if the space has no position.

        Raises ParameterError for positions that the structure does not have.
        """
        if isinstance(self.beam, ModalModel):
            object.__setattr__(self, "space", self.space.on_places(len(self.beam.places)))
            return
        own = self.beam.absorber_position
        free = [variable for variable in self.space.free if variable.name.startswith(POSITION)]
        for variable in free:
            self.beam.place(f"bounds of {variable.name}", variable.low)
            self.beam.place(f"bounds of {variable.name}", variable.high)
        for name, value in self.space.fixed.items():
            if name.startswith(POSITION) and value > 1:
                self.beam.place(name, value)
        if (
            not free
            and self.space.concept != SEVERAL
            and self.space.fixed.get(POSITION, Beam.absorber_position) == Beam.absorber_position
        ):
            object.__setattr__(
                self, "space", replace(self.space, fixed={**self.space.fixed, POSITION: own})
            )

    @cached_property
    def model(self) -> ModalModel:
        """Modal model of the structure without absorber.

        Its tip shape has the mode shapes at the structure's own place for an absorber.
        """
        return model_with_absorber_at(self.beam)

    @cached_property
    def units(self) -> Units:
        """Units of the scaled variables of the space, from the structure and a force per resonance.

        The force is the geometric mean of the forces of all conditions at that resonance. A
        condition with loads counts with the force for which the design rule gives the gap that a
        search under these loads begins with. Raises ParameterError for loads that do not move the
        absorber's place.
        """
        forces: dict[int, list[float]] = {}
        gaps = {
            loads: design_gap_for(self.model, loads)
            for loads in {c.loads for c in self.conditions}
            if loads is not None
        }
        for condition in self.conditions:
            force = condition.force
            if condition.loads is not None:
                require(
                    gaps[condition.loads] > 0, "load", 0.0, "one that moves the absorber's place"
                )
                force *= design_force(
                    self.model,
                    DEFAULT_MASS_RATIO * self.model.beam_mass,
                    gaps[condition.loads],
                    condition.resonance,
                )
            forces.setdefault(condition.resonance, []).append(force)
        return Units(
            self.beam,
            {
                resonance: float(np.exp(np.mean(np.log(values))))
                for resonance, values in forces.items()
            },
        )

    @cached_property
    def usual_rate(self) -> float:
        """Default sweep rate in % per 100 pseudo periods.

        It follows from the least damped resonance of the conditions, see `default_rate`.
        """
        return default_rate(self.model, [condition.resonance for condition in self.conditions])

    def sweep_ratio(self, condition: Condition) -> float:
        """Return the level in sweeps without absorber over the level in stationary vibration.

        See `optimisation.sweep_range`. The ratio is NaN for a condition with loads.
        """
        if condition.loads is not None:
            return math.nan
        return sweep_ratio(self.model, self.rate, condition.resonance, condition.limits)

    @property
    def measures(self) -> tuple[str, ...]:
        """Names of the measures of a run, in the order of `MEASURES`.

        They are the last axis of all arrays of measures.
        """
        needed = {
            name
            for parts in (self.objectives, self.constraints)
            for part in parts
            for name in part.measures
        } | {LEVEL, LEVEL_RATIO}
        return tuple(name for name in MEASURES if name in needed)

    @cached_property
    def ensemble(self) -> Members:
        """Ensemble of a search, the same for every design.

        Reported results use the members of `fresh_ensemble` instead.
        """
        return draw_members(self.members, self.seed)

    def fresh_ensemble(self, members: int, which: int) -> Members:
        """Return ensemble members that no search has used; each ``which`` has other members."""
        (seed,) = np.random.SeedSequence([self.seed, 1 + which]).generate_state(1)
        return draw_members(members + 1, int(seed))[
            1:
        ]  # member 0 is the paper's run in every ensemble

    def describe(self) -> dict[str, object]:
        """Return the problem's identity as JSON values.

        A study of one problem cannot be continued with another problem.
        """
        return {
            "format": FORMAT,
            "space": self.space.describe(),
            "conditions": [condition.describe() for condition in self.conditions],
            "objectives": [objective.describe() for objective in self.objectives],
            "constraints": [constraint.describe() for constraint in self.constraints],
            "beam": to_dict(self.beam),
            "members": self.members,
            "seed": self.seed,
            "rate": self.rate,
            "fatigue_exponent": self.fatigue_exponent,
            **({"uncertain": plain(self.spreads)} if self.spreads else {}),
        }

    def chunks(self, design: Design | None, ensemble: Members, rate: float) -> list[Chunk]:
        """Return a design's runs at a sweep rate, in chunks of one condition and a few members.

        Each member has a sweep up and a sweep down, or one run under the loads. ``design`` None is
        the structure without absorber, under a force of 1 N or the condition's loads.
        """
        scenes = {
            detuning: self._scene(design, detuning)
            for detuning in {condition.detuning for condition in self.conditions}
        }
        return [
            self._chunk(
                design,
                scenes[condition.detuning],
                condition,
                ensemble[start : start + MEMBERS_A_CHUNK],
                rate,
            )
            for condition in self.conditions
            for start in range(0, len(ensemble), MEMBERS_A_CHUNK)
        ]

    def _chunk(
        self,
        design: Design | None,
        scene: Scene,
        condition: Condition,
        ensemble: Members,
        rate: float,
    ) -> Chunk:
        if condition.loads is not None:
            # random parts (records, phases of tones) follow from the member's phase, so that no two
            # members share them
            numbers = np.asarray(ensemble.phases, dtype=np.float64).view(np.uint64).tolist()
            members = zip(numbers, ensemble.phases.tolist(), ensemble.factors.tolist(), strict=True)
            lanes = tuple(
                Lane(
                    scene,
                    condition.loads.member(Member(number, phase, condition.force * factor)),
                    steady_start=True,
                )
                for number, phase, factor in members
            )
            return Chunk(
                lanes, self.measures, self._beams[condition.detuning][1], self.fatigue_exponent
            )
        force = 1.0 if design is None else condition.force
        omega = scene.model.resonance_omega(condition.resonance)
        low, high = condition.limits
        up, down = (
            ensemble.drives(force, linear_sweep(omega, *ends, rate))
            for ends in ((low, high), (high, low))
        )
        lanes = tuple(
            Lane(scene, drive, steady_start=True)
            for pair in zip(up, down, strict=True)
            for drive in pair
        )
        if self.spreads:
            own = [share for share in shares(self.spreads, ensemble) for _ in range(2)]
            lanes = tuple(
                draw_lane(lane, self.spreads, share, condition.resonance, condition.force)
                for lane, share in zip(lanes, own, strict=True)
            )
        return Chunk(
            lanes, self.measures, self._beams[condition.detuning][1], self.fatigue_exponent
        )

    def _scene(self, design: Design | None, detuning: float) -> Scene:
        structure, _, model = self._beams[detuning]
        if design is None:
            return Scene(model)
        at_own = isinstance(structure, Beam) and design.positions == [structure.absorber_position]
        return Scene(model, design.absorber()) if at_own else design.scene(structure)

    @cached_property
    def _beams(self) -> dict[float, tuple[Structure, Array | None, ModalModel]]:
        """Structure, stress shape and modal model by the detuning of the conditions.

        The stress shape is None if the structure has none. The modal model has the absorber at the
        structure's own place.
        """
        every = {}
        for detuning in {condition.detuning for condition in self.conditions}:
            structure = detune(self.beam, detuning)
            every[detuning] = (
                structure,
                stress_shape(structure),
                model_with_absorber_at(structure),
            )
        return every

    @cached_property
    def _references(self) -> dict[tuple[float, bytes], Array]:
        return {}

    def join(self, parts: Sequence[Array], members: int) -> Array:
        """Return the measures of a design's chunks, or of its conditions, as one array.

        Its shape is (members, conditions, 2, measures) for sweeps up and down, and (members,
        conditions, 1, measures) under loads.
        """
        rows = np.concatenate(parts).reshape(len(self.conditions), members, -1, len(self.measures))
        return np.ascontiguousarray(rows.transpose(1, 0, 2, 3))

    def reference(self, ensemble: Members, rate: float) -> Array:
        """Return the measures without absorber, under the conditions' forces, shaped as by `join`.

        The structure is linear, so swept forces are computed with 1 N and scaled; loads are
        simulated as they are. The result is stored for the next call.
        """
        key = (rate, ensemble.key)
        if key not in self._references:
            references: dict[tuple[object, ...], Array] = {}
            rows = []
            for condition in self.conditions:
                own = () if condition.loads is None else (id(condition.loads), condition.force)
                kind = (condition.resonance, condition.limits, condition.detuning, *own)
                if kind not in references:
                    references[kind] = measure(
                        self._chunk(
                            None, self._scene(None, condition.detuning), condition, ensemble, rate
                        )
                    )
                special = {DAMAGE: self.fatigue_exponent, LEVEL_RATIO: 0.0}
                powers = [special.get(name, 1.0) for name in self.measures]
                rows.append(
                    references[kind] * (1.0 if own else condition.force) ** np.array(powers)
                )
            self._references[key] = self.join(rows, len(ensemble))
        return self._references[key]

    def score(self, design: Design, measured: Array, ensemble: Members, rate: float) -> Score:
        """Return a design's score from its measures.

        ``measured``, shaped as by `join`, has the measures of this ensemble at this rate. If one of
        them is NaN the score is that of a failed design, with the values ``FAILED``.
        """
        if np.isnan(measured).any():
            return Score(
                tuple(-FAILED if o.maximise else FAILED for o in self.objectives),
                (1.0,) * len(self.constraints),
                failed=True,
            )
        columns = {name: measured[..., k] for k, name in enumerate(self.measures)}
        members = self.member_values(measured, ensemble, rate)
        values = tuple(
            objective.value_of(row) for objective, row in zip(self.objectives, members, strict=True)
        )
        return Score(
            values, tuple(constraint.violation(design, columns) for constraint in self.constraints)
        )

    def member_values(self, measured: Array, ensemble: Members, rate: float) -> Array:
        """Return the value of each objective for each member, (objectives, members).

        ``measured`` has the design's measures, shaped as by `join`. Relative objectives are divided
        by the larger reference of both sweep directions.
        """
        reference = self.reference(ensemble, rate)
        rows = []
        for objective in self.objectives:
            if objective.own:
                rows.append(
                    own_values(
                        objective.kind,
                        {name: measured[..., k] for k, name in enumerate(self.measures)},
                    )
                )
                continue
            kind = objective.of_kind
            column = self.measures.index(kind.measure)
            # the worse direction over the worse direction, as in the paper's curves: a level of a
            # sweep down has no reference of its own
            scale = reference[..., column].max(axis=2, keepdims=True) if kind.relative else 1.0
            rows.append(objective.per_member(measured[..., column] / scale, self.conditions))
        return np.array(rows)

    def evaluate(
        self,
        X: ArrayLike,
        ensemble: Members | None = None,
        executor: Executor | None = None,
        progress: Progress | None = None,
        failures: dict[int, str] | None = None,
    ) -> "ProblemValues":
        """Return F, G and spread of designs at coordinates, see `evaluate_arrays`."""
        return evaluate_arrays(self, X, ensemble, executor, progress, failures)

    def cost(self, score: Score) -> float:
        """Return the first objective's value, with the opposite sign if it is to be maximised.

        It is infinite for a design that violates a constraint or failed.
        """
        value = -score.values[0] if self.objectives[0].maximise else score.values[0]
        return value if score.feasible else math.inf

    def penalised_cost(self, score: Score) -> float:
        """Return `cost`, or a large finite number for a design that is not feasible.

        The number grows with the violation; it is largest for a failed design.
        """
        return self.cost(score) if score.feasible else PENALTY * (1 + min(score.violation, PENALTY))


def run_chunks(
    chunks: Sequence[Chunk], executor: Executor, progress: Progress | None = None
) -> Iterator[tuple[int, Array]]:
    """Yield (index of a chunk, its measures (lanes, measures)) as chunks are finished.

    ``progress`` is called with the numbers of finished and of all runs. If the generator is closed,
    chunks that have not begun are dropped.
    """
    total = sum(len(chunk.lanes) for chunk in chunks)
    done = 0
    for k, values in executor.each(
        measure,
        chunks,
        [
            (kernel_key(chunk.lanes[0].scene, Exact(), chunk.lanes[0].drive), chunk.record)
            for chunk in chunks
        ],
    ):
        done += len(values)
        if progress is not None:
            progress(done, total)
        yield k, values


def measured_chunks(
    chunks: Sequence[Chunk], executor: Executor, progress: Progress | None = None
) -> list[Array]:
    """Return the measures of chunks, (lanes, measures) each, in their order."""
    measured = dict(run_chunks(chunks, executor, progress))
    return [measured[k] for k in range(len(chunks))]


def evaluate(
    problem: Problem,
    designs: Sequence[Design],
    ensemble: Members,
    rate: float,
    executor: Executor,
    progress: Progress | None = None,
) -> Iterator[tuple[int, Array]]:
    """Yield (index of a design, its measures) as designs are finished.

    The measures are shaped as by `Problem.join`; those of a run with an IntegrationError are NaN.
    ``rate`` is as in `Problem`. Designs begin in the given order, so that after an interruption the
    first ones are complete. Raises ParameterError if the simulator refuses a design.
    """
    owned = [problem.chunks(design, ensemble, rate) for design in designs]
    owners = [k for k, own in enumerate(owned) for _ in own]
    starts = np.cumsum([0] + [len(own) for own in owned])
    chunks = [chunk for own in owned for chunk in own]
    waiting = [len(own) for own in owned]
    parts: dict[int, Array] = {}
    for i, values in run_chunks(chunks, executor, progress):
        parts[i] = values
        k = owners[i]
        waiting[k] -= 1
        if not waiting[k]:
            yield (
                k,
                problem.join(
                    [parts.pop(j) for j in range(starts[k], starts[k + 1])], len(ensemble)
                ),
            )


class ProblemValues(NamedTuple):
    """Values, constraints and spread of N designs, one in each row.

    Rows of failed designs are NaN.

    Attributes
    ----------
    F : array, (N, objectives)
        Values of the objectives, all to be minimised: values of objectives to be maximised have the
        opposite sign.
    G : array, (N, constraints)
        Relative excess over the limit of each constraint, 0 or below if it is satisfied.
    spread : array, (N, objectives)
        Bootstrap standard error of F over the members, NaN for one member.
    """

    F: Array
    G: Array
    spread: Array


def evaluate_arrays(
    problem: Problem,
    X: ArrayLike,
    ensemble: Members | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    failures: dict[int, str] | None = None,
) -> ProblemValues:
    """Return F, G and spread of designs at coordinates ``X`` (N, variables), see `ProblemValues`.

    Coordinates are the free variables of ``problem.space``, between `DesignSpace.low` and `high`.
    ``ensemble`` None is the search's own members (use `Problem.fresh_ensemble` for results to
    report), ``executor`` None all cores. Rows are NaN for designs out of bounds, designs that the
    simulator refuses, and designs with a failed run; ``failures`` receives the reason by the row's
    index. Raises ParameterError unless X has a column for each variable.
    """
    rows = np.atleast_2d(np.asarray(X, dtype=np.float64))
    free = problem.space.free
    require(
        rows.ndim == 2 and rows.shape[1] == len(free),
        "X",
        rows.shape,
        f"(designs, {len(free)}): {', '.join(v.name for v in free)}",
    )
    ensemble = problem.ensemble if ensemble is None else ensemble
    reasons: dict[int, str] = {} if failures is None else failures
    F, spread = (np.full((len(rows), len(problem.objectives)), np.nan) for _ in range(2))
    G = np.full((len(rows), len(problem.constraints)), np.nan)
    designs: dict[int, Design] = {}
    for i, row in enumerate(rows):
        try:
            designs[i] = problem.space.decoded(
                dict(zip((v.name for v in free), map(float, row), strict=True))
            )
            designs[i].absorber()
        except ParameterError as error:
            designs.pop(i, None)
            reasons[i] = str(error)
    numbers = list(designs)
    for k, measured in evaluate(
        problem,
        [designs[i] for i in numbers],
        ensemble,
        problem.rate,
        executor or Threads(),
        progress,
    ):
        i = numbers[k]
        lost = np.isnan(measured).any(axis=(2, 3))
        if lost.any():
            member, condition = (int(x) for x in np.argwhere(lost)[0])
            where = f"member {member} at {problem.conditions[condition].words}"
            reasons[i] = (
                f"the integrator gave up {int(lost.sum())} of {lost.size} runs, the first of "
                f"them {where}"
            )
            continue
        F[i], G[i], spread[i] = _row(problem, designs[i], measured, ensemble)
    return ProblemValues(F, G, spread)


def _row(
    problem: Problem, design: Design, measured: Array, ensemble: Members
) -> tuple[Array, Array, Array]:
    """Return a design's rows of F, G and spread from its measures, shaped as by `Problem.join`."""
    score = problem.score(design, measured, ensemble, problem.rate)
    signs = np.array([-1.0 if objective.maximise else 1.0 for objective in problem.objectives])
    members = problem.member_values(measured, ensemble, problem.rate)
    spread = np.array(
        [standard_error(row, o.share) for row, o in zip(members, problem.objectives, strict=True)]
    )
    return signs * np.array(score.values), np.array(score.violations), spread
