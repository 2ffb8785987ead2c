"""What the strongly modulated response says of the paper's section 3.2."""

from __future__ import annotations

import numpy as np

from studies.paper.claim import Claim, Verdict, judged
from studies.paper.tolerances import LEFT, MUCH, about
from studies.paper.words import middle, spread
from studies.study import Json, Measured

FIGURE, SECTION = "SMR", "3.2"


def claims(measured: Measured) -> list[Claim]:
    """Return the statements that this figure decides."""
    exact, step, linear = (measured.values[name] for name in ("exact", "paper's step", "linear"))
    return [*_rhythm(exact, step), *_lag(exact), *_energy(exact, step), _anywhere(measured.values["other resonances"]), _level(exact, linear)]


def _third(part: Json, what: str, name: str) -> list[float]:
    return [one[name] for one in part[what]]


def _rhythm(exact: Json, step: Json) -> list[Claim]:
    high, low = (_third(exact, "impacts", name) for name in ("high", "low"))
    coarse = _third(step, "impacts", "high")
    fewer = middle(np.array(low) / np.array(high))
    return [
        Claim(
            "two impacts in the burst", "where amplitudes are high, about two impacts a period", SECTION,
            f"{spread(high, '{:.2f}')} in the third of periods with the largest; at the paper's step {spread(coarse, '{:.2f}')}",
            judged(*middle(high), *about(2.0)), FIGURE, "There are more of them, since the absorber strikes a wall twice in some periods.",
        ),
        Claim(
            "fewer impacts between", "where amplitudes are low, impacts are less frequent", SECTION,
            f"{spread(low, '{:.2f}')} in the third with the smallest, against {spread(high, '{:.2f}')}", judged(*fewer, 0.0, 1.0), FIGURE,
            "They are as frequent there.",
        ),
    ]  # fmt: skip


def _lag(exact: Json) -> list[Claim]:
    high, low = (_third(exact, "lag", name) for name in ("high", "low"))
    wide, wider = (np.array(_third(exact, "lag_width", name)) for name in ("high", "low"))
    return [
        Claim(
            "lag near zero", "where amplitudes are high, the phase lag approaches zero", SECTION,
            f"size of a period's lag {spread(high, '{:.2f}')} rad; 90 % of periods within {spread(wide, '{:.1f}')} rad",
            judged(*middle(high), 0.0, LEFT * np.pi), FIGURE,
            f"Its size in the median period; a tenth of pi, {LEFT * np.pi:.2f} rad, counts as close to zero.",
        ),
        Claim(
            "lag arbitrary", "where amplitudes are low, the phase lag takes arbitrary values", SECTION,
            f"size {spread(low, '{:.2f}')} rad; 90 % of periods within {spread(wider, '{:.1f}')} rad (arbitrary: 5.7)",
            judged(*middle(wider), *about(0.9 * 2 * np.pi)), FIGURE,
            "Arbitrary would be evenly from -pi to pi. In some members it prefers a side.",
        ),
    ]  # fmt: skip


def _energy(exact: Json, step: Json) -> list[Claim]:
    return [
        Claim(
            "ninety per cent", "up to 90 % of the mechanical energy is in the absorber for a while", SECTION,
            f"largest share in 25 pseudo periods {spread(exact['share'], '{:.0f}', 100)} %; at the paper's step "
            f"{spread(step['share'], '{:.0f}', 100)} %", _reached(exact["share"]), FIGURE,
            "In some stretches of 25 pseudo periods the largest share stays lower.",
        ),
        Claim(
            "every twelve periods", "the transfer comes again, after about 12 pseudo periods (at 8 and 20)", SECTION,
            f"{spread(exact['waits'], '{:.0f}')} pseudo periods between shares above 80 %", judged(*middle(exact["waits"]), *about(12.0)), FIGURE,
            "The response is chaotic: the wait is of that size, but from one transfer to the next it varies severalfold. Two transfers of one record "
            "do not show a period.",
        ),
        Claim(
            "transfer during capture", "the span of effective transfer coincides with that of a lag near zero", SECTION,
            f"mean size of the lag while the absorber's energy is in its highest third over that at all times "
            f"{spread(exact['lag_at_energy'], '{:.2f}')}; correlation of energy and size {spread(exact['energy_and_lag'], '{:.2f}')}",
            judged(*middle(exact["lag_at_energy"]), 0.0, MUCH), FIGURE, "The lag is no smaller then.",
        ),
    ]  # fmt: skip


def _reached(shares: list[float]) -> Verdict:
    return judged(*middle(shares), *about(0.9))


def _anywhere(rows: list[Json]) -> Claim:
    shares = [spread(row["share"], "{:.0f}", 100) for row in rows]
    said = ", ".join(f"{share} % at the {row['resonance']}." for share, row in zip(shares, rows, strict=True))
    low, high = (each(middle(row["share"])[k] for row in rows) for k, each in ((0, min), (1, max)))
    return Claim(
        "transfer at any frequency", "the transfer of energy to the absorber can take place at any frequency", SECTION,
        f"largest share in 25 pseudo periods at the beam's resonances, each mode alone under 1.7 N scaled as its free tip asks: {said}",
        judged(low, high, *about(0.9)), FIGURE, "In some stretches of 25 pseudo periods the largest share stays lower.",
    )  # fmt: skip


def _level(exact: Json, linear: Json) -> Claim:
    relative = np.array(exact["rms_m"]) * np.sqrt(2) / linear["amplitude_m"]
    return Claim(
        "effective at resonance", "without any loss but that of one mode, the absorber is particularly effective at omega_1", SECTION,
        f"RMS {spread(relative, '{:.0f}', 100)} % of that without absorber, modulation depth {spread(exact['depth'], '{:.2f}')}",
        judged(*middle(relative), 0.0, MUCH), FIGURE, "The RMS is not that low in all members.",
    )  # fmt: skip
