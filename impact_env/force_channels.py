"""Forces at several places in the form that the exact kernels read.

The forces may have their own phases and their own loads.

Kernels have one channel for the structure's force and further channels for bases that move. A force
(N) with the modal shape p acts as the acceleration of a base with the participation -p that does
not accelerate a free absorber, so the force of each further place is computed as such a base.

A force Re(F exp(i phi)) on a complex modal shape p + i q is the sum of a force on the real shape p
and of one on q that is a quarter period ahead, Re(i F exp(i phi)). A structure whose loads all act
at one place has no further channel and costs no more than one force.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import require
from impact_env.drive import Excitation, Load, Pieces
from impact_env.loads import Loads
from impact_env.modes import ModalModel
from impact_env.scene import Scene

Array = NDArray[np.float64]
MOST_SCENES = 64  # whose form for the kernels is cached


@dataclass(frozen=True, eq=False)
class _ChannelLoads(Load):
    """Loads whose pieces have the numbers of the kernels' channels."""

    every: tuple[Pieces, ...]
    length: float

    def pieces(self) -> list[Pieces]:
        """Return the pieces."""
        return list(self.every)


@dataclass(frozen=True)
class _Channels:
    """The channels of a run, in this order.

    The structure's ``own`` force, or without it the first of ``places``; the ``base`` if it moves;
    the quadrature of the own force; the (other) places.
    """

    own: bool
    base: bool
    places: tuple[str, ...]


@lru_cache(MOST_SCENES)
def _with_channels(scene: Scene, channels: _Channels) -> Scene:
    """Return a scene whose model has the shapes of the channels after that of the base.

    The shapes are those of ``force_places`` of the model.
    """
    model = scene.model
    shapes = [model.find_force_place(name) for name in channels.places]
    first = model.force_shape if channels.own else shapes.pop(0)
    if channels.own and model.force_quadrature is not None:
        shapes.insert(0, model.force_quadrature)
    return Scene(
        replace(
            model,
            force_shape=first,
            force_quadrature=None,
            force_places=np.array(shapes) if shapes else None,
            force_place_names=tuple(map(str, range(len(shapes)))) if shapes else None,
            base_participation=model.base_participation if channels.base else None,
        ),
        scene.absorber,
    )


@lru_cache(MOST_SCENES)
def _without_places(scene: Scene) -> Scene:
    model = replace(scene.model, force_places=None, force_place_names=None)
    return Scene(model, scene.absorber)


def split_forces(scene: Scene, drive: Excitation) -> tuple[Scene, Excitation]:
    """Return scene and drive in the form that the kernels read.

    Both are unchanged, unless the structure's forces differ in phase or loads have their own
    places.
    """
    model = scene.model
    if model.force_quadrature is None and model.force_places is None:
        return scene, drive
    pieces = drive.pieces()
    places = tuple(dict.fromkeys(piece.place for piece in pieces if piece.place is not None))
    if model.force_quadrature is None and not places:
        return _without_places(scene), drive
    own = any(piece.place is None and not piece.moves_base for piece in pieces)
    channels = _Channels(own, drive.moves_base, places)
    quadrature = own and model.force_quadrature is not None
    first = 1 + int(channels.base)
    behind = (*(("",) if quadrature else ()), *(places if own else places[1:]))
    channel_of = {name: first + k for k, name in enumerate(behind)}
    result = []
    for piece in pieces:
        if piece.moves_base:
            result.append(piece)
        elif piece.place is not None:
            result.append(replace(piece, place=None, channel=channel_of.get(piece.place, 0)))
        else:
            result.append(piece)
            if quadrature:  # the same force a quarter period ahead
                rows = np.array(piece.rows)
                rows[:, 3::2] = -piece.rows[:, 4::2]
                rows[:, 4::2] = piece.rows[:, 3::2]
                result.append(Pieces(piece.times, rows, False, channel=first))
    part = _ChannelLoads(tuple(result), drive.duration)
    return _with_channels(scene, channels), Loads((part,), drive.schedule.reference)


def find_base_shapes(model: ModalModel) -> tuple[Array, Array]:
    """Return the base shapes of a model of `split_forces`.

    The first array (C, N_m) has the participations of its C bases in sqrt(kg), the second (C,) the
    displacement of each base at the place of the absorbers.
    """
    rows = []
    places = []
    if model.base_participation is not None:
        rows.append(model.base_participation)
        places.append(model.base_at_absorber)
    if model.force_places is not None:
        rows += [-shape for shape in model.force_places]
        places += [0.0] * len(model.force_places)
    return np.array(rows).reshape(len(rows), model.modes), np.array(places)


def check_places(model: ModalModel, drive: Excitation) -> None:
    """Raise ParameterError for a load that lacks a place or a phase that it needs.

    The place of a load must be one of the structure's places. A load needs a phase if the
    structure's forces differ in phase.
    """
    parts = drive.parts
    places = [part.force_place for part in parts if part.force_place is not None]
    require(
        isinstance(drive, Loads) or not places,
        "force_place",
        places[:1],
        "None of a drive by itself; a force at a place of its own is one of Loads",
    )
    for name in places:
        model.find_force_place(name)
    if model.force_quadrature is None:
        return
    for piece in drive.pieces():
        turns = bool(piece.rows[:, :2].any())
        require(
            turns or piece.moves_base or piece.place is not None,
            "force_quadrature",
            "given with a record or a pulse, which has no phase",
            (
                "forces of one phase; a record or a pulse with a place; or harmonic forces, "
                "unbalance and tones"
            ),
        )
