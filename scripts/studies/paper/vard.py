"""The figure `vard`: level, dissipated energy, and what impacts pass to the second mode, over the second mode's damping."""

from __future__ import annotations

from functools import partial

import numpy as np

from impact_env.parameters import Beam
from studies.paper.changed import Changed, name, points
from studies.paper.claim import Claim
from studies.paper.judging import claim
from studies.paper.second_mode import row
from studies.paper.settings import Settings
from studies.paper.tolerances import LEFT, SAME, about
from studies.study import Measured

LABEL = "vard"
RATIO = 6.3  # omega_2/omega_1, as the paper has it here
FIRST = 0.01  # damping ratio of the first mode


def _dampings(settings: Settings) -> tuple[float, ...]:
    return settings.size((0.001, 0.002, 0.005, FIRST, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5), (0.001, FIRST, 0.05, 0.1, 0.3, 0.5))


DAMPING = Changed(
    LABEL,
    "the second mode's damping",
    "dampings",
    _dampings,
    beam=lambda damping: Beam(modes=2, modal_frequency_ratio={2: RATIO}, damping_ratio=(FIRST, damping)),
    shown=(FIRST, 0.3),
    column="D_2, %",
    axis="damping ratio $D_2$ in %",
    each="$D_2 = {:g}$ %",
    about=lambda members: f"As above at omega_2 = {RATIO:g} omega_1 with 1 % damping of the first mode, {members} members.",
    scale=100.0,
    fixed=(("ratio", RATIO),),
)
PART, parameters = DAMPING.part(), DAMPING.parameters


def claims(found: Measured) -> list[Claim]:
    """Return what the second mode's damping does."""
    values = found.values
    dampings = points(values)
    said = partial(claim, LABEL)
    relative = {damping: row(values, name(damping), "relative") for damping in dampings}
    high = [damping for damping in dampings if damping >= 0.3]
    left = np.concatenate([row(values, name(damping), "left") for damping in high])
    gain = np.concatenate([relative[FIRST] - relative[damping] for damping in high])
    contacts = np.median(np.concatenate([row(values, name(damping), "contacts") for damping in high]))
    return [
        said("improvement", "more damping of the second mode lowers the level as a higher frequency does", "4.2",
             100 * (1 - np.concatenate([relative[d] for d in high])), about(20),
             f"Members at D_2 of {100 * high[0]:g} % and more.", about="less than no absorber by ", form="{:.0f}", unit=" %",
             at_step=100 * (1 - float(np.mean([values[name(d)]["step"] for d in high])))),
        said("lower", "the level at high damping is below that of the nominal 1 %", "4.2", 100 * gain, (0.0, 100.0),
             "Single members spread by as much as the gain.", about="lower, in % of no absorber, by ", form="{:.1f}"),
        said("dissipated", "at high damping nearly all that an impact passes on is dissipated before the next", "4.2", left, (0.0, LEFT),
             f"Up to a tenth may be left; there are {contacts:.1f} contacts a pseudo period, not evenly spaced.",
             about="share of the second mode's energy that is left before the next contact "),
        said("saturates", "the level saturates at high damping", "4.2", relative[high[0]] - relative[high[-1]], (-SAME, SAME),
             "A band of 5 % of no absorber is asked for.", about=f"from {100 * high[0]:g} to {100 * high[-1]:g} %, of no absorber, ", form="{:.3f}"),
    ]  # fmt: skip
