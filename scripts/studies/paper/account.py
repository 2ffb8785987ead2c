"""The energy around a sweep's maximum, mode by mode.

Dissipated energy, energy that impacts transfer, and the part of it that is left at the next impact
are computed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from impact_env import Beam, Response, Scene, beam_scene, impact_absorber, simulate
from impact_env.energy import mechanical_energy
from impact_env.ensemble import Lane, draw_members
from impact_env.level import HALF_WINDOW_PERIODS
from studies.paper.curve import FULL_RECORD, compute_level, make_both_sweeps
from studies.study import Array

# per pseudo period: what a mode dissipates between an impact and the next sample is small up to the
# tenth mode
SAMPLES = 4096
# pseudo periods: impacts that follow each other more closely are one contact, in which high modes
# bounce
APART = 0.05


@dataclass(frozen=True, eq=False)
class EnergyShares:
    """Level of a sweep, and the energies of its N modes within the level's window.

    Attributes
    ----------
    level, at : float
        Level in m, and the frequency ratio at the maximum.
    loss : array, (N,)
        Energy dissipated in each mode in J (paper, Eq. edmi).
    contacts : float
        Contacts in each pseudo period.
    passed : array, (N,)
        Mean energy that a contact gives to a mode, over the energy of the first mode before the
        contact.
    left : array, (N,)
        Share of a mode's energy after a contact that remains until the next contact, both summed
        over all contacts.
    single : array, (C,)
        Energy that each contact gives to the second mode, over that of the first mode before it.
    tip : array, (N,)
        RMS of each mode's part in the tip's displacement in m.
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
        """Share of each mode in the dissipated energy, (N,)."""
        return np.asarray(self.loss / np.sum(self.loss))


def measure_energy_shares(lane: Lane) -> EnergyShares:
    """Return the energies of a lane by the exact method.

    After the sweep a second run goes through the window around the maximum, from the state at the
    window's start.
    """
    level = compute_level(lane)
    response = simulate_window(lane, level.time)
    contacts, passed, left, single = _contacts(response)
    history = response.recorded.history
    tip = np.sqrt(np.mean((history.modal_displacement * history.tip_shape) ** 2, axis=0))
    loss = response.recorded.energy.modal_loss
    contacts_each = contacts / response.drive.schedule.periods
    return EnergyShares(
        level.value, level.frequency_ratio, loss, contacts_each, passed, left, single, tip
    )


def simulate_window(lane: Lane, time: float, samples: int = SAMPLES) -> Response:
    """Return the run of a lane within the level's window around a time in s.

    There are ``samples`` per pseudo period.
    """
    schedule = lane.drive.schedule
    half = HALF_WINDOW_PERIODS * schedule.pseudo_period
    begin = max(0.0, time - half)
    end = min(float(schedule.times[-1]), time + half)
    initial = None
    if begin > 0:
        initial = simulate(lane.scene, lane.drive.between(0.0, begin)).final_state
    record = replace(FULL_RECORD, samples_per_period=samples)
    return simulate(lane.scene, lane.drive.between(begin, end), initial=initial, record=record)


def _contacts(response: Response) -> tuple[int, Array, Array, Array]:
    """Return the number of contacts and the energies that they transfer.

    These are the shares passed on and left, and what each contact gives to the second mode, see
    `EnergyShares`.
    """
    energy = mechanical_energy(response.scene, response.recorded.history).modal
    samples = response.recorded.impacts.time / (response.drive.schedule.pseudo_period / SAMPLES)
    new = np.flatnonzero(
        np.diff(samples) >= APART * SAMPLES
    )  # after these impacts the next contact begins
    count = len(new) + (len(samples) > 0)
    nothing = np.full(energy.shape[1], np.nan)
    if count < 2:
        return count, nothing, nothing, nothing[:0]
    first = samples[[0, *(new + 1)]]
    last = samples[[*new, len(samples) - 1]]
    before = np.floor(first).astype(np.int64)
    after = np.minimum(np.ceil(last).astype(np.int64), len(energy) - 1)
    gained = energy[after] - energy[before]
    left = np.sum(energy[before[1:]], axis=0) / np.sum(energy[after[:-1]], axis=0)
    second = gained[:, min(1, energy.shape[1] - 1)] / energy[before, 0]
    return (
        count,
        np.asarray(np.mean(gained, axis=0) / np.mean(energy[before, 0])),
        np.asarray(left),
        np.asarray(second),
    )


def make_scene(beam: Beam) -> Scene:
    """Return the conservative absorber on a beam."""
    return beam_scene(beam, impact_absorber())


def make_lanes(own: Scene, force: float, members: int, seed: int) -> list[Lane]:
    """Return each member's sweep up, and its sweep down after it."""
    drawn = draw_members(members, seed)
    return [
        Lane(own, drawn[m : m + 1].drives(force, schedule)[0])
        for m in range(members)
        for schedule in make_both_sweeps(own)
    ]


def find_critical(result: Sequence[EnergyShares]) -> list[EnergyShares]:
    """Return the account of the direction with the larger level, for each member."""
    return [
        max(pair, key=lambda account: account.level)
        for pair in zip(result[::2], result[1::2], strict=True)
    ]
