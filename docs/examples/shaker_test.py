"""Write a synthetic shaker test of the arm.

Two CSV files, without and with an impact absorber, and the file that describes them.

The arm differs from docs/examples/arm.toml as a real one would: it is softer by 3 % and has a
damping ratio of 0.75 %. Its absorber of 30 g has a clearance of 1.2 mm, a restitution of 0.55 and a
friction limit of 0.15 N. The accelerometer at the tip is sampled through an anti-aliasing filter,
with noise of 0.1 m/s^2.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impact_env import Beam, Record, Scene, impact_absorber, load_structure, modal_model, simulate
from impact_env.drive import FrequencySchedule
from impact_env.loads import Loads, Samples
from impact_env.scene import InitialState

Array = NDArray[np.float64]
ARM = Path(__file__).with_name("arm.toml")
RATE = 1000.0  # Hz
DURATION = 12.0  # s
FORCE = 12.0  # N
SMALL_FORCE = 3.0  # N, without absorber
NOISE = 0.1  # m/s^2
FINER = 8  # samples of the motion in a sampling interval
DESCRIPTION = f"""# A synthetic shaker test: a sweep without the absorber, and one with it.
[[measurement]]
name = "without absorber"
absorber = "removed"
load = {{ file = "without_absorber.csv", channel = "force" }}
response = {{ file = "without_absorber.csv", channel = "tip", quantity = "acceleration", noise = {NOISE} }}

[[measurement]]
name = "with absorber"
load = {{ file = "with_absorber.csv", channel = "force" }}
response = {{ file = "with_absorber.csv", channel = "tip", quantity = "acceleration", noise = {NOISE} }}
"""


def measure(scene: Scene, times: Array, force: Array, generator: np.random.Generator) -> Array:
    """Return the acceleration (K,) in m/s^2 of the tip under a force (K,) in N."""
    loads = Loads((Samples(times, force),), 2 * np.pi * RATE / 25)
    record = Record(level=False, series=True, samples_per_period=25 * FINER)
    start = None if scene.absorber is None else InitialState(absorber_displacement=4e-4)
    history = simulate(scene, loads, initial=start, record=record).recorded.history
    velocity = history.modal_velocity @ scene.model.level_shape
    acceleration = np.diff(velocity, prepend=0.0) * RATE * FINER
    lags = np.arange(-16 * FINER, 16 * FINER + 1)
    window = np.sinc(0.9 * lags / FINER) * np.hanning(len(lags))  # passes 45 % of the rate
    filtered = np.convolve(acceleration, window / np.sum(window), mode="same")[::FINER]
    return np.asarray(filtered[: len(times)] + NOISE * generator.standard_normal(len(times)))


def main(folder: Path) -> None:
    """Write the files into a folder."""
    arm = load_structure(ARM)
    assert isinstance(arm, Beam)
    softer = replace(arm, bending_stiffness=0.97 * arm.bending_stiffness, damping_ratio=0.0075)
    model = modal_model(softer)
    own = model.resonance_omega(1)
    times = np.arange(int(DURATION * RATE) + 1) / RATE
    schedule = FrequencySchedule(np.array([0.0, DURATION]), own * np.array([0.88, 1.1]), own)
    sweep = np.cos(schedule.phase_at(times)) * np.minimum(1.0, times / 0.5)
    absorber = impact_absorber(1.2e-3, 0.55, 0.15, 0.03 / model.beam_mass)
    generator = np.random.default_rng(5)
    folder.mkdir(parents=True, exist_ok=True)
    for name, scene, force in (
        ("without_absorber", Scene(model), SMALL_FORCE * sweep),
        ("with_absorber", Scene(model, absorber), FORCE * sweep),
    ):
        response = measure(scene, times, force, generator)
        rows = [f"{t:.3f},{f:.5g},{a:.5g}" for t, f, a in zip(times, force, response, strict=True)]
        text = "\n".join(["time (s),force (N),tip (m/s^2)", *rows])
        (folder / f"{name}.csv").write_text(text + "\n", encoding="utf-8")
    (folder / "shaker_test.toml").write_text(DESCRIPTION, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "results/shaker_test"))
