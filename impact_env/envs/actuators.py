"""Actuators of the absorber: its gap, its moving walls, its friction limit.

Each sets its quantity by one column of the actions.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import non_negative, positive, require
from impact_env.controlled import friction_limit
from impact_env.envs.observation import FRICTION_IN_USE, GAP_IN_USE
from impact_env.envs.settings import Range, check_pair, check_range
from impact_env.envs.task import Actuator, Array, Generator, LaneState
from impact_env.fields import check_fields
from impact_env.kernels.control.episodes import (
    measure_wall_motion,
    order_friction,
    order_wall_motion,
)
from impact_env.kernels.control.interval import interpolate_log
from impact_env.parameters import RigidWalls, SlidingAbsorber
from impact_env.scene import Scene

WIDEST_GAPS = (1e-9, 1e9)  # of the range, in its unit


@dataclass(frozen=True)
class GapRange:
    """Arguments of the choice of the gap.

    Parameters
    ----------
    gap_limits : pair
        Smallest and largest half-clearance in m.

    """

    gap_limits: Range = (0.1e-3, 3e-3)

    def __post_init__(self) -> None:
        check_fields(self, gap_limits=check_pair("half-clearances in m"))


def find_log_place(value: float, low: float, high: float) -> float:
    """Return the position of a value between ``low`` and ``high`` on a logarithmic scale.

    The position is -1 at ``low`` and 1 at ``high``. Values outside are moved to the ends.
    """
    if low == high:
        return 0.0
    return min(max(2 * math.log(value / low) / math.log(high / low) - 1, -1.0), 1.0)


def require_cavity(scene: Scene) -> None:
    """Raise ParameterError unless a scene's absorber is in a cavity with rigid walls."""
    absorber = scene.absorber
    rigid = isinstance(absorber, SlidingAbsorber) and isinstance(absorber.walls, RigidWalls)
    require(
        rigid,
        "absorber",
        absorber,
        "an impact absorber with rigid walls: there must be a cavity whose walls can be set",
    )


def require_friction(scene: Scene) -> None:
    """Raise ParameterError unless a scene's absorber has rigid friction."""
    require(
        math.isfinite(friction_limit(scene)),
        "absorber",
        scene.absorber,
        "one with rigid friction: there must be a friction_limit that can be set",
    )


@dataclass(frozen=True)
class FrictionRange:
    """Arguments of the choice of the friction limit.

    Parameters
    ----------
    friction_range : pair
        Smallest and largest friction limit, above 0, in units of m_a g0 omega^2 (mass of the
        absorber, half-clearance, resonance; 0.72 N in the default scene). Friction of equal size in
        this unit has equal effect on any structure.

    """

    friction_range: Range = (0.02, 20.0)

    def __post_init__(self) -> None:
        check_fields(self, friction_range=check_range)
        low, high = self.friction_range
        ok = WIDEST_GAPS[0] <= low < high <= WIDEST_GAPS[1]
        allowed = f"(low, high) with {WIDEST_GAPS[0]} <= low < high <= {WIDEST_GAPS[1]}"
        require(ok, "friction_range", self.friction_range, allowed)


@dataclass(frozen=True)
class WallSettings(GapRange):
    """Arguments of walls that move: those of `GapRange`, speed and lag.

    Parameters
    ----------
    gap_speed : float
        Largest change of the half-clearance in a pseudo period, in m.
    gap_lag : float
        Time constant of the walls in pseudo periods.

    """

    gap_speed: float = 0.3e-3
    gap_lag: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields(self, gap_speed=positive, gap_lag=non_negative)

    def motion(self, interval: float) -> tuple[float, float]:
        """Return the two limits of the walls' motion in an interval (pseudo periods).

        They are the share of the distance to their target that the walls cover because of the lag,
        and their longest displacement in m.
        """
        share = -math.expm1(-interval / self.gap_lag) if self.gap_lag > 0 else 1.0
        return share, self.gap_speed * interval


