"""The beam without absorber under a force of 1 N, the reference of all scores.

It is linear, so its levels are proportional to the force.
"""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.controlled import ControlledRuns
from impact_env.drive import PAPER_RATE, default_rate
from impact_env.modes import ModalModel
from impact_env.scene import Scene

Array = NDArray[np.float64]
PERIODS_PER_CHUNK = 20.0  # pseudo periods at the paper's rate; slower ones have as many chunks


def drive_shape(model: ModalModel, moves_base: bool) -> Array:
    """Return the modal forces (N_m,) of a unit of the drive.

    The unit is a force of 1 N, or, with ``moves_base``, an acceleration of the base of 1 m/s^2.
    """
    if not moves_base:
        return model.force_shape
    require(
        model.base_participation is not None,
        "base_participation",
        None,
        "given for a base that moves",
    )
    assert model.base_participation is not None
    return -model.base_participation


@lru_cache(maxsize=64)
def simulate_passage(
    scene: Scene,
    resonance: int,
    start: float,
    stop: float,
    samples_per_period: int,
    exponent: float,
    unit: float,
    moves_base: bool = False,
) -> tuple[float, float]:
    """Return (response level in m, damage) of a structure without absorber in a sweep.

    The drive is one unit of `drive_shape`. The frequency goes from ``start`` to ``stop`` (ratios to
    the resonance) at the rate that suits the structure's damping. The damage is the sum of
    |q_tip/unit|^exponent over the samples, with ``unit`` in m; it is 0 for an exponent of 0.
    """
    omega = scene.model.resonance_omega(resonance)
    percent = default_rate(scene.model, (resonance,))
    # a whole number of samples, as all control intervals are
    chunk = (
        max(1, round(PERIODS_PER_CHUNK * PAPER_RATE / percent * samples_per_period))
        / samples_per_period
    )
    driven = (
        replace(scene.model, force_shape=drive_shape(scene.model, True))
        if moves_base
        else scene.model
    )
    runs = ControlledRuns(
        Scene(driven),
        1,
        omega,
        chunk,
        samples_per_period=samples_per_period,
        exponent=exponent,
        unit=unit,
        threads=1,
    )
    rate = math.copysign(percent / 1e4, stop - start)
    periods = (stop - start) / rate
    damage = 0.0
    runs.orders["force"] = 1.0
    chunks = math.ceil(periods / chunk - 1e-9)
    for k in range(chunks):
        time = k * chunk
        after = min((k + 1) * chunk, periods)
        runs.orders["duration"] = (after - time) * 2 * np.pi / omega
        runs.orders["omega_start"] = (start + rate * time) * omega
        runs.orders["omega_stop"] = (start + rate * after) * omega
        runs.orders["final"] = k == chunks - 1
        runs.advance()
        damage += float(runs.reports["damage"][0])
    return float(runs.reports["level"][0]), damage


def stationary_amplitude(model: ModalModel, omega: float, moves_base: bool = False) -> float:
    """Return the amplitude (m) of the stationary response without absorber at ``omega`` (rad/s).

    It is the amplitude at the level's place under a unit of `drive_shape`.

    The formula is that of `impact_env.frequency`, for one frequency and without NumPy, whose calls
    would take longer than the rest of a reset.
    """
    drive = drive_shape(model, moves_base)
    rows = zip(
        model.omega.tolist(),
        model.damping_ratio.tolist(),
        model.level_shape.tolist(),
        drive.tolist(),
        strict=True,
    )
    total = 0j
    for own, damping, level, force in rows:
        share = level * force
        denominator = complex(own * own - omega * omega, 2 * damping * own * omega)
        require(
            denominator != 0 or share == 0,
            "omega",
            float(omega),
            "a frequency in rad/s off the undamped resonances (the response is infinite)",
        )
        if share != 0:
            total += share / denominator
    return abs(total)
