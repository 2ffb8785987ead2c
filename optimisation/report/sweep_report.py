"""The JSON file and the printed summary of the command `sweep`."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from impact_env.ensemble import LaneLevels
from impact_env.laws import modes_in_words, words
from impact_env.loads import Loads, amplitude_in_words
from impact_env.parameters import Beam
from impact_env.plain import from_scene
from impact_env.response import Response
from optimisation.sweep_rate import LEAST_RATIO


@dataclass(frozen=True)
class Result:
    """The recorded run of member 0, levels of the members after it (None: there are none), and the time of one bare integration in s, if measured.

    ``sweep_ratio``: level of such sweeps without absorber over the stationary one; None at a constant frequency. ``measures`` of each member, as
    `optimisation.signals` has them, None unless asked for.
    """

    response: Response
    others: LaneLevels | None
    wall_time: float | None = None
    sweep_ratio: float | None = None
    measures: list[dict[str, Any]] | None = None

    @property
    def levels(self) -> list[float]:
        """Response levels of all members in m."""
        assert self.response.level is not None
        return [self.response.level.value, *([] if self.others is None else self.others.level.tolist())]

    @property
    def ratios(self) -> list[float]:
        """Frequencies of the levels over that of the resonance."""
        assert self.response.level is not None
        return [self.response.level.frequency_ratio, *([] if self.others is None else self.others.frequency_ratio.tolist())]


def contract(result: Result, beam: Beam | None) -> dict[str, object]:
    """Return the content of the JSON file; the scene is written with its ``beam``, or with its modes if that is None."""
    response = result.response
    level, impacts, energy = response.level, response.impacts, response.energy
    assert level is not None
    assert impacts is not None
    return {
        "impact_time_s": impacts.time.tolist(),
        "impact_relative_velocity_m_s": impacts.relative_velocity.tolist(),
        "response_level_m": result.levels,
        "level_frequency_ratio": result.ratios,
        "max_tip_m": level.max_tip,
        "impacts": response.impact_count,
        "stuck_time_s": response.stuck_time,
        **({} if energy is None else {"energy_balance_relative_error": energy.relative_error}),
        "pseudo_periods": response.drive.schedule.periods,
        "sweep_over_stationary_level": result.sweep_ratio,
        **({} if result.wall_time is None else {"wall_s": result.wall_time}),
        **({} if result.measures is None else {"measures": result.measures}),
        "omega_rad_s": response.scene.model.omega.tolist(),
        "scene": from_scene(response.scene, beam),
    }


def describe_run(response: Response, resonance: int) -> str:
    """Say in a line how the run was driven and with which method."""
    schedule, modes = response.drive.schedule, response.scene.model.modes
    if isinstance(response.drive, Loads):
        told = f"{amplitude_in_words(response.drive)} for {float(schedule.times[-1]):g} s"
        return f"{told}, {schedule.periods:g} pseudo periods of {schedule.reference:.6g} rad/s, {modes_in_words(modes)}, {response.method}"
    ratios = schedule.omegas / schedule.reference
    frequency = f"at {ratios[0]:g}" if ratios[0] == ratios[-1] else f"from {ratios[0]:g} to {ratios[-1]:g}"
    where = f"{frequency} times resonance {resonance} ({schedule.reference:.6g} rad/s)"
    return f"{response.drive.amplitude:g} N {where}, {schedule.periods:g} pseudo periods, {modes_in_words(modes)}, {response.method}"


def summary(result: Result, resonance: int) -> str:
    """Return the lines that are printed."""
    response, levels, ratios = result.response, 1e3 * np.array(result.levels), result.ratios
    level, energy, schedule = response.level, response.energy, response.drive.schedule
    assert level is not None
    rows = [("response level", f"{levels[0]:.4g} mm", f"around {ratios[0]:.4f} times the resonance")]
    if len(levels) > 1:
        low, middle, high = np.quantile(levels, (0.05, 0.5, 0.95))
        rows.append(("", f"{middle:.4g} mm", f"median of {len(levels)} members, 5 to 95 %: {low:.4g} to {high:.4g} mm"))
    stuck = response.stuck_time / float(schedule.times[-1])
    rows += [
        ("largest tip displacement", f"{1e3 * level.max_tip:.4g} mm", ""),
        ("impacts", f"{response.impact_count}", f"{response.impact_count / schedule.periods:.3g} a pseudo period"),
        ("time stuck or held", f"{response.stuck_time:.4g} s", f"{100 * stuck:.3g} % of {float(schedule.times[-1]):.4g} s"),
    ]
    if energy is not None:
        rows.append(("energy balance, relative", f"{energy.relative_error:.1e}", f"work of the force {energy.work:.4g} J"))
    if result.measures is not None:
        found = result.measures[0]["displacement_m"]
        rows.append(("RMS of the displacement", f"{1e3 * found['rms']:.4g} mm", f"after {result.measures[0]['from_s']:.4g} s"))
        rows.append(("power lost in impacts", f"{1e3 * result.measures[0]['impacts']['power_w']:.4g} mW", ""))
    if result.wall_time is not None:
        rows.append(("integration alone", f"{1e3 * result.wall_time:.4g} ms", f"{1e6 * result.wall_time / schedule.periods:.3g} us a pseudo period"))
    if result.sweep_ratio is not None:
        rate = 1e4 * abs(float(schedule.omegas[-1] - schedule.omegas[0])) / schedule.reference / schedule.periods
        fast = "" if result.sweep_ratio >= LEAST_RATIO else ": too fast for shares"
        rows.append(("sweep over stationary", f"{result.sweep_ratio:.3f}", f"without absorber, at {rate:.3g} % per 100 pseudo periods{fast}"))
    lines = [f"  {name:<26}{value:>12}   {note}".rstrip() for name, value, note in rows]
    return "\n".join([words(response.scene.absorber), describe_run(response, resonance), *lines])
