"""Does it pay to choose the friction limit on the way? Passages in haste whose limit is set once or twice, for forces that are not announced.

There is no environment for it: the kernels keep a scene's friction for a run. What a rule could gain is found by going on with the state of one run
in a run of another limit. The level is the larger one of both parts, so a largest response just where the limit changes is seen from one side only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from impact_env import Beam, Scene, beam_scene
from impact_env.controlled import ControlledRuns
from impact_env.envs.reference import passage
from impact_env.envs.settings import make_absorber
from impact_env.response import DEFAULT_SAMPLES

Array = NDArray[np.float64]
START, STOP, RATE, TIME_PRICE = 1.03, 0.93, 4.0, 0.002  # SweepRate's range, fastest rate (% per 100 pseudo periods), price per 100 pseudo periods
INTERVAL, MODES, LOOK = 5.0, 2, 1.02  # LOOK: where a rule has seen enough to know the force
LIMITS = np.geomspace(0.0125, 25.6, 23)  # N, in steps of sqrt(2)
FIRST_LIMIT = LIMITS[2]


@lru_cache(maxsize=64)
def scene_of(limit: float) -> Scene:
    """Return the scene of `SweepRate` with another friction limit (N)."""
    return beam_scene(Beam(modes=MODES), make_absorber("impact", {"friction_limit": limit}))


@dataclass
class Machines:
    """Machines on their way, one a lane: ``forces`` (N) and their phases, state, largest level so far and the tip's last amplitude (m)."""

    forces: Array
    phases: Array
    state: Array
    levels: Array
    amplitudes: Array
    ratio: float = START

    @classmethod
    def at_start(cls, forces: Array, seed: int) -> Machines:
        """Return machines at rest with phases drawn."""
        lanes = len(forces)
        phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, lanes)
        return cls(forces, phases, np.zeros((lanes, 2 * MODES + 2)), np.zeros(lanes), np.zeros(lanes))

    def go(self, limits: Array, to: float) -> None:
        """Go on to a frequency ratio with a friction limit each (N)."""
        for limit in np.unique(limits).tolist():
            self._go(np.flatnonzero(limits == limit), limit, to)
        self.ratio = to

    def _go(self, which: NDArray[np.int64], limit: float, to: float) -> None:
        scene = scene_of(limit)
        omega = scene.model.resonance_omega(1)
        runs = ControlledRuns(scene, len(which), omega, INTERVAL, samples_per_period=DEFAULT_SAMPLES)
        runs.state[:] = self.state[which]
        runs.orders["phase"], runs.orders["force"] = self.phases[which], self.forces[which]
        whole = (self.ratio - to) / (RATE * 1e-4)
        intervals = int(np.ceil(whole / INTERVAL - 1e-9))
        for k in range(intervals):
            begin, end = k * INTERVAL, min((k + 1) * INTERVAL, whole)
            runs.orders["duration"] = (end - begin) * 2 * np.pi / omega
            runs.orders["omega_start"] = (self.ratio - begin * RATE * 1e-4) * omega
            runs.orders["omega_stop"] = (self.ratio - end * RATE * 1e-4) * omega
            runs.orders["final"] = k == intervals - 1
            runs.advance()
            runs.orders["fresh"] = 0.0
        runs.close()
        self.state[which], self.phases[which] = runs.state, runs.orders["phase"]
        self.levels[which] = np.maximum(self.levels[which], runs.reports["level"])
        self.amplitudes[which] = np.hypot(runs.reports["in_phase"], runs.reports["quadrature"])

    def scores(self) -> Array:
        """Return the scores of `SweepRate` (L,)."""
        reference = passage(scene_of(float(LIMITS[0])), 1, START, STOP, DEFAULT_SAMPLES, 0.0, 1e-3)[0]
        return -self.levels / (reference * self.forces) - TIME_PRICE * (START - STOP) / (RATE * 1e-4) / 100


Plan = Callable[[Machines], None]


def nearest(limits: Array) -> Array:
    """Return the nearest of `LIMITS` to each limit: machines of one limit run together."""
    return LIMITS[np.abs(np.log(LIMITS) - np.log(np.maximum(limits, 1e-9))[:, None]).argmin(axis=1)]


def once(limit: float) -> Plan:
    """Return the plan of one limit for everybody."""
    return lambda machines: machines.go(np.full(len(machines.forces), limit), STOP)


def by_force(share: float) -> Plan:
    """Return the plan of an oracle: a limit in proportion to the force."""
    return lambda machines: machines.go(nearest(share * machines.forces), STOP)


def by_look(per_metre: float) -> Plan:
    """Return the plan of a feedback rule: a limit in proportion to the amplitude (N/m) that is seen at `LOOK`, where the first limit ends."""

    def plan(machines: Machines) -> None:
        machines.go(np.full(len(machines.forces), FIRST_LIMIT), LOOK)
        machines.go(nearest(per_metre * machines.amplitudes), STOP)

    return plan


def switched(first: float, second: float, at: float, look: float = 0.0) -> Plan:
    """Return the plan of a limit above a frequency ratio and another below it; with ``look`` (1/m) both are in proportion to what is seen there."""

    def plan(machines: Machines) -> None:
        size = np.ones(len(machines.forces))
        if look > 0:
            machines.go(np.full(len(machines.forces), FIRST_LIMIT), LOOK)
            size = look * machines.amplitudes
        machines.go(nearest(first * size), at)
        machines.go(nearest(second * size), STOP)

    return plan
