"""Modes from a CSV file, and one damping ratio for all of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from impact_env import ModalModel, ParameterError, load_structure

TABLE = "frequencies_hz, force_shape_per_sqrt_kg, tip_shape_per_sqrt_kg, response_shape_per_sqrt_kg\n31.2,0.21,0.9,0.5\n74.6,0.34,-0.8,0.4\n"


def written(folder: Path, table: str = TABLE, more: str = "damping_ratio = 0.01") -> Path:
    (folder / "modes.csv").write_text(table)
    (folder / "bracket.toml").write_text(f'[model]\nmodes_csv = "modes.csv"\nbeam_mass_kg = 6.5\n{more}\n')
    return folder / "bracket.toml"


def test_columns_are_the_rows_of_a_model(tmp_path: Path) -> None:
    found = load_structure(written(tmp_path))
    assert isinstance(found, ModalModel)
    np.testing.assert_allclose(found.omega, 2 * np.pi * np.array([31.2, 74.6]), rtol=1e-15)
    np.testing.assert_array_equal(found.tip_shape, [0.9, -0.8])
    np.testing.assert_array_equal(found.level_shape, [0.5, 0.4])
    np.testing.assert_array_equal(found.damping_ratio, [0.01, 0.01])
    own = load_structure(written(tmp_path, TABLE.replace("hz,", "hz, damping_ratio,").replace(".2,", ".2,0.01,").replace(".6,", ".6,0.02,"), ""))
    assert isinstance(own, ModalModel)
    np.testing.assert_array_equal(own.damping_ratio, [0.01, 0.02])


@pytest.mark.parametrize(
    ("table", "more", "message"),
    [
        (TABLE.replace("0.9", "high"), "damping_ratio = 0.01", "mode 1 is not allowed: a .csv file"),
        (TABLE.replace(",0.4\n", "\n"), "damping_ratio = 0.01", "mode 2: 3 numbers' is not allowed: 4, one a column"),
        (TABLE.replace("tip", "top"), "damping_ratio = 0.01", "top_shape_per_sqrt_kg"),
        (TABLE, "damping_ratio = 0.01\nfrequencies_hz = [1, 2]", "without the columns frequencies_hz"),
        (TABLE, "", "damping_ratio must be given"),
        (TABLE, "damping_ratio = [0.01]", "damping_ratio = \\(0.01,\\) is not allowed: one number, or one for each of the 2 modes"),
        ("", "damping_ratio = 0.01", "modes.csv' is not allowed: a .csv file"),
    ],
)
def test_a_wrong_file_is_one_error(tmp_path: Path, table: str, more: str, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        load_structure(written(tmp_path, table, more))
