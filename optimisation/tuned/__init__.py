"""Tuning of the linear absorber (LTVA): closed forms, and numerical optima.

The closed forms are start values and tests. The optima of the multi-mode model are the results.

`optimisation.tuned.certificate` proves a largest amplitude between grid points; it needs cvxpy and
is imported on its own.
"""

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import ParameterError, instance, positive, require
from impact_env.frequency import (
    frequency_range,
    natural_frequencies,
    poles,
    state_space,
    tip_response,
)
from impact_env.modes import ModalModel
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    LinearAbsorber,
    StuckAbsorber,
    TunedAbsorber,
)

# Tunings of the linear absorber in closed form: one mode, no damping of its own. Start values and
# tests for the numerical ones.
#
# The mass ratio that counts for a resonance is the *effective* one, mu = m_a phi_tip,r^2, absorber
# mass over the modal mass seen at the absorber: four times the plain ratio to the beam's mass for
# the free end of a cantilever. The paper (section 6) names Den Hartog's rule, but its values follow
# from a modal mass of one (`paper_rule`) and twice the rule's damping: `PAPER` is mistuned.


PAPER = TunedAbsorber()  # the paper's values are the defaults


def effective_mass_ratio(
    model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1
) -> float:
    """Return mu = m_a phi_tip,r^2, the effective mass ratio.

    It is the absorber mass over the resonance's effective modal mass at the tip.

    ``mass_ratio`` is m_a over the beam's mass. Raises ParameterError if the mode has a node at the
    absorber: nothing can be tuned there.
    """
    instance("model", model, ModalModel).resonance_omega(resonance)
    mass = positive("mass_ratio", mass_ratio) * model.beam_mass
    shape = float(model.tip_shape[resonance - 1])
    require(
        shape != 0,
        f"tip_shape of mode {resonance}",
        shape,
        "not 0: an absorber at a node of a mode cannot act on it",
    )
    return mass * shape**2


def _make_absorber(
    model: ModalModel,
    mass_ratio: float,
    resonance: int,
    frequency_ratio: float,
    damping_ratio: float,
) -> TunedAbsorber:
    """Return an absorber of given frequency and damping ratios.

    Its omega_a is frequency_ratio * omega_r, and its c is 2 m_a omega_a * damping_ratio.
    """
    mass = mass_ratio * model.beam_mass
    omega = frequency_ratio * model.resonance_omega(resonance)
    return TunedAbsorber(mass_ratio, mass * omega**2, 2 * mass * omega * damping_ratio)


def den_hartog(
    model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1
) -> TunedAbsorber:
    """Return Den Hartog's tuning of a resonance.

    The fixed points have equal height. The damping is the mean of the two values that make the
    curve flat at one of them.

    omega_a/omega_r = 1/(1 + mu), c/(2 m_a omega_a) = sqrt(3 mu / (8 (1 + mu))) with the effective
    mu (one undamped mode). The same damping referred to the beam's frequency, c/(2 m_a omega_r),
    has (1 + mu)^3 under the root: the two forms are easily confused.
    """
    mu = effective_mass_ratio(model, mass_ratio, resonance)
    return _make_absorber(
        model, mass_ratio, resonance, 1 / (1 + mu), float(np.sqrt(3 * mu / (8 * (1 + mu))))
    )


def undamped_minimax(
    model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1
) -> TunedAbsorber:
    """Return the exact minimum of the largest amplitude for one undamped mode.

    The amplitude is that of the displacement under a force. Both peaks are equal.

    With r = sqrt(4 + 3 mu): omega_a/omega_r = 2/(1 + mu) sqrt(2 (16 + 23 mu + 9 mu^2 + 2 (2 + mu)
    r) / (3 (64 + 80 mu + 27 mu^2))) and c/(2 m_a omega_a) = sqrt((8 + 9 mu - 4 r)/(1 + mu))/4 (the
    closed-form exact solution of Nishihara and Asami).
    """
    mu = effective_mass_ratio(model, mass_ratio, resonance)
    r = np.sqrt(4 + 3 * mu)
    frequency = (
        2
        / (1 + mu)
        * np.sqrt(
            2 * (16 + 23 * mu + 9 * mu**2 + 2 * (2 + mu) * r) / (3 * (64 + 80 * mu + 27 * mu**2))
        )
    )
    # 8 + 9 mu - 4 r without the cancellation at small mu
    damping = np.sqrt((9 * mu - 12 * mu / (r + 2)) / (1 + mu)) / 4
    return _make_absorber(model, mass_ratio, resonance, float(frequency), float(damping))


