"""Harmonic balance of a mass with friction and impacts in a cavity (paper, section 2.5).

The equations are condensed to the relative displacement.

The unknowns are the harmonics of r = absorber less tip: 2H + 1 for any number of modes, or only
those of odd order for symmetric orbits. The residual is the force that the equations of motion
require less that of the contact law, harmonic by harmonic; its Jacobian is analytic.

Stability is computed by Hill's method (G. W. Hill, Acta Mathematica 8, 1886; as a matrix: A.
Lazarus, O. Thomas, 2010). A disturbance is exp(mu t) times a polynomial with the harmonics of the
solution, for the modes, the absorber, their velocities, and the contact force, which follows the
contact law linearised along the solution. Most eigenvalues mu are copies of others, shifted by
multiples of the frequency and truncated, so only the eigenvalues whose eigenvectors have the lowest
harmonics count. The linearised contact repeats after half a period of a symmetric solution and
after a period of any other. Harmonics of even and of odd order of this span are therefore not
coupled: after the span one kind is multiplied by exp(mu t), the other by minus this factor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import NDArray

from impact_env.checks import (
    count_from,
    finite,
    flag,
    kind_of,
    labelled,
    non_negative,
    positive,
    require,
)
from impact_env.fields import check_fields
from impact_env.frequency import receptance, receptance_slope
from impact_env.modes import ModalModel
from impact_env.parameters import (
    CompliantWalls,
    CoulombFriction,
    ElasticCoulombFriction,
    RigidWalls,
    SlidingAbsorber,
    require_weightless,
)
from impact_env.periodic.branch import Residual
from impact_env.periodic.contact import CompliantContact, ContactForceLaw, RigidContact
from impact_env.periodic.continuation import ContinuationProblem, start_branch
from impact_env.periodic.trigonometric import Real, derivative, find_largest
from impact_env.scene import Scene

Complex = NDArray[np.complex128]
OMEGA_PARAMETER = "omega"
FORCE_PARAMETER = "force"
PAPER_DAMPER = 0.001  # N s/m between absorber and ground (paper, section 2.5)
# in absorber mass times omega_1^2, and times omega_1
WEIGHT = 100.0
FRICTION_WEIGHT = 10.0
# of the frequency, in which exponents are looked for: a little more than the half that holds each
# once, since truncation may put one that is at its edge on either side
STRIP = 0.6
# relative: a multiplier at the strip's edge is found in both kinds of order, as two values that
# truncation keeps apart by less. Two that are closer and of one kind are two multipliers, and stay
MULTIPLIER_TOL = 0.1
CENTRING = 1e-9  # of the weight: a spring that chooses the mean of r where no wall does


class Dynamics(NamedTuple):
    """Linear dynamics at the harmonics 0 to H, complex (H + 1,) each.

    ``stiffness`` is the force per relative displacement (N/m) and ``drive`` the force per newton of
    the drive; the slopes are their derivatives with respect to omega.
    """

    stiffness: Complex
    drive: Complex
    stiffness_slope: Complex
    drive_slope: Complex


@dataclass(frozen=True, eq=False)
class JointOfMass:
    """A mass in kg at a beam's tip, with the relative displacement r = absorber less tip.

    The force on the absorber is lambda = (r + G_tf f)/(G_a + G_tt) with G_a = 1/(-m w^2 + i c w),
    where w are the multiples of omega/``multiple`` and c is a damper (N s/m) between absorber and
    ground. The mean of the force is zero, because nothing else acts on the absorber.
    """

    model: ModalModel
    mass: float
    harmonics: int = 20
    grounded_damper: float = 0.0
    multiple: int = 1

    def __post_init__(self) -> None:
        check_fields(
            self,
            model=kind_of(ModalModel),
            mass=positive,
            harmonics=count_from(1),
            grounded_damper=non_negative,
        )
        check_fields(self, multiple=count_from(1, self.harmonics))

    def dynamics(self, omega: float) -> Dynamics:
        """Return the dynamics at the drive's frequency in rad/s.

        Raises ParameterError at exactly the frequency of an undamped mode.
        """
        share = np.arange(1, self.harmonics + 1) / self.multiple
        tip = self.model.tip_shape
        w = share * omega
        own = -self.mass * w**2 + 1j * self.grounded_damper * w
        own_slope = (-2 * self.mass * w + 1j * self.grounded_damper) * share
        joint = 1 / own + receptance(self.model, w, tip, tip)
        joint_slope = -own_slope / own**2 + share * receptance_slope(self.model, w, tip, tip)
        stiffness = 1 / joint
        stiffness_slope = -joint_slope / joint**2
        drive = np.zeros_like(stiffness)
        drive_slope = np.zeros_like(stiffness)
        k = self.multiple - 1
        moved = complex(receptance(self.model, omega, tip, self.model.one_phase_force_shape))
        moved_slope = complex(
            receptance_slope(self.model, omega, tip, self.model.one_phase_force_shape)
        )
        drive[k], drive_slope[k] = (
            stiffness[k] * moved,
            stiffness_slope[k] * moved + stiffness[k] * moved_slope,
        )
        return Dynamics(
            *(np.append(0.0, part) for part in (stiffness, drive, stiffness_slope, drive_slope))
        )

    def tip(self, dynamic: Complex, force: float, omega: float) -> Complex:
        """Return the displacement (H + 1,) in m at the place of the response level.

        It follows from the force on the absorber (H + 1,) and the drive's force, both in N.
        """
        w = np.arange(self.harmonics + 1) * omega / self.multiple
        level = self.model.level_shape
        moved = -receptance(self.model, w, level, self.model.tip_shape) * dynamic
        moved[self.multiple] += force * complex(
            receptance(self.model, omega, level, self.model.one_phase_force_shape)
        )
        return np.asarray(moved)


def complexes(row: Real) -> Complex:
    """Return X (H + 1,) with row = Re sum X_k exp(i k angle)."""
    h = (len(row) - 1) // 2
    return np.append(row[:1], row[1 : h + 1] - 1j * row[h + 1 :])


def real_row(values: Complex) -> Real:
    """Return the polynomial (2H + 1,) of X (H + 1,): the inverse of `complexes`."""
    return np.concatenate([values[:1].real, values[1:].real, -values[1:].imag])


@dataclass(frozen=True)
class HarmonicResponse:
    """A solution as harmonics X (H + 1,), with x = Re sum X_k exp(i k angle).

    They are the harmonics of relative displacement (m), tip displacement (m) and force on the
    absorber (N).
    """

    relative: NDArray[np.complex128]
    tip: NDArray[np.complex128]
    contact: NDArray[np.complex128]

    @property
    def tip_amplitude(self) -> float:
        """Half the peak-to-peak value of the tip's displacement in m.

        It is the paper's response level of a periodic response.
        """
        low, high = find_largest(real_row(self.tip))
        return (high - low) / 2

    @property
    def tip_max(self) -> float:
        """Largest displacement of the tip in m."""
        return max(abs(value) for value in find_largest(real_row(self.tip)))

    @property
    def tip_rms(self) -> float:
        """Root mean square of the tip's displacement in m."""
        return float(np.sqrt(abs(self.tip[0]) ** 2 + np.sum(np.abs(self.tip[1:]) ** 2) / 2))


