"""Tasks whose scene is drawn at random.

They are a passage, and control within a period on structures in units of their first resonance.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    count_from,
    flag,
    non_negative,
    positive,
    require,
    word_of,
)
from impact_env.controlled import ControlledRuns
from impact_env.envs.active_task import (
    ActiveFrictionTask,
    ActiveSettings,
    MovingWallsTask,
    WallActuator,
)
from impact_env.envs.adaptive_task import FrictionRange, VariableFrictionTask
from impact_env.envs.observation import (
    DISTANCE_TO_END,
    FREQUENCY,
    FRICTION_IN_USE,
    GAP_IN_USE,
    RMS,
    STATE,
    TIME_LEFT,
    Feature,
)
from impact_env.envs.reference import simulate_passage, stationary_amplitude
from impact_env.envs.settings import FORCE_BOUNDS, Range, TaskSettings, check_range
from impact_env.envs.sweep_task import PER_PERIOD, PassageSettings, SweepTask, speeds
from impact_env.envs.task import Array, Mask, PooledTask
from impact_env.fields import check_fields
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Beam, RigidWalls, SlidingAbsorber
from impact_env.scene import Scene

DIGITS = 1e-12


def _span_within(
    name: str, value: Any, *, lowest: float, highest: float = math.inf
) -> tuple[float, float]:
    """Return (low, high) as floats if both lie from ``lowest`` to ``highest``."""
    low, high = check_range(name, value)
    allowed = f"(low, high), from {lowest:g} to {highest:g}"
    require(lowest <= low and high <= highest, name, value, allowed)
    return low, high


@dataclass(frozen=True)
class RandomisedSettings:
    """Arguments of the random values of a passage.

    Parameters
    ----------
    limits : pair
        Lowest and highest frequency over the resonance.
    start_spread : float
        Largest distance of the start from the near end of ``limits``, as a frequency ratio.
    sweep_rates : pair
        Slowest and fastest rate in % per 100 pseudo periods.
    gap_starts : pair
        Smallest and largest half-clearance at the start in m.
    damping : pair
        Smallest and largest damping ratio of all modes.
    restitution : pair
        Smallest and largest coefficient of restitution.
    scenes : int
        Number of pairs of damping and restitution, spread evenly over their ranges.
    price : float
        Price of moving the walls by one half-clearance of the scene.
    fatigue_exponent : float
        Exponent of the displacement in the cost of fatigue.

    """

    limits: Range = (0.93, 1.03)
    start_spread: float = 0.01
    sweep_rates: Range = (2.0, 6.0)
    gap_starts: Range = (0.3e-3, 2e-3)
    damping: Range = (0.005, 0.02)
    restitution: Range = (0.6, 1.0)
    scenes: int = 12
    price: float = 0.01
    fatigue_exponent: float = PassageSettings.fatigue_exponent

    def __post_init__(self) -> None:
        check_fields(
            self,
            limits=partial(_span_within, lowest=DIGITS),
            gap_starts=partial(_span_within, lowest=DIGITS),
            damping=partial(_span_within, lowest=1e-4, highest=0.5),
            restitution=partial(_span_within, lowest=0.0, highest=1.0),
            scenes=count_from(1, 1000),
            price=non_negative,
            fatigue_exponent=positive,
            start_spread=non_negative,
        )
        half_width = 0.5 * (self.limits[1] - self.limits[0])
        require(
            self.start_spread < half_width,
            "start_spread",
            self.start_spread,
            f"less than half the width of limits, {half_width:g}",
        )
        check_fields(self, sweep_rates=partial(speeds, limits=self.limits))

    def pool(self, scene: Scene) -> list[Scene]:
        """Return the scenes from which episodes draw.

        Each has its own damping and restitution. The scenes are the same at every call.
        """
        absorber = scene.absorber
        assert isinstance(absorber, SlidingAbsorber)
        assert isinstance(absorber.walls, RigidWalls)
        shares = np.random.default_rng(0).permutation((np.arange(self.scenes) + 0.5) / self.scenes)
        made = []
        for k, share in enumerate(shares.tolist()):
            damping = self.damping[0] * (self.damping[1] / self.damping[0]) ** (
                (k + 0.5) / self.scenes
            )
            model = replace(scene.model, damping_ratio=np.full(scene.model.modes, damping))
            walls = replace(
                absorber.walls,
                restitution=self.restitution[0]
                + share * (self.restitution[1] - self.restitution[0]),
            )
            made.append(replace(scene, model=model, absorber=replace(absorber, walls=walls)))
        return made


class LimitedPassageTask(PooledTask, VariableFrictionTask, MovingWallsTask, SweepTask):
    """Lanes that pass through a resonance, each in a scene of a pool, at a rate of its own.

    Of `costs` the level is the rise of the relative level, and the actuator moves the walls.
    Impacts, a pseudo period of a whole interval, are there in the place of the contact force: over
    several periods the absorber's momentum says nothing of it, and reports have no impulses.
    """

    cost_names = ("level", "time", "fatigue", "actuator", "impacts")
    frequency_unit = 0.05
    least_cost = np.array([-math.inf, 0.0, 0.0, 0.0, 0.0])
    features: Sequence[Feature] = (
        *(feature for feature in STATE[:-1] if feature not in (FREQUENCY, TIME_LEFT)),
        FREQUENCY,
        TIME_LEFT,
        RMS,
        DISTANCE_TO_END,
        GAP_IN_USE,
        FRICTION_IN_USE,
        Feature(
            "rate of the frequency", False, "rate of the frequency", "% per 100 pseudo periods / 4"
        ),
    )

    def __init__(
        self,
        settings: TaskSettings,
        drawn: RandomisedSettings,
        drive: WallActuator,
        grip: FrictionRange,
        lanes: int,
    ) -> None:
        self.set_drive(settings, drive, lanes)
        self.set_limits(settings, grip, lanes)
        self.own = drawn
        self.scenes = drawn.pool(settings.scene)
        low, high = drawn.limits
        budget = (high - low) / (drawn.sweep_rates[0] * PER_PERIOD)
        way = PassageSettings(
            direction="random",
            limits=drawn.limits,
            rates=drawn.sweep_rates,
            time_price=0.0,
            frequency_unit=self.frequency_unit,
            level_unit="gap",
            time_budget=1.01 * budget + 1,
        )
        super().__init__(settings, way, lanes)
        self.described = (drawn, drive, grip)
        self.level_name = "RMS of an interval over the scene's half-clearance"
        self.options = {"force": FORCE_BOUNDS, "scene": (0, drawn.scenes - 1)}
        self._levels: dict[tuple[int, bool], float] = {}
        self.rates = np.zeros(lanes)

    def starting_action(self) -> Array:
        """Return the scene's half-clearance and friction (2,), see `Task.starting_action`."""
        walls = MovingWallsTask.starting_action(self)
        return np.concatenate([walls, VariableFrictionTask.starting_action(self)])

    def make_runs(self, **arguments: Any) -> ControlledRuns:
        """Return lanes in a pool of scenes."""
        return super().make_runs(
            **arguments | {"exponent": self.own.fatigue_exponent}
        )  # for the costs: the reward has none

    def draw(self, lane: int, generator: np.random.Generator) -> None:
        """Draw scene, direction, start, rate, gap and force."""
        own = self.own
        number = self.draw_scene("scene", lane, generator)
        down = bool(generator.integers(2))
        start, self.far[lane] = self._ends[int(down)]
        self.sign[lane] = -1.0 if down else 1.0
        self.ratio[lane] = start + self.sign[lane] * own.start_spread * generator.uniform()
        self.rates[lane] = generator.uniform(*own.sweep_rates)
        low, high = own.gap_starts
        self.runs.orders["gap"][lane] = low * (high / low) ** generator.uniform()
        self.force[lane] = force = self.draw_force(lane, generator)
        if (
            number,
            down,
        ) not in self._levels:  # of the beam without absorber over the whole range, under 1 N
            yardstick = (
                self.settings.samples_per_period,
                0.0,
                self.length,
                self.settings.moves_base,
            )
            self._levels[number, down] = simulate_passage(
                self.scenes[number],
                self.settings.resonance,
                *self._ends[int(down)].tolist(),
                *yardstick,
            )[0]
        self.level_scale[lane] = self._levels[number, down] * force
        self._potential[lane] = 0.0

    def charge_passage(self, rise: Array) -> None:
        """Fill the interval's ``costs`` (L, 5), see `SweepTask.charge_passage`."""
        self.charge(self.moved())
        self.costs[:, 0] = rise
        self.costs[:, 4] = self.runs.reports["impact_count"] / self.interval

    def rate(self, actions: NDArray[Any]) -> Array:  # noqa: ARG002 - it is drawn
        """Return the rates (L,) in % per 100 pseudo periods."""
        return self.rates

    def decide(self, actions: NDArray[Any]) -> tuple[Array, Array, Mask]:
        """Order walls and friction, and go on."""
        self.act(actions)
        self.order_friction(actions, 1)
        return super().decide(actions)

    def reward(self) -> Array:
        """Return the reward of the passage, less the price of moving the walls."""
        rewards = super().reward()
        return (
            rewards - self.own.price * np.abs(self.runs.orders["gap"] - self._before) / self.length
        )

    def level(self) -> Array:
        """Return the RMS of the last interval in half-clearances."""
        return np.sqrt(self.runs.reports["mean_square"]) / self.length

    def further(self) -> tuple[Array, ...]:
        """Return the rate of the frequency, too."""
        return (*super().further(), self.rates / 4)

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the task's part of the info, arrays (L,) by key."""
        return super().info() | {"scene": self.which.copy()}


