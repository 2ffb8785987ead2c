"""What one control of the explorer's page is, and the checked values of all of them."""

from collections.abc import Mapping
from dataclasses import dataclass

from impact_env.checks import ParameterError


@dataclass(frozen=True)
class Control:
    """A numerical control of the page.

    Its value in SI units lies from ``low`` to ``high``. The page shows the value times ``per`` in
    ``unit``.

    ``log``: its slider is logarithmic; ``zero``: with 0 at the left end. ``concepts`` and
    ``loads``: those that it is for, empty for all. ``group``: the key of `GROUPS` under which it
    stands; ``about``: a sentence for who does not know it.
    """

    name: str
    label: str
    low: float
    high: float
    value: float
    unit: str = ""
    per: float = 1.0
    log: bool = False
    zero: bool = False
    whole: bool = False
    concepts: tuple[str, ...] = ()
    loads: tuple[str, ...] = ()
    group: str = "absorber"
    about: str = ""

    @property
    def allowed(self) -> str:
        """The allowed values in words, in the page's unit."""
        low = 0.0 if self.zero else self.low
        if self.whole:
            return f"a whole number from {low:g} to {self.high:g}"
        return f"{low * self.per:g} to {self.high * self.per:g} {self.unit}".rstrip()


@dataclass(frozen=True)
class ControlValues:
    """The checked values of a page's controls in SI units.

    ``instant``: time in s from the start of the sweep around which the motion is drawn.

    None: the time of the level.
    """

    concept: str
    load: str
    direction: str
    numbers: Mapping[str, float]
    instant: float | None
    view: str = "levels"

    def __getitem__(self, name: str) -> float:
        return self.numbers[name]

    @property
    def intensity(self) -> float:
        """Amplitude of the load, in its unit."""
        return self.numbers[self.load]

    @property
    def resonance(self) -> int:
        """Resonance, counted from 1."""
        return int(self.numbers["resonance"])

    @property
    def members(self) -> int:
        """Number of runs of each point."""
        return int(self.numbers["members"])


class Refused(ParameterError):  # noqa: N818 - an answer
    """Values that are not allowed: ``errors`` says why, by control ("" for several at once)."""

    def __init__(self, errors: dict[str, str]) -> None:
        super().__init__("; ".join(errors.values()))
        self.errors = errors