@dataclass(frozen=True, eq=False)
class Balance:
    """The equations of harmonic balance at one frequency (rad/s) and force (N).

    ``linear`` is the structure with the mass, ``law`` the contact law. The solution's unknowns z
    are arguments of the methods. ``symmetric`` keeps only odd harmonics. ``centring`` (N/m) is a
    spring on the mean of r, which has no influence on a symmetric orbit.
    """

    linear: JointOfMass
    law: ContactForceLaw
    omega: float
    force: float
    symmetric: bool = True
    centring: float = 0.0

    def __post_init__(self) -> None:
        check_fields(
            self,
            omega=labelled(OMEGA_PARAMETER, positive),
            force=labelled(FORCE_PARAMETER, finite),
            symmetric=flag,
            centring=finite,
        )

    @property
    def indices(self) -> NDArray[np.intp]:
        """Indices of the unknowns z in a polynomial (2H + 1,)."""
        h = self.linear.harmonics
        odd = np.arange(1, h + 1, 2)
        return np.concatenate([odd, odd + h]) if self.symmetric else np.arange(2 * h + 1)

    def polynomial(self, z: Real) -> Real:
        """Return the relative displacement (2H + 1,) in m for unknowns z."""
        row = np.zeros(2 * self.linear.harmonics + 1)
        row[self.indices] = z
        return row

    def at(self, parameter: str, value: float) -> Balance:
        """Return the same balance with one parameter changed.

        The parameter is "omega", "force", or a field of the contact law such as "gap".
        """
        if parameter in (OMEGA_PARAMETER, FORCE_PARAMETER):
            return replace(self, **{parameter: value})  # type: ignore[arg-type]
        law: Any = self.law
        known = [field.name for field in fields(law) if getattr(law, field.name) is not None]
        require(
            parameter in known,
            "parameter",
            parameter,
            f"one of {', '.join([OMEGA_PARAMETER, FORCE_PARAMETER, *known])}",
        )
        return replace(self, law=replace(law, **{parameter: value}))

    def evaluated(self, z: Real, parameter: str) -> tuple[Real, Real]:
        """Return the residual (n,) in N and its Jacobian (n, n + 1).

        The derivatives are with respect to z and the parameter called ``parameter``.
        """
        motion = self.polynomial(z)
        d = self.linear.dynamics(self.omega)
        dynamic = _applied(d.stiffness, motion) + self.force * real_row(d.drive)
        stiffness = _matrix(d.stiffness)
        contact = self.law.contact(motion, dynamic, self.omega / self.linear.multiple, parameter)
        if parameter == OMEGA_PARAMETER:
            moved = _applied(d.stiffness_slope, motion) + self.force * real_row(d.drive_slope)
            last = moved - contact.by_dynamic @ moved - contact.by_omega / self.linear.multiple
        elif parameter == FORCE_PARAMETER:
            last = real_row(d.drive) - contact.by_dynamic @ real_row(d.drive)
        else:
            last = -contact.by_parameter
        jacobian = stiffness - contact.by_motion - contact.by_dynamic @ stiffness
        residual = dynamic - contact.force
        residual[0] += self.centring * motion[0]
        jacobian[0, 0] += self.centring
        indices = self.indices
        return residual[indices], np.column_stack(
            [jacobian[np.ix_(indices, indices)], last[indices]]
        )

    def residual(self, parameter: str) -> Residual:
        """Return the residual as a function of z and the parameter, for `follow_branch`."""

        def at(z: Real, value: float) -> tuple[Real, Real]:
            return self.at(parameter, value).evaluated(z, parameter)

        return at

    def response(self, z: Real) -> HarmonicResponse:
        """Return the displacements and the force of a solution z."""
        motion = self.polynomial(z)
        d = self.linear.dynamics(self.omega)
        dynamic = _applied(d.stiffness, motion) + self.force * real_row(d.drive)
        return HarmonicResponse(
            complexes(motion),
            self.linear.tip(complexes(dynamic), self.force, self.omega),
            complexes(dynamic),
        )

    def free(self) -> Real:
        """Return z of an absorber without contact force, a start for motions without contact."""
        d = self.linear.dynamics(self.omega)
        relative = np.zeros_like(d.stiffness)
        relative[1:] = -self.force * d.drive[1:] / d.stiffness[1:]
        return real_row(relative)[self.indices]

    def solved(self, z: Real) -> Real:
        """Return the solution next to z at this frequency and force; raises NoConvergenceError.

        Levenberg and Marquardt's method comes first, because the harmonics of an exact orbit are
        too far from a solution for Newton's method, which follows.
        """
        scale = max(float(np.linalg.norm(z)), np.finfo(float).tiny)

        def values(x: Real) -> tuple[Real, Real]:
            residual, jacobian = self.evaluated(scale * x, FORCE_PARAMETER)
            return residual, scale * jacobian[:, :-1]

        with np.errstate(over="ignore"):  # in the covariance that nobody asks for
            result = scipy.optimize.root(
                values, z / scale, jac=True, method="lm", options={"maxiter": 400}
            )
        problem = ContinuationProblem(
            self.residual(FORCE_PARAMETER),
            FORCE_PARAMETER,
            scale=scale,
            parameter_scale=max(abs(self.force), 1.0),
        )
        return np.asarray(start_branch(problem, scale * result.x, self.force)[1].x[:-1] * scale)

    def at_impacts(
        self,
        angles: Real,
        impulses: Real,
        friction: Callable[[Real], NDArray[np.complex128]] | None = None,
    ) -> Real:
        """Return z of an orbit with impulses on the absorber (N s) at angles (rad).

        Angles are those of the fundamental. This z is a start from an exact orbit. ``friction``
        maps the orders k (H,) to the harmonics of the friction force in N, complex (H,); None: no
        friction.
        """
        d = self.linear.dynamics(self.omega)
        order = np.arange(1.0, len(d.stiffness))
        rate = (
            self.omega / self.linear.multiple / np.pi
        )  # harmonics of an impulse once a period: 2/T
        pushed = np.asarray(
            rate * np.exp(-1j * np.outer(order, angles)) @ impulses, dtype=np.complex128
        )
        if friction is not None:
            pushed += friction(order)
        relative = (pushed - self.force * d.drive[1:]) / d.stiffness[1:]
        return real_row(np.append(0.0, relative))[self.indices]


