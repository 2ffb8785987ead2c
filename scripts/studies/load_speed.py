"""Time of a sample of a record: the exact method beside scipy.signal.lsim where all is linear, and beside the Moreau scheme where walls are."""

import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import scipy.signal

from impact_env import Beam, ModalModel, Record, Scene, SlidingAbsorber, impact_absorber, modal_model
from impact_env.loads import Loads, Samples
from impact_env.methods import PAPER_STEPS, Exact, Moreau
from optimisation.machine import BARE, Timed
from optimisation.progress import Bar
from studies.study import Array, Json, Measured, Study, lines, table_study, there

NAME = "benchmark_loads"
MODES, RATE, FORCE = 10, 5000.0, 20.0  # samples a second; N, the record's RMS
WHOLE, QUICK = 100_000, 2_000  # samples
PERIOD = 32  # samples in a pseudo period, so that what is recorded is the motion at the record's samples
CASES: dict[str, SlidingAbsorber | None] = {
    "no absorber": None,
    "walls that are watched, never met": impact_absorber(1.0, 0.7),
    "walls that are met, gap 1 mm, e = 0.7": impact_absorber(1e-3, 0.7),
}


def state_space(model: ModalModel) -> tuple[Array, ...]:
    """Return A, B, C, D from the force to the displacement where the level is read, with the modes' displacements and velocities as states."""
    n = model.modes
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(model.omega**2), -np.diag(2 * model.damping_ratio * model.omega)]])
    b = np.concatenate([np.zeros(n), model.force_shape])[:, None]
    return a, b, np.concatenate([model.level_shape, np.zeros(n)])[None], np.zeros((1, 1))


def _each(repeats: int, work: Callable[[], Any], bar: Bar) -> list[float]:
    """Return the times of repeats in s."""
    found = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        found.append(time.perf_counter() - began)
        bar.update()
    return found


def measure(samples: int, repeats: int) -> Json:
    """Return times of a sample in us for each case, and how far lsim's displacement is from the exact one's, relative to its largest."""
    model, times = modal_model(Beam(modes=MODES)), np.arange(samples + 1) / RATE
    values = FORCE * np.random.default_rng(0).standard_normal(len(times))
    loads = Loads((Samples(times, values),), 2 * np.pi * RATE / PERIOD)
    recorded = Record(level=False, series=True, samples_per_period=PERIOD)
    rows = []
    with Bar(total=3 * repeats * len(CASES), desc="timing", unit="repeat", leave=False) as bar:
        for name, absorber in CASES.items():
            scene, row = Scene(model, absorber), {"name": name, "samples": samples}
            exact, seen = Timed(scene, loads, Exact(), record=BARE), Timed(scene, loads, Exact(), record=recorded)
            history = there(seen.run().history)
            row["impacts_per_s"] = exact.run().impact_count / float(times[-1])
            others: dict[str, Callable[[], Any]] = {"exact": exact.run, "recorded": seen.run}
            if absorber is None:
                system = scipy.signal.StateSpace(*state_space(model))
                _, found, _ = scipy.signal.lsim(system, values, times)
                size = float(np.max(np.abs(found)))
                row["difference"] = float(np.max(np.abs(history.modal_displacement @ model.level_shape - found))) / size
                others["lsim"] = partial(scipy.signal.lsim, system, values, times)
            else:
                others["moreau"] = Timed(scene, loads, Moreau()).run
            for other, work in others.items():
                row[f"{other}_us"] = 1e6 * statistics.median(_each(repeats, work, bar)) / samples
            rows.append(row)
    return {"repeats": repeats, "cases": rows}


COLUMNS = {
    "case": "name", "exact, us": "exact_us", "with all samples kept, us": "recorded_us", "lsim, us": "lsim_us", "Moreau, us": "moreau_us",
    "impacts a second": "impacts_per_s",
}  # fmt: skip


def _said(measured: Measured) -> str:
    cases, repeats = measured.values["cases"], measured.values["repeats"]
    told = [{name: row[name] if name == "name" else f"{row[name]:.3g}" if name in row else "" for name in COLUMNS.values()} for row in cases]
    samples, difference = cases[0]["samples"], cases[0]["difference"]
    return (
        f"{lines({head: f'{{{name}}}' for head, name in COLUMNS.items()}, told)}\n\n"
        f"All per sample of a white record of {samples:,} at {RATE:,.0f} a second, {FORCE:g} N RMS, on the paper's beam with {MODES} modes; whole\n"
        f"calls on one core, compiled before, median of {repeats}. What lsim, with straight lines between samples, gives for the displacement\n"
        f"differs by {difference:.1g} of the largest. The Moreau scheme has {PAPER_STEPS} steps per period of the highest mode."
    )


STUDY: Study[tuple[int, int]] = table_study(NAME, "a sample of a record", lambda settings: measure(*settings), _said)
