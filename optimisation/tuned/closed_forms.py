"""Tunings of the linear absorber in closed form: one mode, no damping of its own. Start values and tests for the numerical ones.

The mass ratio that counts for a resonance is the *effective* one, mu = m_a phi_tip,r^2, absorber mass over the modal mass seen at
the absorber: four times the plain ratio to the beam's mass for the free end of a cantilever. The paper (section 6) names Den Hartog's
rule, but its values follow from a modal mass of one (`paper_rule`) and twice the rule's damping: `PAPER` is mistuned.
"""

import numpy as np

from impact_env.modes import ModalModel
from impact_env.parameters import DEFAULT_MASS_RATIO, TunedAbsorber, instance, positive, require

PAPER = TunedAbsorber()  # the paper's values are the defaults


def effective_mass_ratio(model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1) -> float:
    """Return mu = m_a phi_tip,r^2, the absorber mass over the resonance's effective modal mass at the tip.

    ``mass_ratio`` is m_a over the beam's mass. Raises ParameterError if the mode has a node at the absorber: nothing can be tuned there.
    """
    instance("model", model, ModalModel).resonance_omega(resonance)
    mass = positive("mass_ratio", mass_ratio) * model.beam_mass
    shape = float(model.tip_shape[resonance - 1])
    require(shape != 0, f"tip_shape of mode {resonance}", shape, "not 0: an absorber at a node of a mode cannot act on it")
    return mass * shape**2


def _tuned(model: ModalModel, mass_ratio: float, resonance: int, frequency_ratio: float, damping_ratio: float) -> TunedAbsorber:
    """Return the absorber with omega_a = frequency_ratio * omega_r and c = 2 m_a omega_a * damping_ratio."""
    mass, omega = mass_ratio * model.beam_mass, frequency_ratio * model.resonance_omega(resonance)
    return TunedAbsorber(mass_ratio, mass * omega**2, 2 * mass * omega * damping_ratio)


def den_hartog(model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1) -> TunedAbsorber:
    """Return Den Hartog's tuning of a resonance: fixed points of equal height, damping the mean of the two that flatten one of them.

    omega_a/omega_r = 1/(1 + mu), c/(2 m_a omega_a) = sqrt(3 mu / (8 (1 + mu))) with the effective mu (one undamped mode). The same
    damping referred to the beam's frequency, c/(2 m_a omega_r), has (1 + mu)^3 under the root: the two forms are easily confused.
    """
    mu = effective_mass_ratio(model, mass_ratio, resonance)
    return _tuned(model, mass_ratio, resonance, 1 / (1 + mu), float(np.sqrt(3 * mu / (8 * (1 + mu)))))


def undamped_minimax(model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1) -> TunedAbsorber:
    """Return the exact minimum of the largest amplitude for one undamped mode (force to displacement): both peaks are equal.

    With r = sqrt(4 + 3 mu): omega_a/omega_r = 2/(1 + mu) sqrt(2 (16 + 23 mu + 9 mu^2 + 2 (2 + mu) r) / (3 (64 + 80 mu + 27 mu^2)))
    and c/(2 m_a omega_a) = sqrt((8 + 9 mu - 4 r)/(1 + mu))/4 (the closed-form exact solution of Nishihara and Asami).
    """
    mu = effective_mass_ratio(model, mass_ratio, resonance)
    r = np.sqrt(4 + 3 * mu)
    frequency = 2 / (1 + mu) * np.sqrt(2 * (16 + 23 * mu + 9 * mu**2 + 2 * (2 + mu) * r) / (3 * (64 + 80 * mu + 27 * mu**2)))
    # 8 + 9 mu - 4 r without the cancellation at small mu
    damping = np.sqrt((9 * mu - 12 * mu / (r + 2)) / (1 + mu)) / 4
    return _tuned(model, mass_ratio, resonance, float(frequency), float(damping))


def undamped_h2(model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1) -> TunedAbsorber:
    """Return the exact minimum of the displacement's variance under white noise at the mode, undamped.

    omega_a/omega_r = sqrt(1 + mu/2)/(1 + mu), c/(2 m_a omega_a) = sqrt(mu (4 + 3 mu)/(8 (1 + mu)(2 + mu))) (Warburton's optimum for a
    random force on the main mass).
    """
    mu = effective_mass_ratio(model, mass_ratio, resonance)
    return _tuned(model, mass_ratio, resonance, float(np.sqrt(1 + mu / 2) / (1 + mu)), float(np.sqrt(mu * (4 + 3 * mu) / (8 * (1 + mu) * (2 + mu)))))


def paper_rule(model: ModalModel, mass_ratio: float = DEFAULT_MASS_RATIO, resonance: int = 1) -> TunedAbsorber:
    """Return the rule behind the paper's values, for any mass and resonance: Den Hartog's rule with m_a over 1 kg as mass ratio, damping doubled.

    For the paper's beam it gives the paper's k = 701.8 N/m and c = 0.728 N s/m to the digits printed. Not a rule to follow.
    """
    mu = positive("mass_ratio", mass_ratio) * instance("model", model, ModalModel).beam_mass  # in kg, over a modal mass of one
    return _tuned(model, mass_ratio, resonance, 1 / (1 + mu), 2 * float(np.sqrt(3 * mu / (8 * (1 + mu)))))