def _applied(values: NDArray[np.complex128], row: Real) -> Real:
    """Return the polynomial whose harmonics are multiplied by complex values (H + 1,)."""
    return real_row(values * complexes(row))


def _matrix(values: NDArray[np.complex128]) -> Real:
    """Return the matrix (2H + 1, 2H + 1) of `_applied`."""
    h = len(values) - 1
    matrix = np.zeros((2 * h + 1, 2 * h + 1))
    k = np.arange(1, h + 1)
    matrix[0, 0] = values[0].real
    matrix[k, k] = matrix[k + h, k + h] = values[1:].real
    matrix[k, k + h] = values[1:].imag
    matrix[k + h, k] = -values[1:].imag
    return matrix


def _law(
    model: ModalModel, absorber: SlidingAbsorber, mass: float, weight: float, friction_weight: float
) -> ContactForceLaw:
    walls = absorber.walls
    friction = absorber.friction
    gap = None if walls is None else walls.gap
    limit = None if friction is None else friction.limit
    if isinstance(walls, CompliantWalls) or isinstance(friction, ElasticCoulombFriction):
        stiffness = None
        if isinstance(walls, CompliantWalls):
            stiffness = walls.stiffness
            allowed = "1 for harmonic balance, whose compliant walls have no damper"
            require(walls.restitution == 1, "restitution", walls.restitution, allowed)
        return CompliantContact(
            gap,
            stiffness,
            limit,
            friction.stiffness if isinstance(friction, ElasticCoulombFriction) else None,
        )
    if walls is not None:
        require(
            isinstance(walls, RigidWalls),
            "walls",
            walls,
            "RigidWalls or CompliantWalls: the dynamic Lagrangian method knows no impact law",
        )
        allowed = (
            "1, for the dynamic Lagrangian method knows no impact law, only conservative contact "
            "(exact orbits take any restitution)"
        )
        require(walls.restitution == 1, "restitution", walls.restitution, allowed)
    assert friction is None or isinstance(friction, CoulombFriction)
    if friction is not None:
        ratio = friction.static_ratio
        require(ratio == 1, "static_ratio", ratio, "1 for harmonic balance")
    first = float(np.min(model.omega))
    return RigidContact(gap, limit, weight * mass * first**2, friction_weight * mass * first)


