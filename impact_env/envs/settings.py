"""Arguments of the environments for scene, force, method and observation.

They are plain values, so that a spec can be written as JSON.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from impact_env.checks import (
    Check,
    count_from,
    finite,
    flag,
    instance,
    listed,
    non_negative,
    one_of,
    or_none,
    positive,
    require,
    word_of,
)
from impact_env.envs.observation import FEATURE_LIMIT
from impact_env.fields import check_fields
from impact_env.laws import CONCEPTS, make
from impact_env.loads import Random, Samples
from impact_env.methods import METHODS, Exact, Method
from impact_env.modes import Structure, modal_model
from impact_env.parameters import MOST_ELEMENTS, Beam, RigidWalls, SlidingAbsorber
from impact_env.plain import from_scene, load_structure, to_beam, to_scene
from impact_env.plain_loads import to_loads
from impact_env.results import DEFAULT_SAMPLES, MOST_SAMPLES_PER_PERIOD
from impact_env.scene import Scene, beam_scene
from impact_env.solvers import check_general, find_solver

Range = tuple[float, float]
SWEEP_OBJECTIVES = ("level", "fatigue")
FORCE_BOUNDS = (
    1e-30,
    1e30,
)  # N: squares of what follows from them, and powers of order five, are still numbers
SCENE_PARTS = (
    "absorber",
    "absorber_options",
    "modes",
    "beam",
)  # what a whole scene stands in place of


def check_word(name: str, value: Mapping[str, Any], allowed: set[str]) -> dict[str, Any]:
    """Return a mapping as a dict.

    Raises ParameterError for a key that is not in ``allowed``.
    """
    require(isinstance(value, Mapping), name, value, "a mapping of names to values")
    strange = sorted(set(value) - allowed)
    require(
        not strange,
        name,
        value,
        f"only the keys {', '.join(sorted(allowed))}" if allowed else "no keys",
    )
    return dict(value)


def check_range(name: str, value: Any) -> Range:
    """Return a finite number as (number, number), or a pair (low, high) with low <= high."""
    if isinstance(value, Sequence | np.ndarray) and getattr(value, "ndim", 1) > 0:
        items = listed(name, value)
        require(len(items) == 2, name, value, "a number, or a pair (low, high)")
        low, high = (finite(name, x) for x in items)
        require(low <= high, name, value, "a pair (low, high) with low not above high")
        return low, high
    return (finite(name, value),) * 2


def _check_force(name: str, value: Any) -> float | Range:
    """Return a force as a float, or a pair (low, high) of them."""
    low, high = check_range(name, value)
    return (low, high) if isinstance(value, Sequence | np.ndarray) else low


def check_pair(what: str) -> Check:
    """Return the check of a pair (low, high) of numbers above 0, or of one number for both.

    ``what`` describes the allowed values in the error's message.
    """

    def check(name: str, value: Any) -> Range:
        low, high = check_range(name, value)
        require(low > 0, name, value, f"(low, high), {what} above 0")
        return low, high

    return check


def make_method(name: str, steps_per_period: int | None) -> Method:
    """Return the integration method "exact", "moreau" or "runge-kutta".

    ``steps_per_period`` is None for "exact". Raises ParameterError for another name.
    """
    kind: Callable[..., Method] = METHODS[one_of("method", name, METHODS)]
    if steps_per_period is None:
        return kind()
    require(
        kind is not Exact,
        "steps_per_period",
        steps_per_period,
        "left out with method exact: it has no steps",
    )
    return kind(steps_per_period)


@lru_cache(maxsize=64)
def _scene(absorber: str, options: str, beam: str) -> tuple[Scene, Beam]:
    values = json.loads(beam)
    if isinstance(values.get("damping_ratio"), list):
        values["damping_ratio"] = tuple(values["damping_ratio"])
    if "modal_frequency_ratio" in values:
        values["modal_frequency_ratio"] = {
            int(mode): ratio for mode, ratio in values["modal_frequency_ratio"].items()
        }
    result = Beam(**values)
    return beam_scene(result, make(absorber, json.loads(options))), result


def as_json(name: str, value: Any) -> str:
    """Return plain values as JSON text; equal values give equal text."""
    try:
        return json.dumps(value, sort_keys=True, default=_plain)
    except (TypeError, ValueError) as error:
        require(False, name, value, f"plain values that can be written as JSON ({error})")
        raise  # not reached


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is not a plain value")


def _file_of(structure: Any) -> tuple[str, int]:
    """Return a structure's file and the time of its last change.

    With the time as part of a cache key, a changed file is read again.
    """
    require(
        isinstance(structure, str | Path),
        "structure",
        structure,
        "the name of a file as docs/scenes.md describes it",
    )
    path = Path(structure).resolve()
    return str(path), path.stat().st_mtime_ns if path.is_file() else 0


@lru_cache(maxsize=64)
def _structure(path: str, _changed: int) -> Structure:
    return load_structure(path)


@lru_cache(maxsize=64)
def _on_structure(
    path: str, changed: int, absorber: str, options: str
) -> tuple[Scene, Beam | None]:
    structure = _structure(path, changed)
    scene = Scene(modal_model(structure).with_absorber_at(1), make(absorber, json.loads(options)))
    return scene, structure if isinstance(structure, Beam) else None


@lru_cache(maxsize=64)
def _whole_scene(text: str) -> tuple[Scene, Beam | None]:
    plain = json.loads(text)
    return to_scene(plain), to_beam(plain)


@lru_cache(maxsize=64)
def _record(text: str) -> Samples:
    load = to_loads({"load": json.loads(text)}, 1.0).parts[0]
    require(
        isinstance(load, Random | Samples),
        "load",
        json.loads(text),
        "one load of the kind random or samples",
    )
    record = load.record() if isinstance(load, Random) else load
    assert isinstance(record, Samples)
    return record


@dataclass(frozen=True)
class TaskSettings:
    """Arguments that all environments have: scene, force, method, interval, sensors and actuator.

    Defaults are those of this class; an environment that has others lists them. A wrong value
    raises `impact_env.ParameterError` with the argument's name.

    Parameters
    ----------
    absorber : str
        Kind of absorber, one of `impact_env.laws.CONCEPTS`.
    absorber_options : dict
        Parameters of the absorber in SI units: ``mass_ratio``, ``gap``, ``restitution``,
        ``friction_limit`` and the others of its kind.
    modes : int
        Number of modes of the beam.
    beam : dict
        Other parameters of `impact_env.Beam`, by name.
    resonance : int
        Number of the resonance, from 1. Its period is the pseudo period.
    force : float or pair
        Force amplitude in N, or a pair (low, high) from which each episode draws.
    method : str
        ``"exact"``, ``"moreau"`` or ``"runge-kutta"``.
    steps_per_period : int or None
        Time steps in a period, for ``"moreau"`` and ``"runge-kutta"``.
    interval : float
        Control interval in pseudo periods.
    samples_per_period : int
        Samples of the tip in a pseudo period, for level and amplitudes.
    observation_noise : float
        Standard deviation of the noise of each measured, scaled feature.
    observation_delay : int
        Delay of the measured features in intervals.
    observation_drift : float
        Standard deviation of the change of a bias of each measured feature in an interval; the bias
        is 0 at the start of an episode.
    action_delay : int
        Intervals until an action has an effect. Until then the actuator has the value of the scene,
        or the middle of its range where the scene has none.
    action_levels : int or None
        Number of equidistant values from -1 to 1 to which an action is rounded, 2 or more.
    impacts_limit : float
        Upper limit of feature 5, the impacts in a pseudo period; chatter has tens.
    raw_state : bool
        Whether info has the ``state``: modal displacements, absorber displacement, modal velocities
        and absorber velocity.
    threads : int or None
        Threads of a vector environment, by default all cores. Numbers do not depend on it.
    whole_scene : Scene, dict or None
        A scene in place of absorber, modes and beam: an `impact_env.Scene` or its plain form
        (docs/scenes.md).
    structure : str or None
        File of a structure in place of beam and modes (docs/your_structure.md).
    load : dict or None
        Disturbance in addition to the force: a load of the kind ``random`` or ``samples``
        (docs/loads.md). It repeats, and each episode draws its start. Scores and references exclude
        it. It needs the exact method and rigid contact.
    moves_base : bool
        Whether ``force`` is the amplitude of the base's acceleration in m/s^2; displacements are
        then relative to the base. It needs the exact method and rigid contact.

    """

    absorber: str = "impact"
    absorber_options: Mapping[str, Any] = field(default_factory=dict)
    modes: int = 3
    beam: Mapping[str, Any] = field(default_factory=dict)
    resonance: int = 1
    force: float | Range = 1.5
    method: str = "exact"
    steps_per_period: int | None = None
    interval: float = 5.0
    samples_per_period: int = DEFAULT_SAMPLES
    observation_noise: float = 0.0
    observation_delay: int = 0
    observation_drift: float = 0.0
    action_delay: int = 0
    action_levels: int | None = None
    impacts_limit: float = FEATURE_LIMIT
    raw_state: bool = False
    threads: int | None = None
    whole_scene: Scene | Mapping[str, Any] | None = None
    structure: str | None = None
    load: Mapping[str, Any] | None = None
    moves_base: bool = False

    def __post_init__(self) -> None:
        check_fields(
            self,
            absorber=word_of(CONCEPTS),
            force=_check_force,
            method=word_of(METHODS),
            modes=count_from(1, 2 * MOST_ELEMENTS),
            threads=or_none(count_from(1)),
            raw_state=flag,
            moves_base=flag,
        )
        check_fields(
            self,
            absorber_options=partial(check_word, allowed=set(CONCEPTS[self.absorber])),
            beam=partial(check_word, allowed={f.name for f in fields(Beam)}),
        )
        beam = self.beam
        require(
            "modes" not in beam, "beam", self.beam, "no key modes: that is an argument of its own"
        )
        if self.whole_scene is not None:
            self._check_whole_scene()
        if self.structure is not None:
            require(
                self.whole_scene is None,
                "whole_scene",
                self.whole_scene,
                "left out beside a structure",
            )
            require(
                not beam,
                "beam",
                self.beam,
                "left out beside a structure, whose file says what it is",
            )
        find_solver(self.scene, self.integrator)
        model = self.scene.model
        check_fields(self, resonance=lambda _name, value: model.check_resonance(value))
        low, high = self.forces
        allowed = (
            f"a force in N from {FORCE_BOUNDS[0]:g} to {FORCE_BOUNDS[1]:g}, or a pair (low, high) "
            "of such to draw from"
        )
        require(FORCE_BOUNDS[0] <= low <= high <= FORCE_BOUNDS[1], "force", self.force, allowed)
        check_fields(
            self, samples_per_period=count_from(8, MOST_SAMPLES_PER_PERIOD), interval=positive
        )
        samples = self.interval * self.samples_per_period
        whole = abs(samples - round(samples)) < 1e-9 and round(samples) >= 4
        require(
            whole,
            "interval",
            self.interval,
            (
                f"a multiple of 1/{self.samples_per_period} pseudo periods (one sample), four "
                "samples or more"
            ),
        )
        check_fields(
            self,
            observation_noise=non_negative,
            observation_drift=non_negative,
            observation_delay=count_from(0),
            action_delay=count_from(0),
            action_levels=or_none(count_from(2)),
            impacts_limit=positive,
        )
        check_general(self.scene, self.integrator, self.record, moves_base=self.moves_base)

    def _check_whole_scene(self) -> None:
        plain = isinstance(self.whole_scene, Scene | Mapping)
        require(
            plain,
            "whole_scene",
            self.whole_scene,
            "an impact_env.Scene, or its plain form as docs/scenes.md describes it",
        )
        for name in SCENE_PARTS:
            default = {} if name in ("absorber_options", "beam") else getattr(TaskSettings, name)
            require(
                getattr(self, name) == default,
                name,
                getattr(self, name),
                "left out beside whole_scene, which says it already",
            )

    @property
    def _scene_and_beam(self) -> tuple[Scene, Beam | None]:
        if isinstance(self.whole_scene, Scene):
            return self.whole_scene, None
        if self.whole_scene is not None:
            return _whole_scene(as_json("whole_scene", self.whole_scene))
        options = as_json("absorber_options", self.absorber_options)
        if self.structure is not None:
            return _on_structure(*_file_of(self.structure), self.absorber, options)
        return _scene(self.absorber, options, as_json("beam", {**self.beam, "modes": self.modes}))

    @property
    def scene(self) -> Scene:
        """The scene; the same object for the same values."""
        return self._scene_and_beam[0]

    @property
    def beam_parameters(self) -> Beam | None:
        """The beam, None where only its modes are known."""
        return self._scene_and_beam[1]

    @property
    def integrator(self) -> Method:
        """The integration method."""
        return make_method(self.method, self.steps_per_period)

    @property
    def record(self) -> Samples | None:
        """The load of ``load``, None without; the same object for the same values."""
        return (
            None
            if instance("load", self.load, Mapping | None) is None
            else _record(as_json("load", self.load))
        )

    @property
    def forces(self) -> Range:
        """Smallest and largest amplitude of the force in N, or in m/s^2 where it moves the base."""
        return check_range("force", self.force)

    @property
    def omega(self) -> float:
        """Circular frequency of the resonance in rad/s."""
        return self.scene.model.resonance_omega(self.resonance)

    @property
    def length(self) -> float:
        """The unit of displacement in observations in m.

        It is the half-clearance of the cavity, or the paper's half-clearance for a scene without
        one.
        """
        absorber = self.scene.absorber
        walls = absorber.walls if isinstance(absorber, SlidingAbsorber) else None
        return RigidWalls.gap if walls is None or walls.gap == 0 else walls.gap

    def describe(self) -> dict[str, Any]:
        """Return the arguments as plain values, by name.

        ``threads`` is left out, because it changes no result, and so are arguments of the scene
        that have not been given.
        """
        values = {
            f.name: getattr(self, f.name)
            for f in fields(self)
            if f.name not in ("threads", "whole_scene")
        }
        values = {
            name: dict(value) if isinstance(value, Mapping) else value
            for name, value in values.items()
        }
        if self.whole_scene is None:
            return values
        plain = (
            from_scene(self.whole_scene)
            if isinstance(self.whole_scene, Scene)
            else json.loads(as_json("whole_scene", self.whole_scene))
        )
        return {name: value for name, value in values.items() if name not in SCENE_PARTS} | {
            "whole_scene": plain
        }
