"""The event search agrees with brute force (reference/signals.py).

Signals are random and have every kind of start. They are searched from every level of steps.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from core import Array

from impact_env import Beam, ModalModel, Scene, beam_scene, impact_absorber
from impact_env.kernels.events.search import search_events
from impact_env.kernels.events.signals import EventFunction, new_signal
from impact_env.kernels.events.signals import Guards as SearchGuards
from impact_env.kernels.motion.forced import Forced, new_forced, solve_forced
from impact_env.kernels.motion.loads import ForceWindow
from impact_env.kernels.motion.modal_system import SPEED, ModalSystem, S
from impact_env.solvers import rigid_regimes
from reference.signals import (
    HIGH,
    LOW,
    NOTHING,
    TURN,
    FirstEvents,
    Force,
    Guards,
    Signals,
    first_events,
)

Model = tuple[str, int]
MODELS: tuple[Model, ...] = (
    ("paper", 2),
    ("paper", 10),
    ("paper", 30),
    ("other", 2),
    ("other", 10),
    ("other", 30),
)
CASES = {2: 24, 10: 24, 30: 16}  # signals of each start in a window
GUARDED = {
    "walls": ("leaves", "rests", "released", "inside"),
    "walls and rate": ("turns", "turns by a wall", "released", "inside"),
    "spring and rate": ("leaves",),  # compliant walls with elastic friction ask for this
    "rate": ("turns", "released", "inside"),
    "joint": ("inside",),
}


def scene_of(model: Model) -> Scene:
    """Return the paper's beam, or modes with very different damping.

    Damping ratios are from 0 to 1.5, and some modes have almost the same frequency.
    """
    name, modes = model
    absorber = impact_absorber(1e-3, 0.7, 0.1)
    if name == "paper":
        return beam_scene(Beam(modes=modes), absorber)
    rng = np.random.default_rng(modes)
    omega = 40.0 * 10 ** np.sort(rng.uniform(0.0, 0.9 + 0.05 * modes, modes))
    twins = np.arange(0, modes - 1, 3)
    omega[twins + 1] = omega[twins] * (1 + 10 ** rng.uniform(-5, -2, len(twins)))
    damping = rng.choice([0.0, 1e-4, 0.002, 0.03, 0.3, 0.95, 1.0, 1.5], modes)
    return Scene(
        ModalModel(omega, damping, rng.normal(size=modes), rng.normal(size=modes), 0.4), absorber
    )


@dataclass(frozen=True)
class Stage:
    """A regime's slots with the force of one window.

    ``tau`` (s) is the time in the window where the signals start.
    """

    slots: ModalSystem
    forced: Forced
    window: ForceWindow
    tau: float

    @property
    def length(self) -> float:
        return self.window.half - self.tau

    @property
    def used(self) -> int:
        return int(np.sum(self.slots.rows[SPEED] > 0))


def stages(model: Model, joined: bool, rng: np.random.Generator) -> list[Stage]:
    """Return the stages of two windows.

    One is a slow chirp from the window's start on, the other a fast one from a later time. The
    forces have random sizes of 0.01 to 100 N.
    """
    scene = scene_of(model)
    free, stuck, reach = rigid_regimes(scene, 3.2 * scene.model.pseudo_period())
    slots = (stuck if joined else free).system
    stages_of_runs = []
    for k, share in enumerate((0.0, rng.uniform(0.3, 0.8))):
        omega = scene.model.omega[0] * rng.uniform(0.8, 1.2) * (1 + 2 * k)
        half = 0.5 * reach * (1 - 0.4 * k)
        alpha = 2 * (1.2e-15) ** 0.2 / half**2 * (1e-3, 1.0)[k]
        phase = rng.uniform(0, 2 * np.pi)
        push = 10 ** rng.uniform(-2, 2)
        window = ForceWindow(
            0.0, half, float(omega), float(alpha), push * np.cos(phase), push * np.sin(phase)
        )
        forced = new_forced(slots, None)
        solve_forced(slots, window, scene.absorber_mass if joined else None, forced)
        stages_of_runs.append(Stage(slots, forced, window, half * (2 * share - 1)))
    return stages_of_runs


def amplitudes(stage: Stage, count: int, rng: np.random.Generator) -> Array:
    """Return random amplitudes (N, J) of the size of the force's share, smaller or larger.

    All modes have the same velocity, or high or low modes dominate, or one mode is alone.
    """
    s = np.abs(stage.slots.rows[S : S + 2, : stage.used].T @ [1, 1j])
    phase = np.exp(1j * rng.uniform(0, 2 * np.pi, (count, stage.used)))
    power = rng.choice([-1.0, -0.5, 0.0, -1.5, -2.0, -3.0], count)[:, None]
    size = (s / s[0]) ** power * 10 ** rng.normal(0, 0.5, (count, stage.used))
    alone = rng.random(count) < 0.15
    size[alone] *= np.where(
        np.arange(stage.used) == rng.integers(stage.used, size=(np.sum(alone), 1)), 1.0, 1e-3
    )
    total = stage.forced.bound[0] * 10 ** rng.uniform(-1, 2, (count, 1))
    return np.asarray(phase * size * total / size.sum(axis=1, keepdims=True))


@dataclass(frozen=True)
class Cases:
    """Signals of one stage with their guards, and the arguments of the search, (N,) each.

    The arguments are the walls, the wall on which a signal starts, and whether its rate is zero.
    """

    stage: Stage
    name: str
    signals: Signals
    guards: Guards
    low: Array
    high: Array
    side: Array
    zero: Array


def cases_of(stage: Stage, quantity: str, name: str, count: int, rng: np.random.Generator) -> Cases:
    u = amplitudes(stage, count, rng)
    s = stage.slots.rows[S, : stage.used] + 1j * stage.slots.rows[S + 1, : stage.used]
    force = Force.of(
        stage.forced.signals[0, :, 0, 0] + 1j * stage.forced.signals[0, :, 1, 0], stage.window.omega
    )
    pushes = np.array([float(force(m, stage.tau)) for m in range(30)])
    signals = Signals(s, u, np.zeros((count, 3)), np.zeros((count, 3)), force, pushes, stage.tau)
    y, v, a = signals.sizes().T
    natural = np.stack([np.real((u * s**m).sum(axis=1)) for m in range(4)], axis=1) + pushes[:4]
    if quantity == "joint":
        distance = y * 10 ** rng.uniform(-3, 0, (2, count))
        low = natural[:, 0] - distance[0]
        high = natural[:, 0] + distance[1]
        low[rng.random(count) < 0.2] = -np.inf
        none = np.zeros(count)
        start = natural[:, :3]
        guards = Guards(low - start[:, 0], high - start[:, 0], none)
        return Cases(
            stage,
            name,
            Signals(s, u, signals.p, start, force, pushes, stage.tau),
            guards,
            low,
            high,
            none,
            none > 0,
        )
    start = natural[:, :3].copy()
    gap = y * 10 ** rng.uniform(-2.5, 0.5, count)
    sign = rng.choice([-1.0, 1.0], count)
    side = np.zeros(count)
    start[:, 0] = gap * rng.uniform(-1, 1, count)
    start[:, 1] = sign * v * 10 ** rng.uniform(-5, 0, count)
    if name == "released":
        start[:, 1:3] = 0.0
        sign = np.sign(natural[:, 3])
    if name in ("rests", "turns", "turns by a wall"):
        weak = rng.random(count) < 0.5
        start[:, 2] = np.where(weak, sign * a * 10 ** rng.uniform(-5, 0, count), start[:, 2])
        start[:, 1], sign = 0.0, np.sign(start[:, 2])
    if name == "turns by a wall":
        far = 0.5 * np.abs(start[:, 2]) * (10 ** rng.uniform(-3, 0, count) / signals.fastest) ** 2
        start[:, 0] = sign * (gap - np.maximum(far, 1e-10 * y))
    if name == "leaves" or (quantity == "walls" and name != "inside"):
        start[:, 0] = -sign * gap
        side = -sign
    low = -gap
    high = gap
    direction = sign
    if quantity == "walls":
        direction = np.zeros(count)
    if quantity == "walls and rate":  # as the simulator asks: the wall behind cannot be reached
        low = np.where(sign > 0, -np.inf, low)
        high = np.where(sign > 0, high, np.inf)
    if quantity == "rate":
        low = np.full(count, -np.inf)
        high = np.full(count, np.inf)
    zero = np.full(count, quantity in ("walls and rate", "rate") and name != "inside")
    guards = Guards(low - start[:, 0], high - start[:, 0], direction)
    return Cases(
        stage,
        name,
        Signals(s, u, start - natural[:, :3], start, force, pushes, stage.tau),
        guards,
        low,
        high,
        side,
        zero,
    )


def searched(cases: Cases, case: int, level: int) -> tuple[int, float]:
    """Return kind and time of the first event that the search finds from a level on."""
    stage = cases.stage
    guards = cases.guards
    signal = new_signal(stage.slots.rows.shape[1])
    u = cases.signals.u[case]
    signal.u[0, : stage.used] = u.real
    signal.u[1, : stage.used] = u.imag
    signal.polynomial[:] = cases.signals.p[case]
    signal.memory[0] = level
    low = float(cases.low[case])
    high = float(cases.high[case])
    direction = float(guards.direction[case])
    search_guards = SearchGuards(
        low, high, int(cases.side[case]), direction if direction else None, bool(cases.zero[case])
    )
    course = EventFunction(stage.slots, stage.forced, stage.window.omega, signal, stage.tau)
    event = search_events(course, search_guards, stage.length, stage.window.half)
    return int(event.kind), float(event.offset)


def differences(cases: Cases, truth: FirstEvents, top: int) -> list[str]:
    """Return the differences between the search and brute force, one line for each case."""
    lines = []
    sizes = cases.signals.sizes()
    fast = cases.signals.fastest
    for case in np.flatnonzero(truth.clear):
        kind = truth.kind[case]
        time = truth.time[case]
        of_guard = 1 if kind == TURN else 0
        size = sizes[case, of_guard] + sizes[case, of_guard + 1] * min(time, 1 / fast)
        slack = 1e-7 / fast + 1e-13 * size / truth.slope[case]
        results = [searched(cases, case, level) for level in range(top + 1)]
        wrong = {
            n: (k, f"{t * fast:.6g}")
            for n, (k, t) in enumerate(results)
            if k != kind or (k != NOTHING and not abs(t - time) <= slack)
        }
        if wrong:
            lines.append(
                f"{cases.name} {case}: truth ({kind}, {time * fast:.6g}), found {wrong}; "
                "times in 1/|s|"
            )
    return lines


@pytest.mark.parametrize("model", MODELS, ids=lambda model: f"{model[0]}-{model[1]}")
@pytest.mark.parametrize("quantity", GUARDED)
def test_no_event_is_missed_from_any_level(quantity: str, model: Model) -> None:
    rng = np.random.default_rng([len(quantity), MODELS.index(model)])
    lines = []
    judged = 0
    count = 0
    for stage in stages(model, quantity == "joint", rng):
        top = stage.slots.steps.shape[0] - 1
        for name in GUARDED[quantity]:
            cases = cases_of(stage, quantity, name, CASES[model[1]], rng)
            truth = first_events(cases.signals, cases.guards, stage.length)
            lines += differences(cases, truth, top)
            judged = judged + int(np.sum(truth.clear))
            count = count + len(truth.clear)
            assert np.any(truth.kind[truth.clear] != NOTHING)
    assert judged > 0.97 * count
    assert not lines, f"{len(lines)} of {judged} cases:\n" + "\n".join(lines[:20])


def test_brute_force_knows_a_sine() -> None:
    """Brute force gives the known events of a sine.

    y = sin(t) starts on the wall 0: it returns at pi, its rate is zero at pi/2, and it reaches a
    wall at 0.5 after pi/6.
    """
    one = np.ones(1)
    none = Force.of(np.zeros(9, complex), 0.0)
    signals = Signals(
        np.array([1j]),
        np.array([[-1j]]),
        np.zeros((1, 3)),
        np.array([[0.0, 1.0, 0.0]]),
        none,
        np.zeros(30),
        0.0,
    )
    for low, high, direction, kind, time in (
        (0.0, 2.0, 0.0, LOW, np.pi),
        (0.0, 2.0, 1.0, TURN, np.pi / 2),
        (0.0, 0.5, 0.0, HIGH, np.pi / 6),
    ):
        events = first_events(signals, Guards(low * one, high * one, direction * one), 10.0)
        assert events.kind[0] == kind
        assert events.time[0] == pytest.approx(time, rel=1e-12)
        assert events.clear[0]