Generator = np.random.Generator
DAMPING_BOUNDS = (0.005, 0.02)
STRUCTURE_FEATURES = (
    Feature(
        "damping ratio of the first mode", False, "damping ratio of the first mode", "1 / 0.01"
    ),
    Feature("second frequency over the first", False, "second frequency over the first", "1 / 5"),
    Feature(
        "absorber's mass over the first mode's",
        False,
        "absorber's mass times the square of the first mode's shape at it",
        "1 / 0.08",
    ),
)


def _beam(ends: str) -> Any:
    def drawn(generator: Generator) -> ModalModel:
        """Return a beam with force and absorber anywhere in the part that moves."""
        free = ends.endswith("free")
        force = generator.uniform(0.3, 0.7)
        absorber = generator.uniform(0.8, 1.0) if free else generator.uniform(0.4, 0.65)
        return modal_model(
            Beam(
                modes=2,
                ends=ends,
                force_position=float(force),
                absorber_position=float(absorber),
                damping_ratio=_damping(generator),
            )
        )

    return drawn


def _plate(generator: Generator) -> ModalModel:
    """Return two modes of a rectangular plate on hinges.

    Frequencies are proportional to m^2/a^2 + n^2/b^2, shapes are 2 sin sin/sqrt(mass) (A. W. Leissa
    1969).
    """
    aspect = generator.uniform(1.1, 1.8)
    force = generator.uniform(0.25, 0.45, 2)
    absorber = generator.uniform(0.35, 0.65, 2)

    def shape(m: int, place: NDArray[Any]) -> float:
        return float(2 * math.sin(m * math.pi * place[0]) * math.sin(math.pi * place[1]))

    omega = np.array([1.0, (4 / aspect**2 + 1) / (1 / aspect**2 + 1)])
    rows = [np.array([shape(m, place) for m in (1, 2)]) for place in (force, absorber)]
    return ModalModel(omega, np.full(2, _damping(generator)), rows[0], rows[1], 1.0)


