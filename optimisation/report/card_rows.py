"""Groups of rows that the cards of several commands share: the device, what it bears, its rivals, and what is assumed. Given in SI units."""

import math
from collections.abc import Sequence

from impact_env.modes import ModalModel
from impact_env.parameters import SlidingAbsorber
from optimisation.gap_card import Impacts, Rivals
from optimisation.report.card import Row

Rows = tuple[Row, ...]
RATE = "% per 100 pseudo periods"
NO_DEVICE = "no device in this cavity comes below"


def mass_rows(mass_ratio: float, model: ModalModel) -> Rows:
    """Return an absorber's mass and what it is a share of."""
    own = Row("absorber mass", mass_ratio * model.beam_mass, "kg")
    return own, Row("that is", 100 * mass_ratio, f"% of the structure's {model.beam_mass:.4g} kg")


def device_rows(absorber: SlidingAbsorber, model: ModalModel) -> Rows:
    """Return an impact absorber between rigid walls as it is built."""
    walls, friction = absorber.walls, absorber.friction
    return (
        *mass_rows(absorber.mass_ratio, model),
        Row("clearance to either wall", 1e3 * walls.gap, "mm"),  # type: ignore[union-attr]
        Row("coefficient of restitution", float(walls.restitution)),  # type: ignore[union-attr]
        Row("friction limit", 0.0 if friction is None else friction.limit, "N"),
    )


def rival_rows(rivals: Rivals) -> Rows:
    """Return what other absorbers of the same mass leave."""
    damper = f"best friction damper of this mass, {rivals.damper_limit:.4g} N (estimate)"
    return Row("best tuned absorber of this mass (stationary)", 1e3 * rivals.tuned, "mm"), Row(damper, 1e3 * rivals.damper, "mm")


def borne_rows(gap: float, impacts: Impacts, level: float) -> Rows:
    """Return what a device bears whose structure has the ``level`` in m."""
    return (
        Row("stroke of the absorber, wall to wall", 2e3 * gap, "mm"),
        Row("largest impact speed", impacts.largest, "m/s"),
        Row("RMS impact speed", impacts.rms, "m/s"),
        Row("impacts", impacts.rate, "1/s"),
        Row("power lost in impacts", 1e3 * impacts.power, "mW"),
        Row("largest acceleration of the structure, harmonic part", math.sqrt(2) * level * impacts.omega**2, "m/s^2"),
    )


def assumed_rows(model: ModalModel, resonances: Sequence[int], rate: float | None, more: str = "") -> Rows:
    """Return what levels rest on; ``rate`` None: no sweeps."""
    rows = [
        Row(f"resonance {r}", f"{model.resonance_omega(r) / (2 * math.pi):.4g} Hz, damping ratio {100 * model.damping_ratio[r - 1]:.4g} %")
        for r in dict.fromkeys(resonances)
    ]
    swept = () if rate is None else (Row("sweeps up and down at", rate, RATE),)
    return *rows, Row("modes kept", f"{model.modes}{more or '; more are not tried'}"), *swept


def between(low: float, high: float) -> str:
    """Return a range of forces in words."""
    return "at no force that is known" if math.isnan(low) else f"{low:.3g} to {high:.3g} N"
