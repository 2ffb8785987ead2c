"""One step of the classical Runge-Kutta method as a linear map, and its energies.

The scene is a set of independent oscillators with one scalar feedback: a force p(y) on the absorber
that depends on an observation y, by the contact laws of the paper (Eqs. elSignorini, elCoulomb).
Laws that a scene lacks have the stiffness or limit 0, so that one kernel integrates every scene.

In each of the four stages the observation y is linear in the state at the step's start, the
excitation, and the p of the earlier stages. The weights are in a table (`new_runge_kutta_table`).
Then one pass over the modes does a whole step. The excitation is the force over its amplitude.

In: the table with the state, the excitation at start, middle and end of the step, the laws. Out:
the state after the step, and the observations of the next one as far as they follow from it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_env.kernels.compiling.jit import NUMBER, jit, jit_allocating, jit_inline, vector_code
from impact_env.kernels.compiling.vector_code import Code, Index, Number
from impact_env.kernels.stepping.grid import NO_SPRING, Spring

# Rows of the table of oscillators. A constant distance between rows spares a run-time check for
# overlap; it is no power of two, so that rows do not share cache lines' low address bits. Q, U:
# displacement and velocity. The others have the weights in the next Q and U: QQ to UU of Q and U,
# QF1 to UF4 of the excitation at start (1), middle (M) and end (4), QP1 to UP4 of the feedback in
# the four stages. Y: eight rows, weights of Q and of U in the observation of each stage. TIP: share
# in the tip's displacement. Q_BEFORE, U_BEFORE: saved state.
STRIDE = 68
(
    Q,
    U,
    QQ,
    QU,
    UQ,
    UU,
    QF1,
    QFM,
    UF1,
    UFM,
    UF4,
    QP1,
    QP2,
    QP3,
    UP1,
    UP2,
    UP3,
    UP4,
    Y,
    TIP,
    Q_BEFORE,
    U_BEFORE,
    ROWS,
) = (*range(19), 26, 27, 28, 29)
# columns of the mix: weights in the observation of a stage, of the excitation at start, middle and
# end and of the feedback in stages 1 to 3
_MIX = 6


class ElasticSlider(NamedTuple):
    """A spring in series with a Coulomb slider, between absorber and tip."""

    limit: float  # friction limit (N), 0: there is no slider
    stiffness: float  # N/m


class ElasticStops(NamedTuple):
    """Two walls that are unilateral springs."""

    gap: float  # distance of either wall from the middle (m)
    stiffness: float  # N/m, 0: there are no walls


class CubicSpring(NamedTuple):
    """A spring with the force stiffness times relative displacement^3, and a damper."""

    cubic_stiffness: float  # N/m^3, 0: neither spring nor damper
    damping: float  # N s/m


NO_STOPS = ElasticStops(np.inf, 0.0)
NO_SLIDER = ElasticSlider(0.0, 0.0)
NO_CUBIC_SPRING = CubicSpring(0.0, 0.0)


class CompliantLaws(NamedTuple):
    """Mass and contact laws of one absorber; without an absorber both masses are 0."""

    mass: float = 0.0  # of a moving absorber (kg), else 0
    added_mass: float = 0.0  # of an absorber that is stuck for the whole run (kg), else 0
    stops: ElasticStops = NO_STOPS  # walls
    slider: ElasticSlider = NO_SLIDER  # friction
    spring: Spring = NO_SPRING  # of a tuned absorber
    cubic: CubicSpring = NO_CUBIC_SPRING  # of a nonlinear energy sink


class ActiveLaws(NamedTuple):
    """The laws that act in one compiled branch of a step; the others are None.

    ``joined_mass``: m_a / (1 + m_a sum tip_shape^2) of a stuck absorber (kg). With all laws in one
    branch, each of the four stages would wait for the arithmetic of laws that are absent.
    """

    stops: ElasticStops | None
    slider: ElasticSlider | None
    spring: Spring | None
    joined_mass: float | None
    cubic: CubicSpring | None


class Oscillator(NamedTuple):
    """One column of the table: q'' + c q' + w2 q = push f - tip p.

    f is the force over its amplitude, p the feedback on the absorber (N).
    """

    w2: float  # omega^2 (1/s^2)
    c: float  # 2 D omega (1/s)
    push: float  # mode shape at the force times amplitude, 0 for the absorber
    tip: float  # share in the tip's displacement; for the absorber -1/sqrt(mass)
    see_q: float  # weight of q in the observation
    see_u: float  # weight of q' in the observation
    see_push: float  # weight of the acceleration push f in the observation


class RelativeVelocityTable(NamedTuple):
    """A second observation, the relative velocity (m/s); of size 0 if no law depends on it."""

    cells: NDArray[np.float64]  # eight rows like those from `Y` on
    mix: NDArray[np.float64]  # (4, 6) as `RungeKuttaTable.mix`


class RungeKuttaTable(NamedTuple):
    """The oscillators in the form that the loop over steps uses."""

    cells: NDArray[np.float64]  # (ROWS * distance between rows,) the rows Q to U_BEFORE
    mix: NDArray[np.float64]  # (4, 6) weights of excitation and feedback in each observation
    modes: int  # N_m
    lanes: int  # N_m + 1 oscillators, rounded up to a multiple of 4
    wide_stride: int | None  # distance between rows, None: `STRIDE`
    h: float  # time step (s)
    speeds: RelativeVelocityTable  # observation of the relative velocity


@jit
def compute_runge_kutta_step(w2, c, h, q, u, w):
    """Return q and u in the four stages and after a step of h (s) of q'' + c q' + w2 q = w.

    ``w`` are the values in the four stages. The ten numbers returned are q1, u1, ..., q4, u4 and
    the new q, u.
    """
    w1, wm2, wm3, w4 = w
    a1 = w1 - w2 * q - c * u
    q2 = q + 0.5 * h * u
    u2 = u + 0.5 * h * a1
    a2 = wm2 - w2 * q2 - c * u2
    q3 = q + 0.5 * h * u2
    u3 = u + 0.5 * h * a2
    a3 = wm3 - w2 * q3 - c * u3
    q4 = q + h * u3
    u4 = u + h * a3
    a4 = w4 - w2 * q4 - c * u4
    return (
        q,
        u,
        q2,
        u2,
        q3,
        u3,
        q4,
        u4,
        q + h / 6.0 * (u + 2.0 * u2 + 2.0 * u3 + u4),
        u + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
    )


@jit_inline
def find_stride(wide_stride):
    """Return the distance between rows: ``wide_stride``, or `STRIDE` if that is None."""
    if wide_stride is None:
        return STRIDE
    return wide_stride


@jit_allocating
def _add_oscillator(table, j, one):
    """Fill column ``j`` of the table with the weights of an `Oscillator`, and update the mix.

    The same is done in ``table.speeds``, unless it is of size 0.
    """
    cells = table.cells
    mix = table.mix
    stride = find_stride(table.wide_stride)
    responses = np.empty((6, 10))
    for k in range(6):  # to the unit vectors of (q, u, w1, w2, w3, w4)
        e = np.zeros(6)
        e[k] = 1.0
        step = compute_runge_kutta_step(
            one.w2, one.c, table.h, e[0], e[1], (e[2], e[3], e[4], e[5])
        )
        responses[k] = np.array(step)
    cells[TIP * stride + j] = one.tip
    for row in range(2):  # new q, new u
        after = responses[:, 8 + row]
        cells[(QQ + 2 * row) * stride + j] = after[0]
        cells[(QU + 2 * row) * stride + j] = after[1]
        cells[(QF1 + 2 * row) * stride + j] = one.push * after[2]
        cells[(QFM + 2 * row) * stride + j] = one.push * (after[3] + after[4])
        for stage in range(3 + row):
            cells[(QP1 + 3 * row + stage) * stride + j] = -one.tip * after[2 + stage]
    cells[UF4 * stride + j] = one.push * responses[5, 9]
    _fill_observation(cells[Y * stride :], mix, stride, j, one, responses)
    if table.speeds.cells.shape[0] > 0:
        speed = Oscillator(one.w2, one.c, one.push, one.tip, 0.0, -one.tip, 0.0)
        _fill_observation(table.speeds.cells, table.speeds.mix, stride, j, speed, responses)


@jit_allocating
def _fill_observation(cells, mix, stride, j, one, responses):
    """Fill column ``j`` of an observation's eight rows, and add to its ``mix`` (4, 6).

    ``responses`` (6, 10) are results of `compute_runge_kutta_step` for unit q, u, w1, ..., w4.
    """
    for stage in range(4):
        response = one.see_q * responses[:, 2 * stage] + one.see_u * responses[:, 2 * stage + 1]
        cells[2 * stage * stride + j] = response[0]
        cells[(2 * stage + 1) * stride + j] = response[1]
        mix[stage, 0] += one.push * response[2]
        mix[stage, 1] += one.push * (response[3] + response[4])
        mix[stage, (stage + 1) // 2] += one.see_push * one.push
        for earlier in range(3):
            mix[stage, 3 + earlier] -= one.tip * response[2 + earlier]


@jit
def _compute_observation_weights(spring, added_mass, tip, w2, c):
    """Return a mode's ``see_q``, ``see_u`` and ``see_push`` (`Oscillator`) in the observation.

    The observation is that of `new_runge_kutta_table`.
    """
    if added_mass > 0.0:
        return -tip * w2, -tip * c, tip
    if spring.stiffness > 0.0:
        return -spring.stiffness * tip, -spring.damping * tip, 0.0
    return -tip, -0.0 * tip, 0.0


@jit_allocating
def _add_absorber(m_a, spring, table, state):
    """Fill column N_m with a moving absorber: an oscillator of frequency zero.

    Its coordinate is sqrt(m_a) times the absorber's displacement. Nothing is done if ``m_a`` is 0.
    """
    if m_a == 0.0:
        return
    stiffness = 1.0
    damping = 0.0
    if spring.stiffness > 0.0:
        stiffness = spring.stiffness
        damping = spring.damping
    root = np.sqrt(m_a)
    n = table.modes
    stride = find_stride(table.wide_stride)
    _add_oscillator(
        table, n, Oscillator(0.0, 0.0, 0.0, -1.0 / root, stiffness / root, damping / root, 0.0)
    )
    table.cells[Q * stride + n], table.cells[U * stride + n] = (
        root * state[n],
        root * state[2 * n + 1],
    )


@jit_allocating
def new_runge_kutta_table(modes, laws, amplitude, state, h, wide_stride):
    """Return the `RungeKuttaTable` of a scene for steps of h (s), with the initial state.

    ``amplitude`` (N) is that of the force; ``state`` (2 N_m + 2,) has the order of
    `runge_kutta_lane`. The observation is the relative displacement (m); with a linear spring, the
    force of spring and damper (N); with an added mass, the acceleration that the tip would have
    without that mass (m/s^2).
    """
    n = modes.omega.shape[0]
    stride = find_stride(wide_stride)
    needed = 1 if laws.cubic.cubic_stiffness > 0.0 else 0  # the relative velocity
    speeds = RelativeVelocityTable(np.zeros(8 * stride * needed), np.zeros((4 * needed, _MIX)))
    table = RungeKuttaTable(
        np.zeros(ROWS * stride),
        np.zeros((4, _MIX)),
        n,
        4 * ((n + 4) // 4),
        wide_stride,
        h,
        speeds,
    )
    for j in range(n):
        w2 = modes.omega[j] * modes.omega[j]
        c = 2.0 * modes.damping_ratio[j] * modes.omega[j]
        tip = modes.tip_shape[j]
        see_q, see_u, see_push = _compute_observation_weights(
            laws.spring, laws.added_mass, tip, w2, c
        )
        _add_oscillator(
            table,
            j,
            Oscillator(w2, c, modes.force_shape[j] * amplitude, tip, see_q, see_u, see_push),
        )
        table.cells[Q * stride + j], table.cells[U * stride + j] = state[j], state[n + 1 + j]
    _add_absorber(laws.mass, laws.spring, table, state)
    return table


@jit
def compute_stop_force(y, stops):
    """Return the walls' force on the absorber (N) at relative displacement y (m).

    The result is 0 if ``stops`` is None.
    """
    if stops is None:
        return 0.0
    if y > stops.gap:
        return -stops.stiffness * (y - stops.gap)
    if y < -stops.gap:
        return -stops.stiffness * (y + stops.gap)
    return 0.0


@jit
def compute_slider_force(y, rest, slider):
    """Return the friction force on the absorber (N) at relative displacement y (m).

    ``rest`` (m) is the slider's position. The result is 0 if ``slider`` is None.
    """
    if slider is None:
        return 0.0
    return -min(max(slider.stiffness * (y - rest), -slider.limit), slider.limit)


@jit_inline
def compute_feedback(y, v, rest, laws):
    """Return the force on the absorber (N) for an observation y, by `ActiveLaws`.

    v (m/s) is the relative velocity; only a nonlinear spring uses it.
    """
    force = compute_stop_force(y, laws.stops) + compute_slider_force(y, rest, laws.slider)
    if laws.spring is not None:
        force -= y
    if laws.joined_mass is not None:
        force += laws.joined_mass * y
    if laws.cubic is not None:
        force -= laws.cubic.cubic_stiffness * y * y * y + laws.cubic.damping * v
    return force


def _step_code(pushed: bool, sampled: bool) -> Any:
    """Return vector code that updates the rows Q and U of a table by a step.

    ``pushed``: the feedback p1 to p4 acts. ``sampled``: the four observations of the next step are
    computed from the new state; else the four numbers that the code returns are 0.
    """

    @vector_code(NUMBER, 4)
    def advance(
        code: Code,
        table,
        lanes: Index,
        stride: Index,
        f1: Number,
        fm: Number,
        f4: Number,
        p1: Number,
        p2: Number,
        p3: Number,
        p4: Number,
    ):
        numbers = (f1, fm, f4, p1, p2, p3, p4)
        sums = [code.sum() for _ in range(4)]

        def of(row: int, j: Any) -> Number:
            return code.vector(table, stride * row + j)

        for j in code.vectors(lanes):
            f1, fm, f4, p1, p2, p3, p4 = (code.spread(number) for number in numbers)
            q = of(Q, j)
            u = of(U, j)
            in_q = [(QU, u), (QF1, f1), (QFM, fm)] + (
                [(QP1, p1), (QP2, p2), (QP3, p3)] if pushed else []
            )
            in_u = [(UU, u), (UF1, f1), (UFM, fm), (UF4, f4)] + (
                [(UP1, p1), (UP2, p2), (UP3, p3), (UP4, p4)] if pushed else []
            )
            q_next = of(QQ, j) * q
            u_next = of(UQ, j) * q
            for row, number in in_q:
                q_next = of(row, j).fma(number, q_next)
            for row, number in in_u:
                u_next = of(row, j).fma(number, u_next)
            code.store(q_next, table, stride * Q + j)
            code.store(u_next, table, stride * U + j)
            if sampled:
                for k, total in enumerate(sums):
                    total.add_product(of(Y + 2 * k, j), q_next)
                    total.add_product(of(Y + 2 * k + 1, j), u_next)
        return [total.total() for total in sums]

    return advance


_step_forced, _step_forced_observed, _step_fed_back, _step_fed_back_observed = (
    _step_code(pushed, sampled) for pushed in (False, True) for sampled in (False, True)
)


@jit_inline
def advance_oscillators(table, forces, at, push, sampled):
    """Advance all oscillators in ``table`` by a step.

    ``forces[at : at + 3]`` is the excitation at start, middle and end. ``push`` are the feedbacks
    in the four stages, or None if all are 0. Returns the parts of the next step's four observations
    that follow from the state, or zeros if ``sampled`` is None.
    """
    cells = table.cells
    lanes = table.lanes
    stride = find_stride(table.wide_stride)
    f1 = forces[at]
    fm = forces[at + 1]
    f4 = forces[at + 2]
    if push is None:
        if sampled is None:
            return _step_forced(cells, lanes, stride, f1, fm, f4, 0.0, 0.0, 0.0, 0.0)
        return _step_forced_observed(cells, lanes, stride, f1, fm, f4, 0.0, 0.0, 0.0, 0.0)
    if sampled is None:
        return _step_fed_back(cells, lanes, stride, f1, fm, f4, push[0], push[1], push[2], push[3])
    return _step_fed_back_observed(
        cells, lanes, stride, f1, fm, f4, push[0], push[1], push[2], push[3]
    )


@jit_allocating
def observe_rows(table, rows):
    """Return the parts of an observation in the next step's four stages that follow from the state.

    ``rows`` are the observation's eight rows, one after another.
    """
    cells = table.cells
    stride = find_stride(table.wide_stride)
    y = np.zeros(4)
    for stage in range(4):
        for j in range(table.lanes):
            y[stage] += rows[2 * stage * stride + j] * cells[Q * stride + j]
            y[stage] += rows[(2 * stage + 1) * stride + j] * cells[U * stride + j]
    return y[0], y[1], y[2], y[3]


@jit_allocating
def compute_relative_velocities(table):
    """Return the relative velocities (m/s) in the next step's four stages.

    They are the parts that follow from the state, or zeros if no law depends on them.
    """
    if table.speeds.cells.shape[0] == 0:
        return 0.0, 0.0, 0.0, 0.0
    return observe_rows(table, table.speeds.cells)


@jit_inline
def _compute_stage_velocity(cubic, speeds, v, k, f, p):
    """Return the relative velocity (m/s) in stage ``k`` (0 to 3), 0 if ``cubic`` is None.

    ``v`` are the parts that follow from the state, ``f`` is the excitation at start, middle and
    end, and ``p`` are the feedbacks in stages 0 to 2, zeros from stage ``k`` on.
    """
    if cubic is None:
        return 0.0
    mix = speeds.mix
    forced = mix[k, 0] * f[0] + mix[k, 1] * f[1] + mix[k, 2] * f[2]
    return v[k] + forced + mix[k, 3] * p[0] + mix[k, 4] * p[1] + mix[k, 5] * p[2]


@jit_inline
def _compute_stages_under(absorber, table, forces, at, laws):
    """Return (four observations, four feedbacks in N) in a step's stages under `ActiveLaws`."""
    y = absorber.y
    rest = absorber.rest
    v = absorber.v
    mix = table.mix
    speeds = table.speeds
    f = f1, fm, f4 = forces[at], forces[at + 1], forces[at + 2]
    y1 = y[0] + mix[0, 0] * f1
    v1 = _compute_stage_velocity(laws.cubic, speeds, v, 0, f, (0.0, 0.0, 0.0))
    p1 = compute_feedback(y1, v1, rest, laws)
    y2 = y[1] + mix[1, 0] * f1 + mix[1, 1] * fm + mix[1, 3] * p1
    v2 = _compute_stage_velocity(laws.cubic, speeds, v, 1, f, (p1, 0.0, 0.0))
    p2 = compute_feedback(y2, v2, rest, laws)
    y3 = y[2] + mix[2, 0] * f1 + mix[2, 1] * fm + mix[2, 3] * p1 + mix[2, 4] * p2
    v3 = _compute_stage_velocity(laws.cubic, speeds, v, 2, f, (p1, p2, 0.0))
    p3 = compute_feedback(y3, v3, rest, laws)
    y4 = (
        y[3]
        + mix[3, 0] * f1
        + mix[3, 1] * fm
        + mix[3, 2] * f4
        + mix[3, 3] * p1
        + mix[3, 4] * p2
        + mix[3, 5] * p3
    )
    v4 = _compute_stage_velocity(laws.cubic, speeds, v, 3, f, (p1, p2, p3))
    p4 = compute_feedback(y4, v4, rest, laws)
    return (y1, y2, y3, y4), (p1, p2, p3, p4)


