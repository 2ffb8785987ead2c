"""Calls with odd values of every kind for each argument of every public callable.

A call must give a correct result, or one ParameterError.

`walk` calls a function or constructor with each of `ODD` in the place of each argument. A value
that stands for a plain Python number (``numpy.uint8(200)`` for 200) must lead to the same result as
that number, and to plain numbers in what is stored.

Functions that simulate are not among `targets`: LLVM ends the process where the limit of memory
refuses it some, and an interrupted compilation goes on in its thread. `test_bad_input.py` calls
them without limits.
"""

import dataclasses
import datetime
import inspect
import itertools
import re
import signal
import typing
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from decimal import Decimal
from enum import Enum
from fractions import Fraction
from pathlib import Path
from typing import Any

import handed_in
import numpy as np
from handed_in import BEAM, SCENE, SEVERAL

from impact_env.checks import ParameterError
from impact_env.curve import CurveCase, Pass, quantiles
from impact_env.drive import (
    Drive,
    FrequencySchedule,
    constant_frequency,
    default_rate,
    linear_sweep,
)
from impact_env.ensemble import Lane, Members, Threads, draw_members
from impact_env.envs.actuators import FrictionRange, GapRange
from impact_env.envs.one_frequency import ActiveSettings, GapControl
from impact_env.envs.passages import PassageSettings, RandomisedSettings
from impact_env.envs.settings import TaskSettings
from impact_env.envs.structure_families import StructurePool
from impact_env.frequency import (
    frequency_range,
    natural_frequencies,
    poles,
    receptance,
    tip_response,
)
from impact_env.kernels.compiling.parts import only_cached
from impact_env.laws import make
from impact_env.level import response_level
from impact_env.loads import (
    Loads,
    Random,
    Samples,
    ShakenBase,
    Shock,
    Strike,
    Tone,
    Tones,
    Unbalance,
)
from impact_env.methods import Moreau, RungeKutta
from impact_env.modes import ModalModel, modal_model, mode_shapes
from impact_env.parameters import (
    Beam,
    CompliantWalls,
    CoulombFriction,
    ElasticCoulombFriction,
    NonlinearSink,
    RigidWalls,
    Section,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    YieldingWalls,
    friction_damper,
    friction_law,
    impact_absorber,
    impact_absorbers,
    shared_masses,
)
from impact_env.periodic.case import Case, case_of
from impact_env.periodic.contact import CompliantContact, RigidContact
from impact_env.periodic.continuation import Steps
from impact_env.periodic.harmonic_balance import JointOfMass
from impact_env.periodic.residence import Approach, Range
from impact_env.periodic.schedule import flying_schedule
from impact_env.periodic.stationary import Criteria, StationaryRuns
from impact_env.plain import from_drive, from_scene, to_drive, to_method, to_scene, to_structure
from impact_env.plain_loads import to_loads
from impact_env.results import Record, Window
from impact_env.scene import InitialState, Scene, beam_scene
from optimisation.absorber_rules import best_friction, rigid_walls, scaled_absorber, scaled_friction
from optimisation.bounds import (
    common_gap,
    design_force,
    design_gap,
    resonance_limit,
    stroke_limit_rms,
)
from optimisation.comparison import force_grid
from optimisation.contact import estimate, material, meeting_mass
from optimisation.gap_advice import gap_factors
from optimisation.insight import neighbourhood, over_force, with_gaps
from optimisation.mounting import detune, model_with_absorber_at
from optimisation.objectives import Condition, Constraint, Objective
from optimisation.problem import Problem
from optimisation.search.settings import Rung, SearchSettings
from optimisation.space import Design, DesignSpace, Units, Variable, design_space
from optimisation.sweep_range import stationary_level, sweep_ratio, usable_force, usable_mass_ratio
from optimisation.tolerances import spreads
from optimisation.tuned import peaks

