"""Cross sections of beams: area and second moment of area from a few lengths."""

import math
from dataclasses import dataclass

from impact_env.parameters import require

PROFILES = {"rectangle": ("width", "height"), "tube": ("diameter", "wall"), "I": ("width", "height", "flange", "web")}


@dataclass(frozen=True)
class Profile:
    """A cross section that bends about its level axis: a rectangle, a round tube (``wall`` of its diameter's half: a rod) or an I."""

    kind: str
    width: float = 0.0
    height: float = 0.0
    diameter: float = 0.0
    wall: float = 0.0
    flange: float = 0.0
    web: float = 0.0

    def __post_init__(self) -> None:
        require(self.kind in PROFILES, "kind", self.kind, f"one of {', '.join(PROFILES)}")
        for name in PROFILES:
            for key in PROFILES[name]:
                value, own = getattr(self, key), key in PROFILES[self.kind]
                require(
                    value > 0 if own else value == 0 or key in PROFILES[self.kind],
                    f"{key}_m",
                    value,
                    f"above 0, for {name}" if own else f"for {name} only",
                )
        if self.kind == "tube":
            require(2 * self.wall <= self.diameter, "wall_m", self.wall, f"at most half the diameter, {self.diameter / 2:g} m")
        if self.kind == "I":
            require(
                2 * self.flange < self.height and self.web < self.width,
                "flange_m, web_m",
                (self.flange, self.web),
                "less than half the height, the width",
            )

    @property
    def area(self) -> float:
        """Area in m^2."""
        if self.kind == "tube":
            return math.pi * self.wall * (self.diameter - self.wall)
        cut = (self.width - self.web) * (self.height - 2 * self.flange) if self.kind == "I" else 0.0
        return self.width * self.height - cut

    @property
    def second_moment(self) -> float:
        """Second moment of area in m^4."""
        if self.kind == "tube":
            return math.pi / 64 * (self.diameter**4 - (self.diameter - 2 * self.wall) ** 4)
        cut = (self.width - self.web) * (self.height - 2 * self.flange) ** 3 if self.kind == "I" else 0.0
        return (self.width * self.height**3 - cut) / 12