def undamped_h2(
    model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1
) -> TunedAbsorber:
    """Return the exact minimum of the displacement's variance for one undamped mode.

    The excitation is white noise at the mode.

    omega_a/omega_r = sqrt(1 + mu/2)/(1 + mu), c/(2 m_a omega_a) = sqrt(mu (4 + 3 mu)/(8 (1 + mu)(2
    + mu))) (Warburton's optimum for a random force on the main mass).
    """
    mu = effective_mass_ratio(model, mass_ratio, resonance)
    return _make_absorber(
        model,
        mass_ratio,
        resonance,
        float(np.sqrt(1 + mu / 2) / (1 + mu)),
        float(np.sqrt(mu * (4 + 3 * mu) / (8 * (1 + mu) * (2 + mu)))),
    )


def paper_rule(
    model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1
) -> TunedAbsorber:
    """Return the rule behind the paper's values, for any mass and resonance.

    It is Den Hartog's rule with m_a over 1 kg as mass ratio and with twice the damping.

    For the paper's beam it gives the paper's k = 701.8 N/m and c = 0.728 N s/m to the digits
    printed. Not a rule to follow.
    """
    mu = (
        positive("mass_ratio", mass_ratio) * instance("model", model, ModalModel).beam_mass
    )  # in kg, over a modal mass of one
    return _make_absorber(
        model, mass_ratio, resonance, 1 / (1 + mu), 2 * float(np.sqrt(3 * mu / (8 * (1 + mu))))
    )


# Scores of a linear absorber: the largest resonance peak over a range that holds both of the peaks
# into which it splits a resonance.
#
# A narrower range, the paper's sweep limits for one, lets an optimiser push a peak out of sight, so
# it is refused.


# scoring range in units of the resonance frequency
LOW = 0.5
HIGH = 1.6

_GRID = 121
_INSIDE = np.linspace(0, 1, 21)
_ROUNDS = 6  # each round narrows tenfold: a peak's frequency to about 1e-8, its height to rounding
_NEAR_POLE = np.array(
    [-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0]
)  # grid points around a pole, in half-widths
_UNDAMPED = 1e-10  # a pole with a smaller damping ratio counts as undamped


def require_wide_range(
    model: ModalModel, mass_ratio: float, resonance: int, low: float, high: float
) -> None:
    """Raise ParameterError unless [low, high] contains both peaks of a well-tuned absorber.

    The range is over omega_r, and the absorber has this mass.

    Measured by the undamped natural frequencies of the Den Hartog tuning, which lie outside the two
    damped peaks.
    """
    low, high = frequency_range(low, high)
    mu = effective_mass_ratio(model, mass_ratio, resonance)
    tuning = 1 / (1 + mu) ** 2
    half = (1 + (1 + mu) * tuning) / 2
    square = half + np.sqrt(half**2 - tuning)
    first = float(np.sqrt(tuning / square))
    second = float(np.sqrt(square))
    if (low, high) == (LOW, HIGH):
        mass = mass_ratio * model.beam_mass
        require(
            low <= first and high >= second,
            "absorber mass",
            f"{mass:.4g} kg",
            f"less beside the {mass / mu:.4g} kg that mode {resonance} moves at its place: "
            f"the peaks would lie at {first:.4f} and {second:.4f} "
            "of the resonance, out of the scoring range; are the mass in kg and the shapes in "
            "1/sqrt(kg)?",
        )
    allowed = (
        f"a scoring range that holds both peaks of the split resonance: low at most {first:.4f}, "
        f"high at least {second:.4f} (of the resonance)"
    )
    require(low <= first and high >= second, "scoring range (low, high)", (low, high), allowed)


