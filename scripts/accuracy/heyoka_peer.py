"""heyoka as a peer: one Taylor integrator for each regime, with directional terminal events."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import heyoka
import numpy as np
from numpy.typing import NDArray

from accuracy.contact_automaton import Automaton, Regime
from accuracy.event_driven import Integrator, Mechanics, PeerFailedError

Array = NDArray[np.float64]
SMALL = 12  # modes up to which the whole step is unrolled; above it, that takes minutes to compile


def _system(mechanics: Mechanics, regime: Regime) -> tuple[list[tuple[Any, Any]], list[Any]]:
    """Return the equations of a regime and the expressions of its guards."""
    n = mechanics.modes
    names = [*(f"q{i}" for i in range(n)), "qa", *(f"u{i}" for i in range(n)), "va"]
    names += ["work", "loss"] if mechanics.energy else []
    x = heyoka.make_vars(*names)
    q, qa, u, va = x[:n], x[n], x[n + 1 : 2 * n + 1], x[2 * n + 1]
    t = heyoka.time
    force = mechanics.drive.amplitude * heyoka.cos(mechanics.drive.phase + (mechanics.start_omega + 0.5 * mechanics.slope * t) * t)
    free = [float(mechanics.force_shape[i]) * force - float(mechanics.square[i]) * q[i] - float(mechanics.rate[i]) * u[i] for i in range(n)]
    tip = [float(value) for value in mechanics.tip_shape]
    y = qa - heyoka.sum([tip[i] * q[i] for i in range(n)])
    gamma = va - heyoka.sum([tip[i] * u[i] for i in range(n)])
    if regime.joined:
        contact = heyoka.sum([tip[i] * free[i] for i in range(n)]) * (1 / mechanics.compliance)
    else:
        contact = regime.constant - regime.stiffness * (y - regime.rest) - regime.damping * gamma
        contact = contact + 0.0 * qa if regime.stiffness == 0 and regime.damping == 0 else contact
    rates = [*u, va, *(free[i] - tip[i] * contact for i in range(n)), contact * (1 / mechanics.mass)]
    if mechanics.energy:
        rates.append(force * heyoka.sum([float(mechanics.force_shape[i]) * u[i] for i in range(n)]))
        rates.append(heyoka.sum([float(mechanics.rate[i]) * u[i] * u[i] for i in range(n)]) - contact * gamma)
    guards = [g.constant + g.y_weight * y + g.gamma_weight * gamma + g.force_weight * contact for g in regime.guards]
    return list(zip(x, rates, strict=True)), guards


@dataclass
class HeyokaRegimes:
    """The compiled integrators of one scene and drive; calling it makes an `Integrator`. Compilation is not part of a run's time."""

    tolerance: float
    compiled: dict[str, Any] = field(default_factory=dict)

    def __call__(self, mechanics: Mechanics, automaton: Automaton) -> Integrator:
        names = _reachable(automaton)
        for name in names:
            if name not in self.compiled:
                self.compiled[name] = self._compile(mechanics, automaton.regime(name))

        def integrate(regime: Regime, start: float, stop: float, state: Array) -> tuple[float, Array, int]:
            integrator = self.compiled[regime.name]
            integrator.time = start
            integrator.state[:] = state
            if regime.guards:
                integrator.reset_cooldowns()
            outcome = integrator.propagate_until(stop)[0]
            if outcome == heyoka.taylor_outcome.time_limit:
                return stop, np.array(integrator.state), -1
            hit = -int(outcome.value if hasattr(outcome, "value") else outcome) - 1
            if not 0 <= hit < len(regime.guards):
                raise PeerFailedError(f"heyoka stopped with {outcome}")
            return float(integrator.time), np.array(integrator.state), hit

        return integrate

    def _compile(self, mechanics: Mechanics, regime: Regime) -> Any:
        system, guards = _system(mechanics, regime)
        events = [heyoka.t_event(guard, direction=heyoka.event_direction.negative) for guard in guards]
        start = [0.0] * len(system)
        return heyoka.taylor_adaptive(system, start, tol=self.tolerance, t_events=events, compact_mode=mechanics.modes > SMALL)


def _reachable(automaton: Automaton) -> list[str]:
    """Return the regimes that a run can meet."""
    if automaton.gap is None and automaton.limit is None:
        return ["linear"]
    names = ["free"] if automaton.limit is None else ["slide +", "slide -", "stuck"]
    if automaton.wall_stiffness is not None:
        names += ["contact +", "contact -"]
    if automaton.restitution is not None and automaton.restitution < 1:
        names += ["held +", "held -"]
    return names


def heyoka_integrator(tolerance: float) -> Callable[[Mechanics, Automaton], Integrator]:
    return HeyokaRegimes(tolerance)
