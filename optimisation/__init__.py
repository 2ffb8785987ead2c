"""Which absorber, how large a gap, where: design of absorbers by simulation.

`advise`, `compare`, `explain`, `choose_place`, `tune` and `calibrate` return complete results with
the methods `str`, `to_json`, `to_markdown`, `to_html`, `plot` and `save`. The commands `design
gap`, `compare`, `design search`, `design place`, `design tune` and `calibrate` print and write
them.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from optimisation.answers.calibration import calibrate
    from optimisation.answers.comparison import compare
    from optimisation.answers.design import explain
    from optimisation.answers.gap import advise
    from optimisation.answers.place import choose_place
    from optimisation.answers.tuning import tune

__all__ = ["advise", "calibrate", "choose_place", "compare", "explain", "tune"]
_MODULES = {
    "advise": "gap",
    "calibrate": "calibration",
    "choose_place": "place",
    "compare": "comparison",
    "explain": "design",
    "tune": "tuning",
}


def __getattr__(name: str) -> Any:
    """Import a public function at its first use, so that commands start quickly."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"optimisation.answers.{_MODULES[name]}"), name)
