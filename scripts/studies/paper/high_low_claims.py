"""What the frequency responses say of the paper's section 3.1, and of what its section 2.5 assumes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest

from impact_env.modes import modal_model
from impact_env.parameters import Beam
from impact_env.periodic.stationary import Kind
from studies.paper.claim import LITTLE, MUCH, OFTEN, SAME, Claim, Verdict, about, between, chance, judged, middle, spread, within
from studies.study import Json

FIGURE = "high_low"
GAP = 1e-3  # m


def claims(values: Json) -> list[Claim]:
    """Return the statements that this figure decides."""
    return [*_linear(values), *_branches(values), *_regimes(values), *_method(values), _best(values["levels"])]


def _exactly(value: float, least: float, most: float) -> Verdict:
    return judged(value, value, least, most)


def _interpolated(part: Json, name: str, ratio: Any) -> Any:
    return np.interp(ratio, part["linear"]["omega_ratio"], np.array(part["linear"][name], dtype=float))


def _linear(values: Json) -> list[Claim]:
    medium, omega = values["medium"], modal_model(Beam(modes=3)).omega
    stuck, third = medium["stuck_peak"], float(omega[2] / omega[0])
    ratio, height = _sliding(medium)
    off = np.abs(height / _interpolated(medium, "alone", ratio) - 1)
    return [
        Claim("third frequency", "the third frequency is about 17.5 times the first", "2.5", f"{third:.4f}",
              _exactly(third, 17.45, 17.55), FIGURE, "The beam has another third frequency.", True),
        Claim("stuck resonance", "with a stuck absorber the resonance lies slightly lower", "3.1", f"at {stuck:.4f} of omega_1",
              _exactly(stuck, 1 - SAME, 0.999), FIGURE, "It does not lie a few per cent lower.", True),
        Claim(
            "sliding follows linear", "sliding without impacts, the response closely follows that without absorber", "3.1",
            f"within {100 * off.max():.2f} % up to the first impact, {100 * np.median(off):.2f} % in the median", _exactly(float(off.max()), 0, SAME),
            FIGURE, "Friction takes more than 5 % away somewhere.",
        ),
        Claim("sharp bends", "sharp bends where impacts begin", "3.1", f"at a tip displacement of {1e3 * height.max():.4f} mm; the gap is 1 mm",
              _exactly(height.max() / GAP, *within(SAME)), FIGURE, "The response bends away from the gap.", True),
    ]  # fmt: skip


def _sliding(part: Json) -> tuple[Any, Any]:
    """Return frequency and height of the response without impacts below the resonance, by harmonic balance, up to where it turns at the gap."""
    for curve in part["balance"]:
        ratio, height = np.array(curve["omega_ratio"]), np.array(curve["tip_max"], dtype=float)
        if not curve["closed"] and ratio.min() < 0.905:
            ratio, height = (ratio, height) if ratio[0] < ratio[-1] else (ratio[::-1], height[::-1])
            stop = int(np.argmax(height[ratio < 1.0])) + 1
            return ratio[:stop], height[:stop]
    raise ValueError("harmonic balance found no response without impacts")


def _counts(part: Json) -> list[int]:
    """Return how many periodic responses harmonic balance has at 320 frequencies between 0.9 and 1.06."""
    grid, count = np.linspace(0.9003, 1.0597, 320), np.zeros(320, dtype=int)
    for curve in part["balance"]:
        ratio = np.array(curve["omega_ratio"] + (curve["omega_ratio"][:1] if curve["closed"] else []))
        for low, high in zip(np.minimum(ratio[1:], ratio[:-1]), np.maximum(ratio[1:], ratio[:-1]), strict=True):
            count += (low <= grid) & (grid < high)
    return count.tolist()


def _isola(part: Json, method: str) -> Json | None:
    return next((curve for curve in part[method] if curve["closed"]), None)


def _highest(part: Json) -> Json:
    return max((curve for curve in part["exact"] if curve["peak"]), key=lambda curve: curve["peak"][1])


def _branches(values: Json) -> list[Claim]:
    medium, high = values["medium"], values["high"]
    counts = _counts(medium) + _counts(high)
    share = float(np.mean([1 <= n <= 3 for n in counts]))
    isola, top = _isola(medium, "exact"), _highest(high)
    mergers = [one["force_n"] for one in values["isolas"] if one["kind"] == "merger"]
    births = [one["force_n"] for one in values["isolas"] if one["kind"] == "birth"]
    outer = [fold[0] for fold in isola["folds"]] if isola else []
    alone = float(np.max(_interpolated(high, "alone", np.linspace(0.98, 1.02, 401))))
    drop = 1 - top["peak"][1] / alone
    far = max((fold[0] for fold in top["folds"]), default=0.0)
    return [
        Claim("number of responses", "one, two or three periodic responses at a frequency", "3.1",
              f"1 to 3 at {100 * share:.1f} % of 640 frequencies, at most {max(counts)}", _exactly(share, 1 - SAME, 1.0), FIGURE,
              "Harmonic balance has more of them somewhere."),
        Claim("isola", "at 1.5 N an isola lies below omega_1", "3.1",
              f"closed, from {min(outer):.5f} to {max(outer):.5f} of omega_1" if outer else "none", Verdict.HOLDS if outer and max(outer) < 1 else
              Verdict.NOT, FIGURE, "No closed branch of exact orbits was found."),
        Claim("merger", "at a certain force the isola merges with the main branch", "3.1",
              f"born at {between(births, '{:.3f}')} N, merged at {between(mergers, '{:.3f}')} N" if mergers and births else "no threshold",
              Verdict.HOLDS if any(1.5 < force < 3.0 for force in mergers) else Verdict.NOT, FIGURE, "No merger lies between the two forces."),
        Claim("far fold", "at 3 N a single branch turns far to the right", "3.1", f"fold at {far:.4f} of omega_1", _exactly(far, 1.06, 2.0), FIGURE,
              "The branch of the peak does not turn there."),
        Claim("merely shifted", "at 3 N the peak is merely shifted and only slightly decreased", "3.1",
              f"at {top['peak'][0]:.4f} of omega_1, {100 * drop:.1f} % below the linear peak", _exactly(drop, 0.0, LITTLE), FIGURE,
              "It is lowered by more."),
    ]  # fmt: skip


def _near(curves: Sequence[Json], ratio: float, width: float = 0.002) -> list[tuple[float, int]]:
    """Return height and stability of the orbits next to a frequency."""
    return [
        (y, kind)
        for curve in curves
        for x, y, kind in zip(curve["omega_ratio"], curve["tip_max"], curve["kind"], strict=True)
        if y is not None and abs(x - ratio) < width
    ]


def _regimes(values: Json) -> list[Claim]:
    medium, high, found = values["medium"], values["high"], values["stationary"]
    here = _near(medium["exact"], 1.0) or _near(medium["exact"], 1.0, 0.01)
    share = float(np.median([y for y, _ in here])) / float(_interpolated(medium, "alone", 1.0))
    basin, at_peak = values["basin"], [_highest(part)["peak"][0] for part in (medium, high)]
    runs = sum(basin.values())
    upper = [(y, k) for y, k in _near(high["exact"], 0.945, 0.02) if y > 1.2 * GAP]
    stable, slow = (float(np.mean([k >= least for _, k in upper])) for least in (2, 1))
    at, top = found["at resonance, 1.5 N"], found["high branch"]
    exponent = values["exponents"]["high branch"]
    impacts, visits = np.array(top["rhythm Exact"]).T
    steps = np.array(top["rhythm Moreau"])[:, 0]
    modulated = float(np.mean([kind == Kind.MODULATED.value for kind in at["kinds"]]))
    return [
        Claim("low at resonance", "at omega_1 the periodic response is considerably reduced", "3.1", f"{100 * share:.0f} % of no absorber at 1.5 N",
              _exactly(share, 0, MUCH), FIGURE, "It is hardly below the linear response."),
        Claim("unstable at resonance", "the periodic response at omega_1 is unstable; what is seen is strongly modulated", "3.1",
              f"{sum(k < 2 for _, k in here)} of {len(here)} orbits unstable; {100 * modulated:.0f} % of runs strongly modulated, depth "
              + spread(at["depth"], "{:.2f}"), Verdict.HOLDS if all(k < 2 for _, k in here) and modulated >= OFTEN else Verdict.NOT, FIGURE,
              "Runs at the resonance settle to something else."),
        Claim(
            "sustained", "on the high branch impacts are sustained: the absorber comes to either wall in every period", "3.1",
            f"{spread(visits, '{:.2f}')} visits to a wall a period", judged(*middle(visits), *about(2.0)), FIGURE, "It stays away in some periods.",
        ),
        Claim(
            "two impacts", "the high branch has two impacts a period", "3.1",
            f"{spread(impacts, '{:.2f}')} impacts; {spread(steps, '{:.2f}')} at the paper's step", judged(*middle(impacts), *about(2.0)), FIGURE,
            "At a visit to a wall the tip, which the third mode shakes, strikes the absorber twice or more. The orbit with one impact a wall exists "
            f"and is unstable: {100 * stable:.0f} % of the orbits on the branch are stable, {100 * slow:.0f} % but for a fast pair of multipliers, "
            "which changes the rhythm of single impacts. Section 3.3 of the paper says two or more.",
        ),
        Claim("weakly modulated", "the high response is only almost periodic, weakly modulated", "3.1",
              f"modulation depth {spread(top['depth'], '{:.2f}')}; at omega_1 {spread(at['depth'], '{:.2f}')}",
              judged(*middle(top["depth"]), 0.001, LITTLE), FIGURE, "Its peaks vary by more than a quarter."),
        Claim("chaotic", "the high response is chaotic", "3.1", "largest Lyapunov exponent {:.3f} ({:.3f} to {:.3f}) a period".format(*exponent),
              judged(exponent[1], exponent[2], 0.0, np.inf), FIGURE, "Its exponent is not above zero."),
        Claim("lower frequency", "impacts lower the effective resonance frequency, as an absorber that sticks does", "3.2",
              f"the highest orbits lie at {at_peak[0]:.4f} of omega_1 at 1.5 N and {at_peak[1]:.4f} at 3 N, with the "
              f"absorber stuck at {medium['stuck_peak']:.4f}",
              judged(min(at_peak), max(at_peak), 0.0, 0.999), FIGURE, "An orbit peaks above the linear resonance."),
        Claim("basin", "the strongly modulated response has a large basin of attraction (1.5 N, omega_1)", "3.2",
              f"{', '.join(f'{kind} {count}' for kind, count in basin.items())} of {runs} runs from random states",
              chance(*_wilson(basin.get(Kind.MODULATED.value, 0), runs)), FIGURE,
              "States are drawn evenly from the ellipse of the first mode's own resonance, the absorber anywhere in its cavity."),
    ]  # fmt: skip


def _wilson(found: int, runs: int) -> tuple[float, float]:
    interval = binomtest(found, runs).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def _method(values: Json) -> list[Claim]:
    exact, rows, bare = _isola(values["medium"], "exact"), values["harmonics"], values["no_damper"]
    error = _peak_error(rows[0], exact)
    left = [min((fold[0] for fold in one["folds"]), default=np.nan) for one in (rows[0], exact or {"folds": []})]
    more = "".join(f"; with {row['harmonics']} harmonics {100 * _peak_error(row, exact):+.1f} %" for row in rows[1:])
    change = abs(rows[0]["peak"][1] / bare["peak"][1] - 1) if rows[0]["peak"] and bare["peak"] else float("nan")
    return [
        Claim(
            "twenty harmonics", "20 harmonics are enough for three modes", "2.5",
            f"isola's peak {100 * error:+.1f} %, its left end at {left[0]:.4f} instead of {left[1]:.4f}{more}",
            _exactly(abs(error), 0.0, SAME), FIGURE,
            "An impact moves the third mode, at 17.5 times the first frequency, by harmonics on both sides of it, and a cut at 20 leaves out those "
            f"above. The isola of harmonic balance is therefore too high and too long{more}. With two modes the same 20 harmonics are right to about "
            "1 % ([harmonic balance](harmonic_balance.md)). The damper to ground has no part in it: without it that peak changes by "
            f"{100 * change:.2f} %.",
        ),
    ]  # fmt: skip


def _peak_error(row: Json, exact: Json | None) -> float:
    return float("nan") if exact is None or row["peak"] is None else row["peak"][1] / exact["peak"][1] - 1


def _best(levels: Json) -> Claim:
    force, relative = np.array(levels["force_n"]), np.array(levels["relative"])
    best = force[np.argmin(relative, axis=0)]
    return Claim("near the optimum", "1.5 N is near the optimal operating point (3 modes)", "3.1",
                 f"best force of a member {spread(best, '{:.2f}')} N; level there {spread(relative.min(axis=0), '{:.0f}', 100)} % of no absorber",
                 judged(*middle(best), *about(1.5)), FIGURE,
                 "Members differ in their best force: below it already some of the sweeps reach the high branch.")  # fmt: skip
