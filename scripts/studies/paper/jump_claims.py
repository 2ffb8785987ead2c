"""What the sweeps say of the paper's section 3.1, and of what it says of them in sections 3.3 and 4.1."""

import numpy as np

from studies.paper.claim import MUCH, SAME, Claim, Verdict, chance, judged, middle, spread, within
from studies.study import Json

FIGURE = "jump"
GAP, PAPER_PERIODS = 1e-3, 100.0  # m; pseudo periods per 1 % of the sweeps for a level
HIGH_LEVEL = 1.5e-3  # m: at 3 N the high branch is above it, all else below


def claims(values: Json) -> list[Claim]:
    """Return the statements that this figure decides."""
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
    rows = {n: _rows(values, n) for n in (725.0, 1450.0)}
    (fast, coarse, _), (slow, coarser, _) = rows.values()
    exact, step = (one["share"] * (1 - half["share"]) for one, half in ((fast, slow), (coarse, coarser)))
    pair = [fast[low] * (1 - slow[high]) for low, high in (("low", "high"), ("high", "low"))]
    own = [1e3 * max(values["sweeps"][name]["nominal_m"]) for name in ("down, paper's step", "down, half the rate, paper's step")]
    cells = "; ".join(f"share at {n:g} exact {_said(e)}, at the paper's step {_said(s)}" for n, (e, s, _) in rows.items())
    finer = ", ".join(f"{_said(fine)} at {n:g}" for n, (_, _, fine) in rows.items() if fine is not None)
    first, last = values["jumps, exact"][0], values["jumps, exact"][-1]
    dropped = ", ".join(f"{1 - row['share']:.2f} at {row['periods_per_percent']:g}" for row in (first, last))
    return [
        Claim(
            "jump", "a sweep down at 1 % per 725 pseudo periods jumps to the high branch, one at half the rate does not", "3.1",
            f"both together {exact:.2f} ({pair[0]:.2f} to {pair[1]:.2f}), at the paper's step {step:.2f}; {cells}", chance(pair[0], pair[1]), FIGURE,
            "It is a matter of chance: impacts at a frequency between 0.981 and 0.959 are a transient that ends at a rate, and the jump is its "
            f"survival. The nominal run at the paper's step, phase 0, reaches {own[0]:.2f} mm at 725 and {own[1]:.2f} mm at 1450. {_steps(values)} "
            f"With ten times finer steps the shares are {finer}.",
        ),
        Claim("slower jumps less", "at half the rate the jump is less likely", "3.1", f"share {_said(slow)} at 1450, {_said(fast)} at 725",
              judged(slow["low"], slow["high"], 0.0, fast["low"]), FIGURE, "The intervals overlap."),
        Claim("slow sweeps find the sliding response", "only in very slow sweeps the motion is attracted to sliding without impacts", "4.1",
              f"share that drops out: {dropped} pseudo periods per 1 %", Verdict.HOLDS if first["low"] > last["high"] else Verdict.NOT, FIGURE,
              "The share hardly depends on the rate."),
        Claim(
            "conservative rate", "1 % in 100 pseudo periods is conservative: it makes jumps more likely than the slow sweeps do", "3.3",
            f"share {_said(first)} at {first['periods_per_percent']:g}, {_said(fast)} at 725", judged(first["low"], first["high"], fast["high"], 1.0),
            FIGURE, "The intervals overlap.",
        ),
        _lasting(values),
    ]  # fmt: skip


def _lasting(values: Json) -> Claim:
    """Judge how long impacts last where the response without them exists, against the time that a sweep at the paper's rate takes for a percent."""
    alone = values["medium"]["linear"]
    free = np.interp([row["omega_ratio"] for row in values["rates"]], alone["omega_ratio"], np.array(alone["alone"], dtype=float))
    below = [row for row, height in zip(values["rates"], free, strict=True) if height < GAP and row["rate"]]
    stay = [1 / row["rate"] for row in below]
    return Claim(
        "modulation beyond sliding", "the modulated response goes on where the stable one without impacts is", "4.1",
        f"impacts last {min(stay):.0f} pseudo periods or more in the mean from {below[0]['omega_ratio']:g} to {below[-1]['omega_ratio']:g} of "
        "omega_1, where the free tip does not reach the gap", judged(min(stay), min(stay), PAPER_PERIODS, np.inf), FIGURE,
        "They end within the time that the sweep takes for a percent.",
    )  # fmt: skip


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


