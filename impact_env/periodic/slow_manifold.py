"""Slow invariant manifold of an impact absorber.

It is the structure's amplitude over the absorber's impulse.

With two symmetric impacts a period of the force, the amplitude of the resonant mode follows from
the impulse at each impact alone, whatever the force is. The manifold has two branches: at impulses
above that of the least amplitude the motion is attracted, below it is repelled.

Four variants are offered, from the literature's formula to the formula with all harmonics and
modes:

``classical``
    One mode, a light absorber, the restitution e as given (Theurich, Vakakis, Krack 2022; Gendelman
    and others).
``modal``
    The same with the modal restitution e_1, which counts the momentum that an impact gives to the
    other modes as lost.
``corrected``
    The modal formula with the absorber's finite mass, friction, and what the other modes still
    return at the next impact.
``complete``
    All harmonics of all modes at the frequency of the force; exact but for the direct response of
    the other modes to the force.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_env.checks import (
    count,
    instance,
    kind_of,
    positive,
    require,
    word_of,
)
from impact_env.fields import check_fields
from impact_env.modes import ModalModel
from impact_env.parameters import check_restitution
from impact_env.periodic.case import Case
from impact_env.periodic.orbit import Orbit
from impact_env.periodic.survey import closed_form_orbits
from impact_env.plain import from_scene

Array = NDArray[np.float64]
VARIANTS = ("classical", "modal", "corrected", "complete")
SAMPLES = 512  # of a period of the force, from which an orbit's first harmonic is taken
FORCES = (
    0.5,
    0.7,
    1.0,
    1.4,
    2.0,
)  # of the force of the modulation's onset, at which orbits are sought


def modal_restitution(
    model: ModalModel, restitution: float, mass_ratio: float, resonance: int = 1
) -> float:
    r"""Return the effective restitution for the mode of one resonance, in closed form.

    An impact also moves all other modes. The momentum that they take is lost for the resonant mode,
    as if the impact were less elastic:

    .. math:: \frac{1 + e_1}{1/m_a + \varphi_r^2} = \frac{1 + e}{1/m_a + \sum_i \varphi_i^2}

    Parameters
    ----------
    model : ModalModel
        Modes of the structure with the absorber's place.
    restitution : float
        Coefficient of restitution e of the impacts, 0 to 1.
    mass_ratio : float
        Mass of the absorber over that of the structure.
    resonance : int
        Number r of the resonance, counted from 1.

    Returns
    -------
    float
        e_1, at most e; it may be negative if the other modes take most of the momentum.

    Raises
    ------
    ParameterError
        A value is out of range.
    """
    model = instance("model", model, ModalModel)
    restitution = check_restitution("restitution", restitution)
    mass = positive("mass_ratio", mass_ratio) * model.beam_mass
    mode = count("resonance", resonance, 1, model.modes) - 1
    shape = np.asarray(model.tip_shape)
    of_mode = 1 / mass + float(shape[mode] ** 2)
    of_all = 1 / mass + float(np.sum(shape**2))
    return (1 + restitution) * of_mode / of_all - 1


@dataclass(frozen=True, eq=False)
class SlowManifold:
    r"""The slow invariant manifold of a case near one of its resonances.

    The complex amplitude of the resonant mode at the absorber's place is linear in the impulse P of
    an impact, with the phase counted from an impact on the lower wall:

    .. math:: A e^{i\theta} = a_0 + a_1 P

    Parameters
    ----------
    case : Case
        Structure, absorber, frequency (rad/s) and force (N); the manifold does not depend on the
        force.
    resonance : int
        Number of the resonance, counted from 1.
    variant : str
        One of ``"classical"``, ``"modal"``, ``"corrected"``, ``"complete"`` (see the module).

    Raises
    ------
    ParameterError
        For values out of range, and where the resonant mode does not move the absorber's place or
        the force.

    Examples
    --------
    >>> from impact_env import Beam, beam_scene, impact_absorber
    >>> from impact_env.periodic import SlowManifold, case_of
    >>> scene = beam_scene(Beam(), impact_absorber(restitution=0.7))
    >>> manifold = SlowManifold(case_of(scene, 1.0, scene.model.resonance_omega(1)))
    >>> print(f"{manifold.restitution:.2f}, {1e3 * manifold.least_amplitude:.3f} mm")
    0.07, 0.505 mm
    """

    case: Case
    resonance: int = 1
    variant: str = "corrected"

    def __post_init__(self) -> None:
        check_fields(
            self,
            case=kind_of(Case),
            variant=word_of(VARIANTS),
            resonance=lambda name, value: count(name, value, 1, self.case.model.modes),
        )
        shape = np.asarray(self.case.model.tip_shape)
        require(
            bool(shape[self._mode] != 0),
            "resonance",
            self.resonance,
            "one whose mode moves the absorber's place",
        )

    @property
    def _mode(self) -> int:
        return int(self.resonance) - 1

    @property
    def mass(self) -> float:
        """Mass of the absorber in kg."""
        return self.case.mass_ratio * self.case.model.beam_mass

    @property
    def effective_mass_ratio(self) -> float:
        """Mass of the absorber over the modal mass of the resonant mode at the absorber's place."""
        return self.mass * float(self.case.model.tip_shape[self._mode] ** 2)

    @property
    def restitution(self) -> float:
        """Restitution of the resonant mode in this variant.

        It is e, the modal e_1, or the restitution that includes the energy returned by other modes.
        """
        case = self.case
        if self.variant == "classical":
            return case.restitution
        if self.variant == "modal":
            return modal_restitution(case.model, case.restitution, case.mass_ratio, self.resonance)
        # (1 - e)/(1 + e) of an impact whose mean velocity is that of the resonant mode
        share = 2 * self.mass * self._mean_rate / (1 + self.effective_mass_ratio)
        return (1 - share) / (1 + share)

    @property
    def _mean_rate(self) -> float:
        """Mean velocity of the absorber's place at an impact, per unit impulse, in 1/kg.

        It follows from the impact law and the other modes.
        """
        case = self.case
        shape = np.asarray(case.model.tip_shape)
        compliance = 1 / self.mass + float(np.sum(shape**2))
        law = 0.5 * compliance * (1 - case.restitution) / (1 + case.restitution)
        return law + float(self._train_response(1)[self._others].sum())

    @cached_property
    def _others(self) -> NDArray[np.bool_]:
        """Which exponentials of the structure belong to other modes than the resonant one, (J,)."""
        return np.asarray(self.case.structure.mode != self._mode)

    def _train_response(self, order: int) -> Array:
        """Return the response of each exponential of the structure at an impact, (J,).

        The excitation consists of unit impulses of alternating sign, one in each half period.
        ``order`` 0: displacement (m/(N s)); 1: velocity, mean of before and after (1/kg); -1:
        displacement under a square wave that jumps by 1 N (m/N).
        """
        structure = self.case.structure
        mean = 0.5 * np.tanh(-0.5 * structure.s * self._half_period)
        return np.asarray((structure.powers[1 + order] * mean).real)

    @property
    def _half_period(self) -> float:
        return float(np.pi / self.case.omega)

    @cached_property
    def _receptance(self) -> complex:
        """Displacement of the resonant mode at the absorber's place per force there, in m/N."""
        model = self.case.model
        own = float(model.omega[self._mode])
        omega = self.case.omega
        below = own**2 - omega**2 + 2j * float(model.damping_ratio[self._mode]) * own * omega
        require(
            below != 0,
            "frequency",
            self.case.omega,
            "not exactly the resonance of an undamped mode",
        )
        return complex(float(model.tip_shape[self._mode]) ** 2 / below)

    @cached_property
    def coefficients(self) -> tuple[complex, complex]:
        """a_0 in m and a_1 in m/(N s) of the complex amplitude a_0 + a_1 P."""
        case = self.case
        half = self._half_period
        if self.variant in ("classical", "modal"):
            rate = (1 - self.restitution) / (1 + self.restitution) / (2 * self.mass)
            return complex(case.gap), complex(-half / (4 * self.mass), -rate / case.omega)
        limit = case.friction_limit
        # a positive impulse on the absorber pushes the structure down; friction on the structure is
        # +limit while the absorber moves up
        push = -half / (4 * self.mass)
        place = case.gap
        rate = self._mean_rate
        drift = limit * half / (2 * self.mass)
        if self.variant == "corrected":
            push *= 1 + 2 * self.effective_mass_ratio / np.pi**2
        else:
            beyond = self._harmonics_beyond_first()
            others = self._others
            lag = float(self._train_response(0)[others].sum()) + beyond[0]
            push += lag
            rate += beyond[1]
            place -= 2 * limit * (float(self._train_response(-1)[others].sum()) + beyond[2])
            drift -= 2 * limit * lag
        return complex(place, -drift / case.omega), complex(push, -rate / case.omega)

    def _harmonics_beyond_first(self) -> tuple[float, float, float]:
        """Return responses of the resonant mode alone, without their first harmonics.

        They are displacement, velocity, and displacement under the square wave, see
        `_train_response`.
        """
        own = ~self._others
        half = self._half_period
        first = self._receptance
        return (
            float(self._train_response(0)[own].sum() - 2 / half * first.real),
            float(self._train_response(1)[own].sum() + 2 / half * self.case.omega * first.imag),
            float(self._train_response(-1)[own].sum() - 2 / np.pi * first.imag),
        )

    def amplitude(self, impulse: ArrayLike) -> Array:
        """Return the amplitude in m of the resonant mode at the absorber's place.

        ``impulse`` is in N s, of any shape, which is that of the result.
        """
        offset, slope = self.coefficients
        return np.asarray(np.abs(offset + slope * np.asarray(impulse, dtype=float)))

    @property
    def least_impulse(self) -> float:
        """Impulse in N s at the smallest amplitude.

        Motions with smaller impulses are repelled by the manifold.
        """
        return _nearest(*self.coefficients)

    @property
    def least_amplitude(self) -> float:
        """Smallest amplitude in m of the resonant mode with two impacts a period."""
        return float(self.amplitude(self.least_impulse))

    def force(self, impulse: ArrayLike) -> Array:
        """Return the force amplitude in N that sustains the motion with an impulse in N s.

        The frequency is the case's. The result has the shape of ``impulse``.
        """
        offset, slope = self._force_coefficients
        return np.asarray(np.abs(offset + slope * np.asarray(impulse, dtype=float)))

    @cached_property
    def _force_coefficients(self) -> tuple[complex, complex]:
        """Complex coefficients f_0 in N and f_1 in N/(N s) of the force amplitude f_0 + f_1 P.

        They follow from the balance of the first harmonic of the resonant mode.
        """
        case = self.case
        offset, slope = self.coefficients
        shape = float(case.model.tip_shape[self._mode])
        push = float(case.model.one_phase_force_shape[self._mode])
        require(push != 0, "resonance", self.resonance, "one whose mode the force excites")
        friction = 4j * case.friction_limit / np.pi if self.variant in VARIANTS[2:] else 0j
        scale = shape / push
        return (
            scale * (offset / self._receptance + friction),
            scale * (slope / self._receptance + 2 / self._half_period),
        )

    @property
    def fold_force(self) -> float:
        """Smallest force in N with a motion of two impacts a period at the case's frequency.

        The motion may be stable or unstable.
        """
        return float(self.force(_nearest(*self._force_coefficients)))

    @property
    def modulation_force(self) -> float:
        """Force in N at the smallest amplitude.

        At this frequency the motion is modulated under smaller forces, and stationary under larger
        ones.
        """
        return float(self.force(self.least_impulse))


