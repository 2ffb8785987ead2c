"""The kinds of kernels that the tests need.

Each is compiled once, by two processes at a time, before the suite starts.

``python tests/support/kinds.py`` compiles them, unless it has done so already. Tests that compile
one kind after the other, in two workers, would wait for each other's, or compile the same one
twice.
"""

import hashlib
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

from core import OMEGA, drive_of
from every_scene import SOFT, controlled
from load_cases import cantilever

from impact_env.controlled import ControlledRuns
from impact_env.ensemble import available_cores
from impact_env.kernels.compiling.cache import cache_folder
from impact_env.loads import Loads, ShakenBase
from impact_env.methods import Method, Moreau, RungeKutta
from impact_env.parameters import (
    Absorber,
    CompliantWalls,
    SeveralAbsorbers,
    SlidingAbsorber,
    impact_absorber,
    impact_absorbers,
)
from impact_env.results import Record
from impact_env.scene import Scene, beam_scene
from impact_env.sweep import simulate
from impact_env.warm_up import follow_orbits, warm_up

FORCE = drive_of(1e-3, 1.0, periods=1.0)
BASE = Loads((ShakenBase(FORCE.schedule, acceleration=1e-3),), OMEGA)
BARE = Record(events=True)
ENERGY = Record(energy=True)
IMPACTS = impact_absorber(restitution=0.7)
BOTH = impact_absorber(restitution=0.7, friction_limit=0.1)
WALLS = SlidingAbsorber(walls=CompliantWalls(1e5))
SEVERAL = impact_absorbers((3e-4, 5e-4), (1.0, 0.6), 0.7, 0.04)


def sweep(
    absorber: Absorber | SeveralAbsorbers | None, record: Record, method: Method | None = None
) -> None:
    """Run a scene under one force."""
    scene = beam_scene(absorber=absorber)
    simulate(scene, FORCE, method, record=record)


def shake(absorber: Absorber | None, record: Record) -> None:
    """Run a scene on a base that moves."""
    simulate(Scene(cantilever(), absorber), BASE, record=record)


def push(absorber: Absorber | SeveralAbsorbers | None, record: Record) -> None:
    """Run a scene under loads."""
    simulate(beam_scene(absorber=absorber), Loads((FORCE,), OMEGA), record=record)


def control(absorber: Absorber | None, method: Method | None = None) -> None:
    """Run lanes in intervals."""
    controlled(absorber, method)()


def control_on_base() -> None:
    """Run lanes in intervals on a base that moves."""
    scene = Scene(cantilever(), BOTH)
    runs = ControlledRuns(scene, 1, OMEGA, 1.0, samples_per_period=16, moves_base=True)
    runs.orders["omega_start"] = runs.orders["omega_stop"] = OMEGA
    runs.advance()
    runs.close()


# those that take longest to compile first
KINDS: dict[str, Callable[[], None]] = {
    "several absorbers, loads, energies": partial(push, SEVERAL, ENERGY),
    "several absorbers, loads": partial(push, SEVERAL, BARE),
    "several absorbers, energies": partial(sweep, SEVERAL, ENERGY),
    "several absorbers": partial(sweep, SEVERAL, BARE),
    "intervals on a base": control_on_base,
    "impacts and friction, energies": partial(sweep, BOTH, ENERGY),
    "impacts and friction, base, energies": partial(shake, BOTH, ENERGY),
    "impacts, energies": partial(sweep, IMPACTS, ENERGY),
    "orbits": partial(follow_orbits, impact_absorber(friction_limit=0.01)),
    "impacts and friction, base": partial(shake, BOTH, BARE),
    "impacts, base": partial(shake, IMPACTS, BARE),
    "impacts and friction": partial(sweep, BOTH, BARE),
    "impacts": partial(sweep, IMPACTS, BARE),
    "intervals, impacts and friction": partial(control, BOTH),
    "intervals, impacts": partial(control, IMPACTS),
    "compliant walls and elastic friction, energies": partial(sweep, SOFT, ENERGY),
    "compliant walls and elastic friction, loads, energies": partial(push, SOFT, ENERGY),
    "compliant walls, energies": partial(sweep, WALLS, ENERGY),
    "compliant walls": partial(sweep, WALLS, BARE),
    "intervals, compliant walls": partial(control, WALLS),
    "no absorber, base, energies": partial(shake, None, ENERGY),
    "no absorber, energies": partial(sweep, None, ENERGY),
    "no absorber, base": partial(shake, None, BARE),
    "no absorber": partial(sweep, None, BARE),
    "intervals, no absorber": partial(control, None),
    "Runge-Kutta, energies": partial(sweep, SOFT, ENERGY, RungeKutta(50)),
    "Runge-Kutta": partial(sweep, WALLS, BARE, RungeKutta(50)),
    "intervals, Runge-Kutta": partial(control, WALLS, RungeKutta(20)),
    "Moreau, energies": partial(sweep, BOTH, ENERGY, Moreau(100)),
    "Moreau": partial(sweep, IMPACTS, BARE, Moreau(100)),
    "intervals, Moreau": partial(control, IMPACTS, Moreau(100)),
}


def main() -> None:
    """Compile the kinds into the cache, once for these kernels and this list."""
    folder = cache_folder()
    if folder is None:
        return
    done = folder / "kinds-of-tests"
    content = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()
    if done.exists() and done.read_text() == content:
        return
    jobs = list(KINDS.items())
    warm_up(jobs, partial(print, file=sys.stderr, flush=True), available_cores())
    done.write_text(content)


if __name__ == "__main__":
    main()
