"""Records from Universal Files: time histories in datasets 58, with the units of dataset 164."""

import math
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from impact_env.checks import ParameterError, require
from impact_env.extras import optional
from impact_env.records.channels import Channel, RecordOptions, choose_channel, require_finite
from impact_env.records.units import (
    ACCELERATION_DIMENSION,
    FORCE_DIMENSION,
    LENGTH_DIMENSION,
    OTHER_DIMENSION,
    POUND_FORCE,
    STANDARD_GRAVITY,
    TIME_DIMENSION,
    VELOCITY_DIMENSION,
    Unit,
    find_unit,
    name_unit,
)

Dataset = dict[str, Any]
DELIMITER = re.compile(rb"    -1(?= {74}|\r|\n|\Z)")  # after binary data it begins no line
GENERAL_FUNCTION = 0  # kinds of function in a dataset 58
TIME_RESPONSE = 1
FUNCTIONS = {
    0: "general", 1: "time response", 2: "auto spectrum", 3: "cross spectrum",
    4: "frequency response function", 5: "transmissibility", 6: "coherence", 7: "auto correlation",
    8: "cross correlation", 9: "power spectral density", 10: "energy spectral density",
    11: "probability density function", 12: "spectrum", 13: "cumulative frequency distribution",
    14: "peaks valley", 15: "stress/cycles", 16: "strain/cycles", 17: "orbit",
    18: "mode indicator function", 19: "force pattern", 20: "partial power",
    21: "partial coherence", 22: "eigenvalue", 23: "eigenvector", 24: "shock response spectrum",
    25: "finite impulse response filter", 26: "multiple coherence", 27: "order function",
}  # fmt: skip
# kinds of data on an axis
UNKNOWN_DATA = 0
GENERAL_DATA = 1
DISPLACEMENT_DATA = 8
VELOCITY_DATA = 11
ACCELERATION_DATA = 12
FORCE_DATA = (9, 13)  # reaction force, excitation force
TIME_DATA = 17
DATA_TYPES = {
    0: "unknown", 1: "general", 2: "stress", 3: "strain", 5: "temperature", 6: "heat flux",
    8: "displacement", 9: "reaction force", 11: "velocity", 12: "acceleration",
    13: "excitation force", 15: "pressure", 16: "mass", 17: "time", 18: "frequency", 19: "rpm",
    20: "order",
}  # fmt: skip
REAL_PRECISIONS = (2, 4)  # ordinate data types: single and double precision; 5 and 6 are complex
UFF_BYTE_ORDERS = (1, 2)  # little endian, big endian
IEEE = 2  # floating point format
ROTATIONS = (4, 5, 6)
DIRECTION_NAMES = ("", "X", "Y", "Z", "RX", "RY", "RZ")
FOOT = 0.3048
# code of a system of units -> its units of length in m and of force in N; for other codes the
# file has them
UNIT_SYSTEMS = {
    1: (1.0, 1.0), 2: (FOOT, POUND_FORCE), 3: (1.0, STANDARD_GRAVITY),
    4: (FOOT, POUND_FORCE * FOOT / STANDARD_GRAVITY), 5: (1e-3, 1e-3),
    6: (1e-2, 1e-2), 7: (0.0254, POUND_FORCE), 8: (1e-3, STANDARD_GRAVITY),
}  # fmt: skip
USER_DEFINED = 9
FACTOR_TOL = 1e-4  # relative: factors in files have five digits or more
ABSENT_TEXTS = ("", "NONE", "NULL")


@dataclass(frozen=True)
class UnitSystem:
    """A system of units."""

    length: float  # its unit of length in m
    force: float  # its unit of force in N
    name: str


def _require_whole(file: Path) -> None:
    """Raise ParameterError if a file has no dataset, or its last dataset does not end."""
    delimiters = len(DELIMITER.findall(file.read_bytes()))
    allowed = "a whole Universal File, each of whose datasets begins and ends with a line -1"
    require(delimiters > 0 and delimiters % 2 == 0, f"{file.name}: lines -1", delimiters, allowed)


