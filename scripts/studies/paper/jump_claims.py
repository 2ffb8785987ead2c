"""What the sweeps say of the paper's section 3.1, and of what it says of them in sections 3.3 and 4.1."""

from __future__ import annotations

import numpy as np

from studies.paper.claim import Claim, Verdict, judged
from studies.paper.words import middle, spread
from studies.study import Json, Measured

FIGURE = "jump"
SURE, RARE = 0.75, 0.25  # from and up to these shares one run shows what most of them do
HIGH_LEVEL = 1.5e-3  # m: at 3 N the high branch is above it, all else below


def claims(measured: Measured) -> list[Claim]:
    """Return the statements that this figure decides."""
    values = measured.values
    return [*_jump(values), _rate(values["levels"]), *_sweeps(values)]


def _rows(values: Json, slowness: float) -> tuple[Json, Json, Json | None]:
    """Return the shares at a slowness: exact, at the paper's step, and with ten times finer steps."""
    exact, step, finer = (
        next((row for row in values[f"jumps, {name}"] if row["periods_per_percent"] == slowness), None)
        for name in ("exact", "paper's step", "ten times finer")
    )
    assert exact is not None
    assert step is not None
    return exact, step, finer


def _said(row: Json) -> str:
    return f"{row['share']:.2f} ({row['low']:.2f} to {row['high']:.2f})"


def _jump(values: Json) -> list[Claim]:
    exact, step, finer = _rows(values, 725.0)
    fine = "" if finer is None else f", with ten times finer steps {_said(finer)}"
    found = [
        Claim(
            "jump at 725", "a sweep down at 1 % per 725 pseudo periods jumps to the high branch", "3.1",
            f"share {_said(exact)}; at the paper's step {_said(step)}{fine}", _often(exact, step), FIGURE,
            "It is a matter of chance: impacts at a frequency between 0.981 and 0.959 are a transient that ends at a rate, and the jump is its "
            f"survival, in a share of {_said(exact)} of runs that differ in the phase of the force. {_steps(values)}",
        ),
    ]  # fmt: skip
    if any(row["periods_per_percent"] == 1450.0 for row in values["jumps, exact"]):
        found.append(_half(values))
    fast, last = values["jumps, exact"][0], values["jumps, exact"][-1]
    shares = ", ".join(f"{1 - row['share']:.2f} at {row['periods_per_percent']:g}" for row in (fast, last))
    slow = Claim(
        "slow sweeps find the sliding response", "only in very slow sweeps the motion is attracted to sliding without impacts", "4.1",
        f"share that drops out: {shares} pseudo periods per 1 %", Verdict.HOLDS if fast["low"] > last["high"] else Verdict.NOT, FIGURE,
        "The share hardly depends on the rate.",
    )  # fmt: skip
    return [*found, slow]


def _steps(values: Json) -> str:
    """Return what the paper's step does to the jump, in words."""
    drift, rows = values["drift"], values["jumps, paper's step"]
    back, none = (sum(row["reached"] - row["stayed"] for row in found) for found in (rows, values["jumps, exact"]))
    drifts = [spread(drift[name]["drift_m"], "{:.3f}", 1e3) for name in ("paper's step", "ten times finer", "exact")]
    return (
        f"At the paper's step impacts come back: of {sum(row['runs'] for row in rows)} sweeps {back} reach the high branch after 100 pseudo periods "
        f"or more without any impact; by the exact method {none} do. A reversal of friction is noticed a step late there, which moves the absorber a "
        "little each time, until it lies at a wall: in a slow sweep without impacts its place drifts by "
        f"{drifts[0]} mm, with ten times finer steps by {drifts[1]} mm, by the exact method by {drifts[2]} mm."
    )


def _half(values: Json) -> Claim:
    exact, step, finer = _rows(values, 1450.0)
    fine = "" if finer is None else f", with ten times finer steps {_said(finer)}"
    return Claim(
        "no jump at half the rate", "at half that rate it does not", "3.1",
        f"share that jumps {_said(exact)}; at the paper's step {_said(step)}{fine}", _rarely(exact, step), FIGURE,
        f"Most runs drop out, but not all: {_said(exact)} still jump, by the exact method, as the rates of leaving predict. At the "
        f"paper's step {_said(step)} do, since impacts come back there; a single run without a jump is then the exception.",
    )  # fmt: skip


