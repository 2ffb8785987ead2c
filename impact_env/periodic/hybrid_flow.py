"""Linear motion between two events of any contact.

The propagator of a state, and its derivatives by force and frequency, in closed form.

A state (S,) is that of `InitialState.vector`, 2 N_m + 2 n numbers: displacements of modes and
absorbers, then their velocities. With elastic friction the slider's position is a further entry.
Absorbers that are joined to the structure, or on springs, are parts of coupled modes; a free
absorber moves under a constant force.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.periodic.hybrid_case import HybridCase
from impact_env.regime_sets import SetModes, solve_set_modes
from impact_env.regimes import RegimeModes, checked_modes, solve_own_modes
from impact_env.scene import Scene

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


class ContactRegime(NamedTuple):
    """The contact state of each of n absorbers between two events.

    Attributes
    ----------
    joined : tuple of bool
        Whether each absorber moves with the structure.
    sign : tuple of int
        Slip direction of each absorber, 0 without slip.
    wall : int
        Wall whose spring an absorber touches, -1 or 1; 0 for none.
    sticks : bool
        Whether the slider of elastic friction sticks.
    """

    joined: tuple[bool, ...]
    sign: tuple[int, ...]
    wall: int = 0
    sticks: bool = False


@dataclass(frozen=True, eq=False)
class RegimeModel:
    """Exponentials of a regime.

    Attributes
    ----------
    values : array, (J,)
        Exponents in 1/s.
    out : array, (2 N_m + 2 n, J)
        State per unit of each amplitude.
    into : array, (J, 2 N_m + 2 n)
        Amplitudes per unit of each entry of a state.
    drive : array, (J,)
        Response of the amplitudes to the force.
    pushes : array, (J, n)
        Response of the amplitudes to a force between each absorber and the structure.
    free, joined : tuple of int
        Absorbers that move by themselves, and with the structure.
    stiffness, damper : float
        Springs (N/m) and dampers (N s/m) that act.
    """

    values: Complex
    out: Complex
    into: Complex
    drive: Complex
    pushes: Complex
    free: tuple[int, ...]
    joined: tuple[int, ...]
    stiffness: float = 0.0
    damper: float = 0.0


@lru_cache(maxsize=64)
def _rigid_model(scene: Scene, joined: tuple[bool, ...]) -> RegimeModel:
    """Return the regime of a set of joined absorbers."""
    model = scene.model
    shapes = scene.absorber_shapes
    which = [a for a, held in enumerate(joined) if held]
    modes: SetModes = solve_set_modes(model, scene.absorber_masses[which], shapes[which])
    n = model.modes
    half = n + len(joined)
    count = np.where(modes.values.imag == 0, 1.0, 2.0)
    out = np.zeros((2 * half, len(modes.values)), complex)
    out[:n] = modes.shapes.T * count
    out[half : half + n] = out[:n] * modes.values
    into = np.zeros((len(modes.values), 2 * half), complex)
    into[:, :n] = modes.into[:, :n]
    into[:, half : half + n] = modes.into[:, n:]
    return RegimeModel(
        modes.values,
        out,
        into,
        modes.weights @ model.one_phase_force_shape,
        -modes.weights @ shapes.T,
        tuple(a for a, held in enumerate(joined) if not held),
        tuple(which),
    )


@lru_cache(maxsize=64)
def _sprung_model(scene: Scene, mass: float, stiffness: float, damper: float) -> RegimeModel:
    """Return the regime of an absorber on springs, or free where they are absent."""
    model = scene.model
    free = stiffness == 0
    modes: RegimeModes = (
        solve_own_modes(model, np.arange(model.modes))
        if free
        else checked_modes(model, mass, stiffness, damper)
    )
    return RegimeModel(
        modes.values,
        modes.out,
        modes.into,
        modes.drive,
        modes.relative[:, None],
        (0,) if free else (),
        (),
        stiffness,
        damper,
    )


def regime_model(case: HybridCase, regime: ContactRegime) -> RegimeModel:
    """Return the exponentials of a regime of a case."""
    laws = case.laws
    if not laws.compliant:
        return _rigid_model(case.scene, regime.joined)
    wall = regime.wall != 0
    stiffness = laws.wall_stiffness * wall + laws.slider_stiffness * regime.sticks
    return _sprung_model(case.scene, float(laws.mass[0]), stiffness, laws.wall_damper * wall)


@dataclass(frozen=True, eq=False)
class LinearPiece:
    """The motion in one regime, from ``time`` (s after the section).

    At this time the force has the ``phase`` (rad) and the state is ``begin`` (S,).
    """

    case: HybridCase
    regime: ContactRegime
    time: float
    phase: float
    begin: Array

    @cached_property
    def model(self) -> RegimeModel:
        """Exponentials of the regime."""
        return regime_model(self.case, self.regime)

    @cached_property
    def constant_forces(self) -> Array:
        """Constant part (n,) of the forces on the absorbers in N.

        It consists of sliding friction, and of the springs' forces at zero relative displacement.
        """
        laws = self.case.laws
        force = -np.array(self.regime.sign) * laws.limit
        if laws.compliant:
            if self.regime.wall != 0:
                force = force + laws.wall_stiffness * laws.gap * self.regime.wall
            if self.regime.sticks:
                force = force + laws.slider_stiffness * self.begin[-1]
        return np.where(self.regime.joined, 0.0, force)

    @cached_property
    def _amplitudes(self) -> tuple[Complex, Complex, Complex]:
        """Modal amplitudes (J,) of the forced motion at phase 0.

        The three arrays are the parts that rotate with the force and against it, per newton, and
        the part of the constant forces.
        """
        model = self.model
        omega = self.case.omega
        with np.errstate(divide="ignore", invalid="ignore"):
            up = 0.5 * model.drive / (1j * omega - model.values)
            down = 0.5 * model.drive / (-1j * omega - model.values)
        return up, down, -model.pushes @ self.constant_forces / model.values

    def _forced(self, phase: float) -> Complex:
        up, down, _ = self._amplitudes
        return np.asarray(up * np.exp(1j * phase) + down * np.exp(-1j * phase))

    @cached_property
    def _free(self) -> Complex:
        core = self.begin[: self.model.into.shape[1]]
        return np.asarray(
            self.model.into @ core
            - self.case.force * self._forced(self.phase)
            - self._amplitudes[2]
        )

    def states(self, dts: Array) -> Array:
        """Return the states (K, S) at times (K,) in s after the piece's start."""
        case = self.case
        model = self.model
        up, down, rest = self._amplitudes
        turned = case.force * np.exp(1j * (self.phase + case.omega * dts))
        slots = (
            np.exp(np.outer(dts, model.values)) * self._free
            + np.outer(turned, up)
            + np.outer(np.conj(turned), down)
            + rest
        )
        states = np.real(slots @ model.out.T)
        return self._with_absorbers(states, dts)

    def _with_absorbers(self, states: Array, dts: Array) -> Array:
        """Return states (K, S) with the motion of free absorbers and the slider added.

        ``states`` has the motion of the coupled modes at ``dts`` (K,) in s.
        """
        case = self.case
        n = case.scene.model.modes
        half = n + case.scene.places
        shapes = case.scene.absorber_shapes
        begin = self.begin
        for a in self.model.free:
            acceleration = self.constant_forces[a] / case.laws.mass[a]
            rate = begin[half + n + a]
            states[:, n + a] = begin[n + a] + dts * (rate + 0.5 * dts * acceleration)
            states[:, half + n + a] = rate + dts * acceleration
        for a in self.model.joined:
            offset = float(begin[n + a] - shapes[a] @ begin[:n])
            states[:, n + a] = states[:, :n] @ shapes[a] + offset
            states[:, half + n + a] = states[:, half : half + n] @ shapes[a]
        if not case.laws.has_slider:
            return states
        slider = np.full(len(dts), begin[-1])
        if not self.regime.sticks:
            row = relative_rows(case)[0][0]
            slider = slider + states @ row[: 2 * half] - float(row @ begin)
        return np.column_stack([states, slider])

    def propagator(self, dt: float) -> Array:
        """Return the derivative (S, S) of the state after ``dt`` (s) by the state before."""
        case = self.case
        model = self.model
        n = case.scene.model.modes
        half = n + case.scene.places
        size = len(self.begin)
        matrix = np.zeros((size, size))
        core = 2 * half
        decay = np.exp(model.values * dt)
        matrix[:core, :core] = np.real((model.out * decay) @ model.into)
        if self.regime.sticks:
            slots = -model.pushes[:, 0] * case.laws.slider_stiffness / model.values
            by_slider = np.real(model.out @ (slots * (1 - decay)))
            matrix[:core, -1] = by_slider
        for a in model.free:
            matrix[n + a, n + a] = 1.0
            matrix[n + a, half + n + a] = dt
            matrix[half + n + a, half + n + a] = 1.0
        for a in model.joined:
            shape = case.scene.absorber_shapes[a]
            matrix[n + a] = shape @ matrix[:n]
            matrix[half + n + a] = shape @ matrix[half : half + n]
            matrix[n + a, n + a] += 1.0
            matrix[n + a, :n] -= shape
        if case.laws.has_slider:
            matrix[-1] = 0.0
            matrix[-1, -1] = 1.0
            if not self.regime.sticks:
                row = relative_rows(case)[0][0]
                matrix[-1] += row @ matrix - row
        return matrix

    def parameter_columns(self, dt: float) -> Array:
        """Return the derivatives (S, 2) of the state after ``dt`` (s), for a given initial state.

        They are with respect to the force (N) and to its frequency (rad/s) at fixed time: the phase
        of the force is that at the section plus frequency times time.
        """
        case = self.case
        model = self.model
        up, down, _ = self._amplitudes
        omega = case.omega
        decay = np.exp(model.values * dt)
        end = self.phase + omega * dt
        by_force = self._forced(end) - decay * self._forced(self.phase)
        slopes = (1j * case.force * up, -1j * case.force * down)
        offsets = (
            -slopes[0] / (1j * omega - model.values),
            -slopes[1] / (-1j * omega - model.values),
        )

        def particular(time: float, phase: float) -> Complex:
            ahead = (slopes[0] * time + offsets[0]) * np.exp(1j * phase)
            back = (slopes[1] * time + offsets[1]) * np.exp(-1j * phase)
            return np.asarray(ahead + back)

        by_omega = particular(self.time + dt, end) - decay * particular(self.time, self.phase)
        columns = np.real(model.out @ np.column_stack([by_force, by_omega]))
        n = case.scene.model.modes
        half = n + case.scene.places
        for a in model.joined:
            shape = case.scene.absorber_shapes[a]
            columns[n + a] = shape @ columns[:n]
            columns[half + n + a] = shape @ columns[half : half + n]
        if not case.laws.has_slider:
            return columns
        slider = np.zeros(2)
        if not self.regime.sticks:
            slider = relative_rows(case)[0][0][: 2 * half] @ columns
        return np.vstack([columns, slider])

    def contact_forces(self, dt: float, state: Array) -> Array:
        """Return the force (n,) in N on each absorber at ``dt`` (s).

        ``state`` (S,) is the state at this time.
        """
        case = self.case
        model = self.model
        displacement, rate = relative_rows(case)
        force = self.constant_forces.copy()
        if model.stiffness > 0:
            force -= model.stiffness * (displacement @ state) + model.damper * (rate @ state)
        held = list(model.joined)
        if held:
            shapes = case.scene.absorber_shapes
            pull = shapes[held] @ (self._modal_acceleration(dt, state) - shapes.T @ force)
            force[held] = np.linalg.solve(case.compliance[np.ix_(held, held)], pull)
        return force

    def _modal_acceleration(self, dt: float, state: Array) -> Array:
        """Return the modal accelerations (N_m,) without the contact forces."""
        case = self.case
        model = case.scene.model
        n = model.modes
        half = n + case.scene.places
        pull = case.force * np.cos(self.phase + case.omega * dt)
        return np.asarray(
            model.one_phase_force_shape * pull
            - 2 * model.damping_ratio * model.omega * state[half : half + n]
            - model.omega**2 * state[:n]
        )

    def rate(self, dt: float, state: Array) -> Array:
        """Return the time derivative (S,) of the state at ``dt`` (s).

        ``state`` (S,) is the state at this time.
        """
        case = self.case
        half = case.scene.model.modes + case.scene.places
        force = self.contact_forces(dt, state)
        modal = self._modal_acceleration(dt, state) - case.scene.absorber_shapes.T @ force
        result = np.zeros(len(state))
        result[:half] = state[half : 2 * half]
        result[half : 2 * half] = np.concatenate([modal, force / case.laws.mass])
        if case.laws.has_slider and not self.regime.sticks:
            result[-1] = relative_rows(case)[1][0] @ state
        return result