def _read_datasets(file: Path) -> list[tuple[int, Dataset]]:
    """Return the datasets 58 and 164 of a file, each with its number, from 1, among all datasets.

    Raises ParameterError for a file that cannot be read, and MissingExtraError without pyuff.
    """
    with optional():
        import pyuff
    _require_whole(file)
    result = []
    number = 0
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            reader = pyuff.UFF(str(file))
            for number, kind in enumerate(reader.get_set_types(), 1):
                if kind in (58, 164):
                    result.append((number, reader.read_sets(number - 1)))
    except Exception as error:  # the library raises bare exceptions
        words = " ".join(str(error).split())
        where = f"{file.name}: dataset {number}" if number else file.name
        raise ParameterError(
            f"file = {where!r} is not allowed: a Universal File that can be read ({words})"
        ) from error
    return result


def _unit_system(file: Path, datasets: Sequence[tuple[int, Dataset]]) -> UnitSystem | None:
    """Return the system of units in a file's datasets 164, None without one.

    Raises ParameterError for an unknown code, for factors that contradict the code, and for two
    different systems.
    """
    systems = []
    for number, part in datasets:
        if part["type"] != 164:
            continue
        code = int(part["units_code"])
        where = f"{file.name}: dataset {number} (164)"
        allowed = f"a code of units from 1 to {USER_DEFINED}"
        require(code in UNIT_SYSTEMS or code == USER_DEFINED, f"{where}: units", code, allowed)
        factors = (float(part["length"]), float(part["force"]))
        positive = all(math.isfinite(factor) and factor > 0 for factor in factors)
        require(
            positive,
            f"{where}: factors",
            factors,
            "numbers above 0: units of length and force in a metre and a newton",
        )
        length, force = UNIT_SYSTEMS.get(code, (1 / factors[0], 1 / factors[1]))
        same = all(
            math.isclose(a * b, 1, rel_tol=FACTOR_TOL)
            for a, b in zip(factors, (length, force), strict=True)
        )
        require(
            same,
            f"{where}: factors",
            factors,
            f"{1 / length:.7g} and {1 / force:.7g}, as its code of units {code} says",
        )
        systems.append(
            UnitSystem(
                length, force, str(part.get("units_description", "")).strip() or f"code {code}"
            )
        )
    for system in systems[1:]:
        same = (system.length, system.force) == (systems[0].length, systems[0].force)
        require(
            same, f"{file.name}: datasets 164", [one.name for one in systems], "one system of units"
        )
    return systems[0] if systems else None


def _label(part: Dataset, name: str) -> str | None:
    text = str(part.get(f"{name}_axis_units_lab", "")).strip()
    return None if text.upper() in ABSENT_TEXTS else text


def _unit_of_system(where: str, part: Dataset, system: UnitSystem | None) -> Unit | None:
    """Return the unit of a dataset's values, from its kind of data and the file's system of units.

    Without a system, units are SI. The result is None if the kind of data is unknown, or general
    data that may be an acceleration, a velocity or a displacement. For a kind without a unit here,
    such as pressure, its factor is NaN. Raises ParameterError for other general data, and for
    general data with a length to the power 1 in a system that is not SI.
    """
    kind = int(part["ordinate_spec_data_type"])
    exponents = [int(part[f"ordinate_{name}_unit_exp"]) for name in ("len", "force", "temp")]
    if kind == GENERAL_DATA:
        if exponents == [0, 1, 0]:
            kind = FORCE_DATA[0]
        elif exponents == [1, 0, 0]:  # may be a velocity or a displacement: time has no exponent
            require(
                system is None or system.length == 1,
                f"{where}: ordinate",
                "general data, length to the power 1",
                "acceleration (12), in a system of units that is not SI",
            )
            return None
        else:
            require(
                exponents == [0, 0, 0],
                f"{where}: units exponents",
                exponents,
                "those of a force, 0 1 0, or of an acceleration, 1 0 0",
            )
    if kind in (UNKNOWN_DATA, GENERAL_DATA):
        return None
    if kind == ACCELERATION_DATA:
        factor = 1.0 if system is None else system.length
        return name_unit(ACCELERATION_DIMENSION, factor)
    if kind in FORCE_DATA:
        factor = 1.0 if system is None else system.force
        return name_unit(FORCE_DIMENSION, factor)
    length = 1.0 if system is None else system.length
    if kind == DISPLACEMENT_DATA:
        return Unit(f"{length:g} m", LENGTH_DIMENSION, length)
    if kind == VELOCITY_DATA:
        return Unit(f"{length:g} m/s", VELOCITY_DIMENSION, length)
    return Unit(DATA_TYPES.get(kind, f"kind {kind}"), OTHER_DIMENSION, math.nan)