class GapActuator(Actuator):
    """The half-clearance of the cavity, which changes at the start of an interval.

    It is no smaller than the absorber's distance from the middle. ``wanted`` and ``gap_before``
    (L,) are the ordered half-clearances and those of the interval before, in m. Actions are
    logarithmic between the limits (m), or linear.
    """

    def __init__(self, lanes: LaneState, limits: Range, is_logarithmic: bool = True) -> None:
        super().__init__(lanes)
        self.limits = limits
        self.is_logarithmic = is_logarithmic
        self.wanted = np.zeros(lanes.count)
        self.gap_before = np.zeros(lanes.count)
        self.columns = {GAP_IN_USE.name: self.compute_relative_gap}

    def starting_action(self) -> float:
        """Return the position of the scene's half-clearance in the range."""
        low, high = self.limits
        length = self.lanes.length
        if self.is_logarithmic:
            return find_log_place(length, low, high)
        return min(max(2 * (length - low) / (high - low) - 1 if low < high else 0.0, -1.0), 1.0)

    def start(self, lane: int, generator: Generator) -> None:  # noqa: ARG002 - nothing is drawn
        """Set the half-clearance of the scene."""
        self.lanes.runs.orders["gap"][lane] = self.lanes.length
        self.wanted[lane] = self.lanes.length

    def apply(self, actions: Array, column: int) -> None:
        """Order the chosen half-clearances."""
        low, high = self.limits
        share = 0.5 * (actions[:, column] + 1)
        orders = self.lanes.runs.orders
        self.gap_before = orders["gap"].copy()
        self.wanted = (
            interpolate_log(share, low, high) if self.is_logarithmic else low + share * (high - low)
        )
        orders["gap"] = self.wanted

    def compute_displacement(self) -> Array:
        """Return the displacement of the walls (L,) in half-clearances of the scene."""
        return np.abs(self.lanes.runs.orders["gap"] - self.gap_before) / self.lanes.length

    def compute_relative_gap(self) -> Array:
        """Return the half-clearances in use (L,) over that of the scene."""
        return self.lanes.runs.orders["gap"] / self.lanes.length

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the half-clearances in m, and whether the absorber limits them."""
        gap = self.lanes.runs.orders["gap"]
        return {"gap": gap.copy(), "gap_limited": gap > self.wanted}


class MovingWallsActuator(Actuator):
    """Walls that move towards a target, with a lag and a largest speed.

    ``gap_before`` (L,) are the half-clearances in m before the last interval. Episodes start with
    the half-clearance of the scene, or with a random one from ``starts`` (m).
    """

    def __init__(self, lanes: LaneState, walls: WallSettings, starts: Range | None = None) -> None:
        super().__init__(lanes)
        self.limits = walls.gap_limits
        self.starts = starts
        self._motion = (*walls.gap_limits, *walls.motion(lanes.interval))
        self.gap_before = np.zeros(lanes.count)
        self._displacement = np.zeros(lanes.count)
        self.columns = {GAP_IN_USE.name: self.compute_relative_gap}

    def starting_action(self) -> float:
        """Return the position of the scene's half-clearance in the range."""
        return find_log_place(self.lanes.length, *self.limits)

    def start(self, lane: int, generator: Generator) -> None:
        """Set the half-clearance of the scene, or draw one."""
        gap = self.lanes.length
        if self.starts is not None:
            low, high = self.starts
            gap = low * (high / low) ** generator.uniform()
        self.lanes.runs.orders["gap"][lane] = gap

    def apply(self, actions: Array, column: int) -> None:
        """Order half-clearances that approach the chosen targets."""
        order_wall_motion(  # type: ignore[no-untyped-call]
            actions[:, column:], *self._motion, self.lanes.runs.orders, self.gap_before
        )

    def compute_displacement(self) -> Array:
        """Return the displacement of the walls (L,) in half-clearances of the scene."""
        measure_wall_motion(  # type: ignore[no-untyped-call]
            self.lanes.runs.orders, self.gap_before, self.lanes.length, self._displacement
        )
        return self._displacement

    def compute_relative_gap(self) -> Array:
        """Return the half-clearances in use (L,) over that of the scene."""
        return self.lanes.runs.orders["gap"] / self.lanes.length

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the half-clearances in m."""
        return {"gap": self.lanes.runs.orders["gap"].copy()}


class FrictionActuator(Actuator):
    """The friction limit of the absorber, logarithmic between its ``limits`` (low, high) in N.

    ``friction`` (L,) in N and ``place`` (L,) in the range, from -1 to 1, are those in use.
    """

    def __init__(self, lanes: LaneState, friction: FrictionRange) -> None:
        super().__init__(lanes)
        scene = lanes.settings.scene
        self._friction_at_start = friction_limit(scene)
        assert scene.absorber_mass is not None
        unit = scene.absorber_mass * lanes.length * lanes.omega**2
        low, high = friction.friction_range
        self.limits = low * unit, high * unit
        low, high = self.limits
        self._place_at_start = (
            2 * math.log(self._friction_at_start / low) / math.log(high / low) - 1
        )
        self.friction = np.full(lanes.count, self._friction_at_start)
        self.place = np.zeros(lanes.count)
        self._displacement = np.zeros(lanes.count)
        self.columns = {FRICTION_IN_USE.name: self.read_place}

    def starting_action(self) -> float:
        """Return the position of the scene's friction limit in the range."""
        return min(max(self._place_at_start, -1.0), 1.0)

    def start(self, lane: int, generator: Generator) -> None:  # noqa: ARG002 - nothing is drawn
        """Set the friction limit and its position to those of the scene."""
        self.friction[lane] = self._friction_at_start
        self.place[lane] = self._place_at_start

    def apply(self, actions: Array, column: int) -> None:
        """Order the chosen friction limits."""
        order_friction(  # type: ignore[no-untyped-call]
            actions,
            column,
            *self.limits,
            self.lanes.runs.orders,
            self.friction,
            self.place,
            self._displacement,
        )

    def compute_displacement(self) -> Array:
        """Return the displacement (L,) in the range, which is 2 wide."""
        return self._displacement

    def read_place(self) -> Array:
        """Return the positions (L,) of the friction limits in the range, from -1 to 1."""
        return self.place

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the friction limits in N."""
        return {"friction_limit": self.friction.copy()}
