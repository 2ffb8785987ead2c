"""What the strongly modulated response says of the paper's section 3.2."""

from __future__ import annotations

import numpy as np

from studies.paper.claim import Claim, Verdict, judged
from studies.paper.words import middle, spread
from studies.study import Json, Measured

FIGURE, SECTION = "SMR", "3.2"


def claims(measured: Measured) -> list[Claim]:
    """Return the statements that this figure decides."""
    exact, step, linear = (measured.values[name] for name in ("exact", "paper's step", "linear"))
    return [*_rhythm(exact, step), *_lag(exact), *_energy(exact, step), _level(exact, linear)]


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
            judged(*middle(high), 1.6, 2.4), FIGURE, "There are more of them, since the absorber strikes a wall twice in some periods.",
        ),
        Claim(
            "fewer impacts between", "where amplitudes are low, impacts are less frequent", SECTION,
            f"{spread(low, '{:.2f}')} in the third with the smallest, against {spread(high, '{:.2f}')}", judged(*fewer, 0.0, 0.95), FIGURE,
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
            judged(*middle(high), 0.0, np.pi / 6), FIGURE, "It is zero in the mean, but single periods scatter around it.",
        ),
        Claim(
            "lag arbitrary", "where amplitudes are low, the phase lag takes arbitrary values", SECTION,
            f"size {spread(low, '{:.2f}')} rad; 90 % of periods within {spread(wider, '{:.1f}')} rad (arbitrary: 5.7)",
            judged(*middle(wider / wide), 1.4, 10.0), FIGURE, "It scatters little more than where they are high.",
        ),
    ]  # fmt: skip


def _energy(exact: Json, step: Json) -> list[Claim]:
    at, everywhere = (np.array(exact[f"lag_at_{name}"]) for name in ("transfer", "all"))
    return [
        Claim(
            "ninety per cent", "up to 90 % of the mechanical energy is in the absorber for a while", SECTION,
            f"largest share in 25 pseudo periods {spread(exact['share'], '{:.0f}', 100)} %; at the paper's step "
            f"{spread(step['share'], '{:.0f}', 100)} %", _reached(exact["share"]), FIGURE,
            "In some stretches of 25 pseudo periods the largest share stays lower.",
        ),
        Claim(
            "every twelve periods", "the transfer comes again, after about 12 pseudo periods (at 8 and 20)", SECTION,
            f"{spread(exact['waits'], '{:.0f}')} pseudo periods between shares above 80 %", judged(*middle(exact["waits"]), 6.0, 18.0), FIGURE,
            "The response is chaotic: the wait is of that size, but from one transfer to the next it varies severalfold. Two transfers of one record "
            "do not show a period.",
        ),
        Claim(
            "transfer during capture", "the span of effective transfer coincides with that of a lag near zero", SECTION,
            f"size of the lag while the share is above 80 %: {spread(at, '{:.2f}')} rad, at all times {spread(everywhere, '{:.2f}')}; "
            f"correlation of the absorber's energy with it {spread(exact['energy_and_lag'], '{:.2f}')}",
            judged(*middle(at / everywhere), 0.0, 0.75), FIGURE,
            "The absorber's energy is larger where the lag is small (the correlation is below zero), so energy does flow while both move together. "
            "But its share is largest a little later, when the beam is nearly at rest, and by then the lag is no smaller than at any other time: a "
            "share says as much of the beam's lack of energy as of the absorber's.",
        ),
    ]  # fmt: skip


def _reached(shares: list[float]) -> Verdict:
    """Return whether half of the stretches or more come to 85 %, whatever the largest of them."""
    low, _ = middle(shares)
    return Verdict.HOLDS if float(np.median(shares)) >= 0.85 else Verdict.SPREAD if max(shares) >= 0.85 or low >= 0.85 else Verdict.NOT


def _level(exact: Json, linear: Json) -> Claim:
    relative = np.array(exact["rms_m"]) * np.sqrt(2) / linear["amplitude_m"]
    return Claim(
        "effective at resonance", "without any loss but that of one mode, the absorber is particularly effective at omega_1", SECTION,
        f"RMS {spread(relative, '{:.0f}', 100)} % of that without absorber, modulation depth {spread(exact['depth'], '{:.2f}')}",
        judged(*middle(relative), 0.0, 0.4), FIGURE, "The RMS is not that low in all members.",
    )  # fmt: skip
