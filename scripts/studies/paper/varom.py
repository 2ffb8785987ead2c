"""The figure `varom`: level, dissipated energy, and what impacts pass to the second mode, over the second mode's frequency."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.stats import spearmanr

from impact_env.parameters import Beam
from studies.paper.changed import Changed, name, points
from studies.paper.claim import Claim
from studies.paper.judging import INFINITY, claim, interval
from studies.paper.second_mode import FORCE, TOLD, row
from studies.paper.settings import Settings
from studies.paper.tolerances import LEFT, OFTEN, SAME, about
from studies.study import Measured

LABEL = "varom"
OWN = 6.27  # of the beam itself: omega_2/omega_1 = 6.26690
SHOWN = (OWN, 20.0)
SATURATED = 30.0  # a large ratio


def _ratios(settings: Settings) -> tuple[float, ...]:
    return settings.size(
        (1.5, 2.0, 3.0, 4.0, 5.0, OWN, 8.0, 10.0, 12.5, 15.0, 20.0, SATURATED, 40.0, 60.0, 100.0), (1.5, 3.0, OWN, 10.0, 20.0, SATURATED, 100.0)
    )


def _about(members: int) -> str:
    return (
        f"Two modes, e = 1, no friction, {FORCE:g} N, {members} members. Energies are those of the level's window; impacts closer than 0.05 pseudo "
        "periods are one contact."
    )


FREQUENCY = Changed(
    LABEL,
    "the second mode's frequency",
    "ratios",
    _ratios,
    beam=lambda ratio: Beam(modes=2, modal_frequency_ratio={2: ratio}),
    shown=SHOWN,
    column="omega_2/omega_1",
    axis=r"frequency ratio $\omega_2/\omega_1$",
    each=r"$\omega_2/\omega_1 = {:g}$",
    about=_about,
)
PART, parameters = FREQUENCY.part(), FREQUENCY.parameters


def claims(found: Measured) -> list[Claim]:
    """Return what the second mode's frequency does."""
    values = found.values
    ratios = points(values)
    said = partial(claim, LABEL)
    relative = {ratio: row(values, name(ratio), "relative") for ratio in ratios}
    high = [ratio for ratio in ratios if ratio >= SATURATED]
    falling = [ratio for ratio in ratios if ratio >= 3.0]
    orders = [float(spearmanr(falling, one).statistic) for one in np.array([relative[ratio] for ratio in falling]).T]
    changes = relative[high[0]] - relative[high[-1]]
    gain = 100 * (1 - np.concatenate([relative[ratio] for ratio in high]))
    half = np.concatenate([100 * row(values, name(ratio), "half") for ratio in SHOWN])
    single = [min(values[name(ratio)]["single"][1] for ratio in SHOWN), max(values[name(ratio)]["single"][3] for ratio in SHOWN)]
    told = np.concatenate([row(values, name(ratio), "as_told") for ratio in SHOWN])
    contacts = np.concatenate([row(values, name(ratio), "contacts") for ratio in ratios])
    shares = [np.median(row(values, name(ratio), "share")) for ratio in falling]
    return [
        said("contacts", "in the secondary range two or more impacts occur in each pseudo period", "4.2", contacts, (1.99, INFINITY),
             "Counted as contacts in the level's window.", about="contacts in a pseudo period ", form="{:.1f}"),
        said("falls", "the level falls as the frequency ratio grows", "4.2", orders, (-1.0, 0.0),
             "Spearman's rank correlation of level and ratio in single members; their spread is of the size of the fall between neighbouring ratios.",
             about="from 3 on, rank correlation of level and ratio "),
        said("improvement", "for large ratios the level is lower by about 20 %", "4.2", gain, about(20),
             f"Members at ratios of {SATURATED:g} and more; their median alone is {np.median(gain):.0f} %.",
             about="less than no absorber by ", form="{:.0f}", unit=" %",
             at_step=100 * (1 - float(np.mean([values[name(ratio)]["step"] for ratio in high])))),
        said("saturates", "the level saturates at large ratios", "4.2", changes, (-SAME, SAME),
             "A band of 5 % of no absorber is asked for, and single members spread by about that.",
             about=f"from {high[0]:g} to {high[-1]:g}, of no absorber, ", form="{:.3f}"),
        said("passed", "each impact passes 2 to 3 % of the resonant mode's energy to the second", "4.2", told, (OFTEN, 1.0),
             f"Such contacts there are, but half of all pass {100 * single[0]:.2f} to {100 * single[1]:.2f} %, and some take energy back. What "
             f"counts for the level is the net sum: {interval(half)} % in half a pseudo period, by {np.median(contacts) / 2:.1f} contacts.",
             about=f"share of contacts at {' and '.join(f'{ratio:g}' for ratio in SHOWN)} that pass {100 * TOLD[0]:g} to {100 * TOLD[1]:g} %: "),
        said("dissipated", "for large ratios nearly all that an impact passes on is dissipated before the next", "4.2",
             row(values, name(ratios[-1]), "left"), (0.0, LEFT), "Up to a tenth may be left.",
             about=f"at {ratios[-1]:g}, share of the second mode's energy that is left before the next contact "),
        said("share", "the share that the second mode dissipates grows with its frequency", "4.2",
             [float(spearmanr(falling, shares).statistic)], (0.0, 1.0),
             f"Medians: {', '.join(f'{100 * s:.0f} % at {r:g}' for r, s in zip(falling, shares, strict=True))}.",
             about=f"{100 * shares[0]:.0f} to {100 * shares[-1]:.0f} %; rank correlation of share and ratio, from 3 on "),
    ]  # fmt: skip
