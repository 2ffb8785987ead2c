"""Randomly drawn structures (beams, plates, random modes), in units of their first resonance."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.controlled import ControlledRuns, PooledRuns
from impact_env.envs.active_task import ActiveFrictionTask, Cycle
from impact_env.envs.adaptive_task import Grip
from impact_env.envs.observation import Feature
from impact_env.envs.reference import stationary_amplitude
from impact_env.envs.settings import Settings
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Beam, count, one_of, require

Generator = np.random.Generator
DAMPING = (0.005, 0.02)
DATA = (
    Feature("damping ratio of the first mode", False),
    Feature("second frequency over the first", False),
    Feature("absorber's mass over the first mode's", False),
)


def _beam(ends: str) -> Any:
    def drawn(generator: Generator) -> ModalModel:
        """Return a beam with force and absorber anywhere in the part that moves."""
        free = ends.endswith("free")
        force, absorber = generator.uniform(0.3, 0.7), generator.uniform(0.8, 1.0) if free else generator.uniform(0.4, 0.65)
        return modal_model(
            Beam(modes=2, ends=ends, force_position=float(force), absorber_position=float(absorber), damping_ratio=_damping(generator))
        )

    return drawn


def _plate(generator: Generator) -> ModalModel:
    """Return two modes of a rectangular plate on hinges: frequencies as m^2/a^2 + n^2/b^2, shapes 2 sin sin/sqrt(mass) (A. W. Leissa 1969)."""
    aspect = generator.uniform(1.1, 1.8)
    force, absorber = (generator.uniform(0.25, 0.45, 2), generator.uniform(0.35, 0.65, 2))

    def shape(m: int, place: NDArray[Any]) -> float:
        return float(2 * math.sin(m * math.pi * place[0]) * math.sin(math.pi * place[1]))

    omega = np.array([1.0, (4 / aspect**2 + 1) / (1 / aspect**2 + 1)])
    rows = [np.array([shape(m, place) for m in (1, 2)]) for place in (force, absorber)]
    return ModalModel(omega, np.full(2, _damping(generator)), rows[0], rows[1], 1.0)


def _modes(generator: Generator) -> ModalModel:
    """Return two modes as a measurement might give them: any frequency between twice and eight times the first, shapes of either sign."""
    signs = np.array([1.0, generator.choice([-1.0, 1.0])])
    force, absorber = generator.uniform(0.4, 1.5, 2) * signs, generator.uniform(1.2, 2.2, 2)
    return ModalModel(np.array([1.0, generator.uniform(2.0, 8.0)]), generator.uniform(*DAMPING, 2), force, absorber, 1.0)


def _damping(generator: Generator) -> float:
    return float(DAMPING[0] * (DAMPING[1] / DAMPING[0]) ** generator.uniform())


KNOWN, NEW = (_beam("clamped-free"), _beam("pinned-pinned"), _plate), (_beam("clamped-clamped"), _modes)
SPLITS = {"train": (0, KNOWN), "validation": (1, KNOWN), "test": (2, NEW)}


def in_units_of(model: ModalModel, standard: ModalModel) -> ModalModel:
    """Return a model with the first frequency and the mass of a standard: other units of time and mass, the same structure."""
    time, mass = standard.omega[0] / model.omega[0], math.sqrt(model.beam_mass / standard.beam_mass)
    force, tip = model.force_shape * mass, model.tip_shape * mass
    omega, base = model.omega * time, None if model.base_participation is None else model.base_participation / mass
    return replace(model, omega=omega, force_shape=force, tip_shape=tip, beam_mass=standard.beam_mass, response_shape=None, base_participation=base)


@dataclass(frozen=True)
class Pool:
    """Arguments of the choice of structures; `StructuresEnv` describes them."""

    split: str = "train"
    structures: int = 24
    observe_structure: bool = True

    def __post_init__(self) -> None:
        one_of("split", self.split, SPLITS)
        count("structures", self.structures, 1, 1000)
        require(isinstance(self.observe_structure, bool), "observe_structure", self.observe_structure, "True or False")

    def models(self, standard: ModalModel) -> list[ModalModel]:
        """Return the structures, each family in its turn, the same ones always."""
        seed, kinds = SPLITS[self.split]
        return [in_units_of(kinds[k % len(kinds)](np.random.default_rng([seed, k])), standard) for k in range(self.structures)]


class StructuresTask(ActiveFrictionTask):
    """Lanes with a structure each."""

    def __init__(self, settings: Settings, cycle: Cycle, grip: Grip, pool: Pool, lanes: int) -> None:
        standard = settings.scene.model
        require(standard.modes == 2, "modes", standard.modes, "2: structures that are drawn have as many")
        self.pool, self.models = pool, pool.models(standard)
        if pool.observe_structure:
            self.features: Sequence[Feature] = (*ActiveFrictionTask.features, *DATA)
        usual = stationary_amplitude(standard, standard.omega[0], settings.moves_base)
        self._force_unit = [usual / stationary_amplitude(model, model.omega[0], settings.moves_base) for model in self.models]
        self._shapes = np.array([model.tip_shape for model in self.models])
        super().__init__(settings, cycle, grip, lanes)
        self.described += (pool,)
        mass = settings.scene.absorber_mass
        assert mass is not None
        self._data = np.array([(m.damping_ratio[0] / 0.01, m.omega[1] / m.omega[0] / 5, mass * m.tip_shape[0] ** 2 / 0.08) for m in self.models])
        self.options = {**self.options, "structure": (0, pool.structures - 1)}

    def make_runs(self, **arguments: Any) -> ControlledRuns:
        """Return lanes in a pool of scenes."""
        return PooledRuns([replace(self.scene, model=model) for model in self.models], **arguments)

    @property
    def which(self) -> NDArray[np.int64]:
        """The lanes' structures (L,)."""
        assert isinstance(self.runs, PooledRuns)
        return self.runs.which

    def model(self, lane: int) -> ModalModel:
        """Return a lane's structure."""
        return self.models[self.which[lane]]

    def draw(self, lane: int, generator: Generator) -> None:
        """Draw the structure, and what all draw."""
        self.which[lane] = int(self.drawn("structure", lane, float(generator.integers(len(self.models)))))
        super().draw(lane, generator)

    def draw_force(self, lane: int, generator: Generator) -> float:
        """Return the force in N that moves a lane's structure at resonance as far as the one that is drawn moves the standard."""
        return super().draw_force(lane, generator) * self._force_unit[self.which[lane]]

    def tip_shapes(self) -> NDArray[np.float64]:
        """Return the lanes' shapes (L, 2)."""
        return np.asarray(self._shapes[self.which])

    def values(self) -> NDArray[np.float64]:
        """Return the scaled features (L, features)."""
        values = super().values()
        if self.pool.observe_structure:
            values[:, -len(DATA) :] = self._data[self.which]
        return values

    def info(self) -> dict[str, NDArray[Any]]:
        """Return what info says of each lane."""
        return super().info() | {"structure": self.which.copy()}
