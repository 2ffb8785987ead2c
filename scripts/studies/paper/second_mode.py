"""What `varom` and `vard` share: two modes, of which the second is changed, under 3 N in the secondary range."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.drive import PAPER_LIMITS, linear_sweep
from impact_env.energy import mechanical_energy
from impact_env.ensemble import Lane, draw_members
from impact_env.level import HALF_WINDOW_PERIODS
from impact_env.methods import Moreau
from impact_env.parameters import Beam, impact_absorber
from impact_env.scene import Scene, beam_scene
from impact_env.sweep import simulate
from studies.paper.account import SAMPLES, Account, accounted, window_around
from studies.paper.curve import curve_of, curves
from studies.paper.frame import in_turn
from studies.paper.judging import interval
from studies.paper.settings import Settings
from studies.study import Json, Steps, Table

Array = NDArray[np.float64]
FORCE = 3.0
TOLD = 0.75 * 0.02, 1.25 * 0.03  # of the first mode's energy: what an impact passes on by the paper, "about 2 to 3 %"
SIGNAL_PERIODS, THINNED = 2.0, 8  # of the energies over time, and every which sample of it is kept


def scene(beam: Beam) -> Scene:
    """Return the conservative absorber on a beam."""
    return beam_scene(beam, impact_absorber())


def lanes_of(own: Scene, force: float, members: int, seed: int) -> list[Lane]:
    """Return each member's sweep up, and its sweep down after it."""
    reference, (low, high) = own.model.resonance_omega(1), PAPER_LIMITS
    schedules = linear_sweep(reference, low, high), linear_sweep(reference, high, low)
    drawn = draw_members(members, seed)
    return [Lane(own, drawn[m : m + 1].drives(force, schedule)[0]) for m in range(members) for schedule in schedules]


def critical(found: Sequence[Account]) -> list[Account]:
    """Return the account of the direction with the larger level, for each member."""
    return [max(pair, key=lambda account: account.level) for pair in zip(found[::2], found[1::2], strict=True)]


def measured(settings: Settings, label: str, beams: Mapping[str, Beam], members: int, shown: Sequence[str], known: Json) -> Steps:
    """Yield what is known of all beams, by names that say what was changed; ``shown``: those whose energies are recorded in time."""
    groups: dict[str, Callable[[], object]] = {name: partial(_point, settings, label, beam, members) for name, beam in beams.items()}
    groups |= {f"signal, {name}": partial(_signal, scene(beams[name]), settings.seed) for name in shown}
    return in_turn(groups, known)


def _point(settings: Settings, label: str, beam: Beam, members: int) -> Json:
    """Return each member's level over no absorber and account, of the critical direction; ``step``: one run at the paper's step."""
    own = scene(beam)
    found = critical(settings.each(label, lanes_of(own, FORCE, members, settings.seed), accounted))
    none = curve_of(curves(settings, label, {"none": beam_scene(beam)}, (FORCE,), members)["none"]).level[0]
    step = curve_of(curves(settings, label, {"own": own}, (FORCE,), 1, Moreau())["own"]).level[0, 0]
    single = np.concatenate([account.single for account in found])
    return {
        "relative": [account.level / level for account, level in zip(found, none, strict=True)],
        "step": float(step / none[0]),
        "at": [account.at for account in found],
        "contacts": [account.contacts for account in found],
        "share": [float(account.shares[1]) for account in found],
        "half": [float(account.passed[1] * account.contacts / 2) for account in found],
        "left": [float(account.left[1]) for account in found],
        "single": np.quantile(single, (0.05, 0.25, 0.5, 0.75, 0.95)).tolist(),
        "as_told": [float(np.mean((account.single >= TOLD[0]) & (account.single <= TOLD[1]))) for account in found],
    }


def _signal(own: Scene, seed: int) -> Json:
    """Return the energies in J of both modes and the absorber over two pseudo periods around the maximum of the first member's critical sweep."""
    found = [(simulate(lane.scene, lane.drive).level, lane) for lane in lanes_of(own, FORCE, 1, seed)]
    level, lane = max(((level, lane) for level, lane in found if level is not None), key=lambda pair: pair[0].value)
    response = window_around(lane, level.time)
    assert response.history is not None
    energy = mechanical_energy(own, response.history)
    time = response.history.time / response.drive.schedule.pseudo_period
    first = int(HALF_WINDOW_PERIODS * SAMPLES)
    kept = slice(first, first + int(SIGNAL_PERIODS * SAMPLES) + 1, THINNED)
    return {
        "time": (time[kept] - time[first]).tolist(),
        "modal": energy.modal[kept].T.tolist(),
        "absorber": energy.absorber[kept].tolist(),
    }


def row(values: Json, name: str, key: str) -> Array:
    """Return the members' values of a point."""
    return np.array(values[name][key], dtype=float)


def quantiles_of(values: Json, names: Sequence[str], key: str) -> tuple[Array, Array, Array, Array]:
    """Return 5 %, median, 95 % and the nominal member of points, (P,) each."""
    rows = np.array([row(values, name, key) for name in names])
    low, middle, high = np.quantile(rows, (0.05, 0.5, 0.95), axis=1)
    return low, middle, high, rows[:, 0]


def table(values: Json, names: Sequence[str], numbers: Sequence[float], title: str, label: str) -> Table:
    """Return a line for each point that is known."""
    lines: list[tuple[Any, ...]] = [
        (
            f"{number:.4g}",
            interval(row(values, name, "relative"), "{:.3f}"),
            f"{values[name]['step']:.3f}",
            interval(row(values, name, "share"), "{:.3f}"),
            f"{np.median(row(values, name, 'contacts')):.1f}",
            interval(100 * row(values, name, "half"), "{:.2f}"),
            "{:.2f} to {:.2f}".format(*(100 * values[name]["single"][k] for k in (1, 3))),
            f"{np.median(row(values, name, 'left')):.2f}",
        )
        for name, number in zip(names, numbers, strict=True)
        if name in values
    ]
    header = (
        title, "level over no absorber", "at the paper's step", "dissipated in mode 2", "contacts per pseudo period",
        "passed to mode 2 per half period, % of mode 1", "by single contacts (half of them), %", "left before the next contact",
    )  # fmt: skip
    return Table(label, header, lines)
