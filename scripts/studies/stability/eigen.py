"""Accuracy of the modes.

The package's values are compared with the finite-element eigenproblem in many digits, and with the
continuous cantilever.
"""

from decimal import Decimal, localcontext
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from impact_env import Beam, ParameterError, modal_model
from studies.study import Json

ELEMENTS = (2, 3, 5, 10, 20, 30, 50, 100, 200, 350, 500)
QUICK_ELEMENTS = (2, 10, 30, 100)
CHECKED = (1, 2, 10)  # modes
WRONG = 1e-6  # relative error of a frequency from which on it is called wrong
DIGITS = 50
DIGITS_PER_ELEMENT = 3  # what the transfer matrix of an element loses at most
HIGHEST_UP_TO = (
    200  # elements: the highest frequency needs as many digits as there are elements, and time
)

Matrix = NDArray[Any]  # of Decimal

# an Hermite element of unit length, stiffness and mass per length; the mass matrix times 420
_K = ((12, 6, -12, 6), (6, 4, -6, 2), (-12, -6, 12, -6), (6, 2, -6, 4))
_M = ((156, 22, 54, -13), (22, 4, 13, -3), (54, 13, 156, -22), (-13, -3, -22, 4))


def _transfer(square: Decimal) -> Matrix:
    """Return the transfer matrix of an element for omega^2 in units of the element.

    It gives deflection, slope and end forces at the end of the element from those at its start.
    """
    d = np.array(
        [
            [Decimal(k) - square * m / 420 for k, m in zip(*rows, strict=True)]
            for rows in zip(_K, _M, strict=True)
        ]
    )
    (a, b), (c, e) = d[:2, 2:]
    inverse = np.array([[e, -b], [-c, a]]) / (a * e - b * c)
    end = np.hstack([-inverse @ d[:2, :2], inverse])  # deflection and slope
    return np.vstack(
        [end, -(np.hstack([d[2:, :2], np.full((2, 2), Decimal(0))]) + d[2:, 2:] @ end)]
    )


def _end_forces(square: Decimal, elements: int) -> Decimal:
    """Return the determinant whose zeros are the frequencies of a clamped-free chain.

    It is zero if the forces at the free end of the clamped chain of elements are zero.
    """
    power = np.linalg.matrix_power(_transfer(square), elements)
    return Decimal(power[2, 2] * power[3, 3] - power[2, 3] * power[3, 2])


def exact_frequency(elements: int, near: float) -> Decimal:
    """Return the frequency omega of the finite elements nearest to a start value.

    It is in rad/s for unit length, stiffness and mass per length, and has many digits.
    """
    with localcontext() as context:
        context.prec = DIGITS + DIGITS_PER_ELEMENT * elements
        unit = Decimal(elements) ** 4
        one = Decimal(near) ** 2 / unit
        other = (Decimal(near) * (1 + Decimal("1e-9"))) ** 2 / unit
        value = _end_forces(other, elements)
        last = _end_forces(one, elements)
        for _ in range(60):
            if value == last or value == 0:
                break
            one, other, last = other, other - value * (other - one) / (value - last), value
            if abs(other / one - 1) < Decimal(10) ** (5 - DIGITS):
                break
            value = _end_forces(other, elements)
        return (other * unit).sqrt()


def continuous_roots(count: int) -> np.ndarray:
    """Return the first roots of cos x cosh x = -1, (count,)."""
    ends = np.pi * np.arange(count + 1)
    return np.array(
        [
            scipy.optimize.brentq(
                lambda x: np.cos(x) + 1 / np.cosh(x), low, high, xtol=1e-15, rtol=1e-15
            )
            for low, high in pairwise(ends)
        ]
    )


def accuracy(elements: int) -> Json:
    """Return relative errors of the frequencies of a beam by mode, counted from 1.

    The beam has ``elements`` elements and all modes. ``rounding``: relative to the same finite
    elements in many digits; ``discretisation``: of the finite elements relative to the beam;
    ``highest``: rounding of the last mode, None if not computed; ``tip``: of the first mode's tip
    amplitude relative to 2/sqrt(mass). ``wrong``: whether a frequency belongs to none of the modes.
    ``error`` is the reason if there are no numbers.
    """
    result: Json = {
        "elements": elements,
        "rounding": {},
        "discretisation": {},
        "highest": None,
        "tip": None,
        "error": "",
        "wrong": False,
    }
    try:
        model = modal_model(
            Beam(
                length=1.0,
                bending_stiffness=1.0,
                mass_per_length=1.0,
                elements=elements,
                modes=2 * elements,
            )
        )
    except ParameterError as error:
        return result | {"error": str(error)}
    roots = continuous_roots(max(CHECKED)) ** 2
    for mode in (mode for mode in CHECKED if mode <= 2 * elements):
        exact = float(exact_frequency(elements, float(model.omega[mode - 1])))
        result["rounding"][str(mode)] = abs(float(model.omega[mode - 1]) / exact - 1)
        result["discretisation"][str(mode)] = abs(exact / float(roots[mode - 1]) - 1)
    if elements <= HIGHEST_UP_TO:
        last = float(model.omega[-1])
        result["highest"] = abs(last / float(exact_frequency(elements, last)) - 1)
    result["tip"] = abs(float(model.tip_shape[0]) / 2 - 1)
    return result | {"wrong": any(value > WRONG for value in result["rounding"].values())}
