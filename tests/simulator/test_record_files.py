"""Records from files use each field that changes the meaning.

Everything else is refused in one line.
"""

import re
import struct
import warnings
import wave
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import constants

from impact_env.checks import ParameterError
from impact_env.loads import BASE_QUANTITY, FORCE_QUANTITY, Samples
from impact_env.plain_loads import read_loads
from impact_env.sampling_times import is_even

Array = NDArray[np.float64]
RATE = 1000.0
TIMES = np.arange(100) / RATE
VALUES = np.sin(250 * TIMES)


def record(
    folder: Path, content: object, name: str, more: str = "", quantity: str = BASE_QUANTITY
) -> Samples:
    """Return the record of a file with that content; a warning of a library is an error."""
    file = folder / name
    if isinstance(content, np.ndarray):
        np.save(file, content)
    else:
        file.write_bytes(content if isinstance(content, bytes) else str(content).encode())
    table = f"[load]\nkind = 'samples'\nquantity = '{quantity}'\nfile = '{name}'\n{more}"
    (folder / "load.toml").write_text(table, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (part,) = read_loads(folder / "load.toml", 250.0).parts
    assert isinstance(part, Samples)
    return part


def table(
    header: str,
    times: Array = TIMES,
    values: Array = VALUES,
    separator: str = ",",
    decimal: str = ".",
    end: str = "\n",
    digits: int = 9,
) -> str:
    """Return a table of times and values as text."""
    rows = (
        f"{time:.{digits}f}{separator}{value:.9f}".replace(".", decimal)
        for time, value in zip(times, values, strict=True)
    )
    return end.join([header, *rows]) + end


G = constants.g
READ_TABLES: dict[
    str, tuple[bytes | str, float]
] = {  # a table of VALUES at TIMES, and the factor of its unit
    "plain": (table("time_s,value"), 1.0),
    "brackets": (table("time (ms),acc (g)", 1e3 * TIMES), G),
    "underscores": (table("time_us,acc_mm_s2", 1e6 * TIMES), 1e-3),
    "minutes": (table("time [min],acc [m/s^2]", TIMES / 60, digits=12), 1.0),
    "divided by the unit": (table("t / ms,a / (m/s²)", 1e3 * TIMES), 1.0),
    "capitals": (table("TIME (S),ACC (G)"), G),
    "words": (table("Time ms,acceleration in/s²", 1e3 * TIMES), constants.inch),
    "units alone": (table("ms,g", 1e3 * TIMES), G),
    "a row of units": (table("Time,Channel A\n(ms),(g)\n", 1e3 * TIMES), G),
    "a multiple": (table("time (s),acc (0.1 g)"), 0.1 * G),
    "a horizontal acceleration": (table("t_s,acc_h"), 1.0),
    "a smallest acceleration": (table("time_ms,acc_min", 1e3 * TIMES), 1.0),
    "a force that ends in s": (table("t,force_s"), 1.0),
    "elapsed time": (table("elapsed_ms,acc", 1e3 * TIMES), 1.0),
    "negative powers": (table("time (s),acc (m·s⁻²)"), 1.0),
    "micrometres": (table("time (s),acc µm/s²"), 1e-6),
    "a separator at the end of each row": (table("t_s;a_g", end=";\n", separator=";"), G),
    "a separator at the end of each row of numbers": (
        table("t_s,a_g", end=",\n").replace("g,", "g", 1),
        G,
    ),
    "a capital for the time": (table("T,a"), 1.0),
    "a channel's letter": (table("Time (s),Channel A"), 1.0),
    "per": (table("time_s,acc_mm_per_s2"), 1e-3),
    "ps2": (table("time_s,acc_mmps2"), 1e-3),
    "a factor after a slash": (table("t / 0.1 ms,a / m/s²", 1e4 * TIMES), 1.0),
    "units first": (table("(ms) time,(g) acc", 1e3 * TIMES), G),
    "units between": (table("time (ms) from start,acc (g) front", 1e3 * TIMES), G),
    "two brackets": (table("time (s),acc (front) [g]"), G),
    "a slash and brackets": (table("t/(ms),a/(m/s^2)", 1e3 * TIMES), 1.0),
    "quotes": (table('"Time, s","Acc, g"'), G),
    "semicolons and decimal commas": (table("Zeit (s);a (g)", separator=";", decimal=","), G),
    "tabs and decimal commas": (table("Zeit (s)\ta (g)", separator="\t", decimal=","), G),
    "spaces": (table("t_s a_g", separator="  "), G),
    "the header as a comment": ("# made by a logger\n# " + table("t_ms,a_g", 1e3 * TIMES), G),
    "a spreadsheet's first line": ("sep=;\n" + table("t_s;a_g", separator=";"), G),
    "times last": (table("acc (g),time (ms)", VALUES, 1e3 * TIMES), G),
    "other ends of lines": (table("t_s,a_g", end="\r\n"), G),
    "old ends of lines": (table("t_s,a_g", end="\r"), G),
    "UTF-8 with a mark": (b"\xef\xbb\xbf" + table("t_ms,a_g", 1e3 * TIMES).encode(), G),
    "UTF-16": (table("t (ms),a (g)", 1e3 * TIMES).encode("utf-16"), G),
    "UTF-16, other order": (b"\xfe\xff" + table("t_s,a_g").encode("utf-16-be"), G),
    "UTF-32": (table("t (s),a (m/s²)").encode("utf-32"), 1.0),
    "Latin-1": (table("t (µs),a (mm/s²)", 1e6 * TIMES).encode("latin-1"), 1e-3),
}


@pytest.mark.parametrize("name", READ_TABLES)
def test_tables_are_read_in_their_units(name: str, tmp_path: Path) -> None:
    content, factor = READ_TABLES[name]
    load = record(tmp_path, content, "a.csv")
    np.testing.assert_allclose(load.values, factor * VALUES, atol=1e-9 * factor)
    np.testing.assert_allclose(load.times, TIMES, atol=1e-9)


def refuse(folder: Path, content: object, name: str, message: str, more: str = "") -> None:
    """Check that a file is refused in one line with a message."""
    with pytest.raises(ParameterError, match=message) as caught:
        record(folder, content, name, more)
    assert "\n" not in str(caught.value)


def test_small_letters_do_not_make_a_meganewton_a_millinewton(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(table("t_s,force_mn"), encoding="utf-8")
    load = "[load]\nkind = 'samples'\nfile = 'a.csv'\n"
    (tmp_path / "load.toml").write_text(load, encoding="utf-8")
    with pytest.raises(ParameterError, match="unit = 'mn'"):
        read_loads(tmp_path / "load.toml", 250.0)


def test_forces_have_units_too(tmp_path: Path) -> None:
    for unit, factor in (("kN", 1e3), ("mN", 1e-3), ("lbf", constants.lbf), ("kgf", constants.g)):
        load = record(tmp_path, table(f"t_s,force ({unit})"), "a.csv", quantity=FORCE_QUANTITY)
        np.testing.assert_allclose(load.values, factor * VALUES, atol=1e-8 * factor)


THREE = "t_s,a (g),b (mm/s2)\n" + "".join(
    f"{t},{v},{2 * v}\n" for t, v in zip(TIMES, VALUES, strict=True)
)
CHOSEN = {
    "channel = 1": G,
    "channel = 'a (g)'": G,
    "channel = 'a'": G,
    "channel = 2": 2e-3,
    "channel = 'b'": 2e-3,
}


@pytest.mark.parametrize("more", CHOSEN)
def test_a_channel_is_chosen_by_number_or_name(more: str, tmp_path: Path) -> None:
    load = record(tmp_path, THREE, "a.csv", more)
    np.testing.assert_allclose(load.values, CHOSEN[more] * VALUES)


def test_the_load_s_keys_say_what_a_file_does_not(tmp_path: Path) -> None:
    content = table("time,a", 1e3 * TIMES)
    load = record(tmp_path, content, "a.csv", "time_unit = 'ms'\nunit = 'g'\nscale = 2")
    np.testing.assert_allclose(load.values, 2 * G * VALUES, atol=1e-8)
    assert load.duration == pytest.approx(TIMES[-1])
    load = record(tmp_path, table("t_s,a_g"), "a.csv", "unit = 'g'\nscale = 2")
    np.testing.assert_allclose(load.values, 2 * G * VALUES, atol=1e-8)
    columns = table("a_g,b_g", VALUES, 3 * VALUES)
    load = record(tmp_path, columns, "a.csv", "channel = 2\nsample_rate_hz = 1000")
    np.testing.assert_allclose(load.values, 3 * G * VALUES, atol=1e-7)


def put(content: str, row: int, text: str) -> str:
    """Return a table with a line of other text, rows counted from 1."""
    lines = content.split("\n")
    lines[row - 1] = text
    return "\n".join(lines)


PLAIN = table("t_s,a")
HOLD = table("t_s,a", values=np.minimum(1.0, 40 * TIMES))
REFUSED_TABLES: dict[
    str, tuple[bytes | str, str, str]
] = {  # a table, keys of the load, and the message
    "a unit of force": (table("t_s,a (kN)"), "", r"a\.csv: unit = 'kN' .*acceleration, as m/s\^2"),
    "a displacement": (table("t_s,x (mm)"), "", "unit = 'mm'"),
    "a displacement by name": (table("t_s,displacement"), "", "column = 'displacement'"),
    "volts": (table("Time,A\n(ms),(V)\n"), "", "unit = 'V'"),
    "an unknown unit": (table("t_s,a (foo)"), "", "unit = 'foo'"),
    "an unknown unit of time": (
        table("time (tick),a"),
        "",
        "unit = 'tick' .*time in brackets or at the end, as s, ms",
    ),
    "a unit among words": (table("t_s,acc_g_front"), "", "unit = 'g'"),
    "a unit of two words": (table("t_s,acc m_s2 front"), "", "unit = 'm_s2'"),
    "a unit of time among words": (table("time ms rel,a"), "", "unit = 'ms'"),
    "two units": (table("t_s,acc (g) (mm/s^2)"), "", "unit = 'g and mm"),
    "a density": (table("t_s,a ((m/s^2)^2/Hz)"), "", "unit = '"),
    "a density, brackets within": (table("t_s,a (m/s^2)^2/Hz"), "", "unit = '"),
    "an open bracket": (table("t_s,a (g"), "", "unit = 'a"),
    "a spectrum": (table("frequency (Hz),PSD"), "", r"first column = 'frequency \(Hz\)'"),
    "a spectrum without units": (table("freq,psd"), "", "first column = 'freq'"),
    "another unit than the key's": (
        table("t_s,a_g"),
        "unit = 'mm/s^2'",
        r"load\.unit = 'mm/s\^2' .*: g",
    ),
    "a factor for the unit once more": (
        table("t_s,a_g"),
        "scale = 9.81",
        r"load\.scale = 9\.81 .*left out, as a\.csv has values in g",
    ),
    "a unit that is none": (PLAIN, "unit = 'N'", r"load\.unit = 'N'"),
    "a unit of time that is none": (PLAIN, "time_unit = 'g'", r"load\.time_unit = 'g'"),
    "a unit in a comment": ("# unit: g\n" + PLAIN, "", "row 1 = 'unit: g'"),
    "a channel's number before a unit": (
        table("t_s,Accel 2 m/s^2"),
        "",
        r"unit = '2 m/s\^2' .*in brackets",
    ),
    "channels' numbers before a unit": (table("t_s,Ch1/2 g"), "", "unit = '2 g'"),
    "a range before a unit": (table("t_s,acc_50g"), "", "unit = '50g'"),
    "a prefix in a word of its own": (table("t_s,acc milli-g"), "", "unit = 'milli-g'"),
    "dates of ISO 8601": (
        "time,a\n2020-01-01T00:00:00,1\n2020-01-01T00:00:01,2\n",
        "",
        "row 3 = '2020-.*no dates",
    ),
    "complex numbers": ("t_s,a\n0,1+2j\n1,1-2j\n", "", r"row 3 = '1,1-2j' .*real numbers"),
    "a last column of empty cells": (
        table("t_s,a,note", end=",\n").replace("note,", "note"),
        "",
        "row 2 = .*no gap",
    ),
    "a separator at the end of some rows": (
        put(table("t_s,a", end=",\n"), 7, "0.005,1"),
        "",
        "row 7 = .*at the end, as in all rows",
    ),
    "a current": (table("t_s,current A"), "", "unit = 'A'"),
    "no channel": (THREE, "", r"load\.channel = None .*1 'a \(g\)', 2 'b \(mm/s2\)'"),
    "no such channel": (THREE, "channel = 3", r"load\.channel = 3 .*1 'a \(g\)', 2"),
    "no such name": (THREE, "channel = 'c'", r"load\.channel = 'c'"),
    "a channel that is no number": (THREE, "channel = 1.5", r"load\.channel = 1\.5"),
    "two columns of times": (table("t_s,t_ms"), "", "columns of times"),
    "a mark and no header": ("\ufeff" + PLAIN.split("\n", 1)[1], "", "row 1 = .*a header"),
    "no rows": ("t_s,a\n", "", r"a\.csv: rows of numbers = 0"),
    "nothing": ("", "", r"a\.csv: rows of numbers = 0"),
    "one row": ("t_s,a\n0,1\n", "", "rows = 1"),
    "two headers": ("Logger,7\n" + PLAIN, "", "row 2 = .*one header"),
    "text at the end": (PLAIN + "end\n", "", r"row 102 = \['end'\]"),
    "a comment between": (put(PLAIN, 7, "# restart"), "", "row 7 = "),
    "an empty line between": (put(PLAIN, 7, ""), "", "row 7 = "),
    "an empty cell": (put(PLAIN, 7, "0.005,"), "", r"row 7 = \['0\.005', ''\] .*no gap"),
    "no number": (put(PLAIN, 7, "0.005,NaN"), "", "row 7 = .*no gap"),
    "an infinite number": (put(PLAIN, 7, "0.005,1e400"), "", "row 7 = "),
    "a short row": (put(PLAIN, 7, "0.005"), "", "row 7 = .*2 cells"),
    "marks of thousands": (put(table("t;a", separator=";"), 7, "0.005;1,234.5"), "", "row 7 = "),
    "both decimal marks": (
        put(table("t;a", separator=";"), 7, "0,005;1.5"),
        "",
        "row 7 = .*one decimal mark",
    ),
    "dates": ("time,a\n2020-01-01 00:00:00,1\n2020-01-01 00:00:01,2\n", "", "row 2 = "),
    "one time twice": (put(PLAIN, 7, "0.004,1"), "", r"time in row 7 = 0\.004 .*later"),
    "times that fall": (table("t_s,a", TIMES[::-1]), "", "time in row 3 = "),
    "an open quote": ('"' + PLAIN, "", "row 1 = .*quotes are closed"),
    "an open quote between": (put(PLAIN, 7, '0.005,"1'), "", "row 7 = .*quotes are closed"),
    "cut in the last number": (PLAIN[:-4], "", "row 101 = .*the file is cut"),
    "UTF-16 cut": (PLAIN.encode("utf-16")[:-1], "", r"file = 'a\.csv' .*UTF-16"),
    "UTF-16 without a mark": (PLAIN.encode("utf-16-le"), "", r"file = 'a\.csv' .*bytes of zero"),
    "a hold": (HOLD, "", r"a\.csv: value = 1 .*clipped from row 27 on; allow_clipping = true"),
    "a flag that is none": (HOLD, "allow_clipping = 1", r"load\.allow_clipping = 1"),
}


@pytest.mark.parametrize("name", REFUSED_TABLES)
def test_other_tables_are_refused_by_row(name: str, tmp_path: Path) -> None:
    content, more, message = REFUSED_TABLES[name]
    refuse(tmp_path, content, "a.csv", message, more)


def test_a_record_that_holds_its_value_is_taken_if_it_is_meant(tmp_path: Path) -> None:
    load = record(tmp_path, HOLD, "a.csv", "allow_clipping = true")
    np.testing.assert_allclose(load.values, np.minimum(1.0, 40 * TIMES), atol=1e-9)


# Sampling times


def rounded(digits: int) -> Array:
    return np.array([float(f"{time:.{digits - 1}e}") for time in np.arange(5000) / 3000])


EVEN = {
    "exact": np.arange(5000) / 3000,
    "late": 7.3 + np.arange(5000) / 3000,
    "microseconds at 3 kHz": np.round(np.arange(5000) / 3000, 6),
    "microseconds at 48 kHz": np.round(1.7 + np.arange(5000) / 48e3, 6),
    "microseconds cut off": np.floor(1e6 * np.arange(5000) / 48e3) / 1e6,
    "single precision": (100 + np.arange(5000) / 3000).astype(np.float32).astype(float),
    "five digits": rounded(5),
}


@pytest.mark.parametrize("name", EVEN)
def test_rounded_times_are_even_in_files_and_in_python(name: str, tmp_path: Path) -> None:
    times = EVEN[name]
    values = np.sin(times)
    python = (
        Samples(times - times[0], values)
        if name not in ("late", "microseconds at 48 kHz", "single precision")
        else None
    )
    file = record(tmp_path, np.column_stack([times, values]), "a.npy")
    rate = 48e3 if "48" in name or "cut" in name else 3000.0
    for load in (file, python):
        if load is not None:
            np.testing.assert_allclose(
                load.times,
                np.arange(5000) / rate,
                atol=5e-5 if "five" in name or "single" in name else 1.1e-6,
            )
            np.testing.assert_array_equal(load.values, values)
            np.testing.assert_allclose(np.diff(load.times), load.times[1], rtol=1e-6)


JITTER = np.random.default_rng(0).uniform(-1e-4, 1e-4, 100)
UNEVEN = {
    "jitter": np.round(TIMES + JITTER, 6),
    "a little jitter": np.round(TIMES + 0.05 * JITTER, 9),
    "a sample less": np.delete(np.round(TIMES, 6), 50),
    "a sample less at the end": np.delete(np.round(TIMES, 6), 98),
    "another rate from the middle on": np.concatenate(
        [TIMES[:50], TIMES[50] + 1.01 * (TIMES[50:] - TIMES[50])]
    ),
}


@pytest.mark.parametrize("name", UNEVEN)
def test_uneven_times_are_refused_in_files_and_in_python(name: str, tmp_path: Path) -> None:
    times = UNEVEN[name] - UNEVEN[name][0]
    assert not is_even(times)
    with pytest.raises(ParameterError, match=r"times\[\d+\] = .*even steps"):
        Samples(times, np.sin(times))
    refuse(
        tmp_path, np.column_stack([times, np.sin(times)]), "a.npy", "time in row .*resample = true"
    )


def test_resampling_evens_jitter_and_bridges_no_gap(tmp_path: Path) -> None:
    times = TIMES + JITTER
    load = record(tmp_path, np.column_stack([times, 3 * times]), "a.npy", "resample = true")
    np.testing.assert_allclose(load.values, 3 * (times[0] + load.times), rtol=1e-12)
    assert len(load.values) == 100
    np.testing.assert_allclose(np.diff(load.times), load.times[1], rtol=1e-9)
    lost = (np.arange(100) < 40) | (np.arange(100) > 60)
    dense = np.sort(np.concatenate([times, times[40:60] + 2e-4]))
    for bad, row in ((times[lost], 41), (np.delete(times, 40), 41), (dense, 42)):
        refuse(
            tmp_path,
            np.column_stack([bad, bad]),
            "a.npy",
            f"time in row {row} = .*would bridge a gap",
            "resample = true",
        )


# Arrays


def test_arrays_of_real_numbers_are_read(tmp_path: Path) -> None:
    rate = "sample_rate_hz = 1000"
    both = np.column_stack([TIMES, VALUES])
    named = np.array([*zip(1e3 * TIMES, VALUES, strict=True)], [("t_ms", "f8"), ("a_g", "f8")])
    for content, more, factor in (
        (VALUES, rate, 1.0),
        (VALUES.astype(np.float32), rate, 1.0),
        (VALUES.astype(np.float16), rate, 1.0),
        (VALUES.astype(">f8"), rate, 1.0),
        (both, "", 1.0),
        (np.asfortranarray(both), "", 1.0),
        (np.column_stack([both, 3 * VALUES]), "channel = 2", 3.0),
        (named, "", G),
    ):
        load = record(tmp_path, content, "a.npy", more)
        np.testing.assert_allclose(load.values, factor * VALUES, atol=1e-3)
        np.testing.assert_allclose(load.times, TIMES, atol=1e-12)


REFUSED_ARRAYS: dict[str, tuple[Array, str]] = {
    "complex": (VALUES + 0j, "data type = 'complex128'"),
    "text": (VALUES.astype(str), "data type = '<U"),
    "bytes": (VALUES.astype("S"), r"data type = '\|S"),
    "flags": (VALUES > 0, "data type = 'bool'"),
    "dates": (np.arange(100).astype("M8[ms]"), r"data type = 'datetime64\[ms\]'"),
    "durations": (np.arange(100).astype("m8[ms]"), r"data type = 'timedelta64\[ms\]'"),
    "structured text": (np.array([("a", 1.0)], [("t", "U1"), ("a", "f8")]), "data type = '<U1'"),
    "structured complex": (np.zeros(9, [("t", "f8"), ("a", "c16")]), "data type = 'complex128'"),
    "empty": (np.zeros(0), r"shape = \(0,\)"),
    "empty rows": (np.zeros((0, 2)), r"shape = \(0, 2\)"),
    "a number": (np.array(1.0), r"shape = \(\)"),
    "rows for columns": (np.array([TIMES, VALUES]), r"shape = \(2, 100\)"),
    "a cube": (np.zeros((3, 3, 3)), r"shape = \(3, 3, 3\)"),
    "too large": (1e31 * VALUES, "row 2 = "),
}


@pytest.mark.parametrize("name", REFUSED_ARRAYS)
def test_other_arrays_are_refused(name: str, tmp_path: Path) -> None:
    content, message = REFUSED_ARRAYS[name]
    refuse(tmp_path, content, "a.npy", rf"a\.npy: {message}", "sample_rate_hz = 1000")


def test_array_files_that_are_damaged_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "whole.npy", VALUES)
    whole = (tmp_path / "whole.npy").read_bytes()
    np.savez(tmp_path / "many.npz", VALUES)
    np.save(tmp_path / "objects.npy", np.array([1, None], object), allow_pickle=True)
    damaged = [whole[:cut] for cut in (0, 5, 9, 60, 127, 128, 400, len(whole) - 1)]
    damaged += [whole[:k] + bytes([whole[k] ^ 0x55]) + whole[k + 1 :] for k in range(0, 120, 9)]
    damaged += [whole + whole, b"time_s,value\n0,1\n", (tmp_path / "many.npz").read_bytes()]
    for content in (*damaged, (tmp_path / "objects.npy").read_bytes()):
        refuse(tmp_path, content, "a.npy", r"load\.file = 'a\.npy'", "sample_rate_hz = 1000")


# Sounds


def sound(values: Array, bits: int, channels: int = 1, tag: int = 1, extra: bytes = b"") -> bytes:
    """Return a WAV file of values from -1 to 1, as the RIFF specification has it."""
    if tag == 3 or extra[8:9] == b"\3":
        data = values.astype(f"<f{bits // 8}").tobytes()
    elif bits == 8:
        data = bytes(int(128 + round(128 * value)) for value in values)
    else:
        whole = (round(value * 2 ** (bits - 1)) for value in values)
        data = b"".join(number.to_bytes(bits // 8, "little", signed=True) for number in whole)
    block = channels * bits // 8
    about = struct.pack("<HHIIHH", tag, channels, int(RATE), int(RATE) * block, block, bits) + extra
    chunks = b"fmt " + struct.pack("<I", len(about)) + about
    chunks += b"LIST" + struct.pack("<I", 3) + b"abc\0"  # of an odd length, and of no meaning here
    chunks += b"data" + struct.pack("<I", len(data)) + data
    return b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WAVE" + chunks


def extension(bits: int, form: int) -> bytes:
    """Return the part that makes a format extensible, with the form of its samples."""
    tail = bytes.fromhex("0000 0000 1000 8000 00aa 0038 9b71")
    return struct.pack("<HHIH", 22, bits, 4, form) + tail


SOUNDS = {f"{bits} bits": (sound(VALUES / 2, bits), bits) for bits in (8, 16, 24, 32)}
SOUNDS |= {f"floats of {bits} bits": (sound(VALUES / 2, bits, tag=3), 24) for bits in (32, 64)}
SOUNDS["extensible"] = (sound(VALUES / 2, 24, tag=0xFFFE, extra=extension(24, 1)), 24)
SOUNDS["extensible floats"] = (sound(VALUES / 2, 32, tag=0xFFFE, extra=extension(32, 3)), 24)


@pytest.mark.parametrize("name", SOUNDS)
def test_sounds_have_full_scale_one_and_silence_zero(name: str, tmp_path: Path) -> None:
    """To half of the last bit, so the middle too: of 8 bits, which have no sign, it is 128."""
    content, bits = SOUNDS[name]
    load = record(tmp_path, content, "a.wav", "scale = 6.0")
    np.testing.assert_allclose(load.values, 3 * VALUES, atol=6.0 * 0.51 / 2 ** (bits - 1))
    assert load.values[0] == 0.0
    np.testing.assert_allclose(load.times, TIMES)


def test_silence_of_eight_bits_from_another_writer(tmp_path: Path) -> None:
    with wave.open(str(tmp_path / "b.wav"), "wb") as file:
        file.setnchannels(2), file.setsampwidth(1), file.setframerate(1000)
        file.writeframes(bytes([128, 0, 128, 255, 128, 64]))
    content = (tmp_path / "b.wav").read_bytes()
    load = record(tmp_path, content, "a.wav", "scale = 128.0\nchannel = 1")
    assert load.values.tolist() == [0.0, 0.0, 0.0]
    load = record(tmp_path, content, "a.wav", "scale = 128.0\nchannel = 2")
    assert load.values.tolist() == [-128.0, 127.0, -64.0]


SOUND = sound(VALUES / 2, 16)
DATA = SOUND.index(b"data") + 4
REFUSED_SOUNDS: dict[str, tuple[bytes, str]] = {
    "two channels": (sound(VALUES / 2, 16, 2), r"load\.channel = None .*2 channels"),
    "no samples": (sound(np.zeros(0), 16), "chunk 'data' = '0 bytes'"),
    "half a sample": (
        SOUND[:DATA] + struct.pack("<I", 199) + SOUND[DATA + 4 :],
        "chunk 'data' = '199 bytes'",
    ),
    "more samples announced": (
        SOUND[:DATA] + struct.pack("<I", 400) + SOUND[DATA + 4 :],
        "chunk 'data' = '400 bytes'",
    ),
    "fewer samples announced": (
        SOUND[:DATA] + struct.pack("<I", 100) + SOUND[DATA + 4 :],
        "chunk '",
    ),
    "a length that is not known": (
        SOUND[:DATA] + b"\xff\xff\xff\xff" + SOUND[DATA + 4 :],
        "chunk 'data' = '4294967295 bytes'",
    ),
    "bytes at the end": (SOUND + b"more of it", "bytes = "),
    "12 bits": (
        sound(VALUES / 2, 16).replace(
            struct.pack("<H", 16) + b"LIST", struct.pack("<H", 12) + b"LIST"
        ),
        "bits of a sample = 12",
    ),
    "A-law": (sound(VALUES / 2, 8, tag=6), r"file = 'a\.wav' .*ALAW"),
    "ADPCM": (sound(VALUES / 2, 8, tag=2), r"file = 'a\.wav' .*ADPCM"),
    "no sound": (b"time_s,value\n0,1\n1,2\n", r"file = 'a\.wav' .*RIFF"),
    "no format": (
        b"RIFF" + struct.pack("<I", 16) + b"WAVEdata" + struct.pack("<I", 4) + b"abcd",
        "no chunk 'fmt '",
    ),
    "no number": (sound(np.where(TIMES == 0.005, np.nan, VALUES), 32, tag=3), "row 6 = nan"),
}


@pytest.mark.parametrize("name", REFUSED_SOUNDS)
def test_other_sounds_are_refused(name: str, tmp_path: Path) -> None:
    content, message = REFUSED_SOUNDS[name]
    refuse(tmp_path, content, "a.wav", message, "scale = 1.0")


def test_sounds_that_are_cut_anywhere_are_refused(tmp_path: Path) -> None:
    for cut in (*range(60), 100, len(SOUND) - 1):
        refuse(tmp_path, SOUND[:cut], "a.wav", r"a\.wav", "scale = 1.0")


# Universal Files, written as the description of datasets 58 and 164 has them


def dataset_58(
    values: Array = VALUES,
    *,
    function: int = 1,
    axis: int = 17,
    ordinate: int = 12,
    precision: int = 4,
    points: int | None = None,
    step: float = 1 / RATE,
    times: Array | None = None,
    exponents: tuple[int, int, int] = (0, 0, 0),
    below: int = 0,
    place: tuple[int, int] = (1, 3),
    labels: tuple[str, str] = ("NONE", "NONE"),
    binary: str = "",
) -> bytes:
    """Return a dataset 58.

    ``labels`` are those of the units of abscissa and ordinate. ``binary`` is a byte order of NumPy
    for samples in bytes.
    """
    no = "NONE"
    count = len(values) if points is None else points
    spacing = int(times is None)
    rows = [no] * 5
    rows += [
        (
            f"{function:5d}{0:10d}{0:5d}{0:10d} {no:10s}{place[0]:10d}{place[1]:4d} "
            f"{no:10s}{0:10d}{0:4d}"
        )
    ]
    rows += [f"{precision:10d}{count:10d}{spacing:10d}{0:13.5E}{spacing * step:13.5E}{0:13.5E}"]
    rows += [f"{axis:10d}{0:5d}{0:5d}{0:5d} {no:20s} {labels[0]:20s}"]
    powers = "".join(f"{power:5d}" for power in exponents)
    rows += [f"{ordinate:10d}{powers} {no:20s} {labels[1]:20s}"]
    rows += [f"{kind:10d}{0:5d}{0:5d}{0:5d} {no:20s} {no:20s}" for kind in (below, 0)]
    if precision in (5, 6):
        values = np.column_stack([values, values]).ravel()
    if times is not None:
        values = np.column_stack([times, values]).ravel()
    double = precision in (4, 6)
    if binary:
        data = values.astype(f"{binary}f{8 if double else 4}").tobytes()
        order = 1 if binary == "<" else 2
        first = f"    58b{order:6d}{2:6d}{11:12d}{len(data):12d}{0:6d}{0:6d}{0:12d}{0:12d}"
        return "\n".join(["    -1", first, *rows, ""]).encode() + data + b"    -1\n"
    each = 6 if not double else 4
    if double and times is not None:
        cells = [
            f"{value:13.5E}" if k % 2 == 0 else f"{value:20.12E}" for k, value in enumerate(values)
        ]
    else:
        cells = [f"{value:20.12E}" if double else f"{value:13.5E}" for value in values]
    rows += ["".join(cells[k : k + each]) for k in range(0, len(cells), each)]
    return "\n".join(["    -1", "    58", *rows, "    -1", ""]).encode()


def dataset_164(code: int, length: float, force: float) -> bytes:
    """Return a dataset 164: units of length in a metre, of force in a newton."""
    rows = [
        f"{code:10d}{'units':20s}{2:10d}",
        f"{length:25.17E}{force:25.17E}{1:25.17E}",
        f"{0:25.17E}",
    ]
    return "\n".join(["    -1", "   164", *rows, "    -1", ""]).encode()


MM = dataset_164(5, 1e3, 1e3)
INCH = dataset_164(7, 1 / constants.inch, 1 / constants.lbf)
READ_UFF: dict[
    str, tuple[bytes, str, float, str]
] = {  # a file, its quantity, the factor of its unit, keys of the load
    "plain": (dataset_58(), BASE_QUANTITY, 1.0, ""),
    "single": (dataset_58(precision=2), BASE_QUANTITY, 1.0, ""),
    "binary": (dataset_58(binary="<"), BASE_QUANTITY, 1.0, ""),
    "binary, big-endian": (dataset_58(binary=">"), BASE_QUANTITY, 1.0, ""),
    "binary, single": (dataset_58(precision=2, binary="<"), BASE_QUANTITY, 1.0, ""),
    "binary, with times": (dataset_58(times=TIMES, binary="<"), BASE_QUANTITY, 1.0, ""),
    "with times": (dataset_58(times=TIMES), BASE_QUANTITY, 1.0, ""),
    "general function": (dataset_58(function=0), BASE_QUANTITY, 1.0, ""),
    "unknown axis of a time response": (dataset_58(axis=0), BASE_QUANTITY, 1.0, ""),
    "unknown values": (dataset_58(ordinate=0), BASE_QUANTITY, 1.0, ""),
    "units of labels": (dataset_58(step=1.0, labels=("ms", "g")), BASE_QUANTITY, G, ""),
    "SI": (dataset_164(1, 1.0, 1.0) + dataset_58(), BASE_QUANTITY, 1.0, ""),
    "millimetres": (MM + dataset_58(), BASE_QUANTITY, 1e-3, ""),
    "millimetres, afterwards": (dataset_58() + MM, BASE_QUANTITY, 1e-3, ""),
    "millimetres, in words too": (MM + dataset_58(labels=("s", "mm/s^2")), BASE_QUANTITY, 1e-3, ""),
    "feet": (
        dataset_164(2, 1 / constants.foot, 1 / constants.lbf) + dataset_58(),
        BASE_QUANTITY,
        constants.foot,
        "",
    ),
    "centimetres": (dataset_164(6, 1e2, 1e2) + dataset_58(), BASE_QUANTITY, 1e-2, ""),
    "inches": (INCH + dataset_58(), BASE_QUANTITY, constants.inch, ""),
    "pounds": (INCH + dataset_58(ordinate=13), FORCE_QUANTITY, constants.lbf, ""),
    "kilograms": (dataset_164(3, 1.0, 1 / G) + dataset_58(ordinate=9), FORCE_QUANTITY, G, ""),
    "millinewtons": (MM + dataset_58(ordinate=13), FORCE_QUANTITY, 1e-3, ""),
    "poundals": (
        dataset_164(4, 1 / constants.foot, 7.2330138512) + dataset_58(ordinate=13),
        FORCE_QUANTITY,
        0.138254954376,
        "",
    ),
    "units of one's own": (dataset_164(9, 1e6, 1.0) + dataset_58(), BASE_QUANTITY, 1e-6, ""),
    "a force by its exponents": (
        MM + dataset_58(ordinate=1, exponents=(0, 1, 0)),
        FORCE_QUANTITY,
        1e-3,
        "",
    ),
    "unknown values, with a unit": (MM + dataset_58(ordinate=0), BASE_QUANTITY, G, "unit = 'g'"),
    "a negative direction, with a sign": (
        dataset_58(place=(1, -3)),
        BASE_QUANTITY,
        -1.0,
        "scale = -1",
    ),
    "the second": (
        dataset_58(2 * VALUES) + dataset_58(place=(7, 1)),
        BASE_QUANTITY,
        1.0,
        "channel = 2",
    ),
    "the one at a node": (
        dataset_58(2 * VALUES) + dataset_58(place=(7, 1)),
        BASE_QUANTITY,
        1.0,
        "channel = '7:+X'",
    ),
    "beside a frequency response": (
        dataset_58(function=4, axis=18, precision=6) + dataset_58(),
        BASE_QUANTITY,
        1.0,
        "",
    ),
}


@pytest.mark.parametrize("name", READ_UFF)
def test_universal_files_are_read_in_their_units(name: str, tmp_path: Path) -> None:
    pytest.importorskip("pyuff")
    content, quantity, factor, more = READ_UFF[name]
    load = record(tmp_path, content, "a.uff", more, quantity)
    np.testing.assert_allclose(load.values, factor * VALUES, atol=1e-5 * abs(factor))
    np.testing.assert_allclose(load.times, TIMES, atol=1e-9)


REFUSED_UFF: dict[str, tuple[bytes, str]] = {
    "a spectrum": (
        dataset_58(function=0, axis=18, precision=6),
        r"dataset 1 \(58\): abscissa = '18 \(frequency\)'",
    ),
    "complex numbers": (dataset_58(precision=6), "ordinate data type = 6"),
    "complex numbers, single": (dataset_58(precision=5), "ordinate data type = 5"),
    **{
        f"function {kind}": (dataset_58(function=kind), rf"time histories = 0 .*has {kind} \(")
        for kind in (2, 4, 7, 9, 12, 24, 25, 27)
    },
    **{f"axis {kind}": (dataset_58(axis=kind), f"abscissa = '{kind}") for kind in (1, 8, 19, 20)},
    "nothing known of the axis": (dataset_58(function=0, axis=0), "abscissa = '0"),
    **{f"values {kind}": (dataset_58(ordinate=kind), "unit = ") for kind in (2, 3, 8, 11, 13, 15)},
    "an energy": (dataset_58(ordinate=1, exponents=(1, 1, 0)), r"units exponents = \[1, 1, 0\]"),
    "a ratio": (dataset_58(below=13), r"ordinate denominator = '13 \(excitation force\)'"),
    "a rotation": (dataset_58(place=(1, 4)), "response direction = 4"),
    "a negative direction": (dataset_58(place=(1, -3)), "response direction = '1:-Z' .*a scale"),
    "more points announced": (dataset_58(points=400), "points = '100 of 400'"),
    "fewer points announced": (dataset_58(points=50), "points = '100 of 50'"),
    "fewer bytes announced": (
        dataset_58(binary="<").replace(b"         800 ", b"         400 ", 1),
        "bytes = 400",
    ),
    "floats of another machine": (
        dataset_58(binary="<").replace(b"58b     1     2", b"58b     1     1"),
        "floating point format = 1",
    ),
    "another order of bytes": (
        dataset_58(binary="<").replace(b"58b     1", b"58b     7"),
        "byte order = 7",
    ),
    "binary and cut": (dataset_58(binary="<")[:-300] + b"    -1\n", "points = "),
    "without an end": (dataset_58()[:-8], "lines -1 = 1"),
    "cut": (dataset_58()[:-300], "lines -1 = 1"),
    "a second one cut": (dataset_58() + dataset_58()[:-300], "lines -1 = 3"),
    "no step": (dataset_58(step=0.0), "abscissa increment = 0"),
    "time steps that are not even": (dataset_58(times=UNEVEN["jitter"]), "time in row .*resample"),
    "a unit of another kind": (dataset_58(labels=("s", "N")), "unit of the ordinate = 'N'"),
    "an unknown unit": (dataset_58(labels=("s", "foo")), "unit of the ordinate = 'foo'"),
    "hertz": (dataset_58(labels=("Hz", "g")), "unit of the abscissa = 'Hz'"),
    "two units": (
        MM + dataset_58(labels=("s", "g")),
        r"unit of the ordinate = 'g' .*mm/s\^2, as dataset 164",
    ),
    "units that are not SI, of unknown values": (
        MM + dataset_58(ordinate=0),
        "ordinate = 'unknown'",
    ),
    "factors of another system": (
        dataset_164(1, 1e3, 1.0) + dataset_58(),
        r"dataset 1 \(164\): factors",
    ),
    "two systems of units": (MM + INCH + dataset_58(), "datasets 164 = "),
    "no system of units": (dataset_164(0, 1.0, 1.0) + dataset_58(), "units = 0"),
    "a factor of zero": (dataset_164(9, 0.0, 1.0) + dataset_58(), "factors = "),
    "no number": (dataset_58(np.where(TIMES == 0.005, np.nan, VALUES)), "row 6 = nan"),
    "two histories": (
        dataset_58() + dataset_58(place=(7, 1)),
        r"load\.channel = None .*1 '1:\+Z', 2 '7:\+X'",
    ),
    "no history": (MM, "time histories = 0"),
    "no numbers": (dataset_58().replace(b"E-01", b"X-01"), r"file = 'a\.uff: dataset 1'"),
    "no Universal File": (b"time_s,value\n0,1\n", "lines -1 = 0"),
}


@pytest.mark.parametrize("name", REFUSED_UFF)
def test_other_universal_files_are_refused(name: str, tmp_path: Path) -> None:
    pytest.importorskip("pyuff")
    content, message = REFUSED_UFF[name]
    refuse(tmp_path, content, "a.uff", message)


def test_characters_changed_anywhere_in_headers_end_in_one_line_or_a_record(tmp_path: Path) -> None:
    pytest.importorskip("pyuff")
    whole = {
        "a.uff": MM + dataset_58(VALUES[:20]),
        "a.wav": SOUND,
        "a.csv": table("t (ms);a (g)", separator=";").encode(),
    }
    refused = []
    for name, content in whole.items():
        for k in range(0, min(len(content), 900), 19):
            for other in (b"9", b"x", b" ", b"\xff", b"\0", b'"'):
                changed = content[:k] + other + content[k + 1 :]
                more = "scale = 1.0\nunit = 'g'" if name != "a.uff" else ""
                try:
                    record(tmp_path, changed, name, more)
                except ParameterError as error:
                    refused.append(str(error))
    assert len(refused) > 170
    assert all(re.fullmatch(r"load[.:].*", line) for line in refused)