def harmonic_balance(
    scene: Scene,
    omega: float,
    force: float,
    harmonics: int = 20,
    weight: float = WEIGHT,
    friction_weight: float = FRICTION_WEIGHT,
    *,
    grounded_damper: float = 0.0,
    symmetric: bool = True,
    multiple: int = 1,
) -> Balance:
    """Return the harmonic balance of a scene with one sliding absorber.

    Parameters
    ----------
    scene : Scene
        Structure with one sliding absorber.
    omega : float
        Frequency of the force in rad/s.
    force : float
        Amplitude of the force in N.
    harmonics : int, optional
        Highest order H.
    weight : float, optional
        Weight of rigid walls in m_a omega_1^2.
    friction_weight : float, optional
        Weight of rigid friction in m_a omega_1.
    grounded_damper : float, optional
        Damper between absorber and ground in N s/m; the paper has `PAPER_DAMPER`.
    symmetric : bool, optional
        Keep only odd harmonics.
    multiple : int, optional
        Period in periods of the force.

    Returns
    -------
    Balance
        The equations. `Balance.solved` solves them and `hill_multipliers` gives the stability.

    Raises
    ------
    ParameterError
        Another absorber, a restitution below 1, or an even multiple for a symmetric orbit.

    Notes
    -----
    Friction depends on the walls' force with truncated harmonics. With 20 harmonics the error is
    2e-4 of the largest displacement.
    """
    absorber = scene.absorber
    require(
        isinstance(absorber, SlidingAbsorber),
        "absorber",
        absorber,
        "one absorber with walls, friction or both",
    )
    assert isinstance(absorber, SlidingAbsorber)
    require_weightless(absorber, "harmonic balance")
    weight = positive("weight", weight)
    friction_weight = positive("friction_weight", friction_weight)
    require(
        not symmetric or multiple % 2 == 1,
        "multiple",
        multiple,
        "odd for orbits that repeat with the other sign after half a period",
    )
    mass = absorber.mass_ratio * scene.model.beam_mass
    linear = JointOfMass(scene.model, mass, harmonics, grounded_damper, multiple)
    law = _law(scene.model, absorber, mass, weight, friction_weight)
    return Balance(
        linear,
        law,
        omega,
        force,
        symmetric,
        CENTRING * weight * mass * float(np.min(scene.model.omega)) ** 2,
    )