@lru_cache(maxsize=64)
def _relative_rows(scene: Scene, slider: bool) -> tuple[Array, Array]:
    shapes = scene.absorber_shapes
    places, n = shapes.shape
    half = n + places
    displacement = np.zeros((places, 2 * half + slider))
    rate = np.zeros_like(displacement)
    displacement[:, :n] = -shapes
    displacement[:, n:half] = np.eye(places)
    rate[:, half : half + n] = -shapes
    rate[:, half + n : 2 * half] = np.eye(places)
    return displacement, rate


def relative_rows(case: HybridCase) -> tuple[Array, Array]:
    """Return the rows (n, S) of relative displacement (m) and of relative velocity (m/s).

    The product of a row with a state is the absorber's motion minus the structure's.
    """
    return _relative_rows(case.scene, case.laws.has_slider)


def impulse_columns(case: HybridCase) -> Array:
    """Return the changes (S, n) of a state by unit impulses.

    Each impulse acts on one absorber, and the opposite impulse on the structure.
    """
    scene = case.scene
    places, n = scene.absorber_shapes.shape
    half = n + places
    columns = np.zeros((2 * half + case.laws.has_slider, places))
    columns[half : half + n] = -scene.absorber_shapes.T
    columns[half + n : 2 * half] = np.diag(1 / case.laws.mass)
    return columns