def _rate(levels: list[Json]) -> Claim:
    middles = [float(np.median(row["level_m"])) for row in levels]
    worst, first = levels[int(np.argmax(middles))], levels[0]
    shown = ", ".join(f"{row['periods_per_percent']:g}: {spread(row['level_m'], '{:.2f}', 1e3)}" for row in levels)
    low, high = middle(np.array(first["level_m"]) / min(middles[1:]))
    return Claim(
        "fast may be worse", "to pass the resonance as fast as possible may be detrimental", "3.1",
        f"level in mm over pseudo periods per 1 %: {shown}", judged(low, high, 1.0, np.inf), FIGURE,
        f"The fastest passage is the best: {first['periods_per_percent']:g} pseudo periods per 1 % leave no time to reach the high branch. The worst "
        f"is in between, at {worst['periods_per_percent']:g}; from there on slower is better, since more runs drop out of it.",
    )  # fmt: skip


def _sweeps(values: Json) -> list[Claim]:
    sweeps, medium = values["sweeps"], values["medium"]
    alone = float(np.max(medium["linear"]["alone"]))
    smr = np.array(sweeps["down"]["at_resonance_m"])
    orbit = max(y for curve in medium["exact"] for x, y in zip(curve["omega_ratio"], curve["tip_max"], strict=True) if y and 0.995 < x < 1.005)
    down, up = (np.array(sweeps[f"high force, {way}"]["on_branch_m"]) for way in ("down", "up"))
    peaks = {way: np.array([max(sweeps[f"high force, {way}"]["nominal_m"]), max(sweeps[f"high force, {way}"]["low_m"])]) for way in ("down", "up")}
    orbits = [pair for curve in values["high"]["exact"] for pair in zip(curve["omega_ratio"], curve["tip_max"], strict=True)]
    branch = float(np.median([y for x, y in orbits if y and 0.935 < x < 0.945 and y > 1e-3]))  # of the high branch
    ratio = down / branch
    return [
        Claim("sweeps follow branches", "sweeps follow the periodic responses, the high one included", "3.1",
              f"at 3 N, down, between 0.935 and 0.945 of omega_1: {spread(ratio, '{:.2f}')} of the exact orbits' largest displacement",
              judged(*middle(ratio), *within(SAME)), FIGURE, "Motions wander around the unstable orbit and are somewhat lower on average."),
        Claim("modulated maxima", "at omega_1 maxima exceed the unstable periodic response and stay well below the linear resonance", "3.1",
              f"largest displacement {spread(smr, '{:.2f}', 1e3)} mm; periodic {1e3 * orbit:.2f} mm, linear {1e3 * alone:.2f} mm",
              judged(*middle(smr), orbit, MUCH * alone), FIGURE, "In some members maxima reach further."),
        Claim(
            "high force reaches it", "at 3 N sweeps reach the high branch easily", "3.1",
            f"in the lowest twentieth of members the largest displacement is {1e3 * peaks['down'][1]:.2f} mm down, {1e3 * peaks['up'][1]:.2f} mm up",
            judged(min(map(np.min, peaks.values())), min(map(np.min, peaks.values())), HIGH_LEVEL, 10e-3), FIGURE,
            "In one direction some members stay low.",
        ),
        Claim("hysteresis", "the largest response may depend on the direction considerably", "3.3",
              f"at 3 N between 0.935 and 0.945 of omega_1 {spread(down, '{:.2f}', 1e3)} mm down, {spread(up, '{:.2f}', 1e3)} mm up",
              Verdict.HOLDS if np.median(up) < MUCH * np.median(down) else Verdict.NOT, FIGURE, "Both directions show the same."),
    ]  # fmt: skip
