"""In densely sampled runs no wall is entered and every contact force is admissible.

Whole runs are sampled far more densely than their fastest mode oscillates.

What acts on an absorber follows from its velocity at the samples alone. A missed impact shows as a
penetration, a missed reversal as friction that drives: both last for a good share of a fast mode's
period, long after which no event list would tell.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from core import Array, run
from numpy.typing import NDArray

from impact_env import (
    Beam,
    Drive,
    FrequencySchedule,
    InitialState,
    Record,
    Response,
    Scene,
    beam_scene,
    friction_damper,
    impact_absorber,
    impact_absorbers,
    simulate,
)
from impact_env.kernels.motion.observers import HELD_LOWER, HELD_UPPER, STUCK_INSIDE

Mask = NDArray[np.bool_]
GAP = 1e-3
DEPTH = 1e-9  # of the gap
STILL = 1e-9  # of the largest velocity
LOOSE = 1e-6  # of the friction limit
# samples in a period of the fastest mode, pseudo periods of a run, scenes
RUNS = {2: (64, 60.0, 60), 5: (64, 20.0, 60), 10: (64, 8.0, 40), 30: (16, 3.0, 12)}


@dataclass(frozen=True)
class Motion:
    """Motion and contacts of one absorber.

    Time, relative displacement and velocity (S,), largest velocity, force on the absorber between
    two samples (S - 1,), and its contacts.

    ``hit``, ``joined`` and ``apart`` (S - 1,): between the two samples there is an impact of any
    absorber, it is joined throughout, or it is neither joined nor hit at any time. ``kind`` (S -
    1,) says how it is joined.
    """

    time: Array
    place: Array
    speed: Array
    fastest: float
    force: Array
    hit: Mask
    joined: Mask
    apart: Mask
    kind: NDArray[np.int64]


def motion_of(response: Response, which: int) -> Motion:
    history = response.history
    impacts = response.impacts
    phases = response.phases
    time = history.time
    shape = response.scene.absorber_shapes[which]
    q, v = (
        rows.reshape(len(time), -1)[:, which]
        for rows in (history.absorber_displacement, history.absorber_velocity)
    )
    force = response.scene.absorber_masses[which] * np.diff(v) / np.diff(time)
    count = len(force)
    hit, joined, touched, kind = (np.zeros(count, dtype=t) for t in (bool, bool, bool, np.int64))
    for side in ("left", "right"):  # an impact on a sample belongs to both of its neighbours
        hit[np.clip(np.searchsorted(time, impacts.time, side) - 1, 0, count - 1)] = True
    for k in np.flatnonzero(phases.absorber == which):
        first, last = np.searchsorted(time, [phases.start[k], phases.end[k]])
        joined[first : max(last - 1, first)] = True
        kind[first : max(last - 1, first)] = phases.kind[k]
        touched[max(first - 1, 0) : last + 1] = True
    place = q - history.modal_displacement @ shape
    speed = v - history.modal_velocity @ shape
    fastest = float(max(np.max(np.abs(v)), np.max(np.abs(speed))))
    return Motion(time, place, speed, fastest, force, hit, joined, ~hit & ~touched, kind)


def faults(response: Response, which: int = 0) -> list[str]:
    """Return the absorber's faults, in words."""
    absorber = getattr(response.scene.absorber, "absorbers", [response.scene.absorber])[which]
    gap = np.inf if absorber.walls is None else absorber.walls.gap
    limit = 0.0 if absorber.friction is None else absorber.friction.limit
    m = motion_of(response, which)
    messages = []
    period = response.drive.schedule.pseudo_period
    slack = LOOSE * limit + 1e-9
    still = STILL * m.fastest

    def note(what: str, wrong: Mask, size: Array) -> None:
        if np.any(wrong):
            k = int(np.argmax(np.where(wrong, size, -np.inf)))
            messages.append(
                f"{what} at {np.sum(wrong)} samples, worst {size[k]:.2e} at "
                f"{m.time[k] / period:.4f} periods"
            )

    note("in a wall", np.abs(m.place) > gap * (1 + DEPTH), np.abs(m.place) / gap - 1)
    note("a force beyond friction", m.apart & (np.abs(m.force) > limit + slack), np.abs(m.force))
    if limit > 0:
        slides = m.apart & (np.abs(m.force) > limit - slack)
        along = np.maximum(np.sign(m.force) * m.speed[:-1], np.sign(m.force) * m.speed[1:])
        turning = LOOSE * np.abs(
            np.diff(m.speed)
        )  # a reversal so close to a sample that the mean force does not show it
        note("driven by friction", slides & (along > still + turning), along)
    low = np.full_like(m.force, -limit)
    high = np.full_like(m.force, limit)
    low[m.kind == HELD_UPPER] = -np.inf
    high[m.kind == HELD_LOWER] = np.inf
    holds = m.joined & ~m.hit
    note(
        "a joint beyond its bounds",
        holds & ((m.force > high + slack) | (m.force < low - slack)),
        np.abs(m.force),
    )
    note("a joint that moves", holds & (np.abs(m.speed[:-1]) > still), np.abs(m.speed[:-1]))
    note(
        "held off the wall",
        holds & (m.kind != STUCK_INSIDE) & (np.abs(np.abs(m.place[:-1]) - gap) > DEPTH * gap),
        np.abs(m.place[:-1]) / gap - 1,
    )
    return messages


