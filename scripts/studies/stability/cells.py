"""One cell of the stability matrix: a case run with one method, measured and judged."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from impact_env import (
    Drive,
    FrequencySchedule,
    InitialState,
    ParameterError,
    Record,
    Response,
    RigidWalls,
    Scene,
    SlidingAbsorber,
)
from impact_env.energy import stored_energy
from impact_env.methods import Exact, Method, Moreau, RungeKutta
from impact_env.sweep import IntegrationError, simulate
from optimisation.checkpoint import peak_memory
from reference.dense import Truth, follow
from studies.stability.cases import EXACT, MOREAU, StabilityCase

SAMPLES = 32  # per pseudo period
LEAST_SAMPLES = 33
FINER = {MOREAU: 16, "runge-kutta": 4}
FINER_FAST = 4  # the same for scenes with a highest mode above this many first ones
FAST = 5e3
MAKE: dict[str, Callable[[int], Method]] = {
    EXACT: lambda _: Exact(),
    MOREAU: lambda factor: Moreau(20 * factor),
    "runge-kutta": lambda factor: RungeKutta(20 * factor, 20 * factor),
}

GOOD = "good"
WEAK = "fewer digits"
REFUSED = "refused"
FAILED = "FAILED"
TEXTS = ("balance {:.1e}", "{:.1e} from the reference", "penetration {:.1e} of gap and motion")
WRONG_BALANCE = 1e-6
LIMITS = {
    FAILED: (WRONG_BALANCE, 1e-5, 1e-9),
    WEAK: (1e-9, 1e-9, 1e-12),
}  # of an exact method: wrong, and more than rounding may take
FAR = 0.3  # a stepping method must come closer than this with the finer step
CLOSE = 1e-2  # a stepping method this near to the reference need not come nearer with a finer step
GAIN = 0.5  # what a finer step must make of the deviation


@dataclass
class Cell:
    """Result of a case with a method.

    Energies are relative to the largest term of their balance. None stands for a quantity that does
    not exist.

    Attributes
    ----------
    balance : float or None
        Error of the energy balance as the package reports it.
    identity : float or None
        This error without the part that follows exactly from the step (Moreau).
    drift : float or None
        Change of the balance per pseudo period over the run's second half.
    penetration : float or None
        Largest penetration of a wall over the sum of gap and motion.
    deviation, finer : float or None
        Largest distance from the reference over ``followed`` pseudo periods, relative to its
        largest displacement, and the same with a finer step.
    wall_s, memory_mb : float or None
        Time of a run in s, and largest memory of the process in MB.
    """

    group: str
    case: str
    method: str
    verdict: str
    reason: str = ""
    balance: float | None = None
    identity: float | None = None
    drift: float | None = None
    penetration: float | None = None
    deviation: float | None = None
    finer: float | None = None
    followed: float | None = None
    impacts: int | None = None
    wall_s: float | None = None
    memory_mb: float | None = None


def measure(case: StabilityCase, method: str) -> Cell:
    """Run a case with a method and judge it.

    Only an interrupt is raised. An error that is not a clear refusal counts as a failure.
    """
    cell = Cell(case.group, case.name, method, FAILED)
    try:
        scene, drive, initial = case.build()
        response = _run(scene, drive, initial, MAKE[method](1), _samples(drive))
        _fill(cell, case, scene, drive, initial, response)
    except (ParameterError, IntegrationError) as error:
        cell.verdict = REFUSED
        cell.reason = f"{type(error).__name__}: {error}"
    except Exception as error:
        cell.verdict = FAILED
        cell.reason = f"not a clear refusal: {type(error).__name__}: {error}"
    else:
        cell.verdict, cell.reason = _judge(cell, case)
    cell.memory_mb = 1e-6 * peak_memory()
    return cell


def _samples(drive: Drive) -> int:
    """Return samples per pseudo period: more than usual where the run is shorter than one."""
    return max(SAMPLES, int(np.ceil(LEAST_SAMPLES / drive.schedule.periods)))


def _run(
    scene: Scene, drive: Drive, initial: InitialState, method: Method, samples: int
) -> Response:
    return simulate(
        scene,
        drive,
        method,
        initial=initial,
        record=Record(
            level=False, events=True, series=True, energy=True, samples_per_period=samples
        ),
    )


def _cut(drive: Drive, end: float) -> Drive:
    """Return the drive up to a time in s."""
    schedule = drive.schedule
    times = np.append(schedule.times[schedule.times < end * (1 - 1e-12)], end)
    return Drive(
        drive.amplitude,
        FrequencySchedule(times, schedule.omega_at(times), schedule.reference),
        drive.phase,
    )


def _fill(
    cell: Cell,
    case: StabilityCase,
    scene: Scene,
    drive: Drive,
    initial: InitialState,
    response: Response,
) -> None:
    cell.impacts = response.impact_count
    cell.wall_s = response.wall_time
    cell.balance = response.recorded.energy.relative_error
    if isinstance(response.method, Moreau):
        cell.identity = _left_over(scene, initial, response)
    half = _run(
        scene,
        _cut(drive, 0.5 * float(drive.schedule.times[-1])),
        initial,
        response.method,
        _samples(drive),
    )
    cell.drift = _drift(scene, response, half, case.conserved)
    cell.penetration = _penetration(scene, response)
    expected = _truth(case)
    if len(expected.time) > 1:
        cell.followed = float(expected.time[-1]) / drive.schedule.pseudo_period
        cell.deviation = _deviation(expected, response)
        if cell.method != EXACT:
            factor = (
                FINER[cell.method]
                if scene.model.omega[-1] < FAST * scene.model.omega[0]
                else FINER_FAST
            )
            cell.finer = _deviation(
                expected,
                _run(
                    scene,
                    _cut(drive, float(expected.time[-1])),
                    initial,
                    MAKE[cell.method](factor),
                    _samples(drive),
                ),
            )


@lru_cache(maxsize=8)
def _truth(case: StabilityCase) -> Truth:
    scene, drive, initial = case.build()
    interval = drive.schedule.pseudo_period / _samples(drive)
    samples = int(np.floor(drive.schedule.times[-1] / interval * (1 + 1e-12) + 1e-6)) + 1
    return follow(scene, drive, initial, interval * np.arange(samples, dtype=float), case.impacts)


def _deviation(expected: Truth, response: Response) -> float:
    history = response.recorded.history
    count = min(len(expected.time), len(history.time))
    tip = history.tip_displacement[:count]
    distance = np.abs(tip - expected.tip[:count])
    scale = float(np.max(np.abs(expected.tip)))
    if response.scene.absorber is not None:
        relative = history.absorber_displacement[:count] - tip
        distance = np.maximum(distance, np.abs(relative - expected.relative[:count]))
        scale = max(scale, float(np.max(np.abs(expected.relative))))
    largest = float(np.max(distance))
    return largest / scale if scale > 0 else largest


def _penetration(scene: Scene, response: Response) -> float | None:
    """Return how far the absorber is beyond a wall at the samples.

    It is relative to the sum of gap and largest motion, and None without rigid walls.
    """
    walls = scene.absorber.walls if isinstance(scene.absorber, SlidingAbsorber) else None
    if not isinstance(walls, RigidWalls):
        return None
    history = response.recorded.history
    relative = history.absorber_displacement - history.tip_displacement
    depth = max(0.0, float(np.max(np.abs(relative))) - walls.gap)
    return depth / (walls.gap + float(np.max(np.abs(history.absorber_displacement))))


def _left_over(scene: Scene, initial: InitialState, response: Response) -> float:
    """Return the relative balance error of the Moreau scheme without a known term.

    The term is dt^2/8 times the change of sum omega^2 u^2 (and of k r'^2 for a tuned absorber).
    With the mean velocity of each step the scheme's balance is exact except for this term.
    """
    n = scene.model.modes
    model = scene.model
    account = response.recorded.energy
    dt = float(response.drive.schedule.times[-1]) / response.steps

    def kinetic(state: np.ndarray) -> float:
        total = float(np.sum((model.omega * state[n + 1 : -1]) ** 2))
        if scene.link is not None:
            total += (
                scene.link.stiffness * float(state[-1] - model.tip_shape @ state[n + 1 : -1]) ** 2
            )
        return total

    change = dt**2 / 8 * (kinetic(response.end_state) - kinetic(initial.vector(scene)))
    error = abs(account.balance_error + change)
    scale = _scale(response)
    return error / scale if scale > 0 else error


def _scale(response: Response) -> float:
    """Return the largest term of the energy balance in J."""
    account = response.recorded.energy
    losses = (
        float(np.sum(account.modal_loss)),
        account.friction_loss,
        account.impact_loss,
        account.absorber_damping,
    )
    return max(abs(account.work), account.stored_at_start, account.stored_at_end, *map(abs, losses))


def _drift(scene: Scene, response: Response, half: Response, conserved: bool) -> float:
    """Return the change of the balance over the second half, per pseudo period.

    For a conserved case it is the change of the stored energy itself.
    """
    scale = _scale(response)
    if conserved:
        change = stored_energy(scene, response.end_state) - stored_energy(scene, half.end_state)
    else:
        change = response.recorded.energy.balance_error - half.recorded.energy.balance_error
    return abs(change) / (scale if scale > 0 else 1.0) / (0.5 * response.drive.schedule.periods)


def _judge(cell: Cell, case: StabilityCase) -> tuple[str, str]:
    """Return verdict and reason of a finished cell."""
    if case.must_refuse:
        return FAILED, "finished where there is no right answer"
    wrong = [
        name
        for name, value in vars(cell).items()
        if isinstance(value, float) and not np.isfinite(value)
    ]
    if wrong:
        return FAILED, f"not finite: {', '.join(wrong)}"
    return _judge_exact(cell) if cell.method == EXACT else _judge_steps(cell)


def _judge_exact(cell: Cell) -> tuple[str, str]:
    result = [
        (value or 0.0, text)
        for value, text in zip((cell.balance, cell.deviation, cell.penetration), TEXTS, strict=True)
    ]
    for verdict, most in LIMITS.items():
        reasons = [
            text.format(value)
            for (value, text), limit in zip(result, most, strict=True)
            if value > limit
        ]
        if reasons:
            return verdict, ", ".join(reasons)
    return GOOD, ""


def _judge_steps(cell: Cell) -> tuple[str, str]:
    if cell.deviation is None or cell.finer is None:
        return GOOD, ""
    if cell.finer > FAR:
        return FAILED, f"{cell.finer:.1e} from the reference even with a finer step"
    if cell.finer > max(GAIN * cell.deviation, CLOSE):
        return (
            FAILED,
            (
                f"{cell.deviation:.1e} from the reference, {cell.finer:.1e} with a finer step: it "
                "does not converge"
            ),
        )
    if cell.identity is not None and cell.identity > WRONG_BALANCE:
        return FAILED, f"balance {cell.identity:.1e} beside what the step explains"
    return GOOD, ""