def _values_unit(
    where: str, part: Dataset, system: UnitSystem | None, options: RecordOptions
) -> tuple[Unit | None, str | None]:
    """Return the unit of a dataset's values, and a label that is no known unit.

    The unit is that of the label, if it is known, or follows from kind of data and system of units;
    None if the file has neither. The label is returned, instead of None, only if kind of data and
    system give no unit. Raises ParameterError if both units differ, and for a label that is needed
    but unknown unless ``options.unit`` is given.
    """
    by_system = _unit_of_system(where, part, system)
    label = _label(part, "ordinate")
    by_label = None if label is None else find_unit(label)
    if by_system is None:
        named = by_label is not None or options.unit is not None
        ok = system is None or system.length == system.force == 1 or named
        require(
            ok,
            f"{where}: ordinate",
            DATA_TYPES.get(int(part["ordinate_spec_data_type"])),
            (
                "acceleration or force, as dataset 164 has units other than SI "
                f"({system.name if system else ''}); or unit given"
            ),
        )
        return by_label, label if by_label is None else None
    if label is None:
        return by_system, None
    if by_label is None:
        require(
            options.unit is not None,
            f"{where}: unit of the ordinate",
            label,
            "a unit that is known, or the load's unit beside it",
        )
        return (by_system if system is not None else None), None
    if by_label.dimension != by_system.dimension:
        raise ParameterError(
            f"{where}: unit of the ordinate = {label!r} is not allowed: a unit of its kind of "
            f"data, {by_system.dimension}"
        )
    if system is not None and not by_label.is_same_as(by_system):
        raise ParameterError(
            f"{where}: unit of the ordinate = {label!r} is not allowed: {by_system.name}, as "
            f"dataset 164 says ({system.name})"
        )
    return by_label, None


def _describe(part: Dataset) -> str:
    """Return response node and direction of a dataset 58 as text, such as "12:+Z"."""
    direction = int(part.get("rsp_dir", 0))
    sign = "" if direction == 0 else "-" if direction < 0 else "+"
    axis = DIRECTION_NAMES[abs(direction)] if abs(direction) < len(DIRECTION_NAMES) else "?"
    return f"{int(part.get('rsp_node', 0))}:{sign}{axis}"


