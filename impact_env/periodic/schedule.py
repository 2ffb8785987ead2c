"""The order of an orbit's events, without their times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np

from impact_env.checks import (
    ParameterError,
    count,
    count_from,
    each_of,
    flag,
    kind_of,
    listed,
    require,
)
from impact_env.fields import check_fields
from impact_env.kernels.periodic.structure import Order


class Regime(Enum):
    """The regime of a segment between two events.

    Absorber and beam are apart, without or with friction between them, or joined by friction or a
    wall.
    """

    FREE = "free"
    SLIDING = "sliding"
    JOINED = "joined"


@dataclass(frozen=True)
class Event:
    """One event, and the segment that follows it.

    ``regime`` is that of the segment, ``wall`` is the wall touched (-1, 0, 1), and ``sign`` is that
    of the relative velocity (0: joined). At an impact sign = -wall. At a reversal wall = 0. At the
    start of a joined segment ``wall`` is the wall that holds the absorber, 0 for friction.
    """

    regime: Regime
    wall: int
    sign: int

    def __post_init__(self) -> None:
        require(isinstance(self.regime, Regime), "regime", self.regime, "one of the class Regime")
        require(self.wall in (-1, 0, 1), "wall", self.wall, "-1, 0 or 1")
        joined = self.regime is Regime.JOINED
        require(
            self.sign in ((0,) if joined else (-1, 1)),
            "sign",
            self.sign,
            "0 in a joined segment, else -1 or 1",
        )
        require(
            joined or self.wall == 0 or self.sign == -self.wall,
            "sign",
            self.sign,
            f"{-self.wall} after an impact on wall {self.wall}",
        )

    @property
    def mirrored(self) -> Event:
        """The event of the mirrored motion."""
        return Event(self.regime, -self.wall, -self.sign)

    @property
    def is_impact(self) -> bool:
        """Whether the absorber hits a wall and leaves it."""
        return self.wall != 0 and self.sign != 0


MOST_ORBIT_PERIODS = 10**6  # of an orbit: more are never computed


def count_turns(symmetric: bool, period_multiple: int) -> float:
    """Return the phase of the force in rad after which an orbit's state repeats.

    If the orbit is ``symmetric``, the state repeats with the opposite sign.
    """
    period_multiple = count("period_multiple", period_multiple, 1, MOST_ORBIT_PERIODS)
    odd = period_multiple % 2 == 1
    require(
        odd or not symmetric,
        "period_multiple",
        period_multiple,
        "odd for a symmetric orbit: the force must turn its sign in half of it",
    )
    return period_multiple * math.pi * (1 if symmetric else 2)


@dataclass(frozen=True)
class EventSchedule:
    """The events of one period of an orbit.

    Parameters
    ----------
    events : tuple of Event
        Events of the period, or of its first half if ``symmetric``.
    symmetric : bool, optional
        Whether the second half of the period mirrors the first.
    period_multiple : int, optional
        Period in periods of the force.

    Raises
    ------
    ParameterError
        The events cannot repeat in this order.
    """

    events: tuple[Event, ...]
    symmetric: bool = False
    period_multiple: int = 1

    def __post_init__(self) -> None:
        check_fields(
            self,
            events=each_of(kind_of(Event)),
            symmetric=flag,
            period_multiple=count_from(1, MOST_ORBIT_PERIODS),
        )
        require(len(self.events) > 0, "events", self.events, "one or more")
        count_turns(self.symmetric, self.period_multiple)  # raises where there is no such orbit
        require(
            self.symmetric or len(self.events) > 1,
            "events",
            self.events,
            "two or more where no half mirrors the other",
        )
        last = self.events[-1].mirrored if self.symmetric else self.events[-1]
        for before, after in zip((last, *self.events[:-1]), self.events, strict=True):
            turns = (
                after.regime is Regime.SLIDING
                and after.wall == 0
                and before.regime is not Regime.JOINED
            )
            require(
                not turns or after.sign == -before.sign,
                "events",
                self.events,
                "a reversal between two senses of sliding",
            )

    @property
    def turn(self) -> float:
        """Phase of the force over the events listed, in rad."""
        return count_turns(self.symmetric, self.period_multiple)

    @cached_property
    def impacts(self) -> int:
        """Number of impacts among the events listed."""
        return sum(event.is_impact for event in self.events)

    @cached_property
    def reversals(self) -> int:
        """Number of friction reversals among the listed events.

        The end of a joined segment is no reversal.
        """
        pairs = zip((self.events[-1], *self.events[:-1]), self.events, strict=True)
        return sum(
            event.regime is Regime.SLIDING
            and event.wall == 0
            and before.regime is not Regime.JOINED
            for before, event in pairs
        )

    @cached_property
    def flies(self) -> bool:
        """Whether absorber and beam are never joined."""
        return all(event.regime is not Regime.JOINED for event in self.events)

    @property
    def unknowns(self) -> int:
        """Number m of unknowns of an orbit without joined segments.

        They are phases, impulses, and the mean relative displacement unless the orbit is symmetric.
        """
        return len(self.events) + self.impacts + (0 if self.symmetric else 1)

    @cached_property
    def order(self) -> Order:
        """The events as arrays, for the kernels.

        Raises ParameterError if the schedule has a joined segment or does not begin with an impact.
        """
        if not self.flies:
            raise ParameterError(
                "schedule with joined segments is not allowed here: Green's function is that "
                "of a free or sliding absorber"
            )
        require(self.events[0].is_impact, "schedule", str(self), "one that begins with an impact")
        wall, sign = (
            np.array([getattr(event, name) for event in self.events], dtype=np.int64)
            for name in ("wall", "sign")
        )
        return Order(wall, sign, self.turn, -1.0 if self.symmetric else 1.0)

    def __str__(self) -> str:
        words = (
            f"{self.impacts} impact{'s' * (self.impacts != 1)} and {self.reversals} "
            f"reversal{'s' * (self.reversals != 1)} in "
        )
        whole = "period" if self.period_multiple == 1 else f"{self.period_multiple} periods"
        return words + (
            f"half of {'a' if self.period_multiple == 1 else ''} {whole}".replace("  ", " ")
            if self.symmetric
            else whole
        )


def flying_schedule(
    walls: Sequence[int], friction: bool, symmetric: bool = False, period_multiple: int = 1
) -> EventSchedule:
    """Return the schedule of impacts on ``walls`` (-1, 1) in this order, without joined segments.

    0 stands for a reversal. The first event must be an impact.
    """
    allowed = "a row of -1, 0 and 1 that begins with an impact"
    walls = [count("walls", wall, -1, 1, allowed) for wall in listed("walls", walls)]
    friction = flag("friction", friction)
    require(len(walls) > 0 and walls[0] != 0, "walls", walls, allowed)
    regime = Regime.SLIDING if friction else Regime.FREE
    sign = 0
    events = []
    for wall in walls:
        sign = -wall if wall != 0 else -sign
        events.append(Event(regime, wall, sign))
    return EventSchedule(tuple(events), symmetric, period_multiple)