@jit_inline
def compute_stages(absorber, table, forces, at, laws, joined_mass):
    """Return (four observations, four feedbacks in N) in the stages of a step.

    ``absorber`` is a `runge_kutta.AbsorberStages`; ``forces`` and ``at`` are as in
    `advance_oscillators`. ``joined_mass`` (kg) is that of `ActiveLaws`, 0 unless the absorber is
    stuck. Nothing is modified.
    """
    if laws.cubic.cubic_stiffness > 0.0:
        of_cubic = ActiveLaws(None, None, None, None, laws.cubic)
        return _compute_stages_under(absorber, table, forces, at, of_cubic)
    if laws.spring.stiffness > 0.0:
        of_spring = ActiveLaws(None, None, laws.spring, None, None)
        return _compute_stages_under(absorber, table, forces, at, of_spring)
    if joined_mass > 0.0:
        of_mass = ActiveLaws(None, None, None, joined_mass, None)
        return _compute_stages_under(absorber, table, forces, at, of_mass)
    if laws.slider.limit > 0.0:
        of_slider = ActiveLaws(laws.stops, laws.slider, None, None, None)
        return _compute_stages_under(absorber, table, forces, at, of_slider)
    of_stops = ActiveLaws(laws.stops, None, None, None, None)
    return _compute_stages_under(absorber, table, forces, at, of_stops)


