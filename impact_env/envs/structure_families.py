"""Families of random two-mode structures for training, validation and test.

Each structure is scaled to the mass and the first frequency of a standard model.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import count_from, flag, word_of
from impact_env.envs.observation import STRUCTURE_NUMBERS
from impact_env.envs.task import Array, Generator, LaneState, MachineDifference
from impact_env.fields import check_fields
from impact_env.modes import ModalModel, modal_model
from impact_env.parameters import Beam

DAMPING_BOUNDS = (0.005, 0.02)


def _beam(ends: str) -> Any:
    """Return a function of a random generator that draws a beam with the given ends."""

    def drawn(generator: Generator) -> ModalModel:
        """Return two modes of a beam with random damping and places of force and absorber."""
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
    """Return the modes (1, 1) and (2, 1) of a simply supported rectangular plate.

    Frequencies are proportional to m^2/a^2 + n^2/b^2. Shapes are
    2 sin(m pi x/a) sin(n pi y/b)/sqrt(mass) (A. W. Leissa 1969). The ratio a/b, damping and the
    places of force and absorber are random.
    """
    aspect = generator.uniform(1.1, 1.8)
    force = generator.uniform(0.25, 0.45, 2)
    absorber = generator.uniform(0.35, 0.65, 2)

    def shape(m: int, place: NDArray[Any]) -> float:
        """Return the shape of mode (m, 1) at a place (x/a, y/b), for a mass of 1 kg."""
        return float(2 * math.sin(m * math.pi * place[0]) * math.sin(math.pi * place[1]))

    omega = np.array([1.0, (4 / aspect**2 + 1) / (1 / aspect**2 + 1)])
    rows = [np.array([shape(m, place) for m in (1, 2)]) for place in (force, absorber)]
    return ModalModel(omega, np.full(2, _damping(generator)), rows[0], rows[1], 1.0)


def _modes(generator: Generator) -> ModalModel:
    """Return two modes with random parameters, as a modal test would give them.

    The second frequency is two to eight times the first. The second mode's shape at the force has
    a random sign.
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
    """Return a damping ratio, log-uniform in `DAMPING_BOUNDS`."""
    return float(DAMPING_BOUNDS[0] * (DAMPING_BOUNDS[1] / DAMPING_BOUNDS[0]) ** generator.uniform())


TRAINING_FAMILIES = (_beam("clamped-free"), _beam("pinned-pinned"), _plate)
TEST_FAMILIES = (_beam("clamped-clamped"), _modes)
FAMILY_SPLITS = {
    "train": (0, TRAINING_FAMILIES),
    "validation": (1, TRAINING_FAMILIES),
    "test": (2, TEST_FAMILIES),
}


def rescale_model(model: ModalModel, standard: ModalModel) -> ModalModel:
    """Return a model scaled to the first frequency and the mass of a standard model.

    Only the units of time and mass change: ratios of frequencies and of modal masses are kept.
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
    """Arguments of an environment that choose its random structures.

    Parameters
    ----------
    split : str
        ``"train"``, ``"validation"`` or ``"test"``.
    structures : int
        Number of structures from which episodes draw.
    observe_structure : bool
        Whether damping ratio, second frequency and mass ratio of the structure are observed.

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
        """Return the structures, scaled to a ``standard`` model, from each family in turn.

        Every call returns the same structures.
        """
        seed, kinds = FAMILY_SPLITS[self.split]
        return [
            rescale_model(kinds[k % len(kinds)](np.random.default_rng([seed, k])), standard)
            for k in range(self.structures)
        ]


class StructureNumbers(MachineDifference):
    """Parameters of each lane's structure as components of observations.

    The parameters are scaled to order 1 (`STRUCTURE_NUMBERS`). L: number of lanes.
    """

    def __init__(self, lanes: LaneState, models: Sequence[ModalModel]) -> None:
        """Compute the parameters of ``models``, in the order that ``lanes.which`` refers to."""
        super().__init__(lanes)
        mass = lanes.settings.scene.absorber_mass
        assert mass is not None
        first = [model.tip_shape[0] for model in models]
        self._damping = np.array([model.damping_ratio[0] / 0.01 for model in models])
        self._second = np.array([model.omega[1] / model.omega[0] / 5 for model in models])
        self._mass = np.array([mass * shape**2 / 0.08 for shape in first])
        damping, second, mass_ratio = (feature.name for feature in STRUCTURE_NUMBERS)
        self.columns = {
            damping: self.read_damping,
            second: self.read_second_frequency,
            mass_ratio: self.read_mass_ratio,
        }

    def read_damping(self) -> Array:
        """Return the damping ratios (L,) of the first modes over 0.01."""
        return np.asarray(self._damping[self.lanes.which])

    def read_second_frequency(self) -> Array:
        """Return the second frequencies (L,) over five times the first."""
        return np.asarray(self._second[self.lanes.which])

    def read_mass_ratio(self) -> Array:
        """Return the ratios (L,) of absorber mass to the first mode's effective mass, over 0.08.

        The effective mass is 1/phi^2 with the tip shape phi.
        """
        return np.asarray(self._mass[self.lanes.which])