LOADS = {"load": {"kind": "random", "spectrum": [[20.0, 1.0], [60.0, 1.0]], "duration_s": 4.0}}
NOTHING = object()  # no plain value corresponds to it
LABELS = {(f, "name") for f in ("place", "usable_force", "usable_mass_ratio")}
SECONDS = 5  # of processor time: a call that takes longer does not end
# value, and the plain Python value that it stands for
ODD: tuple[tuple[Any, Any], ...] = (
    (np.uint8(3), 3),
    (np.int8(3), 3),
    (np.uint8(200), 200),
    (np.int16(1000), 1000),
    (np.uint64(2**63), 2**63),
    (np.float16(0.5), 0.5),
    (np.float32(0.25), 0.25),
    (np.longdouble(0.5), 0.5),
    (Fraction(1, 2), 0.5),
    (np.uint8([100, 200]), [100.0, 200.0]),
    (np.float16([0.5, 1.0]), [0.5, 1.0]),
    (np.ma.array([0.5, 1.0]), [0.5, 1.0]),
    (deque([0.5, 1.0]), [0.5, 1.0]),
    (range(1, 3), [1, 2]),
    (np.str_("exact"), "exact"),
    *(
        (value, NOTHING)
        for value in (
            True,
            np.True_,
            1j,
            0.5j,
            np.complex64(1),
            np.timedelta64(1),
            np.timedelta64(5, "s"),
            np.datetime64("2020-01-01"),
            datetime.timedelta(seconds=1),
            Decimal("0.5"),
            "0.75",
            "",
            b"1",
            bytearray(b"\x01\x02"),
            memoryview(b"\x01\x02"),
            np.ma.masked,
            np.ma.array([0.5, 1.0], mask=[True, False]),
            np.ma.array([[1.0, 2.0], [3.0, 4.0]], mask=[[False, True], [False, False]]),
            [[0.0, 1.0]],
            [[1.0], [2.0, 3.0]],
            [0.0, True],
            [True, False],
            [0.5, "1"],
            [np.timedelta64(1), np.timedelta64(2)],
            [1.0, np.ma.masked],
            [],
            (),
            [None],
            np.array(0.5),
            np.array(True),
            np.array([1, 2], dtype=object),
            np.array([1 + 2j]),
            np.array(["a"]),
            np.zeros(2, dtype=[("a", float)]),
            np.zeros((0, 2)),
            np.zeros((2, 2, 2)),
            np.array([1, 2], dtype="timedelta64[s]"),
            np.broadcast_to(1.0, 10**12),
            range(10**9),
            10**400,
            -(10**5000),
            10**9,
            1e9,
            1e300,
            -1e300,
            5e-324,
            float("nan"),
            float("inf"),
            float("-inf"),
            [float("nan"), 1.0],
            [1e300, 2e300],
            None,
            object(),
            print,
            int,
            {},
            {"a": 1.0},
            {1: 2.0},
            {"modes": 10**9},
            set(),
            {1.0, 2.0},
            frozenset({1}),
            Path("nowhere"),
            ...,
        )
    ),
)
ENDLESS = (itertools.count, lambda: iter([0.5, 1.0]))  # made for each call: iterators are used up


@contextmanager
def limited(gigabytes: float = 2.0) -> Iterator[None]:
    """Limit the memory and the processor time of a call, where the system can.

    Nothing is compiled within the limits.
    """
    try:
        import resource
    except ImportError:  # not a POSIX system
        yield
        return
    pages = (
        int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        if Path("/proc/self/statm").exists()
        else 0
    )
    before = resource.getrlimit(resource.RLIMIT_AS)

    def stop(*_: object) -> None:
        raise TimeoutError(f"took more than {SECONDS} s")

    handler = signal.signal(signal.SIGVTALRM, stop)
    try:
        if pages:
            limit = pages * resource.getpagesize() + int(gigabytes * 2**30)
            resource.setrlimit(resource.RLIMIT_AS, (limit, before[1]))
        with only_cached():
            yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, handler)
        resource.setrlimit(resource.RLIMIT_AS, before)


def outcome(make: Callable[..., Any], arguments: Mapping[str, Any]) -> tuple[str, Any]:
    """Return ("result", value), ("refused", error) or ("error", error) of a call."""
    try:
        try:
            signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
            return "result", make(**arguments)
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    except ParameterError as error:
        return "refused", error
    except Exception as error:
        return "error", error


