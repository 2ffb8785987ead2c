"""Calls with wrong arguments of every kind.

Each argument of a callable, one after the other, is replaced by each of `VALUES`.

What an argument takes is read from its type hint, so a new constructor needs nothing here. A call
must be refused with a ParameterError that names the argument; or the value is of the kind that the
hint says, is kept as given, and what comes out can be used.
"""

import dataclasses
import inspect
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from fractions import Fraction
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np
from core import ALL

from impact_env.checks import ParameterError
from impact_env.drive import Drive, FrequencySchedule, constant_frequency
from impact_env.methods import Exact, Moreau, RungeKutta
from impact_env.modes import ModalModel
from impact_env.parameters import (
    Beam,
    CompliantWalls,
    CoulombFriction,
    ElasticCoulombFriction,
    RigidWalls,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
    impact_absorbers,
)
from impact_env.results import Record, Response
from impact_env.scene import InitialState, Scene, beam_scene
from impact_env.sweep import IntegrationError, simulate

BEAM = Beam(modes=2)
SCENE = beam_scene(BEAM, impact_absorber(restitution=0.7))
OMEGA = SCENE.model.resonance_omega(1)
DRIVE = Drive(3.5, constant_frequency(OMEGA, 0.98, 2.0))
SEVERAL = impact_absorbers([1e-3, 2e-3], [1.0, 0.7], 0.7)
LONG = 1e5  # rad of the fastest motion: longer runs are right too, but not made here
# events: what is extreme may chatter without end, which is an error with words of its own
FEW = 2000

NUMBERS = (
    0,
    1,
    -1,
    7,
    0.0,
    0.5,
    -2.5,
    1e30,
    1e-30,
    1e300,
    -1e300,
    1e-300,
    np.nan,
    np.inf,
    -np.inf,
    10**9,
    10**400,
    10**5000,
    1j,
)
OTHER_NUMBERS = (np.float32(0.5), np.int64(2), Fraction(1, 2), np.float64(np.nan), np.array(0.5))
LISTS = (
    [],
    [1.0],
    (0.5, 1.5),
    [True],
    ["1"],
    [None],
    [np.nan, 1.0],
    [1e300, 2e300],
    [[1.0, 2.0]],
    [[1.0], [2.0, 3.0]],
    [1j],
    [10**400],
)
ARRAYS = (
    np.zeros(0),
    np.ones(2),
    np.arange(3),
    np.ones((2, 2)),
    np.array(["1", "2"]),
    np.array([True, False]),
    np.array([0.0, 1.0, 1e9]),
)
WORDS = ("", "1", "no", b"1", "exact", Path("nowhere"), True, False, np.bool_(True), None)
TABLES = ({}, {"a": 1.0}, {2: 3.0}, {2: "3"}, {2: 1e300}, {1, 2}, object(), len)
CLASSES = (Beam, RigidWalls, Exact, Drive, SlidingAbsorber)
OBJECTS = (
    BEAM,
    SCENE,
    SCENE.model,
    DRIVE,
    DRIVE.schedule,
    RigidWalls(),
    CompliantWalls(1e5),
    CoulombFriction(0.1),
    ElasticCoulombFriction(0.1, 1e5),
)
MORE = (
    impact_absorber(),
    TunedAbsorber(),
    StuckAbsorber(),
    SEVERAL,
    [impact_absorber(), 1],
    InitialState(),
    Record(),
    Exact(),
    Moreau(),
    RungeKutta(),
)
VALUES = (*NUMBERS, *OTHER_NUMBERS, *LISTS, *ARRAYS, *WORDS, *TABLES, *CLASSES, *OBJECTS, *MORE)


def opened(hint: Any) -> Any:
    """Return the type hint behind a name for one: NumPy's are names from 2.5 on."""
    return getattr(typing.get_origin(hint) or hint, "__value__", hint)


