"""Time of a sample of a record: the exact method beside scipy.signal.lsim where all is linear, and beside the Moreau scheme where walls are."""

import statistics
from collections.abc import Callable
from functools import partial

import numpy as np
import scipy.signal

from impact_env import Beam, ModalModel, Record, Scene, SlidingAbsorber, impact_absorber, modal_model
from impact_env.loads import Loads, Samples
from impact_env.methods import PAPER_STEPS, Exact, Moreau
from optimisation.machine import BARE, Timed
from studies.study import Array, Json, Measured, Study, lines, table_study, there
from studies.timing import Advance, Settings, all_cases, in_turn, seconds

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


def measure(case: tuple[str, SlidingAbsorber | None], given: Settings, advance: Advance) -> Json:
    """Return times of a sample in us, and how far lsim's displacement is from the exact one's, relative to its largest."""
    (name, absorber), samples = case, int(given.periods)
    model, times = modal_model(Beam(modes=MODES)), np.arange(samples + 1) / RATE
    values = FORCE * np.random.default_rng(0).standard_normal(len(times))
    loads, scene = Loads((Samples(times, values),), 2 * np.pi * RATE / PERIOD), Scene(model, absorber)
    recorded = Record(level=False, series=True, samples_per_period=PERIOD)
    exact, seen = Timed(scene, loads, Exact(), record=BARE), Timed(scene, loads, Exact(), record=recorded)
    history = there(seen.run().history)
    row: Json = {"name": name, "samples": samples, "impacts_per_s": exact.run().impact_count / float(times[-1])}
    runs: dict[str, Callable[[], object]] = {"exact": exact.run, "recorded": seen.run}
    if absorber is None:
        system = scipy.signal.StateSpace(*state_space(model))
        _, found, _ = scipy.signal.lsim(system, values, times)
        row["difference"] = float(np.max(np.abs(history.modal_displacement @ model.level_shape - found)) / np.max(np.abs(found)))
        runs["lsim"] = partial(scipy.signal.lsim, system, values, times)
    else:
        runs["moreau"] = Timed(scene, loads, Moreau()).run
    each = in_turn({name: partial(seconds, run) for name, run in runs.items()}, given.repeats, advance)
    return row | {f"{name}_us": 1e6 * statistics.median(found) / samples for name, found in each.items()}


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


STUDY: Study[Settings] = table_study(NAME, "a sample of a record", lambda given: all_cases(list(CASES.items()), given, measure), _said)