def _nearest(offset: complex, slope: complex) -> float:
    """Return the real p at which offset + slope p is closest to 0."""
    return -(slope.conjugate() * offset).real / abs(slope) ** 2


def manifold_gap(case: Case, resonance: int = 1, variant: str = "corrected") -> float:
    """Return the gap in m for which the case's force is at the onset of modulation.

    The frequency is that of the resonance. Up to this force the amplitude stays at the manifold's
    least, in a modulated motion; above it the amplitude grows with the force. No simulation and no
    fitted number is used. The friction limit is scaled with the gap.

    Parameters
    ----------
    case : Case
        Structure, absorber and force (N). The frequency is replaced by the resonance's, and the gap
        is used only for the ratio of friction limit and gap.
    resonance : int, optional
        Number of the resonance, counted from 1.
    variant : str, optional
        Variant of the manifold.

    Returns
    -------
    float
        Clearance to either wall in m.

    Raises
    ------
    ParameterError
        The force is 0, or a value is out of range.
    """
    require(case.force != 0, "force amplitude", case.force, "a force other than 0 N")
    omega = case.model.resonance_omega(count("resonance", resonance, 1, case.model.modes))
    manifold = SlowManifold(case.changed(omega=float(omega)), resonance, variant)
    return case.gap * abs(case.force) / manifold.modulation_force