def hill_multipliers(balance: Balance, z: Real) -> Complex:
    """Return the 2 N_m + 2 Floquet multipliers of a solution z, the largest first.

    For a symmetric balance they are those over half a period with the mirror image. They converge
    with the number of harmonics at compliant walls. At rigid walls the size of a fast pair does not
    converge (docs/harmonic_balance.md); use `Orbit.stability` there. Raises ParameterError for
    elastic friction, whose force depends on the motion's past.
    """
    linear = balance.linear
    law = balance.law
    elastic = isinstance(law, CompliantContact) and law.friction_limit is not None
    require(not elastic, "friction", law, "rigid, or none, for Hill's method")
    result: list[tuple[float, complex, int]] = []
    for kind in (0, 1):
        exponents, order, omega = _exponents(balance, z, kind)
        sign = 1 if balance.symmetric == (kind == 1) else -1
        result += [
            (at, complex(sign * np.exp(np.pi / omega * exponent)), kind)
            for at, exponent in zip(order, exponents, strict=True)
        ]
    taken: list[tuple[float, complex, int]] = []
    for one in sorted(result, key=lambda each: each[0]):
        if all(
            one[2] == other[2] or abs(one[1] - other[1]) > MULTIPLIER_TOL * abs(one[1])
            for other in taken
        ):
            taken.append(one)
    return np.array(
        sorted(
            (value for _, value, _ in taken[: 2 * linear.model.modes + 2]), key=abs, reverse=True
        )
    )


def _exponents(balance: Balance, z: Real, kind: int) -> tuple[Complex, Real, float]:
    """Return the exponents (1/s) of disturbances of even (0) or odd (1) order.

    The other results are the mean order of each, and the frequency (rad/s) to which orders refer.
    """
    linear = balance.linear
    law = balance.law
    rows = [balance.polynomial(z), real_row(balance.response(z).contact)]
    omega = balance.omega / linear.multiple
    if not balance.symmetric:  # over two periods
        once = np.array([complexes(row) for row in rows])
        omega = omega / 2
        twice = np.zeros((2, 2 * once.shape[1] - 1), complex)
        twice[:, ::2] = once
        rows = [real_row(row) for row in twice]
    h = len(rows[0]) // 2
    orders = np.concatenate([[0], np.arange(1, h + 1), np.arange(1, h + 1)])
    selected = np.flatnonzero(orders % 2 == kind)
    contact = law.contact(rows[0], rows[1], omega, OMEGA_PARAMETER)
    turn, held, slope, rate = (
        each[np.ix_(selected, selected)]
        for each in (
            omega * derivative(np.eye(2 * h + 1)).T,
            contact.by_dynamic,
            contact.by_motion,
            contact.by_rate,
        )
    )
    model = linear.model
    tip = linear.model.tip_shape
    across = np.append(-tip, 1.0)
    push = np.append(-tip, 1 / linear.mass)
    losses = np.append(2 * model.damping_ratio * model.omega, linear.grounded_damper / linear.mass)
    one = np.eye(len(selected))
    bodies = np.eye(len(across))
    size = len(across) * len(selected)
    flow = np.block([
        [-np.kron(bodies, turn), np.eye(size), np.zeros((size, len(selected)))],
        [
            -np.kron(np.diag(np.append(model.omega**2, 0.0)), one),
            -np.kron(bodies, turn) - np.kron(np.diag(losses), one),
            np.kron(push[:, None], one),
        ],
        [np.kron(across[None], slope - rate @ turn), np.kron(across[None], rate), held - one],
    ])  # fmt: skip
    exponents, vectors = scipy.linalg.eig(
        flow, scipy.linalg.block_diag(np.eye(2 * size), np.zeros_like(one))
    )
    inside = np.isfinite(exponents) & (np.abs(exponents.imag) < STRIP * omega)
    shares = np.sum(
        np.abs(vectors[:size, inside].reshape(len(across), len(selected), -1)) ** 2, axis=0
    )
    inside[inside] = ok = np.sum(shares, axis=0) > 0
    return (
        exponents[inside],
        orders[selected] @ (shares[:, ok] / np.sum(shares[:, ok], axis=0)),
        omega,
    )
