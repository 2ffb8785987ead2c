"""Structures in small files, for tests."""

import json
from pathlib import Path

import numpy as np

BEAM = "[beam]\nlength_m = 0.5\nbending_stiffness_n_m2 = 362.88\nmass_per_length_kg_m = 1.1275\n"
MATRICES = {"mass": "m.npz", "stiffness": "m.npz", "units": "kg, m, s", "force": 0, "absorber": 1, "mass_kg": 3.0, "modes": 3, "damping_ratio": 0.01}


def written(folder: Path, table: str, **keys: object) -> Path:
    """Write a structure of one table, as JSON, which TOML's reader shares all checks with."""
    path = folder / "structure.json"
    path.write_text(json.dumps({table: {key: value for key, value in keys.items() if value is not None}}))
    return path


def chain(folder: Path, held: bool = True, **more: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Three masses on springs, as matrices in a file."""
    mass = np.diag([1.0, 0.5, 1.5])
    stiffness = 1e4 * np.array([[2.0 if held else 1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    np.savez(folder / "m.npz", M=mass, K=stiffness, **more)
    return mass, stiffness
