"""heyoka as a peer: one Taylor integrator for each regime, with directional terminal events.

A guard that is zero at the start of a step hides its next zero from heyoka, within the same step,
without a word. So each regime that starts on a guard is entered by a very short step without
events, after which all guards must be positive.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from impact_env.extras import optional
from reference.contact import Automaton, Regime
from studies.accuracy.event_driven import Integrator, Mechanics, PeerFailedError
from studies.study import Array

with optional():
    import heyoka

LEAD = 1e-3  # of 1/omega of the highest mode: the step without events
SMALL = 12  # modes up to which the whole step is unrolled; above it, that takes minutes to compile


def _system(mechanics: Mechanics, regime: Regime) -> tuple[list[tuple[Any, Any]], list[Any]]:
    """Return the equations of a regime and the expressions of its guards."""
    n = mechanics.modes
    model = mechanics.model
    names = [*(f"q{i}" for i in range(n)), "qa", *(f"u{i}" for i in range(n)), "va"]
    names += ["work", "loss"] if mechanics.energy else []
    x = heyoka.make_vars(*names)
    q = x[:n]
    qa = x[n]
    u = x[n + 1 : 2 * n + 1]
    va = x[2 * n + 1]
    t = heyoka.time
    force = mechanics.drive.amplitude * heyoka.cos(
        mechanics.drive.phase + (mechanics.start_omega + 0.5 * mechanics.slope * t) * t
    )
    free = [
        float(model.force_shape[i]) * force
        - float(mechanics.square[i]) * q[i]
        - float(mechanics.rate[i]) * u[i]
        for i in range(n)
    ]
    tip = [float(value) for value in model.tip_shape]
    y = qa - heyoka.sum([tip[i] * q[i] for i in range(n)])
    gamma = va - heyoka.sum([tip[i] * u[i] for i in range(n)])
    if regime.joined:
        contact = heyoka.sum([tip[i] * free[i] for i in range(n)]) * (1 / mechanics.compliance)
    else:
        contact = regime.constant - regime.stiffness * (y - regime.rest) - regime.damping * gamma
        contact = contact + 0.0 * qa if regime.stiffness == 0 and regime.damping == 0 else contact
    rates = [
        *u,
        va,
        *(free[i] - tip[i] * contact for i in range(n)),
        contact * (1 / mechanics.mass),
    ]
    if mechanics.energy:
        rates.append(force * heyoka.sum([float(model.force_shape[i]) * u[i] for i in range(n)]))
        rates.append(
            heyoka.sum([float(mechanics.rate[i]) * u[i] * u[i] for i in range(n)]) - contact * gamma
        )
    guards = [
        g.constant + g.y_weight * y + g.gamma_weight * gamma + g.force_weight * contact
        for g in regime.guards
    ]
    return list(zip(x, rates, strict=True)), guards


@dataclass
class HeyokaRegimes:
    """The compiled integrators of one scene and drive.

    A call makes an `Integrator`. Compilation does not count in the time of a run.
    """

    tolerance: float
    compiled: dict[str, tuple[Any, Any]] = field(default_factory=dict)  # with events, and without

    def __call__(self, mechanics: Mechanics, automaton: Automaton) -> Integrator:
        """Compile the regimes that can occur in a run, and return their integrator."""
        for name in _reachable(automaton):
            if name not in self.compiled:
                self.compiled[name] = self._compile(mechanics, automaton.regime(name))
        lead = LEAD / float(np.max(mechanics.model.omega))

        def integrate(
            regime: Regime, start: float, stop: float, state: Array
        ) -> tuple[float, Array, int]:
            watching, blind = self.compiled[regime.name]
            if regime.guards and start > 0 and start + lead < stop:
                blind.time = start
                blind.state[:] = state
                blind.propagate_until(start + lead)
                start = start + lead
                state = blind.state
                if any(
                    mechanics.value(regime, guard, start, np.array(state)) <= 0
                    for guard in regime.guards
                ):
                    raise PeerFailedError(
                        f"a return to a guard within {LEAD:g} of the fastest mode's time"
                    )
            watching.time = start
            watching.state[:] = state
            if regime.guards:
                watching.reset_cooldowns()
            outcome = watching.propagate_until(stop)[0]
            if outcome == heyoka.taylor_outcome.time_limit:
                return stop, np.array(watching.state), -1
            hit = -int(outcome.value if hasattr(outcome, "value") else outcome) - 1
            if not 0 <= hit < len(regime.guards):
                raise PeerFailedError(f"heyoka stopped with {outcome}")
            return float(watching.time), np.array(watching.state), hit

        return integrate

    def _compile(self, mechanics: Mechanics, regime: Regime) -> tuple[Any, Any]:
        system, guards = _system(mechanics, regime)
        events = [
            heyoka.t_event(guard, direction=heyoka.event_direction.negative) for guard in guards
        ]

        def compiled(t_events: list[Any]) -> Any:
            options = {"tol": self.tolerance, "compact_mode": mechanics.modes > SMALL}
            return heyoka.taylor_adaptive(system, [0.0] * len(system), t_events=t_events, **options)

        return compiled(events), compiled([])


def _reachable(automaton: Automaton) -> list[str]:
    """Return the regimes that can occur in a run."""
    if automaton.gap is None and automaton.limit is None:
        return ["linear"]
    names = ["free"] if automaton.limit is None else ["slide +", "slide -", "stuck"]
    if automaton.wall_stiffness is not None:
        names += ["contact +", "contact -"]
    if automaton.restitution is not None and automaton.restitution < 1:
        names += ["held +", "held -"]
    return names
