"""What one control of the explorer's page is, and the checked values of all of them."""

from collections.abc import Mapping
from dataclasses import dataclass

from impact_env.checks import ParameterError


@dataclass(frozen=True)
class Control:
    """A numerical control of the page.

    Attributes
    ----------
    name, label, about : str
        Name, text of the label, and a sentence of explanation.
    low, high, value : float
        Range and default value in SI units.
    unit, per : str and float
        Unit on the page, and the factor from SI units to it.
    log, zero, whole : bool
        Whether the slider is logarithmic, has 0 at its left end, and has whole numbers only.
    concepts, loads : tuple of str
        Kinds of absorber and loads for which the control is present, empty for all.
    group : str
        Key of its heading in `GROUPS`.
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

    ``instant`` is the time in s from the start of the sweep around which the motion is drawn, None:
    the time of the response level.
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


class RefusedValues(ParameterError):  # noqa: N818 - an answer
    """Values that are not allowed; ``errors`` has the reasons by control ("": several controls)."""

    def __init__(self, errors: dict[str, str]) -> None:
        super().__init__("; ".join(errors.values()))
        self.errors = errors
