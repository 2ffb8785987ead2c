"""What the paper states of beam, tuned absorber, sweeps, window, step and scaling, beside the numbers of `basics`."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import norm

from impact_env.curve import BAND
from studies.paper.claim import SAME, Claim, Verdict, about, judged, within
from studies.study import Json

FIGURE = "basics"
DEFINITIONAL = ("omega_2", "mass", "node", "stiffness", "own_period", "span", "scaling", "undamped")
AT_ONCE = 0.005  # of the resonance's frequency, within which of a limit a first impact belongs to the start


def _claim(name: str, section: str, statement: str, computed: str, holds: bool, why: str) -> Claim:
    """Return a statement that either holds or does not."""
    verdict = Verdict.HOLDS if holds else Verdict.NOT
    return Claim(f"{FIGURE}_{name}", statement, section, computed, verdict, FIGURE, "" if holds else why, name in DEFINITIONAL)


def of(values: Json) -> list[Claim]:
    """Return all claims of the part."""
    tuned = [_tuning(values["tuned"]["tunings"]), *_tuned_effects(values["tuned"])]
    runs = [_limits(values["linear"], values["entry"]), _window(values["window"]), _step(values["step"]), _scaling(values["scaling"])]
    return [*_beam(values["beam"]), *_sweeps(values["linear"]), *runs, _damper(values["damper"]), *tuned]


def _beam(beam: Json) -> list[Claim]:
    second, lost, span = beam["ratios"][1], beam["lost_in_own_period"], beam["span_periods"]
    own, whole, off = beam["absorber_kg"], beam["beam_kg"], beam["stiffness_of_modes"] / beam["stiffness"] - 1
    stiffness = f"{beam['stiffness']:.2f} N/m; that of all the modes together differs by {off:.0e}"
    return [
        _claim("omega_2", "2.1", "omega_2 = 6.3 omega_1", f"{second:.4f}", round(second, 1) == 6.3, "The ratio is another."),
        _claim("mass", "2", "the absorber has 2 % of the beam's mass", f"{1e3 * own:.3f} g of {1e3 * whole:.2f} g", abs(own / whole - 0.02) < 1e-12,
               "The masses have another ratio."),
        _claim("node", "2.1", "x = 0.4 l is the 12th node", f"node {beam['node']:g} after the clamp", abs(beam["node"] - 12) < 1e-9,
               "It is another."),
        _claim("stiffness", "A", "3 EI/l^3 is the static stiffness of the tip", stiffness, abs(off) < 1e-9, "The modes give another stiffness."),
        _claim("own_period", "4.2", "with one damping ratio each mode loses the same share of its energy in a period of its own",
               f"{100 * min(lost):.4f} to {100 * max(lost):.4f} %, {len(lost)} modes", max(lost) - min(lost) < 1e-9, "The shares differ."),
        _claim("span", "4.2", "130 pseudo periods around omega_1 are 0.9935 to 1.0065", f"{span:.4f} pseudo periods", abs(span - 130) < 0.5,
               "The sweep takes another time."),
    ]  # fmt: skip


def _sweeps(linear: Json) -> list[Claim]:
    sweep, stuck, gap, rule = (linear[name] for name in ("sweep_ratio", "stuck_over_none", "gap_force_n", "design_force_n"))
    off, times, later = max(abs(x - 1) for x in stuck.values()), rule["2"] / rule["1"], gap["2"] / gap["1"]
    return [
        _claim("rate", "3.3", "1 % in 100 pseudo periods is moderately slow",
               f"without absorber a sweep shows {sweep['1']:.3f} of the stationary level, {sweep['2']:.3f} at the second resonance",
               min(sweep.values()) > 1 - SAME, "The sweep does not reach the stationary level."),
        _claim("stuck_level", "3.3", "the curve with a stuck absorber is virtually that without",
               f"level over no absorber {stuck['1']:.3f}, at the second resonance {stuck['2']:.3f}", off < SAME,
               f"They differ by {100 * off:.1f} %."),
        _claim("second_reason", "6", "the reason for ten times the force at the second resonance: so much later the tip reaches the gap",
               f"the free tip fills the gap from {gap['1']:.3f} and {gap['2']:.2f} N on, {later:.1f} times; by the design rule {rule['1']:.2f} and "
               f"{rule['2']:.1f} N, {times:.1f} times", about(10.0)[0] <= later <= about(10.0)[1],
               f"The best forces have about that ratio, but not for this reason: the tip alone asks for {later:.1f} times the force. The design "
               f"rule, which also counts what the absorber's mass can take at either frequency, gives {times:.1f}."),
    ]  # fmt: skip


def _limits(linear: Json, entry: list[Json]) -> Claim:
    stationary = min(linear["gap_force_at_limits_n"]["1"])
    early = [row["force"] for row in entry if min(abs(row["up"] - row["limits"][0]), abs(row["down"] - row["limits"][1])) < AT_ONCE]
    seen = "; ".join(f"{row['force']:g} N: {row['up']:.4f} and {row['down']:.4f}" for row in entry)
    return _claim(
        "limits", "3.3", "0.9 and 1.06 of the resonance lie well in the linear range",
        f"stationary below {stationary:.2f} N; first impact of sweeps up and down (10 modes, e = 1) at {seen}", not early,
        f"The stationary response is linear at both limits below {stationary:.1f} N. But a sweep begins from rest with the whole force at once, "
        f"and its transient nearly doubles the amplitude: from {min(early, default=0):g} N on the first impact comes within "
        f"{100 * AT_ONCE:g} % of a limit. The levels hardly depend on that, see the random starts.",
    )  # fmt: skip


def _window(rows: list[Json]) -> Claim:
    change = [row["relative"][1] / row["relative"][0] - 1 for row in rows]
    one, two = (np.argsort([row["relative"][window] for row in rows]) for window in (0, 1))
    less = [100 * (1 - row["shrinks"]) for row in rows]
    return _claim(
        "window", "3.3", "twice the window lowers the level and changes no conclusion",
        f"level {min(less):.1f} to {max(less):.1f} % lower, relative to no absorber {100 * min(change):+.1f} to {100 * max(change):+.1f} % "
        f"({len(rows)} cases, {'in the same' if np.array_equal(one, two) else 'in another'} order)", min(less) > 0 and max(map(abs, change)) < SAME,
        "A relative level changes by more than 5 %.",
    )  # fmt: skip


def _step(rows: list[Json]) -> Claim:
    """Judge each case by how the bands of both methods stand to each other; the weakest case decides."""
    off = [100 * (row["moreau"][0] / row["exact"][0] - 1) for row in rows]
    cases = [judged(row["moreau"][1], row["moreau"][2], (1 - SAME) * row["exact"][1], (1 + SAME) * row["exact"][2]) for row in rows]
    low, high = (f"{100 * q:g}" for q in BAND)
    return Claim(
        f"{FIGURE}_step", "20 steps a period of the highest mode are enough (3 and 10 modes)", "2.4",
        f"median level of sweeps at that step {min(off):+.1f} to {max(off):+.1f} % from the exact one ({len(rows)} cases)", _weakest(cases), FIGURE,
        f"Compared are the {low} to {high} % bands of the members, the exact one widened by {100 * SAME:g} %: of {len(rows)}, "
        f"{cases.count(Verdict.HOLDS)} of the scheme lie inside, {cases.count(Verdict.NOT)} beside it. The level of a sweep is a statistic and "
        "forgives the step; the jump does not (see there).",
    )  # fmt: skip


def _weakest(cases: list[Verdict]) -> Verdict:
    return next(verdict for verdict in (Verdict.NOT, Verdict.SPREAD, Verdict.HOLDS) if verdict in cases)


def jumps(damper: Json) -> list[tuple[str, Json]]:
    """Return the rows on sweeps with the damper to ground, and what they are of."""
    return [(f"{row['method']}, {row['periods_per_percent']:g} pseudo periods per 1 %", row) for row in damper["jumps"]]


def difference(rows: Sequence[Json]) -> tuple[float, float, float]:
    """Return how much larger the share of runs is with the damper than without, the mean of all rows, and its 95 % interval."""
    shares = np.array([[row[key] / row["runs"] for key in ("with", "without")] for row in rows])
    counts = np.array([[row["runs"]] for row in rows])
    middle = float(np.mean(shares[:, 0] - shares[:, 1]))
    bound = float(norm.ppf(0.975) * np.sqrt(np.sum(shares * (1 - shares) / counts)) / len(rows))
    return middle, middle - bound, middle + bound


def _damper(damper: Json) -> Claim:
    """Judge the change of the share of sweeps that jump, and of levels; the weakest case decides."""
    found, levels = difference(damper["jumps"]), damper["levels"]
    cases = [judged(*found[1:], -SAME, SAME)] + [judged(row["low"], row["high"], *within(SAME)) for row in levels]
    each = ", ".join(f"{row['with'] / row['runs']:.3f} for {row['without'] / row['runs']:.3f} ({name})" for name, row in jumps(damper))
    ratios = ", ".join(f"{row['with'] / row['without']:.3f} ({row['low']:.3f} to {row['high']:.3f}) at {row['force_n']:g} N" for row in levels)
    return Claim(
        f"{FIGURE}_damper", "a damper of 0.001 N s/m between absorber and ground does not matter in sweeps", "2.5",
        "share of sweeps down that jump, with it less without: {:+.3f} ({:+.3f} to {:+.3f}) in the mean of ".format(*found)
        + f"{each}; level over that without, 3 modes: {ratios}", _weakest(cases), FIGURE,
        f"Of {len(cases)} changes {cases.count(Verdict.HOLDS)} lie within {100 * SAME:g} % with their whole 95 % interval, "
        f"{cases.count(Verdict.NOT)} beyond it.",
    )  # fmt: skip


def _scaling(scaling: Json) -> Claim:
    level, times = abs(scaling["level_by_2"]), scaling["times_by_3"]
    first = f"the times of the first {scaling['impacts']} impacts by {times:.0e}"
    said = f"times 2: the level of a sweep with friction differs by {level:.0e}; times 3: {first}"
    holds = level < 1e-12 and times < 1e-6
    return _claim("scaling", "2.3", "gap, friction and force times alpha give the response times alpha", said, holds, "The scaled runs differ.")


def _tuning(tunings: Json) -> Claim:
    paper, rule, own, best = (tunings[name] for name in ("paper", "Den Hartog", "modal mass of one", "smallest peak"))
    off = max(abs(paper[name] / rule[name] - 1) for name in ("stiffness", "damping"))
    heights = [100 * height for height in paper["peaks"]]
    level, least, low, lower = (100 * one[name] for name in ("relative", "within_limits") for one in (paper, best))
    return _claim(
        "ltva", "6", "the tuned absorber follows Den Hartog's rule: equal peaks, and the smallest level near the first resonance",
        f"k = 701.8 N/m, c = 0.728 N s/m, the rule gives {rule['stiffness']:.1f} and {rule['damping']:.3f}; peaks in % of no absorber "
        f"{', '.join(f'{height:.1f}' for height in heights)}; the highest {level:.2f}, of the best tuning {least:.2f}",
        off < SAME and max(heights) / min(heights) < 1 + SAME and level < least * (1 + SAME),
        "The rule asks for the absorber's mass over the effective modal mass at the tip, 1/phi^2, which is a quarter of the beam's: 0.08. "
        f"The paper's values are those of a modal mass of 1 kg (k = {own['stiffness']:.1f} N/m), with twice that rule's damping "
        f"(c = {own['damping']:.3f} N s/m). So its peaks are not equal, and its level is not the smallest; within 0.9 to 1.06 of the resonance, "
        f"which leaves its high peak out, it is {low:.1f} % of no absorber against {lower:.1f} %.",
    )  # fmt: skip


def _tuned_effects(tuned: Json) -> list[Claim]:
    second, undamped = tuned["second_relative"], tuned["undamped_relative"]
    return [
        _claim("ltva_second", "6", "the tuned absorber is virtually ineffective at the second resonance",
               f"largest amplitude {100 * second:.1f} % of no absorber", second > 1 - SAME,
               f"Its mass hardly moves there, so its damper acts between tip and ground and takes {100 * (1 - second):.0f} % off the peak: little "
               "beside the impact absorber, but not nothing."),
        _claim("undamped", "1", "an undamped tuned absorber brings the tip to rest at its own frequency",
               f"tip amplitude there {undamped:.0e} of that without", undamped < 1e-9, "The tip moves."),
    ]  # fmt: skip
