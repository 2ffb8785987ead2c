"""What a damper between absorber and ground does in sweeps: the paper has one in its harmonic balance alone (its section 2.5).

A run goes on in short pieces, and at the end of each the absorber's velocity shrinks as the damper's would in that time.
"""

from collections.abc import Sequence

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from impact_env.controlled import ControlledRuns
from impact_env.drive import PAPER_LIMITS, Drive, linear_sweep
from impact_env.ensemble import draw_members
from impact_env.level import HALF_WINDOW_PERIODS
from impact_env.methods import Exact, Method, Moreau
from impact_env.periodic.harmonic_balance import PAPER_DAMPER
from impact_env.periodic.residence import Approach, passage
from impact_env.scene import Scene
from studies.paper import high_low, jump
from studies.paper.frame import Settings
from studies.study import Json

Array = NDArray[np.float64]
PIECES, SAMPLES = 4, 32  # a pseudo period
DAMPERS = {"without": 0.0, "with": PAPER_DAMPER}  # N s/m
METHODS: dict[str, Method] = {"exact": Exact(), "paper's step": Moreau()}


def squares(scene: Scene, drives: Sequence[Drive], damper: float, method: Method, threads: int | None = None, pieces: int = PIECES) -> Array:
    """Return the mean square of the tip displacement in m^2 in each piece of each run, (pieces, runs); ``damper`` in N s/m. One schedule for all."""
    schedule, mass = drives[0].schedule, scene.absorber_mass
    assert mass is not None
    runs = ControlledRuns(scene, len(drives), schedule.reference, 1 / pieces, method, samples_per_period=SAMPLES, threads=threads)
    runs.orders["force"], runs.orders["phase"] = np.array([(drive.amplitude, drive.phase) for drive in drives]).T
    edges: Array = runs.duration * np.arange(int(schedule.times[-1] / runs.duration) + 1.0)
    omega = np.asarray(schedule.omega_at(edges))
    found = np.empty((len(omega) - 1, len(drives)))
    for k in range(len(found)):
        runs.orders["omega_start"], runs.orders["omega_stop"] = omega[k : k + 2]
        runs.orders["fresh"] = True  # a piece begins at the state as it is left here
        runs.advance()
        runs.state[:, -1] *= np.exp(-damper * runs.duration / mass)
        found[k] = runs.reports["mean_square"]
    runs.close()
    return found


def levels(scene: Scene, drives: Sequence[Drive], damper: float, method: Method, threads: int | None = None) -> Array:
    """Return the largest RMS of the tip displacement in m over as many pseudo periods as the level's window has, (runs,)."""
    window = 2 * HALF_WINDOW_PERIODS * PIECES
    total = np.cumsum(squares(scene, drives, damper, method, threads), axis=0)
    return np.asarray(np.sqrt(np.max(total[window:] - total[:-window], axis=0) / window))


def _jumps(settings: Settings, runs: int) -> list[Json]:
    """Return how many sweeps down come to the high branch (the figure jump) without and with the damper."""
    own, rows = jump.scene(), []
    phases = draw_members(runs, settings.seed, "phase").phases.tolist()
    for name, method in METHODS.items():
        for slowness in (jump.RATE, 2 * jump.RATE):
            approach = Approach(own.model.resonance_omega(1), jump.OVER.start)
            drives = [passage(approach, jump.FORCES["medium"], jump.OVER.start, jump.OVER.last, slowness, phase) for phase in phases]
            reached = {key: int(np.sum(levels(own, drives, c, method, settings.threads) > jump.HIGH_LEVEL)) for key, c in DAMPERS.items()}
            rows.append({"method": name, "periods_per_percent": slowness, "runs": runs, **reached})
    return rows


def _levels(settings: Settings, runs: int) -> list[Json]:
    """Return the median level of sweeps over three modes (the figure high_low) without and with the damper, and the 95 % interval of their ratio."""
    own, members, rows = high_low.scene(), draw_members(runs, settings.seed), []
    for force in high_low.FORCES.values():
        sweeps = [linear_sweep(own.model.resonance_omega(1), *ends) for ends in (PAPER_LIMITS, PAPER_LIMITS[::-1])]
        found = {
            key: np.max([levels(own, members.drives(force, sweep), c, METHODS["exact"], settings.threads) for sweep in sweeps], axis=0)
            for key, c in DAMPERS.items()
        }
        ratio = scipy.stats.bootstrap(
            (found["with"], found["without"]), lambda a, b, axis: np.median(a, axis) / np.median(b, axis), method="percentile", rng=settings.seed
        ).confidence_interval
        rows.append({"force_n": force, "low": float(ratio.low), "high": float(ratio.high)} | {key: float(np.median(x)) for key, x in found.items()})
    return rows


def numbers(settings: Settings, runs: int) -> Json:
    """Return both: the jumps of so many sweeps, the levels of a quarter."""
    return {"jumps": _jumps(settings, runs), "levels": _levels(settings, runs // 4)}