def _check_scored_range(
    model: ModalModel, absorber: LinearAbsorber | None, resonance: int, low: float, high: float
) -> float:
    """Return omega_r; raises ParameterError unless the range can score an absorber."""
    omega_r = model.resonance_omega(resonance)
    low, high = frequency_range(low, high)
    if isinstance(absorber, LinearAbsorber) and not isinstance(absorber, StuckAbsorber):
        require_wide_range(model, absorber.mass_ratio, resonance, low, high)
    return omega_r


def _inside(s: NDArray[np.complex128], low: float, high: float) -> NDArray[np.bool_]:
    """Return which poles lie in low..high.

    The ends are included up to rounding, because an undamped response is infinite there, too.
    """
    return np.asarray((s.imag >= low * (1 - 1e-12)) & (s.imag <= high * (1 + 1e-12)))


def _grid(
    model: ModalModel, absorber: LinearAbsorber | None, omega_r: float, low: float, high: float
) -> NDArray[np.float64] | None:
    """Return frequency ratios that are dense enough to find every resonance peak.

    The result is None if an undamped pole lies in the range.
    """
    s = poles(model, absorber) / omega_r
    inside = _inside(s, low, high)
    if np.any(-s.real[inside] <= _UNDAMPED * s.imag[inside]):
        return None
    s = s[(s.imag > low - 5 * np.abs(s.real)) & (s.imag < high + 5 * np.abs(s.real))]
    near_poles = (s.imag[:, None] + np.abs(s.real)[:, None] * _NEAR_POLE).ravel()
    return np.unique(
        np.concatenate(
            [np.linspace(low, high, _GRID), near_poles[(near_poles > low) & (near_poles < high)]]
        )
    )


def peaks(
    model: ModalModel,
    absorber: LinearAbsorber | None,
    resonance: int = 1,
    low: float = LOW,
    high: float = HIGH,
) -> list[tuple[float, float]]:
    """Return all local maxima of the tip amplitude in [low, high], in order of frequency.

    They are (m/N, frequency over omega_r). The ends of the range do not count.

    Arguments and errors as in `peak`; an undamped pole in the range raises ParameterError.
    """
    low, high = frequency_range(low, high)
    model = instance("model", model, ModalModel)
    omega_r = _check_scored_range(model, absorber, resonance, low, high)
    grid = _grid(model, absorber, omega_r, low, high)
    if grid is None:
        raise ParameterError(
            f"damping_ratio = {model.damping_ratio!r} is not allowed: above 0 at every "
            "resonance of the range"
        )
    return _local_maxima(model, absorber, omega_r, grid)


def _local_maxima(
    model: ModalModel, absorber: LinearAbsorber | None, omega_r: float, grid: NDArray[np.float64]
) -> list[tuple[float, float]]:
    """Return the local maxima on the grid, refined.

    Each is refined by a grid of its own that shrinks tenfold in each round.
    """
    amplitude = np.abs(tip_response(model, absorber, grid * omega_r))
    middle = amplitude[1:-1]
    at = 1 + np.flatnonzero((middle >= amplitude[:-2]) & (middle > amplitude[2:]))
    if len(at) == 0:
        return []
    left = grid[at - 1]
    right = grid[at + 1]
    refined = (amplitude[at], grid[at])
    row = np.arange(len(at))
    for _ in range(_ROUNDS):
        x = left[:, None] + (right - left)[:, None] * _INSIDE
        y = np.abs(tip_response(model, absorber, x * omega_r))
        best = np.clip(np.argmax(y, axis=1), 1, len(_INSIDE) - 2)
        left = x[row, best - 1]
        right = x[row, best + 1]
        refined = (y[row, best], x[row, best])
    return [(float(height), float(ratio)) for height, ratio in zip(*refined, strict=True)]


