"""Free parameters of a calibration: their priors, and the scene for given values."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from impact_env.checks import ParameterError, finite, one_of, require
from impact_env.laws import CONCEPTS, make, values
from impact_env.parameters import SlidingAbsorber
from impact_env.scene import Scene

Array = NDArray[np.float64]
DAMPING = "damping"
FREQUENCY = "frequency"
MASS_KG = "mass_kg"
GAP = "gap"
RESTITUTION = "restitution"
FRICTION_LIMIT = "friction_limit"
OTHER_NAMES = {"gap_m": GAP, "friction_limit_n": FRICTION_LIMIT}  # with the unit, as files have it
ABSORBER_PARAMETERS = tuple(CONCEPTS["impact"])
STRUCTURE_PARAMETERS = (DAMPING, FREQUENCY)
PARAMETERS = (*STRUCTURE_PARAMETERS, MASS_KG, *ABSORBER_PARAMETERS)
UNIFORM = "uniform"
LOG_UNIFORM = "log"
NORMAL = "normal"
SHAPES = (UNIFORM, LOG_UNIFORM, NORMAL)
CUT = 3.0  # standard deviations from the mean at which a normal prior is truncated
LEAST_SHARE = 1e-6  # lower end of a friction limit over its upper end: above 0, so friction stays
UNITS = {
    DAMPING: "",
    FREQUENCY: "Hz",
    MASS_KG: "kg",
    **{name: field.metadata["unit"] for name, field in CONCEPTS["impact"].items()},
}
FORM = (
    "two numbers, the lower one first, in SI units; or mean and standard deviation before 'normal'"
)


@dataclass(frozen=True)
class Prior:
    """Prior distribution of a parameter.

    It is uniform or log-uniform from ``low`` to ``high``, or normal with mean ``low`` and standard
    deviation ``high``, truncated at three of them, at 0, and at 1 for restitution. Values are in
    the units of `UNITS`.
    """

    name: str
    low: float
    high: float
    shape: str = UNIFORM

    def at(self, share: Array) -> Array:
        """Return the quantiles (N,) at probabilities ``share`` (N,)."""
        if self.shape == NORMAL:
            least = (
                -CUT if self._lowest is None else max(-CUT, (self._lowest - self.low) / self.high)
            )
            most = CUT if self.name != RESTITUTION else min(CUT, (1 - self.low) / self.high)
            return np.asarray(self.low + self.high * scipy.stats.truncnorm.ppf(share, least, most))
        if self.shape == LOG_UNIFORM:
            return np.asarray(self.low * (self.high / self.low) ** share)
        return np.asarray(self.low + (self.high - self.low) * share)

    @property
    def _lowest(self) -> float | None:
        """Lower bound of a normal distribution, None: only the truncation at `CUT`."""
        return 0.0

    def share_of(self, value: float) -> float:
        """Return the probability, 0 to 1, of values below a value."""
        grid = np.linspace(0.0, 1.0, 4001)
        return float(np.interp(value, self.at(grid), grid))

    @property
    def words(self) -> str:
        """The distribution in words, with its unit."""
        unit = UNITS[self.name]
        if self.shape == NORMAL:
            text = f"normal, mean {self.low:.4g}, standard deviation {self.high:.4g} {unit}"
        else:
            kind = "uniform" if self.shape == UNIFORM else "log-uniform"
            text = f"{kind} from {self.low:.4g} to {self.high:.4g} {unit}"
        return text.rstrip()

    def to_plain(self) -> list[float | str]:
        """Return [low, high, shape] for JSON."""
        return [self.low, self.high, self.shape]


PriorInput = Sequence[float | str] | None


def read_priors(
    free: Mapping[str, PriorInput] | Sequence[str], scene: Scene, resonance: int
) -> tuple[Prior, ...]:
    """Return the prior of each free parameter; parameters without a range get `usual_prior`.

    ``free``: names, or for each name two numbers and optionally a distribution (`FORM`) or None.
    Raises ParameterError for an unknown or repeated name, for a parameter that the scene lacks, for
    both mass and mass ratio, and for an impossible range.
    """
    absorber = require_impact_absorber(scene)
    table = dict(free) if isinstance(free, Mapping) else dict.fromkeys(free)
    require(len(table) > 0, "free", table, f"one parameter or more of {', '.join(PARAMETERS)}")
    priors: list[Prior] = []
    for word, value in table.items():
        name = one_of("free", OTHER_NAMES.get(word, word), PARAMETERS)
        require(name not in {one.name for one in priors}, "free", word, "each parameter once")
        if value is None:
            priors.append(usual_prior(name, scene, resonance))
        else:
            priors.append(_read_prior(name, value))
    names = {one.name for one in priors}
    require(not names >= {MASS_KG, "mass_ratio"}, "free", sorted(names), f"{MASS_KG} or mass_ratio")
    middle = {one.name: float(one.at(np.array([0.5]))[0]) for one in priors}
    try:
        scene_with(scene, middle, resonance)
    except ParameterError as error:
        raise ParameterError(f"free {', '.join(sorted(names))} on {absorber}: {error}") from error
    return tuple(priors)


def _read_prior(name: str, value: Sequence[float | str]) -> Prior:
    """Return the prior that two numbers, and optionally a distribution, define (`FORM`)."""
    path = f"free {name}"
    words = list(value)
    require(len(words) in (2, 3), path, value, FORM)
    shape = one_of(f"{path}: distribution", words[2] if len(words) == 3 else UNIFORM, SHAPES)
    low, high = (_number(path, word) for word in words[:2])
    if shape == NORMAL:
        require(low > 0 and high > 0, path, value, "a mean and a standard deviation above 0")
        return Prior(name, low, high, shape)
    require(0 <= low < high, path, value, "from 0 on, the lower one first")
    require(shape != LOG_UNIFORM or low > 0, path, value, "above 0, for a log-uniform distribution")
    require(name != RESTITUTION or high <= 1, path, value, "at most 1")
    if name == FRICTION_LIMIT and low == 0:
        low = LEAST_SHARE * high
    require(low > 0 or name == RESTITUTION, path, value, "above 0")
    return Prior(name, low, high, shape)


def _number(path: str, word: float | str) -> float:
    """Return a finite number; raises ParameterError that names ``path``."""
    try:
        return finite(path, float(word))
    except (ValueError, TypeError) as error:
        raise ParameterError(f"{path} = {word!r} is not allowed: {FORM}") from error


def usual_prior(name: str, scene: Scene, resonance: int) -> Prior:
    """Return the default prior of a parameter.

    It lies around the scene's value, for restitution and the ratio of static friction in a fixed
    range, for other contact parameters in a range that follows from mass, gap and frequency.

    Raises ParameterError for a parameter without default prior, and if a value that the range
    is relative to is not positive.
    """
    absorber = require_impact_absorber(scene)
    model = scene.model
    omega = model.resonance_omega(resonance)
    mass = absorber.mass_ratio * model.beam_mass
    walls = absorber.walls
    assert walls is not None
    own = values(absorber)
    ranges: dict[str, tuple[float, float, str]] = {
        DAMPING: (0.5, 2.0, LOG_UNIFORM),
        FREQUENCY: (0.97, 1.03, UNIFORM),
        MASS_KG: (0.8, 1.25, UNIFORM),
        "mass_ratio": (0.8, 1.25, UNIFORM),
        GAP: (0.5, 2.0, UNIFORM),
    }
    nominal = {
        DAMPING: float(model.damping_ratio[resonance - 1]),
        FREQUENCY: omega / (2 * math.pi),
        MASS_KG: mass,
        "mass_ratio": absorber.mass_ratio,
        GAP: walls.gap,
    }
    if name in ranges:
        low, high, shape = ranges[name]
        require(
            0 < nominal[name] < math.inf, f"free {name}", nominal[name], "given with two numbers"
        )
        return Prior(name, low * nominal[name], high * nominal[name], shape)
    if name == RESTITUTION:
        return Prior(name, 0.2, 0.95)
    inertia = mass * omega**2 * walls.gap  # N, inertial force at an amplitude of one gap
    if name == FRICTION_LIMIT:
        high = max(0.5 * inertia, 3 * float(own.get(FRICTION_LIMIT) or 0.0))
        return Prior(name, LEAST_SHARE * high, high)
    if name == "contact_stiffness":
        return Prior(name, 9 * mass * omega**2, 1e4 * mass * omega**2, LOG_UNIFORM)
    if name == "yield_velocity":
        return Prior(name, 0.05 * omega * walls.gap, 50 * omega * walls.gap, LOG_UNIFORM)
    if name == "static_friction_ratio":
        return Prior(name, 1.0, 2.0)
    raise ParameterError(
        f"free {name} is not allowed without a range: {FORM}, as there is no usual one"
    )


def require_impact_absorber(scene: Scene) -> SlidingAbsorber:
    """Return the absorber of a scene.

    Raises ParameterError unless it is a single absorber between walls, rigid or compliant.
    """
    absorber = scene.absorber
    if isinstance(absorber, SlidingAbsorber) and absorber.walls is not None:
        return absorber
    raise ParameterError(
        f"absorber = {absorber} is not allowed: one impact absorber, between walls"
    )


def scene_with(scene: Scene, chosen: Mapping[str, float], resonance: int) -> Scene:
    """Return the scene with the ``chosen`` values of parameters, by their names in `PARAMETERS`.

    ``frequency`` (Hz) and ``damping`` (ratio) belong to the ``resonance`` (counted from 1).
    Frequencies and damping ratios of the other modes change by the same factors.
    """
    model = scene.model
    which = resonance - 1
    if FREQUENCY in chosen:
        factor = 2 * math.pi * chosen[FREQUENCY] / float(model.omega[which])
        model = replace(model, omega=model.omega * factor)
    if DAMPING in chosen:
        factor = chosen[DAMPING] / float(model.damping_ratio[which])
        model = replace(model, damping_ratio=model.damping_ratio * factor)
    absorber = require_impact_absorber(scene)
    own = {name: chosen[name] for name in ABSORBER_PARAMETERS if name in chosen}
    if MASS_KG in chosen:
        own["mass_ratio"] = chosen[MASS_KG] / model.beam_mass
    if own:
        own = {name: float(value) for name, value in own.items()}
        return Scene(model, make("impact", values(absorber) | own))
    return Scene(model, absorber)
