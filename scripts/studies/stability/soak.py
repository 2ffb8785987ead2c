"""Very long runs, to test that memory does not grow and that the energy balance holds."""

from collections.abc import Callable
from dataclasses import dataclass

from impact_env import Drive, Record, beam_scene, constant_frequency, simulate
from impact_env.methods import Exact, Method, Moreau, RungeKutta
from impact_env.parameters import Absorber, Beam, CompliantWalls, SlidingAbsorber, impact_absorber
from optimisation.checkpoint import peak_memory
from studies.study import Json

LENGTHS = (1_000, 10_000, 100_000, 1_000_000)  # pseudo periods
QUICK_LENGTHS = (100, 1_000, 10_000)
# N, and frequency over the first resonance
FORCE = 2.0
RATIO = 0.98
RECORD = Record(level=True, energy=True)
MOST_GROWTH_MB = (
    20.0  # from the shortest run to the longest, far below what one number a period would take
)
MOST_BALANCE = 1e-9  # of the exact method
# from a stepping method's worst balance in shorter runs to that of the longest; a drift makes it
# ten times as large
MOST_FACTOR = 4.0


@dataclass(frozen=True)
class SoakCase:
    """A scene cheap enough for a very long run."""

    name: str
    modes: int
    absorber: Callable[[], Absorber]
    method: Method
    longest: int = 1_000_000  # pseudo periods; less where a period takes long


CASES = (
    SoakCase("3 modes, e = 0.8, exact", 3, lambda: impact_absorber(restitution=0.8), Exact()),
    SoakCase(
        "1 mode, e = 0.7, friction, exact",
        1,
        lambda: impact_absorber(restitution=0.7, friction_limit=0.05),
        Exact(),
        100_000,
    ),
    SoakCase(
        "1 mode, compliant walls, exact",
        1,
        lambda: SlidingAbsorber(walls=CompliantWalls(1e5)),
        Exact(),
        100_000,
    ),
    SoakCase(
        "1 mode, e = 0.7, friction, Moreau",
        1,
        lambda: impact_absorber(restitution=0.7, friction_limit=0.05),
        Moreau(),
    ),
    SoakCase(
        "1 mode, compliant walls, Runge-Kutta",
        1,
        lambda: SlidingAbsorber(walls=CompliantWalls(1e5)),
        RungeKutta(),
    ),
)


def soak(case: SoakCase, lengths: tuple[int, ...]) -> Json:
    """Run a case over each length, the shortest first.

    Per length in pseudo periods: relative balance error, largest memory of the process so far in
    MB, time in us and impacts per pseudo period.
    """
    scene = beam_scene(Beam(modes=case.modes), case.absorber())
    lengths = tuple(length for length in lengths if length <= case.longest)
    result: Json = {
        "name": case.name,
        "lengths": list(lengths),
        "balance": [],
        "memory_mb": [],
        "us_per_period": [],
        "impacts_per_period": [],
    }
    for length in lengths:
        schedule = constant_frequency(scene.model.resonance_omega(1), RATIO, float(length))
        response = simulate(scene, Drive(FORCE, schedule), case.method, record=RECORD)
        result["balance"].append(response.recorded.energy.relative_error)
        result["memory_mb"].append(1e-6 * peak_memory())
        result["us_per_period"].append(1e6 * response.wall_time / length)
        result["impacts_per_period"].append(response.impact_count / length)
    reason = wrong_with(result, isinstance(case.method, Exact))
    return result | {"passed": not reason, "reason": reason}


def wrong_with(result: Json, exact: bool) -> str:
    """Return the faults of a very long run, empty if there are none."""
    memory = result["memory_mb"]
    balance = result["balance"]
    growth = memory[-1] - memory[0]
    shorter = max([*balance[:-1], 1e-12])
    if growth > MOST_GROWTH_MB:
        return f"memory grew by {growth:.0f} MB"
    if exact and max(balance) > MOST_BALANCE:
        return f"balance {max(balance):.1e}"
    if not exact and balance[-1] > MOST_FACTOR * shorter:
        return f"balance grew from {shorter:.1e} to {balance[-1]:.1e}"
    return "" if min(result["impacts_per_period"]) > 0 else "no impacts: nothing was tested"