def _highest(
    model: ModalModel, absorber: LinearAbsorber | None, omega_r: float, low: float, high: float
) -> tuple[float, float]:
    grid = _grid(model, absorber, omega_r, low, high)
    if grid is None:
        s = poles(model, absorber) / omega_r
        return float("inf"), float(
            s.imag[np.argmin(np.where(_inside(s, low, high), -s.real, np.inf))]
        )
    maxima = _local_maxima(model, absorber, omega_r, grid)
    return max(
        maxima
        or [(float(abs(tip_response(model, absorber, x * omega_r))), float(x)) for x in (low, high)]
    )


def peak(
    model: ModalModel,
    absorber: LinearAbsorber | None,
    resonance: int = 1,
    low: float = LOW,
    high: float = HIGH,
) -> tuple[float, float]:
    """Return the highest resonance peak over low..high times omega_r.

    The result is (tip amplitude per newton in m/N, its frequency over omega_r).

    A peak is a local maximum of the amplitude; a flank of a neighbouring resonance at an end of the
    range counts only if there is none. All modes and their damping take part, and a neighbouring
    resonance inside the range is scored with the rest: narrow the range for high modes, which lie
    close together. The grid contains every pole of the damped system with points around it, and
    local maxima are refined, so narrow peaks are not missed. Infinite if an undamped pole lies in
    the range. Raises ParameterError for a resonance that the model lacks and, with a TunedAbsorber,
    for a range that cannot hold both split peaks (see `require_wide_range`).
    """
    low, high = frequency_range(low, high)
    model = instance("model", model, ModalModel)
    return _highest(
        model, absorber, _check_scored_range(model, absorber, resonance, low, high), low, high
    )


def highest_amplitude(
    model: ModalModel,
    absorber: LinearAbsorber | None,
    resonance: int = 1,
    low: float = LOW,
    high: float = HIGH,
) -> tuple[float, float]:
    """Return the largest amplitude over low..high times omega_r, including ends and flanks.

    The result is (m/N, its frequency over omega_r), infinite if an undamped pole lies in the range,
    which may have any width. It is used for limits and certificates, which do not distinguish peaks
    from flanks; `peak` is the score.
    """
    omega_r = model.resonance_omega(resonance)
    low, high = frequency_range(low, high)
    ends = np.array([low, high])
    grid = _grid(model, absorber, omega_r, low, high)
    if grid is None:
        return _highest(model, absorber, omega_r, low, high)
    heights = np.abs(tip_response(model, absorber, ends * omega_r))
    return max(
        _local_maxima(model, absorber, omega_r, grid)
        + [(float(y), float(x)) for y, x in zip(heights, ends, strict=True)]
    )


# Numerical tuning on the damped multi-mode model: the smallest peak (H-infinity) and the smallest
# variance (H2), from several starts.


# H2: the response to white noise, from a Lyapunov equation, over all frequencies or over a range.
#
#     ||H||_2^2 = 1/(2 pi) integral of |H(i omega)|^2 over omega = c W c',    A W + W A' + b b' = 0.
#
# Over |omega| <= w the Gramian is S W + W S' with S = 1/(2 pi) times the integral of (i nu - A)^-1
# from -w to w, which is i/(2 pi) log((A + i w)(A - i w)^-1); a range is the difference of two such.
# The range keeps a higher resonance from being drowned by the first.


Real = NDArray[np.float64]

_CONDITION = 1e9  # of the eigenvectors: above it their digits are lost


def h2_norm(
    model: ModalModel,
    absorber: LinearAbsorber | None,
    resonance: int = 1,
    low: float = LOW,
    high: float = HIGH,
) -> float:
    """Return the part of the H2 norm from low..high times omega_r, in m/(N sqrt(s)).

    The mirror image of the range is included.

    Raises ParameterError for a mode without damping and, with a TunedAbsorber, for a range that
    cannot hold both split peaks.
    """
    omega_r = _check_scored_range(model, absorber, resonance, low, high)
    matrix, b, c = state_space(model, absorber, omega_r)
    decay = float(-np.max(np.linalg.eigvals(matrix).real))
    require(
        decay > 1e-12,
        "damping_ratio",
        model.damping_ratio,
        "above 0 at every mode, or an absorber that damps it: the variance is infinite",
    )
    weighted = scipy.linalg.solve_continuous_lyapunov(matrix, -np.outer(b, b)) @ c
    return float(np.sqrt(omega_r * 2 * max(0.0, _integrate_band(matrix, c, weighted, low, high))))


