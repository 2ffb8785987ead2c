"""Structures from matrices on a base that moves: static sag under a constant acceleration, an absorber that stays behind, and what is refused."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from structure_files import MATRICES, chain, written

from impact_env.loads import BASE, Loads, Samples
from impact_env.modes import ModalModel
from impact_env.parameters import ParameterError, impact_absorber
from impact_env.response import Record
from impact_env.scene import Scene
from impact_env.structure import load_structure
from impact_env.sweep import simulate

SHARES = [1.0, 0.5, 1.0]  # the middle mass, which the absorber is on, moves at 60 degrees to the base
ACCELERATION, SECONDS = 3.0, 4.0


def read(folder: Path, base_vector: Any, **more: Any) -> ModalModel:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = load_structure(written(folder, "matrices", **MATRICES | {"damping_ratio": 0.1, "base_vector": base_vector} | more))
    assert isinstance(model, ModalModel)
    return model


def pushed(model: ModalModel, gap: float | None = None) -> tuple[float, float]:
    """Return where structure and absorber are, at the absorber's place, after seconds of a constant acceleration of the base."""
    load = Loads((Samples(np.array([0.0, SECONDS]), np.full(2, ACCELERATION), BASE),), float(model.omega[0]))
    scene = Scene(model, None if gap is None else impact_absorber(gap, 0.7, 0.0, 0.02))
    history = simulate(scene, load, record=Record(level=False, series=True)).history
    late = history.time[-1] if gap is not None else 0.0
    return float(history.tip_displacement[-1]), float(history.absorber_displacement[-1] / late**2) if gap is not None else 0.0


@pytest.mark.parametrize("form", ["list", "file", "units"])
def test_a_constant_acceleration_bends_as_a_weight_does(form: str, tmp_path: Path) -> None:
    mass, stiffness = chain(tmp_path)
    np.savetxt(tmp_path / "r.txt", SHARES)
    more = {}
    if form == "units":  # t, mm, s: N/mm and t are thousandths of N/m and kg
        np.savez(tmp_path / "t.npz", M=mass / 1e3, K=stiffness / 1e3)
        more = {"mass": "t.npz", "stiffness": "t.npz", "units": "t, mm, s"}
    model = read(tmp_path, "r.txt" if form == "file" else SHARES, **more)
    assert model.base_participation is not None
    assert np.sum(model.base_participation**2) == pytest.approx(np.array(SHARES) @ mass @ SHARES)  # all modes are kept
    assert model.base_at_absorber == 0.5
    sag = -ACCELERATION * np.linalg.solve(stiffness, mass @ SHARES)[1]
    assert pushed(model)[0] == pytest.approx(sag, rel=1e-6)


def test_a_free_absorber_stays_behind_by_its_share(tmp_path: Path) -> None:
    chain(tmp_path)
    assert pushed(read(tmp_path, SHARES), gap=100.0)[1] == pytest.approx(-0.5 * ACCELERATION / 2, rel=1e-9)


def test_shapes_that_are_turned_take_their_participation_along(tmp_path: Path) -> None:
    """Signs of modes are free: what a base does at the absorber is not."""
    mass, stiffness = chain(tmp_path)
    model = read(tmp_path, SHARES)
    assert model.base_participation is not None
    assert np.all(model.tip_shape >= 0)
    static = float(np.sum(model.base_participation * model.tip_shape / model.omega**2))
    assert static == pytest.approx(np.linalg.solve(stiffness, mass @ SHARES)[1])


BAD = {
    "short": ([1.0, 1.0], r"base_vector = '2 numbers' is not allowed: a list or a file with 3 finite numbers"),
    "no file": ("none.txt", r"base_vector = 'none\.txt' is not allowed: .*3 finite numbers"),
    "words": ("words.txt", r"base_vector = 'words\.txt' is not allowed"),
    "not finite": ("nan.txt", r"base_vector = .*nan.* is not allowed"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_vectors_are_refused(case: str, tmp_path: Path) -> None:
    chain(tmp_path)
    (tmp_path / "words.txt").write_text("one\ntwo\nthree\n")
    (tmp_path / "nan.txt").write_text("1\nnan\n1\n")
    given, message = BAD[case]
    with pytest.raises(ParameterError, match=message):
        read(tmp_path, given)


def test_places_that_a_base_moves_differently_are_refused(tmp_path: Path) -> None:
    chain(tmp_path)
    with pytest.raises(ParameterError, match=r"base_vector = \[0\.5, 1\.0\] is not allowed: the same displacement at all places"):
        read(tmp_path, SHARES, absorber=[1, 2])
