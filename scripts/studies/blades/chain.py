"""The cyclic chain of Weidemann et al. with an absorber in every sector.

The source is Weidemann, Bergman, Vakakis and Krack (Nonlinear Dynamics, 2025).

Quantities are those of the paper, without units: the spring to the ground of a sector, its mass
with the absorber and the force on it are 1. Its damping ratio refers to the sector with the
absorber stuck.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impact_env import (
    Drive,
    InitialState,
    Record,
    Scene,
    constant_frequency,
    impact_absorber,
    simulate,
)
from impact_env.sectors import participation_ratio
from impact_env.structures.cyclic import CyclicStructure, ring_of_masses

Array = NDArray[np.float64]
SECTORS = 10
MASS_RATIO = 0.02  # of the absorber to its sector and itself
DAMPING_RATIO = 1e-3
RESTITUTION = 0.8
FREQUENCY_SHARES = (0.98, 1.03)  # of the resonances with absorbers stuck, and without them
FREQUENCIES = 50
TRANSIENT_DECAY = 1e-3  # of the linear motion, before the first frequency is measured
PERIODS = 300  # at each frequency
SAMPLES_PER_PERIOD = 128
START_SIZE = 1e-4  # of the linear amplitude: random displacements of the sectors
START_PLACE = -0.99  # of the clearance: where absorbers start
SYNCHRONISED = 1.99  # impacts a period, from which an absorber counts as synchronised


@dataclass(frozen=True)
class Chain:
    """The chain with given coupling, wave number and clearance.

    ``coupling`` is the stiffness of a link over that of the spring to the ground, ``wave_number``
    that of the force, and ``clearance`` is relative to the linear amplitude.
    """

    coupling: float
    wave_number: int
    clearance: float

    @property
    def resonance(self) -> float:
        """Frequency of the wave number's mode with all absorbers stuck."""
        return float(
            np.sqrt(1 + 4 * self.coupling * np.sin(np.pi * self.wave_number / SECTORS) ** 2)
        )

    @property
    def linear_amplitude(self) -> float:
        """Amplitude at that resonance with all absorbers stuck."""
        return 1 / (2 * DAMPING_RATIO * self.resonance**2)

    @cached_property
    def disk(self) -> CyclicStructure:
        """The chain without absorbers."""
        host = 1 - MASS_RATIO
        return ring_of_masses(
            SECTORS,
            self.coupling,
            1 / (2 * np.pi * np.sqrt(host)),
            DAMPING_RATIO / np.sqrt(host),
            host,
        )

    @cached_property
    def scene(self) -> Scene:
        """The chain with an absorber in every sector."""
        gap = self.clearance * self.linear_amplitude
        ratio = MASS_RATIO / (1 - MASS_RATIO)
        absorber = impact_absorber(gap, RESTITUTION, mass_ratio=ratio)
        return self.disk.scene(absorber, self.wave_number, "backward")

    @property
    def frequencies(self) -> Array:
        """The paper's 50 frequencies.

        They range from below the resonance with stuck absorbers to above the resonance without
        absorbers.
        """
        low, high = FREQUENCY_SHARES
        removed = self.resonance / np.sqrt(1 - MASS_RATIO)
        return np.linspace(low * self.resonance, high * removed, FREQUENCIES)

    def draw_start(self, seed: int) -> InitialState:
        """Return small random displacements of the sectors.

        The absorbers are next to their lower walls.
        """
        size = START_SIZE * self.linear_amplitude
        return self.make_start(size * np.random.default_rng(seed).uniform(-1, 1, SECTORS))

    def make_start(self, places: Array) -> InitialState:
        """Return sectors at rest at places (N,), with the absorbers next to their lower walls."""
        shapes = self.disk.response_shapes()
        modal = np.asarray(np.linalg.solve(shapes, places), dtype=np.float64)
        gap = self.clearance * self.linear_amplitude
        return InitialState(modal, None, shapes @ modal + START_PLACE * gap)


def classify_response(impacts: Array) -> str:
    """Return the kind of a response by the impacts per period (N,) that reverse each absorber.

    "synchronised": all absorbers are reversed twice a period; "localised": some are; "solitary":
    one is; "modulated": none is.
    """
    number = int(np.sum(np.asarray(impacts) >= SYNCHRONISED))
    if number == len(impacts):
        return "synchronised"
    if number > 0:
        return "solitary" if number == 1 else "localised"
    return "modulated" if np.any(np.asarray(impacts) > 0) else "without impacts"


@dataclass(frozen=True, eq=False)
class Step:
    """Motion of the sectors (N,) at one frequency.

    ``amplitude`` and ``deviation`` are the mean and the standard deviation over periods of the
    amplitude, relative to the linear one. ``impacts`` is the number of impacts per period.
    """

    frequency: float
    amplitude: Array
    deviation: Array
    impacts: Array
    by_period: Array | None = None  # amplitudes (P, N) of the periods

    @property
    def level(self) -> float:
        """Mean amplitude of the sectors."""
        return float(np.mean(self.amplitude))

    @property
    def kind(self) -> str:
        """Kind of the response, see `classify_response`."""
        return classify_response(self.impacts)

    @property
    def participation(self) -> float:
        """Participation ratio of the sectors' amplitudes."""
        return float(participation_ratio(self.amplitude))


def run_periods(
    chain: Chain, frequency: float, periods: int, start: InitialState, samples: int | None
) -> tuple[InitialState, Step | None]:
    """Return the state after some periods at a frequency, and the motion if it is sampled.

    ``samples`` is the number of samples per period. With None no motion is returned.
    """
    drive = Drive(1.0, constant_frequency(frequency, 1.0, float(periods)))
    record = Record(
        level=False, series=samples is not None, samples_per_period=samples or SAMPLES_PER_PERIOD
    )
    response = simulate(chain.scene, drive, initial=start, record=record)
    if samples is None:
        return response.final_state, None
    history = response.recorded.history
    shapes = chain.disk.response_shapes()
    motion = (history.modal_displacement[1:] @ shapes.T).reshape(periods, samples, SECTORS)
    amplitude = np.ptp(motion, axis=1) / (2 * chain.linear_amplitude)
    turns = np.diff(np.sign(history.absorber_velocity), axis=0) != 0
    return response.final_state, Step(
        frequency,
        amplitude.mean(axis=0),
        amplitude.std(axis=0),
        turns.sum(axis=0) / periods,
        amplitude,
    )


def count_transient(frequency: float) -> int:
    """Return the number of periods in which the linear motion decays to `TRANSIENT_DECAY`."""
    return int(np.ceil(-np.log(TRANSIENT_DECAY) / DAMPING_RATIO * frequency / (2 * np.pi)))


def step_frequencies(
    chain: Chain, frequencies: Array, seed: int, periods: int = PERIODS
) -> Iterator[Step]:
    """Yield the motion at rising frequencies.

    Each frequency starts from the state at the end of the previous one, as in the published code
    CC.
    """
    transient = count_transient(float(frequencies[0]))
    state, _ = run_periods(
        chain, float(frequencies[0]), transient, chain.draw_start(seed), samples=None
    )
    for frequency in frequencies:
        state, step = run_periods(chain, float(frequency), periods, state, SAMPLES_PER_PERIOD)
        assert step is not None
        yield step
