"""Reading and writing of a `ModalModel` as plain numbers: the table ``model`` of a file.

The arrays of the table may be the columns of a separate CSV file, with a line for each mode.
"""

import math
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from impact_env.checks import non_negative, require
from impact_env.modes import ModalModel
from impact_env.plain_files import (
    NUMBER_CODEC,
    ROW_CODEC,
    ROWS_CODEC,
    Codec,
    Keys,
    dataclass_codec,
    dataclass_keys,
)
from impact_env.structures.checks import StructureWarning
from impact_env.structures.matrix_files import read_columns

# one number for all modes, or one for each mode
DAMPING_RATIO_CODEC = Codec(
    lambda path, plain: (
        tuple(ROW_CODEC.read(path, plain))
        if isinstance(plain, list | tuple)
        else NUMBER_CODEC.read(path, plain)
    ),
    lambda value: list(map(float, value)) if isinstance(value, tuple) else float(value),
)


def require_text(path: str, plain: Any) -> str:
    """Return ``plain`` if it is a text that is not empty; otherwise raise ParameterError.

    ``path`` is the path of the key in the file, for the error.
    """
    require(isinstance(plain, str) and plain != "", path, plain, "a text")
    return str(plain)


TEXT_CODEC = Codec(require_text, str)


def choose_damping_ratios(specified: Any, measured: Any, modes: int) -> Any:
    """Return the damping ratios (N_m,): the specified ones, or else the measured ones.

    ``specified`` is one number for all modes, a list with one for each mode, or None. ``measured``
    is an array (N_m,), or None. Raises ParameterError if both are None, and for negative numbers or
    a wrong number of them.
    """
    ratios = (
        [non_negative("damping_ratio", specified)] * modes
        if np.ndim(specified) == 0 and specified is not None
        else specified
    )
    if specified is None:
        require(
            measured is not None,
            "damping_ratio",
            specified,
            "given, as one number or a list with one for each mode: the file has no damping",
        )
        return measured
    require(
        len(ratios) == modes,
        "damping_ratio",
        specified,
        f"one number, or one for each of the {modes} modes",
    )
    return np.array([non_negative("damping_ratio", float(x)) for x in ratios])


def _read_names(path: str, plain: Any) -> tuple[str, ...]:
    """Return a list of texts as a tuple; raises ParameterError if it is none."""
    require(isinstance(plain, list | tuple), path, plain, "a list of names")
    return tuple(require_text(f"{path}[{i}]", name) for i, name in enumerate(plain))


NAMES_CODEC = Codec(_read_names, list)
MODEL_KEYS = dataclass_keys(
    ModalModel,
    without=("beam",),
    **dict.fromkeys(
        (
            "omega",
            "damping_ratio",
            "force_shape",
            "tip_shape",
            "response_shape",
            "stress_shape",
            "base_participation",
            "force_quadrature",
        ),
        ROW_CODEC,
    ),
    absorber_shapes=ROWS_CODEC,
    force_places=ROWS_CODEC,
    force_place_names=NAMES_CODEC,
)


ROWS_OF_MODES = (
    "omega",
    "damping_ratio",
    "force_shape",
    "tip_shape",
    "absorber_shapes",
    "response_shape",
    "stress_shape",
    "base_participation",
    "force_quadrature",
    "force_places",
)


def order_by_frequency(model: ModalModel) -> ModalModel:
    """Return the model with its modes in the order of ascending frequency.

    Resonance 1 is then the lowest one. Issues a StructureWarning if the order changes.
    """
    order = np.argsort(model.omega, kind="stable")
    if np.array_equal(order, np.arange(model.modes)):
        return model
    old_order = ", ".join(str(k + 1) for k in order)
    warnings.warn(
        f"the modes are not listed by rising frequency; they are sorted: {old_order}",
        StructureWarning,
        stacklevel=2,
    )
    rows = {name: getattr(model, name) for name in ROWS_OF_MODES}
    return replace(
        model, **{name: row[..., order] for name, row in rows.items() if row is not None}
    )