def _require_time_history(where: str, part: Dataset, options: RecordOptions) -> None:
    """Raise ParameterError for a dataset 58 that is not a complete, suitable time history.

    Suitable are real values over time that are no ratio and no rotation. A negative direction needs
    ``options.scale``. Complete means that all points and bytes of the header are there.
    """
    kind = int(part["abscissa_spec_data_type"])
    is_time = kind == TIME_DATA or (
        kind == UNKNOWN_DATA and int(part["func_type"]) == TIME_RESPONSE
    )
    require(
        is_time,
        f"{where}: abscissa",
        f"{kind} ({DATA_TYPES.get(kind, 'no known kind')})",
        f"time ({TIME_DATA})",
    )
    precision = int(part["ord_data_type"])
    require(
        precision in REAL_PRECISIONS,
        f"{where}: ordinate data type",
        precision,
        "2 or 4, real numbers; 5 and 6 are complex",
    )
    below = int(part["orddenom_spec_data_type"])
    require(
        below == 0,
        f"{where}: ordinate denominator",
        f"{below} ({DATA_TYPES.get(below, 'no known kind')})",
        "0, none: a ratio is no load",
    )
    direction = int(part.get("rsp_dir", 0))
    require(
        abs(direction) not in ROTATIONS,
        f"{where}: response direction",
        direction,
        "a translation, 1 to 3, or 0",
    )
    require(
        abs(direction) < len(DIRECTION_NAMES),
        f"{where}: response direction",
        direction,
        "from -3 to 3",
    )
    turned = direction < 0 and options.scale is None
    require(
        not turned,
        f"{where}: response direction",
        _describe(part),
        "a scale beside a negative direction, -1 or 1, which says what sign the load has",
    )
    spacing = int(part["abscissa_spacing"])
    require(spacing in (0, 1), f"{where}: abscissa spacing", spacing, "0 or 1, uneven or even")
    if part.get("binary"):
        order = int(part["byte_ordering"])
        form = int(part["fp_format"])
        require(
            order in UFF_BYTE_ORDERS, f"{where}: byte order", order, "1 or 2, little or big endian"
        )
        require(form == IEEE, f"{where}: floating point format", form, f"{IEEE}, IEEE 754")
        bytes_each = {2: 4, 4: 8}[precision] * (2 - spacing)
        size = int(part["n_bytes"])
        expected = int(part["num_pts"]) * bytes_each
        require(
            size == expected, f"{where}: bytes", size, f"{expected}, {bytes_each} for each point"
        )
    increment = float(part["abscissa_inc"])
    require(spacing == 0 or increment > 0, f"{where}: abscissa increment", increment, "above 0 s")
    announced = int(part["num_pts"])
    length = len(part["data"])
    require(
        length == announced,
        f"{where}: points",
        f"{length} of {announced}",
        "all that the header announces",
    )


def read_uff(file: Path, options: RecordOptions) -> Channel:
    """Return a time history of a Universal File, with its times, in the file's units.

    ``options.channel`` chooses it if there are several. Raises ParameterError for a file, a dataset
    or a unit that cannot be used, and MissingExtraError without pyuff.
    """
    datasets = _read_datasets(file)
    system = _unit_system(file, datasets)
    functions = [(number, part) for number, part in datasets if part["type"] == 58]
    histories = [
        (number, part)
        for number, part in functions
        if int(part["func_type"]) in (GENERAL_FUNCTION, TIME_RESPONSE)
    ]
    kinds = sorted({int(part["func_type"]) for _, part in functions})
    others = (
        ", ".join(f"{kind} ({FUNCTIONS.get(kind, 'no known function')})" for kind in kinds)
        or "no dataset 58"
    )
    allowed = f"one or more, datasets 58 with a time response (1); the file has {others}"
    require(len(histories) > 0, f"{file.name}: time histories", 0, allowed)
    index = choose_channel(file, options, [_describe(part) for _, part in histories])
    number, part = histories[index]
    where = f"{file.name}: dataset {number} (58)"
    _require_time_history(where, part, options)
    unit, unknown = _values_unit(where, part, system, options)
    label = _label(part, "abscissa")
    time_unit = None if label is None else find_unit(label)
    wrong = time_unit is not None and time_unit.dimension != TIME_DIMENSION
    require(not wrong, f"{where}: unit of the abscissa", label, "a unit of time")
    values = require_finite(file, np.asarray(part["data"], dtype=np.float64))
    times = require_finite(file, np.asarray(part["x"], dtype=np.float64))
    return Channel(
        values,
        unit,
        times,
        time_unit,
        unit_unknown=unknown,
        time_unit_unknown=label if time_unit is None else None,
    )
