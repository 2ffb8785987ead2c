"""Where the energy goes around a sweep's maximum, mode by mode: what is dissipated, what impacts pass on, and what is left of it at the next one."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import PAPER_LIMITS, linear_sweep
from impact_env.energy import mechanical_energy
from impact_env.ensemble import Lane, draw_members
from impact_env.level import HALF_WINDOW_PERIODS
from impact_env.parameters import Beam, impact_absorber
from impact_env.periodic.case import start_from
from impact_env.response import Response
from impact_env.scene import Scene, beam_scene
from impact_env.sweep import simulate
from studies.paper.curve import WATCHED, part_of

Array = NDArray[np.float64]
SAMPLES = 4096  # per pseudo period: what a mode dissipates between an impact and the next sample is small up to the tenth mode
APART = 0.05  # pseudo periods: impacts that follow each other more closely are one contact, in which high modes bounce


@dataclass(frozen=True, eq=False)
class Account:
    """A sweep's level in m, the frequency ratio ``at`` its maximum, and the energy of its N modes within the level's window.

    ``loss`` (N,): dissipated in each mode in J (paper, Eq. edmi). ``contacts`` in each pseudo period. ``passed`` (N,): mean energy that a
    contact gives to a mode, over what the first mode has before it. ``left`` (N,): share of a mode's energy after a contact that it still has before
    the next, both summed over all of them. ``single`` (C,): what each contact gives to the second mode, over what the first has before it. ``tip``
    (N,): RMS of each mode's part in the tip's displacement in m.
    """

    level: float
    at: float
    loss: Array
    contacts: float
    passed: Array
    left: Array
    single: Array
    tip: Array

    @property
    def shares(self) -> Array:
        """Share of each mode in what all modes dissipate, (N,)."""
        return np.asarray(self.loss / np.sum(self.loss))


def accounted(lane: Lane) -> Account:
    """Return the account of a lane by the exact method: its sweep, and once more around the maximum, from the state at the window's start."""
    level = simulate(lane.scene, lane.drive).level
    assert level is not None
    response = window_around(lane, level.time)
    assert response.energy is not None
    contacts, passed, left, single = _contacts(response)
    periods = response.drive.schedule.periods
    assert response.history is not None
    tip = np.sqrt(np.mean((response.history.modal_displacement * response.history.tip_shape) ** 2, axis=0))
    return Account(level.value, level.frequency_ratio, response.energy.modal_loss, contacts / periods, passed, left, single, tip)


def window_around(lane: Lane, time: float, samples: int = SAMPLES) -> Response:
    """Return the run of a lane within the level's window around a time in s, with ``samples`` for each pseudo period."""
    schedule = lane.drive.schedule
    half, end = HALF_WINDOW_PERIODS * schedule.pseudo_period, float(schedule.times[-1])
    begin = max(0.0, time - half)
    initial = None
    if begin > 0:
        state = simulate(lane.scene, part_of(lane.drive, 0.0, begin)).end_state
        initial = start_from(lane.scene, state)
    record = replace(WATCHED, samples_per_period=samples)
    return simulate(lane.scene, part_of(lane.drive, begin, min(end, time + half)), initial=initial, record=record)


def _contacts(response: Response) -> tuple[int, Array, Array, Array]:
    """Return the number of contacts, and what they pass on, leave, and each give to the second mode (`Account`)."""
    history, impacts, schedule = response.history, response.impacts, response.drive.schedule
    assert history is not None
    assert impacts is not None
    energy = mechanical_energy(response.scene, history).modal
    samples = impacts.time / (schedule.pseudo_period / SAMPLES)
    first, last = contact_ends(samples, APART * SAMPLES)
    before = np.floor(first).astype(np.int64)
    after = np.minimum(np.ceil(last).astype(np.int64), len(energy) - 1)
    nothing = np.full(energy.shape[1], np.nan)
    if len(first) < 2:
        return len(first), nothing, nothing, nothing[:0]
    passed = np.mean(energy[after] - energy[before], axis=0) / np.mean(energy[before, 0])
    left = np.sum(energy[before[1:]], axis=0) / np.sum(energy[after[:-1]], axis=0)
    second = (energy[after] - energy[before])[:, min(1, energy.shape[1] - 1)] / energy[before, 0]
    return len(first), np.asarray(passed), np.asarray(left), np.asarray(second)


def contact_ends(times: Array, apart: float) -> tuple[Array, Array]:
    """Return when contacts begin and end, (C,) each: impacts at rising ``times`` (K,) that are less than ``apart`` from their neighbours are one."""
    if len(times) == 0:
        return times, times
    new = np.flatnonzero(np.diff(times) >= apart)
    return times[np.concatenate([[0], new + 1])], times[np.concatenate([new, [len(times) - 1]])]


def scene(beam: Beam) -> Scene:
    """Return the conservative absorber on a beam."""
    return beam_scene(beam, impact_absorber())


def lanes_of(own: Scene, force: float, members: int, seed: int) -> list[Lane]:
    """Return each member's sweep up, and its sweep down after it."""
    reference, (low, high) = own.model.resonance_omega(1), PAPER_LIMITS
    schedules = linear_sweep(reference, low, high), linear_sweep(reference, high, low)
    drawn = draw_members(members, seed)
    return [Lane(own, drawn[m : m + 1].drives(force, schedule)[0]) for m in range(members) for schedule in schedules]


def critical(found: Sequence[Account]) -> list[Account]:
    """Return the account of the direction with the larger level, for each member."""
    return [max(pair, key=lambda account: account.level) for pair in zip(found[::2], found[1::2], strict=True)]