@dataclass(frozen=True, eq=False)
class OrbitPoint:
    """A confirmed periodic orbit for comparison with the manifold.

    Attributes
    ----------
    case : Case
        Structure, absorber, force and frequency.
    impulse : float
        Impulse of an impact in N s.
    amplitude : float
        Amplitude in m of the first harmonic of the resonant mode at the absorber's place, from
        samples of the orbit.
    stable : bool
        Whether the orbit is stable.
    """

    case: Case
    impulse: float
    amplitude: float
    stable: bool


def measure_orbit(orbit: Orbit, resonance: int = 1) -> OrbitPoint | None:
    """Return impulse and amplitude of an orbit.

    The result is None for an orbit without mirror symmetry, or with another number of impacts a
    period than two.
    """
    if (
        not orbit.schedule.symmetric
        or orbit.schedule.period_multiple != 1
        or len(orbit.impacts) != 2
    ):
        return None
    mode = count("resonance", resonance, 1, orbit.case.model.modes) - 1
    phases = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    displacement = orbit.motion.states(phases)[:, mode]
    harmonic = 2 * abs(np.mean(displacement * np.exp(-1j * phases)))
    amplitude = abs(float(orbit.case.model.tip_shape[mode])) * float(harmonic)
    impulse = abs(orbit.impacts[0].impulse)
    return OrbitPoint(orbit.case, impulse, amplitude, orbit.stability.stable)