def _modes(generator: Generator) -> ModalModel:
    """Return two modes as a measurement might give them.

    The second frequency is between twice and eight times the first. The shapes have either sign.
    """
    signs = np.array([1.0, generator.choice([-1.0, 1.0])])
    force = generator.uniform(0.4, 1.5, 2) * signs
    absorber = generator.uniform(1.2, 2.2, 2)
    return ModalModel(
        np.array([1.0, generator.uniform(2.0, 8.0)]),
        generator.uniform(*DAMPING_BOUNDS, 2),
        force,
        absorber,
        1.0,
    )


def _damping(generator: Generator) -> float:
    return float(DAMPING_BOUNDS[0] * (DAMPING_BOUNDS[1] / DAMPING_BOUNDS[0]) ** generator.uniform())


TRAINING_FAMILIES = (_beam("clamped-free"), _beam("pinned-pinned"), _plate)
TEST_FAMILIES = (_beam("clamped-clamped"), _modes)
FAMILY_SPLITS = {
    "train": (0, TRAINING_FAMILIES),
    "validation": (1, TRAINING_FAMILIES),
    "test": (2, TEST_FAMILIES),
}


def rescale_model(model: ModalModel, standard: ModalModel) -> ModalModel:
    """Return a model with the first frequency and the mass of a standard model.

    The structure is the same in other units of time and mass.
    """
    time = standard.omega[0] / model.omega[0]
    mass = math.sqrt(model.beam_mass / standard.beam_mass)
    force = model.force_shape * mass
    tip = model.tip_shape * mass
    omega = model.omega * time
    base = None if model.base_participation is None else model.base_participation / mass
    return replace(
        model,
        omega=omega,
        force_shape=force,
        tip_shape=tip,
        beam_mass=standard.beam_mass,
        response_shape=None,
        base_participation=base,
    )