def _integrate_band(matrix: Real, c: Real, weighted: Real, low: float, high: float) -> float:
    """Return c (S(high) - S(low)) ``weighted``, with S of the text above.

    The logarithm of the matrix is computed from its poles, or directly if two poles coincide.
    """
    s, vectors = np.linalg.eig(matrix)
    if np.linalg.cond(vectors) < _CONDITION:
        turned = [(np.log(-s - 1j * w) - np.log(-s + 1j * w)) for w in (low, high)]
        return float(
            np.real(
                1j
                / (2 * np.pi)
                * (c @ vectors)
                @ ((turned[1] - turned[0]) * np.linalg.solve(vectors, weighted))
            )
        )
    shifts = [1j * w * np.eye(len(matrix)) for w in (low, high)]
    logs = [scipy.linalg.logm((matrix + shift) @ np.linalg.inv(matrix - shift)) for shift in shifts]
    return float(np.real(1j / (2 * np.pi) * c @ (logs[1] - logs[0]) @ weighted))


# shifts of ln stiffness and ln damping from the closed form, a grid whose lowest local minima are
# starts of a search too
STIFFNESS_SHIFTS = (-1.6, -1.2, -0.8, -0.4, -0.2, 0.0, 0.15, 0.3, 0.6, 1.0)
DAMPING_SHIFTS = (-3.5, -2.5, -1.5, -0.5, 0.5, 1.5, 2.5)
GRID_STARTS = 4
# from the closed form, in ln stiffness or damping: a spring as stiff as that holds the mass, one as
# soft leaves it at rest
FARTHEST = 7.0
_REFUSED = 1e3  # objective (log of the score) of a design that the range cannot score

Array = NDArray[np.float64]
Score = Callable[[TunedAbsorber], float]


def minimax(
    model: ModalModel,
    mass_ratio: float = DEFAULT_MASS_RATIO,
    resonance: int = 1,
    low: float = LOW,
    high: float = HIGH,
) -> TunedAbsorber:
    """Return the stiffness and damping with the smallest `peak` over low..high times omega_r.

    This is H-infinity tuning.

    Designs with a natural frequency next to omega_r outside the range are excluded, so no peak can
    be pushed out of sight. Raises ParameterError if the range is too narrow for a tuned absorber of
    this mass.
    """
    model = instance("model", model, ModalModel)
    exact = undamped_minimax(model, mass_ratio, resonance)
    rule = den_hartog(model, mass_ratio, resonance)
    return _smallest(
        lambda absorber: peak(model, absorber, resonance, low, high)[0],
        (exact, rule),
        model,
        resonance,
        low,
        high,
    )


def smallest_amplitude(
    model: ModalModel, mass_ratio: float, resonance: int, low: float, high: float
) -> TunedAbsorber:
    """Return the stiffness and damping with the smallest `highest_amplitude` over low..high.

    The range is in units of omega_r, and flanks and other resonances count. A peak of the split
    resonance outside of the range counts as well (`_visible_range`), so that no design is best
    because its peak is outside.
    """
    exact = undamped_minimax(model, mass_ratio, resonance)
    rule = den_hartog(model, mass_ratio, resonance)

    def score(absorber: TunedAbsorber) -> float:
        visible = _visible_range(model, absorber, resonance, low, high)
        return highest_amplitude(model, absorber, resonance, *visible)[0]

    return _smallest(score, (exact, rule), model, resonance, low, high, inside=False)


