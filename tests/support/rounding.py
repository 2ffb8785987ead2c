"""Other last bits in every modal model, as other processors and libraries would give them: verdicts of tests must not hang on these."""

from __future__ import annotations

from typing import Any

import numpy as np

from impact_env.modes import ModalModel

BITS = 3  # of a number's 53 those that differ, a relative change of 1e-15 at most
NAMES = ("omega", "tip_shape", "force_shape", "absorber_shapes")


def rounded(values: Any, pattern: int) -> Any:
    """Return an array with its lowest bits set to a pattern; what has them already stays."""
    bits = np.array(values, dtype=np.float64).view(np.int64)
    found: Any = ((bits >> BITS << BITS) | pattern % 2**BITS).view(np.float64)
    return np.where(np.asarray(values) == 0, values, found)


def round_models(pattern: int) -> None:
    """Let all modal models of this process have these last bits."""
    made = ModalModel.__post_init__

    def post_init(self: ModalModel) -> None:
        made(self)
        for name in NAMES:
            values = getattr(self, name)
            if values is not None:
                changed = rounded(values, pattern)
                changed.flags.writeable = False
                object.__setattr__(self, name, changed)

    ModalModel.__post_init__ = post_init
