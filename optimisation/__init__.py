"""Which absorber, how large a gap, where: design of absorbers by simulation.

`advise`, `compare`, `explain`, `choose_place`, `tune` and `calibrate` return whole answers: each
has its text (`str`), `to_json`, `to_markdown`, `to_html`, `plot` and `save`, and is what the
commands `design gap`, `compare`, `design search`, `design place`, `design tune` and `calibrate`
print and write.
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
    """Import an answer's function when it is first used: the commands start without them."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"optimisation.answers.{_MODULES[name]}"), name)