def _often(exact: Json, step: Json) -> Verdict:
    if exact["low"] >= SURE:
        return Verdict.HOLDS
    if exact["share"] < SURE <= step["share"]:
        return Verdict.STEP
    return Verdict.SPREAD if exact["high"] > RARE else Verdict.NOT


def _rarely(exact: Json, step: Json) -> Verdict:
    if exact["high"] <= RARE:
        return Verdict.HOLDS
    if exact["share"] > RARE >= step["share"]:
        return Verdict.STEP
    return Verdict.SPREAD if exact["low"] < SURE else Verdict.NOT


def _rate(levels: list[Json]) -> Claim:
    middles = [float(np.median(row["level_m"])) for row in levels]
    by = {row["periods_per_percent"]: row for row in levels}
    worst = levels[int(np.argmax(middles))]
    first, last = levels[0], levels[-1]
    shown = ", ".join(f"{n:g}: {spread(by[n]['level_m'], '{:.2f}', 1e3)}" for n in by)
    return Claim(
        "fast may be worse", "to pass as fast as possible may be worse than to pass slowly", "3.1",
        f"level in mm over pseudo periods per 1 %: {shown}",
        Verdict.HOLDS if np.median(worst["level_m"]) > 1.2 * np.median(last["level_m"]) and worst is not last else Verdict.SPREAD, FIGURE,
        f"The worst rate is in between, {worst['periods_per_percent']:g} pseudo periods per 1 %: a passage at {first['periods_per_percent']:g} has "
        "no time to reach the high branch, and one much slower than those here mostly drops out of it.",
    )  # fmt: skip


def _sweeps(values: Json) -> list[Claim]:
    sweeps, medium = values["sweeps"], values["medium"]
    alone = float(np.max(medium["linear"]["alone"]))
    smr = np.array(sweeps["down"]["at_resonance_m"])
    orbit = max(y for curve in medium["exact"] for x, y in zip(curve["omega_ratio"], curve["tip_max"], strict=True) if y and 0.995 < x < 1.005)
    down, up = (np.array(sweeps[f"high force, {way}"]["on_branch_m"]) for way in ("down", "up"))
    peaks = {way: np.array([max(sweeps[f"high force, {way}"]["nominal_m"]), max(sweeps[f"high force, {way}"]["low_m"])]) for way in ("down", "up")}
    branch = _height(values["high"], 0.935, 0.945)
    ratio = down / branch
    return [
        Claim(
            "sweeps follow branches", "sweeps follow the periodic responses, the high one included", "3.1",
            f"at 3 N, down, between 0.935 and 0.945 of omega_1: {spread(ratio, '{:.2f}')} of the exact orbits' largest displacement",
            judged(*middle(ratio), 0.8, 1.2), FIGURE, "Motions wander around the unstable orbit and are somewhat lower on average.",
        ),
        Claim(
            "modulated maxima", "at omega_1 maxima exceed the unstable periodic response and stay well below the linear resonance", "3.1",
            f"largest displacement {spread(smr, '{:.2f}', 1e3)} mm; periodic {1e3 * orbit:.2f} mm, linear {1e3 * alone:.2f} mm",
            judged(*middle(smr), 1.05 * orbit, 0.75 * alone), FIGURE, "In some members maxima reach further.",
        ),
        Claim(
            "high force reaches it", "at 3 N sweeps reach the high branch easily", "3.1",
            f"in the lowest twentieth of members the largest displacement is {1e3 * peaks['down'][1]:.2f} mm down, {1e3 * peaks['up'][1]:.2f} mm up",
            judged(min(map(np.min, peaks.values())), min(map(np.min, peaks.values())), HIGH_LEVEL, 10e-3), FIGURE,
            "In one direction some members stay low.",
        ),
        Claim(
            "hysteresis", "the largest response may depend on the direction considerably", "3.3",
            f"at 3 N between 0.935 and 0.945 of omega_1 {spread(down, '{:.2f}', 1e3)} mm down, {spread(up, '{:.2f}', 1e3)} mm up",
            Verdict.HOLDS if np.median(down) > 1.2 * np.median(up) else Verdict.NOT, FIGURE, "Both directions show the same.",
        ),
    ]  # fmt: skip


def _height(part: Json, low: float, high: float) -> float:
    """Return the median height of the high branch's orbits between two ratios."""
    return float(
        np.median(
            [y for curve in part["exact"] for x, y in zip(curve["omega_ratio"], curve["tip_max"], strict=True) if y and low < x < high and y > 1e-3]
        )
    )