def fits(value: Any, hint: Any) -> bool:
    """Return whether a value is of the kind of a type hint."""
    hint = opened(hint)
    origin = typing.get_origin(hint)
    parts = typing.get_args(hint)
    value = value.item() if isinstance(value, np.ndarray) and value.ndim == 0 else value
    if origin is np.ndarray or "_SupportsArray" in str(hint):
        return _is_array(value)
    if origin in (typing.Union, types.UnionType):
        return any(fits(value, part) for part in parts)
    if hint is Any:
        return True
    if hint is None or hint is type(None):
        return value is None
    if origin is typing.Literal:
        return isinstance(value, str) and value in parts
    if hint in (bool, float, int):
        kinds = {bool: bool | np.bool_, float: Real, int: Integral}[hint]
        return isinstance(value, kinds) and (hint is bool or not isinstance(value, bool))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(
            fits(k, parts[0]) and fits(v, parts[1]) for k, v in value.items()
        )
    if origin is Callable or hint is Callable:
        return callable(value)
    if isinstance(origin, type) and issubclass(origin, Iterable):
        return (
            isinstance(value, Iterable)
            and not isinstance(value, str | bytes)
            and all(fits(part, parts[0]) for part in value)
        )
    return isinstance(value, hint)


def _is_array(value: Any) -> bool:
    try:
        return np.asarray(value).dtype.kind in "iuf"
    except ValueError:  # rows of several lengths
        return False


def hints_of(make: Callable[..., Any]) -> dict[str, Any]:
    """Return the type hint of each argument."""
    hints = typing.get_type_hints(
        make if not isinstance(make, type) or dataclasses.is_dataclass(make) else make.__init__
    )
    return {name: opened(hints[name]) for name in inspect.signature(make).parameters}


# what an argument without default is given while another one is wrong: by name, or else by type
BY_NAME: dict[str, Any] = {
    "gaps": [1e-3, 2e-3],
    "positions": [1.0, 0.7],
    "absorbers": SEVERAL.absorbers,
    "elements": 3,
    "times": [0.0, 1.0],
    "omegas": [OMEGA, OMEGA],
    "omega": [OMEGA, 6 * OMEGA],
    "damping_ratio": [0.01, 0.01],
    "reference": OMEGA,
    "stiffness": 1e5,
    "model": SCENE.model,
    "forces": [1.0, 2.0],
    "beam": BEAM,
    "structure": BEAM,
    "drive": DRIVE,
}
# what an error may call an argument
ALSO = {
    "path": "file",
    "structure": "file",
    "whole_scene": "scene",
    "kind": "objective",
    "name": "constraint",
    "free": "variable",
    "fixed": "variable",
    "bounds": "variable",
}
BY_TYPE: dict[Any, Any] = {
    float: 1.0,
    int: 2,
    np.ndarray: [1.0, 2.0],
    FrequencySchedule: DRIVE.schedule,
    Scene: SCENE,
    Drive: DRIVE,
    ModalModel: SCENE.model,
    Callable: print,
}