@jit_allocating
def account_step(energy, modes, amplitude, laws, table, rest, stages):
    """Add a step's work and losses (J) to ``energy``, before the table is advanced.

    They are the powers in the four stages with the weights of the method. ``stages`` is (excitation
    at start, middle and end; observations in the four stages; feedbacks in the four stages), and
    ``rest`` (m) the slider's position. Nothing is done if ``energy`` is None.
    """
    if energy is None:
        return
    f, y, p = stages
    cells = table.cells
    n = table.modes
    h = table.h
    stride = find_stride(table.wide_stride)
    totals = energy.totals[0]
    weights = (h / 6.0, h / 3.0, h / 3.0, h / 6.0)
    gamma = np.zeros(4)
    for j in range(n + 1):
        w2 = 0.0
        c = 0.0
        push = 0.0
        if j < n:
            w2 = modes.omega[j] * modes.omega[j]
            c = 2.0 * modes.damping_ratio[j] * modes.omega[j]
            push = modes.force_shape[j] * amplitude
        tip = cells[TIP * stride + j]
        e = (push * f[0], push * f[1], push * f[1], push * f[2])
        w = (e[0] - tip * p[0], e[1] - tip * p[1], e[2] - tip * p[2], e[3] - tip * p[3])
        steps = compute_runge_kutta_step(w2, c, h, cells[Q * stride + j], cells[U * stride + j], w)
        us = (steps[1], steps[3], steps[5], steps[7])
        for s in range(4):
            gamma[s] -= tip * us[s]
            totals.work += weights[s] * e[s] * us[s]
            if j < n:
                energy.modal[j] += weights[s] * c * us[s] * us[s]
    for s in range(4):
        slider_force = compute_slider_force(y[s], rest, laws.slider)
        totals.friction_loss -= weights[s] * slider_force * gamma[s]
        totals.absorber_damping += weights[s] * laws.spring.damping * gamma[s] * gamma[s]
        totals.absorber_damping += weights[s] * laws.cubic.damping * gamma[s] * gamma[s]