def require_modes_once(model: ModalModel) -> None:
    """Raise ParameterError if a mode is listed twice, so that it would count twice.

    These are modes with exactly the same frequency and, up to a sign, the same shapes.
    """
    rows = np.vstack([model.force_shape, model.level_shape, model.places])
    for i in range(model.modes):
        for j in range(i):
            sign = -1.0 if rows[:, i] @ rows[:, j] < 0 else 1.0
            same = np.array_equal(rows[:, i], sign * rows[:, j])
            require(
                not (same and model.omega[i] == model.omega[j] and np.any(rows[:, i])),
                "model",
                f"the mode of {model.omega[i] / (2 * math.pi):.6g} Hz twice with the same shapes",
                "each mode once",
            )


ALLOWED_SUSPENSION = (
    "above 0: a motion that bends nothing has the frequency of its suspension, and cannot be left "
    "out, since it carries the absorber too"
)


def _model(
    *,
    damping_ratio: Any,
    force_shape: list[float],
    tip_shape: list[float],
    beam_mass: float,
    omega: list[float] | None = None,
    frequencies: list[float] | None = None,
    **more: Any,
) -> ModalModel:
    """Return a model from the values in a file.

    Either ``omega`` (rad/s) or ``frequencies`` (Hz) is needed, above 0; with the latter the modes
    are sorted by frequency. ``damping_ratio`` is one number, or one for each mode. ``more``:
    further arguments of `ModalModel`. Raises ParameterError for bad values.
    """
    if omega is None:
        require(
            frequencies is not None,
            "omega",
            omega,
            "given, in rad/s, or frequencies_hz in its place",
        )
        assert frequencies is not None
        require(min(frequencies) > 0, "frequencies", frequencies, ALLOWED_SUSPENSION)
        omega = [2 * math.pi * f for f in frequencies]
    else:
        require(frequencies is None, "frequencies", frequencies, "left out beside omega_rad_s")
        require(min(omega) > 0, "omega", omega, ALLOWED_SUSPENSION)
    for name, row in (("force_shape", force_shape), ("tip_shape", tip_shape)):
        require(len(row) == len(omega), name, row, f"{len(omega)} numbers, one for each mode")
    for name in ("absorber_shapes", "force_places"):
        if name in more:
            more[name] = np.array(more[name])
    ratios = choose_damping_ratios(damping_ratio, None, len(omega))
    model = ModalModel(
        np.array(omega), ratios, np.array(force_shape), np.array(tip_shape), beam_mass, **more
    )
    # files written by this program have omega_rad_s: their order of modes is kept
    return model if frequencies is None else order_by_frequency(model)


# a model is written with omega_rad_s, which is exact, and read with either key
READ_KEYS: Keys = {
    "omega_rad_s": MODEL_KEYS["omega_rad_s"],
    "frequencies_hz": ("frequencies", ROW_CODEC),
    **MODEL_KEYS,
    "damping_ratio": ("damping_ratio", DAMPING_RATIO_CODEC),
}
MODEL_CODEC = Codec(
    dataclass_codec(_model, READ_KEYS).read, dataclass_codec(ModalModel, MODEL_KEYS).write
)


def model_codec_for(folder: Path) -> Codec:
    """Return the codec of a model whose arrays may be the columns of a CSV file.

    The table then has the key ``modes_csv`` with the CSV file's path, relative to ``folder``. The
    columns are named like the keys of the table that they replace.
    """

    def read(path: str, plain: Any) -> Any:
        """Return the model; raises ParameterError, also for a key in both table and CSV file."""
        if isinstance(plain, Mapping) and "modes_csv" in plain:
            name = require_text(f"{path}.modes_csv", plain["modes_csv"])
            rows = read_columns(folder / name, f"{path}.modes_csv")
            left = {key: value for key, value in plain.items() if key != "modes_csv"}
            twice = sorted(set(rows) & set(left))
            require(
                not twice,
                f"{path}.modes_csv",
                name,
                f"a file without the columns {', '.join(twice)}, which are given beside it",
            )
            plain = rows | left
        return MODEL_CODEC.read(path, plain)

    return Codec(read, MODEL_CODEC.write)