def same(a: Any, b: Any) -> bool:
    """Return whether two results are equal, numbers also in their types."""
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, float):
        return a == b or (a != a and b != b)
    if isinstance(a, Mapping):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, Sequence) and not isinstance(a, str | bytes | range):
        return len(a) == len(b) and all(map(same, a, b))
    if dataclasses.is_dataclass(a) and not isinstance(a, type):
        return all(
            same(getattr(a, f.name), getattr(b, f.name))
            for f in dataclasses.fields(a)
            if f.compare or f.init
        )
    if isinstance(a, int | str | bytes | Enum | None | type):
        return bool(a == b)
    return True  # an object without values of its own, such as a function


def walk(name: str, make: Callable[..., Any], good: Mapping[str, Any]) -> Iterator[str | None]:
    """Yield for each argument and odd value what is wrong, None if nothing is."""
    hints = handed_in.hints_of(make)
    for argument in hints:
        # what is called is the caller's, and a label of an error is not the user's
        if "Callable" in str(hints[argument]) or (make.__name__, argument) in LABELS:
            continue
        for odd, plain in (*ODD, *((None, make_odd) for make_odd in ENDLESS)):
            fresh = plain in ENDLESS
            value = plain() if fresh else odd
            kind, result = outcome(make, {**good, argument: value})
            problem = None
            if kind == "error":
                problem = f"{type(result).__name__}: {result}"
            elif kind == "result" and plain is not NOTHING and not fresh:
                wanted, right = outcome(make, {**good, argument: plain})
                if wanted == "result" and not same(result, right):
                    problem = f"{result!r:.200} is not {right!r:.200}"
                elif wanted != "result":
                    problem = f"accepted, but {plain!r} is not: {right}"
            elif kind == "result" and not fits(value, hints[argument]) and not fresh:
                default = inspect.signature(make).parameters[argument].default
                if value is not default:
                    problem = f"accepted, though it is no {hints[argument]}"
            printed = (
                "endless"
                if fresh
                else repr(value)[:60]
                if not isinstance(value, int)
                else (str(value) if abs(value) < 10**20 else "huge")
            )
            yield None if problem is None else f"{name}({argument}={printed}): {problem[:300]}"


def fits(value: Any, hint: Any) -> bool:
    """Return whether a value is of the kind of a type hint."""
    if value is NOTHING or (callable(value) and not isinstance(value, type)):
        return False
    if isinstance(value, np.timedelta64 | np.datetime64 | bytearray | memoryview):
        return False
    if re.search(r"(tuple|Sequence)\[float", str(hint)) and fits(value, float):
        return (
            True  # one number stands for a row of one or a pair of equal ones, where it is accepted
        )
    if isinstance(value, np.ndarray) and value.dtype.kind == "b":
        return False
    try:
        if isinstance(value, np.ma.MaskedArray) and np.ma.getmaskarray(value).any():
            return False
        if (
            typing.get_origin(hint) is np.ndarray
            and isinstance(value, list)
            and True in [type(x) is bool for x in value]
        ):
            return False
        values = list(value) if isinstance(value, list | tuple) else []
        if "ArrayLike" in str(hint) or "_SupportsArray" in str(hint):
            plain = not isinstance(value, bool | np.bool_ | str | bytes | complex)
            return plain and bool not in set(map(type, values)) and handed_in.fits(value, hint)
        return handed_in.fits(value, hint)
    except Exception:
        return False