def drive_of(scene: Scene, start: float, periods: float, rng: np.random.Generator) -> Drive:
    """A sweep up or down, at the paper's rate or ten times it."""
    reference = scene.model.omega[0]
    change = periods * 1e-4 * rng.choice([1.0, 10.0]) * rng.choice([-1.0, 1.0])
    schedule = FrequencySchedule(
        np.array([0.0, periods * 2 * np.pi / reference]),
        np.array([start, start + change]) * reference,
        reference,
    )
    return Drive(float(rng.choice([0.3, 1.5, 3.5, 10.0])), schedule, rng.uniform(0, 2 * np.pi))


def start_of(scene: Scene, rng: np.random.Generator) -> InitialState:
    """Return a random initial state.

    The first mode oscillates about as far as the gap. The absorbers are in the middle, or on a wall
    that they leave or rest on.
    """
    q = np.zeros(scene.model.modes)
    shapes = scene.absorber_shapes
    q[0] = GAP * 10 ** rng.uniform(-0.3, 0.7) / scene.model.tip_shape[0]
    places = shapes @ q
    speeds = np.zeros(len(shapes))
    if scene.cavity(0) is not None and rng.random() < 0.4:
        side = rng.choice([-1.0, 1.0], len(shapes))
        places = places + side * [scene.cavity(a).gap for a in range(len(shapes))]
        speeds = -side * 10 ** rng.uniform(-6, -1, len(shapes)) * rng.integers(0, 2, len(shapes))
    return InitialState(
        q,
        None,
        places if len(shapes) > 1 else float(places[0]),
        speeds if len(shapes) > 1 else float(speeds[0]),
    )


def beam_of(modes: int, rng: np.random.Generator, **other: float) -> Beam:
    """The paper's beam, or one with less or no damping and its force elsewhere."""
    return Beam(
        modes=modes,
        damping_ratio=float(rng.choice([0.01, 0.002, 0.0])),
        force_position=float(rng.choice([0.4, 0.7, 0.25])),
        **other,
    )


def one_absorber(modes: int, rng: np.random.Generator) -> Scene:
    limit = float(rng.choice([0.0, 0.025, 0.1, 0.3])) or None
    ratio = float(rng.choice([0.02, 0.005, 0.1]))
    walls = impact_absorber(GAP, float(rng.choice([0.0, 0.7, 0.9, 1.0])), limit, ratio)
    return beam_scene(beam_of(modes, rng, absorber_position=float(rng.choice([1.0, 0.8]))), walls)


def two_absorbers(modes: int, rng: np.random.Generator) -> Scene:
    gaps = GAP * rng.uniform(0.3, 1, 2)
    limits = [float(x) or None for x in rng.choice([0.0, 0.025, 0.2], 2)]
    both = impact_absorbers(gaps, (1.0, 0.6), rng.choice([0.5, 0.7, 0.9, 1.0], 2).tolist(), limits)
    return beam_scene(beam_of(modes, rng), both)


def damper(modes: int, rng: np.random.Generator) -> Scene:
    return beam_scene(
        beam_of(modes, rng, absorber_position=float(rng.choice([1.0, 0.8]))),
        friction_damper(float(rng.choice([0.025, 0.1, 0.5]))),
    )


@pytest.mark.parametrize("modes", RUNS)
@pytest.mark.parametrize("make", [one_absorber, damper, two_absorbers])
def test_contacts_hold_at_every_sample(make: object, modes: int) -> None:
    density, periods, scenes = RUNS[modes]
    wrong = []
    impacts = 0
    for seed in range(scenes if make is one_absorber else scenes // 4):
        rng = np.random.default_rng([seed, modes])
        scene = make(modes, rng)
        drive = drive_of(scene, rng.uniform(0.9, 1.04), periods, rng)
        samples = int(density * scene.model.omega[-1] / scene.model.omega[0])
        response = run(scene, drive, initial=start_of(scene, rng), samples=samples)
        impacts += response.impact_count
        wrong += [
            f"seed {seed}, absorber {a}: {fault}"
            for a in range(scene.places)
            for fault in faults(response, a)
        ]
    assert make is damper or impacts > scenes
    assert not wrong, f"{len(wrong)} faults:\n" + "\n".join(wrong)


@pytest.mark.parametrize("make", [one_absorber, damper, two_absorbers])
def test_between_impacts_a_sliding_absorber_turns_where_a_reversal_is_listed_and_nowhere_else(
    make: object,
) -> None:
    turns = 0
    record = Record(level=False, events=True, series=True, reversals=True, samples_per_period=100)
    for seed in range(12 if make is one_absorber else 5):
        rng = np.random.default_rng([seed, 77])
        scene = make(2, rng)
        sliding = [
            a
            for a, each in enumerate(getattr(scene.absorber, "absorbers", [scene.absorber]))
            if each.friction is not None
        ]
        if not sliding:
            continue
        response = simulate(
            scene,
            drive_of(scene, rng.uniform(0.9, 1.04), 2.0, rng),
            initial=start_of(scene, rng),
            record=record,
        )
        for a in sliding:
            motion = motion_of(response, a)
            listed = response.reversals.time[response.reversals.absorber == a]
            changes = motion.apart & (motion.speed[:-1] * motion.speed[1:] < 0)
            odd = motion.apart & (np.histogram(listed, motion.time)[0] % 2 == 1)
            assert np.array_equal(
                changes[1:], odd[1:]
            )  # at the start it may rest, but for rounding
            turns += np.sum(odd)
    assert turns >= 5
