"""Modes from a Universal File, its datasets 55 with normal modes or complex ones that are nearly real, and a record, its dataset 58."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.extras import optional
from impact_env.parameters import ParameterError, require

Real = NDArray[np.float64]

# kinds of analysis in a dataset 55
NORMAL = 2
COMPLEX = (3, 7)
SI = 1  # code of the units in a dataset 164
COLLINEAR = 0.95  # least modal phase collinearity of a complex shape that is read as a real one
NODES = (15, 2411)  # datasets with coordinates
TIME_HISTORIES = (0, 1)  # kinds of function in a dataset 58: general, time response
DIRECTIONS = {"x": "r1", "y": "r2", "z": "r3"}


@dataclass(frozen=True, eq=False)
class MeasuredMode:
    """A mode: ``omega`` in rad/s, ``damping_ratio`` (None: the file has none), real mass-normalised shape by node, (nodes, 3)."""

    omega: float
    damping_ratio: float | None
    nodes: NDArray[np.int64]
    shape: Real
    normalised_by_mass: bool


def _datasets(path: Path, *kinds: int) -> tuple[list[dict[str, Any]], list[int]]:
    """Return the datasets of some kinds in a file, as the library has them, and the kinds of all; raises ParameterError if it cannot be read."""
    with optional():
        import pyuff
    require(path.is_file(), "file", str(path), "a Universal File that exists")
    try:
        reader = pyuff.UFF(str(path))
        every = [int(kind) for kind in reader.get_set_types()]
        return [reader.read_sets(k) for k, kind in enumerate(every) if kind in kinds], every
    except Exception as error:  # the library raises bare exceptions
        raise ParameterError(
            f"file = {str(path)!r} is not allowed: a Universal File that can be read ({error})"
        ) from error


def read_modes(path: Path) -> list[MeasuredMode]:
    """Return the modes of a Universal File by rising frequency.

    A shape is divided by the root of its modal mass, if the file has one. Raises ParameterError for a file that cannot be read or has no modes,
    for units other than SI, and for shapes that are far from real.
    """
    sets, kinds = _datasets(path, 55, 164)
    for units in (part for part in sets if part["type"] == 164):
        code = int(units["units_code"])
        require(code == SI, "file", f"{path}, units {code}", "SI units (code 1 in dataset 164)")
    modes = [
        _mode(path, part)
        for part in sets
        if part["type"] == 55 and part["analysis_type"] in (NORMAL, *COMPLEX)
    ]
    found = ", ".join(str(kind) for kind in sorted(set(kinds))) or "none"
    require(
        len(modes) > 0,
        "file",
        str(path),
        f"a Universal File with modes in datasets 55; it has datasets {found}",
    )
    return sorted(modes, key=lambda mode: mode.omega)


def _mode(path: Path, part: dict[str, Any]) -> MeasuredMode:
    rows = [np.asarray(part[name]) for name in DIRECTIONS.values() if name in part]
    shape = np.column_stack(rows)
    number = int(part.get("mode_n", 0))
    name = f"{path}, mode {number}"
    require(bool(np.all(np.isfinite(shape))), "file", name, "finite numbers in all shapes")
    if part["analysis_type"] == NORMAL:
        omega = 2 * np.pi * float(part["freq"])
        mass = float(part["modal_m"])
        damping = float(part["modal_damp_vis"]) or float(part["modal_damp_his"]) / 2 or None
    else:
        value = complex(part["eig"])
        mass = 0.0
        omega = abs(value)
        damping = -value.real / max(abs(value), np.finfo(float).tiny)
        modal_a = complex(part["modal_a"])
        require(
            modal_a != 0,
            "file",
            f"{name}, modal A 0",
            "complex modes with their modal A, which scales them",
        )
        # the residue of a mass-normalised real mode is 1/(2 i omega_d): modal A becomes 2 i omega_d
        shape = np.asarray(shape * np.sqrt(2j * value.imag / modal_a))
    if np.iscomplexobj(shape):
        shape = _real(name, shape)
    require(
        omega > 0,
        "file",
        name,
        "a frequency above 0: a rigid-body motion needs that of its suspension",
    )
    require(
        math.isfinite(mass) and mass >= 0,
        "file",
        f"{name}, modal mass {mass}",
        "a modal mass of 0 (none) or above",
    )
    return MeasuredMode(
        omega,
        damping,
        np.asarray(part["node_nums"], dtype=np.int64),
        shape / np.sqrt(mass or 1.0),
        mass > 0,
    )


def _real(name: str, shape: NDArray[np.complex128]) -> Real:
    """Return a complex shape turned to the real axis; raises ParameterError if it is far from real."""
    turn = np.sum(shape**2)
    collinear = float(abs(turn)) / max(float(np.sum(np.abs(shape) ** 2)), np.finfo(float).tiny)
    allowed = f"{COLLINEAR} or above: the simulation works with real modes, so fit normal modes"
    require(collinear >= COLLINEAR, "file", f"{name}, phase collinearity {collinear:.3f}", allowed)
    return np.asarray(np.real(shape * np.exp(-0.5j * np.angle(turn))))


def at(modes: list[MeasuredMode], path: Path, name: str, place: tuple[int, str]) -> Real:
    """Return the shapes at a node in a direction, one of x, y, z with a sign or without, (N_m,) in 1/sqrt(kg)."""
    node, direction = place
    sign, axis = (
        (-1.0, direction[1:]) if direction.startswith("-") else (1.0, direction.removeprefix("+"))
    )
    values = []
    for mode in modes:
        where = np.flatnonzero(mode.nodes == node)
        nodes = ", ".join(str(n) for n in mode.nodes[:12]) + (
            " ..." if len(mode.nodes) > 12 else ""
        )
        require(len(where) == 1, name, node, f"a node of {path.name}: {nodes}")
        column = list(DIRECTIONS).index(axis)
        require(column < mode.shape.shape[1], name, direction, f"a direction that {path.name} has")
        values.append(sign * mode.shape[where[0], column])
    return np.array(values)


def read_nodes(path: Path) -> tuple[NDArray[np.int64], Real]:
    """Return numbers (N,) and coordinates (N, 3) in m of the nodes of a Universal File, its datasets 15 or 2411; raises ParameterError for none."""
    sets, _ = _datasets(path, *NODES)
    require(
        len(sets) > 0,
        "file",
        str(path),
        "a Universal File with the coordinates of its nodes, in datasets 15 or 2411",
    )
    numbers = np.concatenate([np.asarray(part["node_nums"]) for part in sets]).astype(np.int64)
    return numbers, np.concatenate(
        [np.column_stack([part[axis] for axis in DIRECTIONS]) for part in sets]
    ).astype(np.float64)


def read_record(path: Path) -> tuple[Real, Real]:
    """Return times in s and values of the one time history of a Universal File. Raises ParameterError where there is none, or more."""
    sets, _ = _datasets(path, 58)
    histories = [part for part in sets if int(part["func_type"]) in TIME_HISTORIES]
    require(
        len(histories) == 1,
        f"{path.name}: time histories",
        len(histories),
        "one dataset 58 with a response over time",
    )
    return np.asarray(histories[0]["x"], dtype=np.float64), np.real(
        np.asarray(histories[0]["data"])
    ).astype(np.float64)
