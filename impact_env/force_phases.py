"""Forces at several places with phases of their own, as the exact kernels take them.

A force Re(F exp(i phi)) on a complex modal shape p + i q is the sum of a force on the real shape p and of one on q that is a quarter period
ahead, Re(i F exp(i phi)). Kernels take the second force as the acceleration of a moving base with the participation -q, which does not act on an
absorber apart from the structure. A structure under one force, or under forces of one phase, has no such base and no kernels for one.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from impact_env.drive import Excitation, Load, Pieces
from impact_env.loads import Loads
from impact_env.parameters import require
from impact_env.scene import Scene

MOST_SCENES = 64  # whose form for the kernels is cached


@dataclass(frozen=True, eq=False)
class TwoPhaseLoad(Load):
    """A load on a complex modal shape, as a force on the real part and, a quarter period ahead, on the imaginary part."""

    load: Load

    @property
    def duration(self) -> float:
        """Return how long it lasts in s."""
        return self.load.duration

    def pieces(self) -> list[Pieces]:
        """Return the pieces of both parts."""
        result = []
        for piece in self.load.pieces():
            ahead = np.array(piece.rows)
            ahead[:, 3::2] = -piece.rows[:, 4::2]
            ahead[:, 4::2] = piece.rows[:, 3::2]
            result += [piece, Pieces(piece.times, ahead, moves_base=True)]
        return result


@lru_cache(MOST_SCENES)
def _with_two_channels(scene: Scene) -> Scene:
    model = scene.model
    assert model.force_quadrature is not None
    return Scene(
        replace(
            model,
            force_quadrature=None,
            base_participation=-model.force_quadrature,
            base_at_absorber=0.0,
        ),
        scene.absorber,
    )


def split_force_phases(scene: Scene, drive: Excitation) -> tuple[Scene, Excitation]:
    """Return scene and drive as the kernels take them: the same, unless the forces of the structure differ in phase."""
    if scene.model.force_quadrature is None:
        return scene, drive
    parts = tuple(TwoPhaseLoad(part) for part in drive.parts)
    return _with_two_channels(scene), Loads(parts, drive.schedule.reference)


def check_phases(drive: Excitation) -> None:
    """Raise ParameterError if one of the loads has no phase, so that forces cannot differ by theirs."""
    for piece in drive.pieces():
        turns = bool(piece.rows[:, :2].any())
        require(
            turns and not piece.moves_base,
            "force_quadrature",
            "given with a base that moves, or with a record or a pulse, which has no phase",
            "forces of one phase; or harmonic forces, unbalance and tones",
        )