def targets() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Return the tested callables: name, callable, and arguments of a call that succeeds."""
    model = SCENE.model
    omega = model.resonance_omega(1)
    schedule = handed_in.DRIVE.schedule
    spectrum = [[20.0, 1.0], [60.0, 1.0]]
    random = Random(spectrum, 4.0)
    space = design_space("impact", ["gap"])
    first = Condition(1, 3.5)
    mass = 0.02 * model.beam_mass
    design = space.default
    classes = (
        # structures and absorbers
        (Beam, {"modes": 2, "elements": 4}),
        (Section, {"elements": 3, "bending_stiffness": 100.0, "mass_per_length": 1.0}),
        (
            ModalModel,
            {
                "omega": [250.0, 1500.0],
                "damping_ratio": [0.01, 0.01],
                "force_shape": [1.0, 1.0],
                "tip_shape": [2.0, 2.0],
                "beam_mass": 0.5,
            },
        ),
        (RigidWalls, {}),
        (YieldingWalls, {"yield_velocity": 0.1}),
        (CompliantWalls, {"stiffness": 1e5}),
        (CoulombFriction, {"limit": 0.1}),
        (ElasticCoulombFriction, {"limit": 0.1, "stiffness": 1e5}),
        (StuckAbsorber, {}),
        (TunedAbsorber, {}),
        (NonlinearSink, {"cubic_stiffness": 1e5}),
        (SlidingAbsorber, {"friction": CoulombFriction(0.1)}),
        (SeveralAbsorbers, {"absorbers": SEVERAL.absorbers, "positions": [1.0, 0.7]}),
        (impact_absorber, {}),
        (friction_damper, {}),
        (impact_absorbers, {"gaps": [1e-3, 2e-3], "positions": [1.0, 0.7]}),
        (shared_masses, {"number": 2}),
        (friction_law, {"limit": 0.1}),
        (Scene, {"model": model}),
        (beam_scene, {}),
        (modal_model, {"beam": BEAM}),
        (mode_shapes, {"beam": BEAM, "positions": [0.5, 1.0]}),
        (model.with_absorber_at, {"place": 1}),
        (model.with_absorbers_at, {"places": [1, 1]}),
        (model.detuned, {"share": 0.01}),
        (model.pseudo_period, {"resonance": 1}),
        (model.resonance_omega, {"resonance": 1}),
        (BEAM.place, {"name": "position", "value": 0.5}),
        # drives and loads
        (linear_sweep, {"reference": omega}),
        (constant_frequency, {"reference": omega, "ratio": 1.0, "periods": 10.0}),
        (default_rate, {"model": model}),
        (FrequencySchedule, {"times": [0.0, 1.0], "omegas": [omega, omega], "reference": omega}),
        (Drive, {"amplitude": 1.0, "schedule": schedule}),
        (Samples, {"times": [0.0, 0.1, 0.2], "values": [0.0, 1.0, 0.0]}),
        (Random, {"spectrum": spectrum, "length": 4.0}),
        (Loads, {"parts": [random], "reference": omega}),
        (Shock, {"pulse": "half-sine", "peak": 1.0, "width": 0.01, "length": 0.1}),
        (Strike, {"velocity": 1.0, "length": 0.1}),
        (Unbalance, {"unbalance": 1e-3, "schedule": schedule}),
        (ShakenBase, {"schedule": schedule, "acceleration": 1.0}),
        (Tone, {"amplitude": 1.0, "frequency": 20.0}),
        (Tones, {"tones": [Tone(1.0, 20.0)], "length": 1.0}),
        (random.share_above, {"frequency": 30.0}),
        (InitialState, {}),
        # runs
        (Moreau, {}),
        (RungeKutta, {}),
        (Record, {}),
        (Window, {"start": 0.0, "end": 1.0}),
        (Threads, {}),
        (Lane, {"scene": SCENE, "drive": handed_in.DRIVE}),
        (Members, {"phases": [0.0, 1.0], "factors": [1.0, 1.0]}),
        (draw_members, {"members": 3, "seed": 0}),
        (CurveCase, {"scene": SCENE, "forces": [1.0, 2.0]}),
        (Pass, {}),
        (quantiles, {"values": [1.0, 2.0, 3.0], "wanted": [0.5]}),
        (response_level, {"tip_displacement": np.ones(800), "samples_per_period": 8}),
        (to_scene, {"plain": {"beam": {"modes": 2}}}),
        (to_structure, {"plain": {"beam": {"modes": 2}}}),
        (to_drive, {"plain": from_drive(handed_in.DRIVE)}),
        (to_method, {"plain": {"kind": "moreau"}}),
        (from_scene, {"scene": beam_scene(BEAM), "beam": BEAM}),
        (to_loads, {"plain": LOADS, "reference": omega}),
        (make, {"concept": "impact", "values": {"gap": 1e-3}}),
        # frequency domain and periodic responses
        (frequency_range, {"low": 0.9, "high": 1.1}),
        (
            receptance,
            {"model": model, "omega": [100.0, 200.0], "a": model.tip_shape, "b": model.tip_shape},
        ),
        (tip_response, {"model": model, "absorber": None, "omega": [100.0, 200.0]}),
        (natural_frequencies, {"model": model, "absorber": None}),
        (poles, {"model": model, "absorber": None}),
        (Case, {"model": model, "omega": omega, "force": 1.0}),
        (case_of, {"scene": SCENE, "force": 1.0, "omega": omega}),
        (flying_schedule, {"walls": [1, -1], "friction": False}),
        (Criteria, {}),
        (StationaryRuns, {"points": 3}),
        (Steps, {}),
        (Approach, {"reference": omega}),
        (Range, {"start": 1.1, "first": 1.05, "last": 0.95, "stop": 0.9}),
        (
            RigidContact,
            {"gap": 1e-3, "friction_limit": 0.1, "weight": 1.0, "friction_weight": 1.0},
        ),
        (
            CompliantContact,
            {"gap": 1e-3, "stiffness": 1e5, "friction_limit": 0.1, "friction_stiffness": 1e5},
        ),
        (JointOfMass, {"model": model, "mass": 0.01}),
        # environments
        (TaskSettings, {}),
        (PassageSettings, {}),
        (FrictionRange, {}),
        (GapRange, {}),
        (GapControl, {}),
        (ActiveSettings, {}),
        (RandomisedSettings, {}),
        (StructurePool, {}),
        # design
        (Objective, {}),
        (Constraint, {"name": "stroke", "limit": 1e-3}),
        (Condition, {"resonance": 1, "force": 3.5}),
        (Design, {"concept": "impact", "values": design.values}),
        (design_space, {"concept": "impact", "free": ["gap"]}),
        (DesignSpace, {"concept": "impact", "free": space.free}),
        (Variable, {"name": "gap", "unit": "m", "low": 1e-4, "high": 1e-2, "default": 1e-3}),
        (Units, {"beam": BEAM, "forces": {1: 3.5}}),
        (Problem, {"space": space, "conditions": (first,), "beam": model, "members": 3}),
        (Rung, {"members": 3}),
        (SearchSettings, {"sampler": "random", "batch": 4, "rungs": (Rung(3),)}),
        (spreads, {"uncertain": {"gap": "5%"}}),
        (usable_force, {"name": "force", "value": 1.0}),
        (usable_mass_ratio, {"name": "mass_ratio", "value": 0.02}),
        (stationary_level, {"model": model}),
        (sweep_ratio, {"model": model, "rate": 1.0}),
        (force_grid, {"design": 1.0}),
        (gap_factors, {"number": 3}),
        (scaled_absorber, {"model": model, "force": 3.5}),
        (scaled_friction, {"model": model, "mass": mass, "gap": 1e-3}),
        (best_friction, {"model": model, "mass": mass, "force": 3.5}),
        (rigid_walls, {"absorber": impact_absorber()}),
        (design_gap, {"model": model, "mass": mass, "force": 3.5}),
        (design_force, {"model": model, "mass": mass, "gap": 1e-3}),
        (common_gap, {"model": model, "mass": mass, "forces": {1: 3.5}}),
        (resonance_limit, {"model": model, "mass": mass, "gap": 1e-3, "force": 3.5}),
        (
            stroke_limit_rms,
            {"model": model, "mass": mass, "gap": 1e-3, "force_amplitude": 3.5, "omega": omega},
        ),
        (model_with_absorber_at, {"structure": BEAM}),
        (detune, {"structure": model, "share": 0.01}),
        (material, {"name": "steel"}),
        (
            estimate,
            {"first": "steel", "second": "steel", "radius": 5e-3, "mass": mass, "speed": 0.1},
        ),
        (meeting_mass, {"model": model, "absorber_mass": mass}),
        (peaks, {"model": model, "absorber": TunedAbsorber()}),
        (over_force, {"condition": first, "forces": [1.0, 2.0]}),
        (with_gaps, {"design": design, "gaps": [1e-3, 2e-3]}),
        (neighbourhood, {"space": space, "design": design}),
    )
    return {getattr(make, "__qualname__", make.__name__): (make, good) for make, good in classes}
