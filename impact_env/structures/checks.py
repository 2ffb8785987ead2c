"""Warnings about implausible modal models.

They are not errors, because a model may be intended so.
"""

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from impact_env.modes import ModalModel
from impact_env.parameters import Beam

Real = NDArray[np.float64]
# of the first mode
LOW_HZ = 0.05
HIGH_HZ = 2e4
MUCH_DAMPING = 0.2
# |shape| sqrt(mass) of the liveliest place of a mode, mass-normalised
LIGHTEST = 0.05
HEAVIEST = 60.0
HIGHEST_WAVE_SPEED = 5000.0  # m/s: of sound along a bar of steel or aluminium
# of a beam, over its length
THICK = 0.3
THIN = 1e-4
CLOSE_MODES_DISTANCE = 1.0  # distance of two modes, over the sum of their half-widths


DIAGONAL = (
    0.1,
    100.0,
)  # of a mass matrix's diagonal, over the mass: two or three directions, and rotations
# of the upper quartile of the diagonal: a freedom with less is no displacement, or has no mass of
# its own
ROTATES = 1e-3


STILL_TOL = (
    1e-3  # |shape| sqrt(mass) of a place that a mode does not move; lively places have 1 to 3
)


class StructureWarning(UserWarning):
    """A structure's file contains an implausible value, or limits what can be computed from it."""


def list_matrix_warnings(diagonal: Real, mass: float, places: Mapping[str, int]) -> list[str]:
    """Return sentences about implausible values of a mass matrix.

    Its ``diagonal`` is compared with the structure's ``mass`` in kg. ``places``: rows by name.
    """
    result = []
    total = float(np.sum(diagonal))
    if not DIAGONAL[0] * mass <= total <= DIAGONAL[1] * mass:
        result.append(
            f"mass_kg = {mass:g}, while the mass matrix has {total:.4g} kg on its diagonal "
            "over all directions: is it in kg?"
        )
    usual = float(np.quantile(diagonal, 0.75))
    for name, row in places.items():
        if diagonal[row] < ROTATES * usual:
            result.append(
                f"{name} = {row}: the mass matrix has {diagonal[row]:.3g} there, {usual:.3g} "
                "elsewhere: is this row a rotation?"
            )
    return result


def list_warnings(model: ModalModel, beam: Beam | None = None, rigid: int = 0) -> list[str]:
    """Return a sentence for every implausible property of a model.

    ``rigid``: number of its modes that are motions on a suspension.
    """
    result = []
    first = float(model.omega[rigid]) / (2 * np.pi)
    damping = float(np.max(model.damping_ratio))
    if not LOW_HZ < first < HIGH_HZ:
        result.append(
            f"the first frequency is {first:.3g} Hz: are the units right (SI: kg, m, N, rad/s)?"
        )
    if damping > MUCH_DAMPING:
        result.append(
            f"a damping ratio of {damping:.3g} is {100 * damping:.3g} %: was it given in percent?"
        )
    result += [*_scaling(model, rigid), *_doubles(model, rigid)]
    rows = np.vstack([model.force_shape, model.places, model.tip_shape, model.level_shape])
    largest = np.max(np.abs(rows), axis=0) * np.sqrt(model.beam_mass)
    for k in range(rigid, model.modes):
        if largest[k] < STILL_TOL:
            hertz = float(model.omega[k]) / (2 * np.pi)
            result.append(
                f"resonance {k + 1} at {hertz:.5g} Hz moves none of the places of force, "
                "absorber and response: are they the right ones?"
            )
    for name, row in (
        ("force", model.force_shape),
        ("absorber", model.tip_shape),
        ("response", model.level_shape),
    ):
        if not np.any(row[rigid:]):
            result.append(f"no mode moves the place of the {name}: is it held there?")
    return result if beam is None else [*result, *_beam(beam)]


def _scaling(model: ModalModel, rigid: int) -> list[str]:
    """Return a sentence if the scaling of the mode shapes is implausible.

    Mass-normalised shapes have a mean square of 1 over the mass. So shape times root of mass is
    about 1 to 3 at places that move well.
    """
    rows = [
        model.force_shape,
        model.tip_shape,
        model.level_shape,
        *(() if model.absorber_shapes is None else model.absorber_shapes),
    ]
    every = np.abs(np.array(rows))[:, rigid:] * np.sqrt(model.beam_mass)
    result = []
    most = np.max(every, axis=0)
    median = float(np.median(most))
    if median > 0 and not LIGHTEST <= median <= HEAVIEST:
        share = 1 / median**2
        text = (
            f"the modes move masses of {share:.2g} of the structure's at the places given, as a "
            "median of the modes"
        )
        result.append(
            f"{text}: are the shapes mass-normalised, in 1/sqrt(kg), and is the mass right?"
        )
    plain = np.max(np.abs(np.array(rows)), axis=0)[rigid:]
    if (
        len(plain) > 1
        and np.all(np.abs(plain - plain[0]) < 1e-6 * plain[0])
        and abs(plain[0] - 1) < 1e-6
    ):
        result.append(
            "the largest shape is 1 in every mode: that looks scaled to 1 and not "
            "mass-normalised; divide by the root of the modal mass"
        )
    return result


def _doubles(model: ModalModel, rigid: int) -> list[str]:
    result = []
    order = rigid + np.argsort(model.omega[rigid:])
    for i, j in pairwise(order):
        distance = model.omega[j] - model.omega[i]
        width = model.omega[i] * (model.damping_ratio[i] + model.damping_ratio[j])
        if distance < CLOSE_MODES_DISTANCE * width or distance < 1e-6 * model.omega[i]:
            hertz = float(model.omega[i]) / (2 * np.pi)
            text = (
                f"modes {i + 1} and {j + 1} are one peak at {hertz:.5g} Hz: simulation and limit "
                "have both"
            )
            result.append(
                f"{text}, while design rule, tunings and friction rule start from a single mode"
            )
    return result


def _beam(beam: Beam) -> list[str]:
    gyration = float(np.sqrt(beam.bending_stiffness / beam.mass_per_length)) / HIGHEST_WAVE_SPEED
    height = float(np.sqrt(12)) * gyration / beam.length
    if THIN < height < THICK:
        return []
    text = (
        f"a metal bar with this bending stiffness and mass would be {height * beam.length:.2g} m "
        f"high and is {beam.length:g} m long"
    )
    return [f"{text}: are the units right (N m^2, kg/m, m)?"]