@dataclass(frozen=True, eq=False)
class ManifoldCheck:
    """Comparison of orbits with the manifold of a case near one of its resonances.

    It gives the errors of each variant of the manifold.
    """

    case: Case
    resonance: int
    points: tuple[OrbitPoint, ...]

    def manifold(self, variant: str) -> SlowManifold:
        """Return a variant of the manifold at the resonance."""
        omega = float(self.case.model.resonance_omega(self.resonance))
        return SlowManifold(self.case.changed(omega=omega), self.resonance, variant)

    def errors(self, variant: str) -> Array:
        """Return the relative error of the manifold's amplitude at each orbit's impulse, (n,).

        ``"complete"`` is evaluated at each orbit's frequency. The other variants are a formula at
        the resonance over the amplitude of the absorber, which is proportional to impulse over
        frequency.
        """
        at_resonance = self.manifold(variant)
        errors = []
        for point in self.points:
            manifold = at_resonance
            impulse = point.impulse
            if variant == "complete":
                manifold = SlowManifold(point.case, self.resonance, variant)
            else:
                impulse *= at_resonance.case.omega / point.case.omega
            errors.append(float(manifold.amplitude(impulse)) / point.amplitude - 1)
        return np.array(errors)

    def median_error(self, variant: str) -> float:
        """Return the median over all orbits of the absolute relative error.

        The result is nan without orbits.
        """
        return float(np.median(np.abs(self.errors(variant)))) if self.points else float("nan")

    def to_plain(self) -> dict[str, Any]:
        """Return scene, variants and orbits as plain values in SI units."""
        variants = []
        for name in VARIANTS:
            manifold = self.manifold(name)
            offset, slope = manifold.coefficients
            variants.append(
                {
                    "variant": name,
                    "mode_restitution": manifold.restitution,
                    "offset_m": [offset.real, offset.imag],
                    "slope_m_per_Ns": [slope.real, slope.imag],
                    "least_impulse_Ns": manifold.least_impulse,
                    "least_amplitude_m": manifold.least_amplitude,
                    "fold_force_N": manifold.fold_force,
                    "modulation_force_N": manifold.modulation_force,
                    "median_error": self.median_error(name) if self.points else None,
                }
            )
        orbits = [
            {
                "force_N": point.case.force,
                "omega_rad_s": point.case.omega,
                "impulse_Ns": point.impulse,
                "amplitude_m": point.amplitude,
                "stable": point.stable,
            }
            for point in self.points
        ]
        omega = self.manifold("classical").case.omega
        return {
            "scene": from_scene(self.case.scene),
            "resonance": self.resonance,
            "omega_rad_s": omega,
            "variants": variants,
            "orbits": orbits,
        }


def check_manifold(
    case: Case,
    resonance: int,
    ratios: ArrayLike,
    forces: ArrayLike | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> ManifoldCheck:
    """Compare confirmed symmetric orbits with one impact at each wall with the manifold.

    Parameters
    ----------
    case : Case
        Structure and absorber; its frequency and force are not used.
    resonance : int
        Number of the resonance, counted from 1.
    ratios : array_like
        Frequencies of the force over that of the resonance.
    forces : array_like, optional
        Force amplitudes in N; by default `FORCES` times the force at the onset of modulation.
    progress : callable, optional
        Called with the number of finished points and of all points.

    Returns
    -------
    ManifoldCheck
        The orbits, and the errors of each variant.

    Raises
    ------
    ParameterError
        A value is out of range.
    """
    omega = float(case.model.resonance_omega(count("resonance", resonance, 1, case.model.modes)))
    if forces is None:
        manifold = SlowManifold(case.changed(omega=omega), resonance, "complete")
        forces = manifold.modulation_force * np.array(FORCES)
    grid = [
        case.changed(omega=positive("frequency ratio", float(ratio)) * omega, force=float(force))
        for force in np.atleast_1d(np.asarray(forces, dtype=float))
        for ratio in np.atleast_1d(np.asarray(ratios, dtype=float))
    ]
    points = []
    for done, here in enumerate(grid, 1):
        measured = (measure_orbit(orbit, resonance) for orbit in closed_form_orbits(here).orbits)
        points += [point for point in measured if point is not None]
        if progress is not None:
            progress(done, len(grid))
    return ManifoldCheck(case, resonance, tuple(points))