def good_arguments(make: Callable[..., Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Return arguments with which a call succeeds.

    They are those that have no default, and those in ``own``.
    """
    needed = {n: p for n, p in inspect.signature(make).parameters.items() if p.default is p.empty}
    hints = hints_of(make)
    known = {**BY_NAME, **own}
    return {
        name: known[name]
        if name in known
        else BY_TYPE[typing.get_origin(hints[name]) or hints[name]]
        for name in needed
    } | dict(own)


def used(result: Any) -> None:
    """Use the result of a call, and check that its numbers are finite.

    Raises ParameterError or IntegrationError if a run is refused or fails.
    """
    if isinstance(result, Response):
        numbers = [
            result.end_state,
            result.stuck_time,
            *([] if result.level is None else dataclasses.astuple(result.level)),
        ]
        assert all(np.all(np.isfinite(x)) for x in numbers), f"{result} is not finite"
    elif isinstance(result, Drive):
        for scene in (SCENE, beam_scene(BEAM)):
            fastest = max(
                scene.model.omega[-1], result.schedule.omegas.max(), result.schedule.reference
            )
            if result.schedule.times[-1] * fastest < LONG:
                used(simulate(scene, result, record=ALL, most_events=FEW))
    elif isinstance(result, FrequencySchedule):
        used(Drive(1.0, result))
    elif isinstance(result, Scene):
        first = result.model.resonance_omega(1)
        periods = min(2.0, LONG * first / float(result.model.omega.max()))
        used(
            simulate(
                result,
                Drive(3.5, constant_frequency(first, 0.98, periods)),
                record=ALL,
                most_events=FEW,
            )
        )
    elif isinstance(result, Beam | ModalModel):
        used(beam_scene(result))
    elif isinstance(result, RigidWalls | CompliantWalls):
        used(
            SlidingAbsorber(
                walls=result,
                friction=CoulombFriction(0.1) if isinstance(result, RigidWalls) else None,
            )
        )
    elif isinstance(result, CoulombFriction | ElasticCoulombFriction):
        used(
            SlidingAbsorber(
                walls=RigidWalls(1e-3, 0.7)
                if isinstance(result, CoulombFriction)
                else CompliantWalls(1e5),
                friction=result,
            )
        )
    elif isinstance(result, StuckAbsorber | TunedAbsorber | SlidingAbsorber | SeveralAbsorbers):
        scene = beam_scene(BEAM, result)
        if not getattr(
            result, "gravity", 0.0
        ):  # what hangs is one more kernel, with any of its observers: test_loads.py
            used(scene)
    elif isinstance(result, InitialState):
        used(simulate(SCENE, DRIVE, initial=result, record=ALL, most_events=FEW))
    elif isinstance(result, Record):
        used(
            simulate(
                beam_scene(BEAM),
                DRIVE,
                record=dataclasses.replace(result, energy=False, check=False),
            )
        )  # each set of observers is one more kernel
    elif isinstance(result, Exact | Moreau | RungeKutta):
        used(
            simulate(
                beam_scene(BEAM, friction_damper())
                if isinstance(result, Moreau)
                else beam_scene(BEAM),
                DRIVE,
                result,
                record=ALL,
            )
        )
    elif isinstance(result, float | np.ndarray):
        assert np.all(np.isfinite(result)), f"{result} is not finite"
    elif isinstance(result, tuple | list):
        for part in result:
            used(part)


def complaints(
    name: str, make: Callable[..., Any], own: Mapping[str, Any], *, dear: bool = False
) -> Iterator[str | None]:
    """Yield the error of the call for each argument and each of `VALUES`.

    None stands for a call without error. With ``dear`` only values of a wrong kind are tried.
    """
    good = good_arguments(make, own)
    if not dear:
        used(make(**good))
    for argument, hint in hints_of(make).items():
        for value in VALUES:
            if fits(value, hint) and (
                dear or "Callable" in str(hint)
            ):  # what is called is the caller's
                continue
            try:
                problem = _complaint(make, good, argument, value, hint)
            except Exception as error:
                problem = f"{type(error).__name__}: {error}"
            yield None if problem is None else f"{name}({argument}={_text(value)}): {problem}"


def _text(value: Any) -> str:
    return "10**5000" if isinstance(value, int) and value > 10**4000 else repr(value)[:80]


def _complaint(
    make: Callable[..., Any], good: Mapping[str, Any], argument: str, value: Any, hint: Any
) -> str | None:
    try:
        result = make(**{**good, argument: value})
        if (
            not fits(value, hint)
            and value is not inspect.signature(make).parameters[argument].default
        ):
            return f"accepted, though it is no {hint}"
        stored = getattr(result, argument, value)
        if (
            stored is not value
            and _is_array(value)
            and not np.allclose(stored, value, rtol=1e-12, atol=0)
        ):
            return f"kept as {stored!r}"
        used(result)
    except ParameterError as error:
        named = any(
            _words(name).removesuffix("s") in _words(str(error))
            for name in (argument, ALSO.get(argument, argument))
        )
        return None if named else f"refused without the argument's name: {error}"
    except IntegrationError:  # its message says when and why
        return None
    return None


def _words(text: str) -> str:
    return text.lower().replace("_", " ")
