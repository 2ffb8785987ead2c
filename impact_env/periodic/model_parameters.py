"""Parameters of structure and absorber that change an orbit's modal model.

They are the mass ratio, the damping ratio, and the absorber's position on a beam.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError, number, require
from impact_env.modes import ModalModel, deflection_row, solve_modes
from impact_env.parameters import MOST_DAMPING, Beam

Array = NDArray[np.float64]
MASS_RATIO = "mass_ratio"
DAMPING_RATIO = "damping_ratio"
ABSORBER_POSITION = "absorber_position"
MODEL_PARAMETERS = (MASS_RATIO, DAMPING_RATIO, ABSORBER_POSITION)
LEAST_MASS_RATIO = 1e-9
CACHED_MODELS = (
    64  # one for each value of a parameter, which differences at one point of a curve share
)
ANY_POSITION = 0.3  # of the absorber, where modes do not depend on it
END_MARGIN = 1e-9  # of the length: how close to an end that is held an absorber may sit
# of a parameter's size: the step of five-point differences, whose error and rounding are about
# equal there
DIFFERENCE_SHARE = 1e-3
CENTRAL = (np.array([-2.0, -1.0, 1.0, 2.0]), np.array([1.0, -8.0, 8.0, -1.0]) / 12)
ONE_SIDED = (
    np.array([0.0, 1.0, 2.0, 3.0, 4.0]),
    np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / 12,
)


def damping_of(model: ModalModel) -> float:
    """Return the damping ratio of the first mode."""
    return float(model.damping_ratio[0])


@lru_cache(maxsize=CACHED_MODELS)
def with_damping(model: ModalModel, ratio: float) -> ModalModel:
    """Return the model with another damping ratio of its first mode.

    The damping ratios of the other modes change in proportion. If no mode is damped, all get the
    same ratio.
    """
    own = damping_of(model)
    if own == ratio:
        return model
    if own > 0:
        return replace(model, damping_ratio=model.damping_ratio * (number(ratio) / own))
    require(
        not np.any(model.damping_ratio),
        DAMPING_RATIO,
        ratio,
        "0 for a model whose first mode only is undamped: the others have no ratio to it",
    )
    return replace(model, damping_ratio=np.full(model.modes, number(ratio)))


def position_of(model: ModalModel) -> float:
    """Return the absorber's position on the model's beam, as a fraction of its length.

    Raises ParameterError for a model without a beam.
    """
    if model.beam is None:
        raise ParameterError(
            "absorber_position is not allowed here: a modal model without a beam has single "
            "places, and none between them"
        )
    return float(model.beam.absorber_position)


@lru_cache(maxsize=CACHED_MODELS)
def with_position(model: ModalModel, position: float) -> ModalModel:
    """Return the model with its absorber at another position on the beam.

    The place of the level is unchanged.
    """
    own = position_of(model)
    if own == position:
        return model
    assert model.beam is not None
    level = model.beam.response_position
    beam = replace(
        model.beam, absorber_position=position, response_position=own if level is None else level
    )
    vectors = _nodal_shapes(_ByContent(model.beam))
    force, tip, response = (
        deflection_row(beam, float(x)) @ vectors
        for x in (beam.force_position, beam.absorber_position, beam.response_position)
        if x is not None
    )
    return replace(model, force_shape=force, tip_shape=tip, response_shape=response, beam=beam)


class _ByContent:
    """A beam as the key of a cache.

    It equals any other beam that differs only in the positions of its absorber and of its response.
    """

    def __init__(self, beam: Beam) -> None:
        self.beam = beam
        own = {"absorber_position", "response_position"}
        self.text = repr({name: value for name, value in vars(beam).items() if name not in own})

    def __hash__(self) -> int:
        return hash(self.text)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _ByContent) and self.text == other.text


@lru_cache(maxsize=16)
def _nodal_shapes(key: _ByContent) -> Array:
    """Return the mass-normalised modes (., N_m) kept of a beam over its free freedoms."""
    beam = replace(key.beam, absorber_position=ANY_POSITION)
    return solve_modes(beam)[0][:, : beam.modes]


def domain_of(model: ModalModel, name: str) -> tuple[float, float]:
    """Return the least and the largest value that a parameter of `MODEL_PARAMETERS` may have."""
    if name == MASS_RATIO:
        return LEAST_MASS_RATIO, np.inf
    if name == DAMPING_RATIO:
        largest = float(np.max(model.damping_ratio))
        return 0.0, MOST_DAMPING * (damping_of(model) / largest if largest > 0 else 1.0)
    position_of(model)  # raises where there is no beam
    assert model.beam is not None
    left, right = model.beam.ends.split("-")
    return (0.0 if left == "free" else END_MARGIN), (1.0 if right == "free" else 1.0 - END_MARGIN)


def difference_rule(value: float, domain: tuple[float, float], size: float) -> tuple[Array, Array]:
    """Return points (K,) and weights (K,) of a difference rule for a derivative.

    The derivative at ``value`` is the sum of weights times function values at the points, which lie
    within ``domain``. The rule has five points and is of fourth order: around ``value``, or on one
    side of it next to an end of the domain. ``size`` is the unit of the parameter.
    """
    step = DIFFERENCE_SHARE * size
    low, high = domain
    if low <= value - 2 * step and value + 2 * step <= high:
        places, weights = CENTRAL
        return value + step * places, weights / step
    side = -1.0 if value + 4 * step > high else 1.0
    places, weights = ONE_SIDED
    return value + side * step * places, side * weights / step