@dataclass(frozen=True)
class StructurePool:
    """Arguments of the choice of structures.

    Parameters
    ----------
    split : str
        ``"train"``, ``"validation"`` or ``"test"``.
    structures : int
        Number of structures from which episodes draw.
    observe_structure : bool
        Whether the last three features are observed.

    """

    split: str = "train"
    structures: int = 24
    observe_structure: bool = True

    def __post_init__(self) -> None:
        check_fields(
            self,
            split=word_of(FAMILY_SPLITS),
            structures=count_from(1, 1000),
            observe_structure=flag,
        )

    def models(self, standard: ModalModel) -> list[ModalModel]:
        """Return the structures, each family in its turn, the same ones always."""
        seed, kinds = FAMILY_SPLITS[self.split]
        return [
            rescale_model(kinds[k % len(kinds)](np.random.default_rng([seed, k])), standard)
            for k in range(self.structures)
        ]


class StructuresTask(ActiveFrictionTask):
    """Lanes with a structure each."""

    features: Sequence[Feature] = (*ActiveFrictionTask.features, *STRUCTURE_FEATURES)

    def __init__(
        self,
        settings: TaskSettings,
        cycle: ActiveSettings,
        grip: FrictionRange,
        pool: StructurePool,
        lanes: int,
    ) -> None:
        standard = settings.scene.model
        require(
            standard.modes == 2,
            "modes",
            standard.modes,
            "2: structures that are drawn have as many",
        )
        self.pool = pool
        self.models = pool.models(standard)
        if not pool.observe_structure:
            self.features = ActiveFrictionTask.features
        usual = stationary_amplitude(standard, standard.omega[0], settings.moves_base)
        self._force_unit = [
            usual / stationary_amplitude(model, model.omega[0], settings.moves_base)
            for model in self.models
        ]
        self._shapes = np.array([model.tip_shape for model in self.models])
        super().__init__(settings, cycle, grip, lanes)
        self.described += (pool,)
        mass = settings.scene.absorber_mass
        assert mass is not None
        self._data = np.array(
            [
                (
                    m.damping_ratio[0] / 0.01,
                    m.omega[1] / m.omega[0] / 5,
                    mass * m.tip_shape[0] ** 2 / 0.08,
                )
                for m in self.models
            ]
        )
        self.options = {**self.options, "structure": (0, pool.structures - 1)}

    def nominal_scenes(self, settings: TaskSettings) -> Sequence[Scene]:
        """Return a scene for each structure."""
        return [replace(settings.scene, model=model) for model in self.models]

    def draw(self, lane: int, generator: Generator) -> None:
        """Draw the structure, and what all draw."""
        self.draw_scene("structure", lane, generator)
        super().draw(lane, generator)

    def draw_force(self, lane: int, generator: Generator) -> float:
        """Return a lane's force in N, scaled to its structure.

        It moves the lane's structure at resonance as far as the drawn force moves the standard
        structure.
        """
        return super().draw_force(lane, generator) * self._force_unit[self.which[lane]]

    def level_shapes(self) -> NDArray[np.float64]:
        """Return the lanes' shapes (L, 2)."""
        return np.asarray(self._shapes[self.which])

    def further(self) -> tuple[Array, ...]:
        """Return the structure's numbers, too, if they are shown."""
        return (
            *super().further(),
            *(self._data[self.which].T if self.pool.observe_structure else ()),
        )

    def info(self) -> dict[str, NDArray[Any]]:
        """Return the task's part of the info, arrays (L,) by key."""
        return super().info() | {"structure": self.which.copy()}