def _visible_range(
    model: ModalModel, absorber: TunedAbsorber, resonance: int, low: float, high: float
) -> tuple[float, float]:
    """Return low..high (over omega_r), widened to contain the split resonance.

    The range contains both natural frequencies into which an absorber splits the resonance.

    It goes no further than half-way (geometric mean) to the neighbouring resonances, and to `LOW`
    and `HIGH`.
    """
    omega_r = model.resonance_omega(resonance)
    split = natural_frequencies(model, absorber)[resonance - 1 : resonance + 1] / omega_r
    ratios = model.omega / omega_r
    below = float(np.max(ratios[ratios < 1 - 1e-9], initial=LOW**2))
    above = float(np.min(ratios[ratios > 1 + 1e-9], initial=HIGH**2))
    lowest = max(0.99 * float(split[0]), np.sqrt(below), LOW)
    highest = min(1.01 * float(split[1]), np.sqrt(above), HIGH)
    return min(low, lowest), max(high, highest)


def minimum_h2(
    model: ModalModel,
    mass_ratio: float = DEFAULT_MASS_RATIO,
    resonance: int = 1,
    low: float = LOW,
    high: float = HIGH,
) -> TunedAbsorber:
    """Return the stiffness and damping with the smallest `h2_norm` over low..high.

    The range, over omega_r, and the errors are those of `minimax`.
    """
    exact = undamped_h2(model, mass_ratio, resonance)
    rule = den_hartog(model, mass_ratio, resonance)
    return _smallest(
        lambda absorber: h2_norm(model, absorber, resonance, low, high),
        (exact, rule),
        model,
        resonance,
        low,
        high,
    )


def _smallest(
    score: Score,
    known: tuple[TunedAbsorber, TunedAbsorber],
    model: ModalModel,
    resonance: int,
    low: float,
    high: float,
    inside: bool = True,
) -> TunedAbsorber:
    """Return the absorber with the smallest score.

    The method is Nelder-Mead in the logarithms of k and c from several starts.

    They are two known tunings and the lowest local minima of a grid around them
    (`STIFFNESS_SHIFTS`): with close modes there are several. The search is repeated from the best,
    because the optimum of a largest peak is a kink (two equal peaks). ``inside``: only designs
    whose natural frequencies around the resonance lie within the range.
    """
    mass_ratio = known[0].mass_ratio
    if inside:
        require_wide_range(model, mass_ratio, resonance, low, high)

    def absorber_at(logs: Array) -> TunedAbsorber:
        return TunedAbsorber(mass_ratio, *np.exp(logs).tolist())

    def objective(logs: Array) -> float:
        if np.any(np.abs(logs - middle) > FARTHEST):
            return _REFUSED
        absorber = absorber_at(logs)
        if not inside:
            return float(np.log(score(absorber)))
        first, second = natural_frequencies(model, absorber)[
            resonance - 1 : resonance + 1
        ] / model.resonance_omega(resonance)
        return (
            float(np.log(score(absorber))) if low <= first and second <= high else _REFUSED
        )  # outside a peak would not be seen

    starts = [np.log([a.stiffness, a.damping]) for a in known]
    middle = starts[0]
    shifts = np.stack(np.meshgrid(STIFFNESS_SHIFTS, DAMPING_SHIFTS, indexing="ij"), axis=-1)
    grid = middle + shifts
    values = np.apply_along_axis(objective, 2, grid)
    lowest = values <= scipy.ndimage.minimum_filter(values, size=3, mode="nearest")
    minima = sorted(zip(values[lowest].tolist(), grid[lowest].tolist(), strict=True))
    starts += [np.array(start) for _, start in minima[:GRID_STARTS]]

    def descend(start: Array, size: float, steps: float, gain: float) -> Array:
        options = {
            "initial_simplex": start + size * np.array([[0, 0], [1, 0], [0, 3]]),
            "xatol": steps,
            "fatol": gain,
        }
        return np.asarray(
            scipy.optimize.minimize(objective, start, method="Nelder-Mead", options=options).x
        )

    best = min((descend(start, 0.05, 1e-3, 1e-6) for start in starts), key=objective)
    for size in (1e-2, 1e-4):
        best = descend(best, size, 1e-8, 1e-12)
    require(
        objective(best) < _REFUSED,
        "scoring range (low, high)",
        (low, high),
        "wider: it must hold both natural frequencies around the resonance",
    )
    return absorber_at(best)
