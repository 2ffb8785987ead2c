"""Structures drawn by a seed that had no part in how `design_gap` searches: what its answers are worth where nobody has looked.

Four families by turns: plates with a machine on them, by finite elements (Bogner, Fox and Schmit); stepped beams with a tip mass; frames of two
storeys; modal models as a test gives them. Sizes, places, damping of 0.12 to 3 %, resonance 1 to 4 and an absorber of 1 to 5 % are drawn anew until
the free amplitude is 1.5 to 15 times the rule's gap. SI units.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from impact_env.modes import ModalModel
from impact_env.structures.matrices import lowest_modes
from optimisation.bounds import reach
from studies.gaps import ALUMINIUM, MODES, STEEL, Case, assembled, hermite
from studies.study import Array

SEEDS = range(2001, 2011)
REACH, DAMPING, SHARES = (1.5, 15.0), (0.0012, 0.03), (0.01, 0.05)
ALONG, ACROSS, STEPS = 8, 6, 12  # elements of a plate and of a beam


def _drawn_modes(draw: Generator, mass: Array, stiffness: Array, free: NDArray[np.intp], places: NDArray[np.intp], total: float) -> ModalModel:
    """Return a model of what is free to move, with force, absorber and response at three of the places, all freedoms by number."""
    modes = lowest_modes(mass[np.ix_(free, free)], stiffness[np.ix_(free, free)], MODES)
    force, tip, read = modes.shapes[np.searchsorted(free, draw.choice(np.intersect1d(places, free), 3))]
    return ModalModel(modes.omega, np.ones(MODES), force, tip, total, response_shape=read)


def machine_plate(draw: Generator) -> ModalModel:
    """Return a plate that is held along one edge or two, with a machine of up to its own mass on it."""
    (young, density), thickness, poisson = (STEEL, ALUMINIUM)[draw.integers(2)], draw.uniform(0.002, 0.006), 0.3
    length, width = draw.uniform(0.25, 0.8, 2)
    (ax, bx, cx, dx), (ay, by, cy, dy) = hermite(length, ALONG), hermite(width, ACROSS)
    stiffness: Array = np.kron(cx, ay) + np.kron(ax, cy) + poisson * (np.kron(dx, dy.T) + np.kron(dx.T, dy)) + 2 * (1 - poisson) * np.kron(bx, by)
    stiffness *= young * thickness**3 / (12 * (1 - poisson**2))
    mass = np.asarray(density * thickness * np.kron(ax, ay), dtype=np.float64)
    total = density * thickness * length * width
    x, y = np.divmod(np.arange(len(mass)), len(ay))  # freedoms along and across: deflection and slope by turns
    held = [x < 2, (x < 2) | (x >= 2 * ALONG), (x < 2) | (y < 2)][draw.integers(3)]
    places = np.flatnonzero((x % 2 == 0) & (y % 2 == 0) & ~held)
    machine, own = draw.choice(places), draw.uniform(0, total)
    mass[machine, machine] += own
    return _drawn_modes(draw, mass, stiffness, np.flatnonzero(~held), places, total + own)


def stepped_beam(draw: Generator) -> ModalModel:
    """Return a cantilever of three depths with a mass at its end that turns with it."""
    (young, density), width = (STEEL, ALUMINIUM)[draw.integers(2)], draw.uniform(0.02, 0.06)
    length, depth = draw.uniform(0.4, 2.0), np.repeat(draw.uniform(0.006, 0.02, 3), STEPS // 3)
    nodes = np.stack([np.linspace(0, length, STEPS + 1), np.zeros(STEPS + 1)], 1)
    per_length = density * width * depth
    mass, stiffness = assembled(nodes, [(k, k + 1) for k in range(STEPS)], young * width * depth**3 / 12, per_length)
    total = float(per_length.mean() * length)
    tip = draw.uniform(0.05, 1.0) * total
    mass[-3:, -3:] += np.diag([tip, tip, tip * (0.03 * length) ** 2])
    return _drawn_modes(draw, mass, stiffness, np.arange(3, len(mass)), np.arange(4, len(mass), 3), total + tip)


def two_storeys(draw: Generator) -> ModalModel:
    """Return a frame of two storeys that is clamped at both feet, each member of two elements; it is pushed and read sideways."""
    width, heights = draw.uniform(0.5, 3.0), np.cumsum([0, *draw.uniform(0.4, 2.0, 2)])
    nodes = [(x, float(y)) for x in (0.0, width) for y in heights]
    pairs = [(0, 1), (1, 2), (3, 4), (4, 5), (1, 4), (2, 5)]
    bending, per_length = np.exp(draw.normal(np.log([3e3, 4.0]), 0.4, (len(pairs), 2))).T
    members = []
    for k, (a, b) in enumerate(pairs):
        nodes.append(tuple(np.mean([nodes[a], nodes[b]], axis=0)))
        members += [(a, 6 + k), (6 + k, b)]
    at = np.array(nodes)
    mass, stiffness = assembled(at, members, np.repeat(bending, 2), np.repeat(per_length, 2))
    free = np.setdiff1d(np.arange(len(mass)), [0, 1, 2, 9, 10, 11])
    total = float(sum(m * np.hypot(*(at[b] - at[a])) for m, (a, b) in zip(per_length, pairs, strict=True)))
    return _drawn_modes(draw, mass, stiffness, free, np.arange(0, len(mass), 3), total)


def measured(draw: Generator) -> ModalModel:
    """Return a modal model of four to eight modes, each with its own damping around what is drawn for all."""
    number, total = int(draw.integers(4, 9)), float(np.exp(draw.uniform(0, 4)))
    omega = 2 * np.pi * draw.uniform(10, 80) * np.cumprod([1, *draw.uniform(1.3, 2.5, number - 1)])
    shapes = draw.normal(0, 1 / np.sqrt(0.4 * total), (3, number))
    return ModalModel(omega, np.exp(draw.normal(0, 0.3, number)), shapes[0], shapes[1], total, response_shape=shapes[2])


FAMILIES: tuple[Callable[[Generator], ModalModel], ...] = (machine_plate, stepped_beam, two_storeys, measured)


def drawn(seed: int) -> Case:
    """Return the case of a seed."""
    draw, family = np.random.default_rng(seed), FAMILIES[seed % len(FAMILIES)]
    while True:
        ratio = float(np.exp(draw.uniform(*np.log(DAMPING))))
        resonance, share, model = int(draw.integers(1, 5)), float(draw.uniform(*SHARES)), family(draw)
        model = replace(model, damping_ratio=np.clip(ratio * model.damping_ratio, *DAMPING))
        if REACH[0] <= reach(model, share * model.beam_mass, resonance) <= REACH[1]:
            return Case(f"{family.__name__.replace('_', ' ')} {seed}", partial(replace, model), resonance, round(share, 4))


CASES = tuple(drawn(seed) for seed in SEEDS)
