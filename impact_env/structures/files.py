"""Matrices from files: NumPy's and SciPy's .npz, and Matrix Market; and columns of numbers from .csv."""

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import scipy.io
import scipy.sparse

from impact_env.parameters import ParameterError, require


def _npz(path: Path, letter: str) -> Any:
    """Return a sparse matrix that SciPy saved, or the array that is named after the matrix, or the only one."""
    with np.load(path, allow_pickle=False) as archive:
        names = list(archive.files)
        if {"indptr", "format"} <= set(names):
            return scipy.sparse.load_npz(path)
        if letter not in names and len(names) != 1:
            raise ValueError(f"it has {', '.join(names) or 'nothing'}, and no {letter}")
        return archive[letter if letter in names else names[0]]


READERS: dict[str, Callable[[Path, str], Any]] = {".npz": _npz, ".mtx": lambda path, _: scipy.io.mmread(path)}


def read_matrix(path: Path, name: str, letter: str) -> Any:
    """Return a matrix from a file, dense or sparse; of several arrays in a .npz that called ``letter``, one of M, K, C.

    Raises ParameterError with the matrix's ``name`` if the file cannot be read.
    """
    reader = READERS.get(path.suffix.lower())
    require(reader is not None, name, str(path), f"a file that ends in {' or '.join(READERS)}")
    assert reader is not None
    try:
        return reader(path, letter)
    except (OSError, ValueError, KeyError, BadZipFile, EOFError, TypeError) as error:
        raise ParameterError(f"{name} = {str(path)!r} is not allowed: a matrix that can be read ({error})") from error


def read_columns(path: Path, name: str) -> dict[str, list[float]]:
    """Return the columns of a CSV file with a line of names, commas between, by name; raises ParameterError, which names file and line."""
    allowed = "a .csv file: a line of names, then a line of numbers for each mode, commas between"
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = [[cell.strip() for cell in line] for line in csv.reader(file) if any(cell.strip() for cell in line)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ParameterError(f"{name} = {str(path)!r} is not allowed: {allowed} ({error})") from error
    require(len(lines) > 1 and len(set(lines[0])) == len(lines[0]), name, str(path), allowed)
    rows = []
    for number, line in enumerate(lines[1:], 1):
        try:
            rows.append([float(cell) for cell in line])
        except ValueError as error:
            raise ParameterError(f"{name} = {str(path)!r}, mode {number} is not allowed: {allowed} ({error})") from error
        require(len(line) == len(lines[0]), name, f"{path}, mode {number}: {len(line)} numbers", f"{len(lines[0])}, one a column")
    return {key: list(column) for key, column in zip(lines[0], zip(*rows, strict=True), strict=True)}
