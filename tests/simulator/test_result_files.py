"""Results in files come back with every bit, and what is no such file is refused."""

import json
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from core import EVERYTHING
from load_cases import cantilever

from impact_env import (
    Beam,
    Drive,
    Exact,
    ParameterError,
    PerformanceCurve,
    Record,
    Response,
    Scene,
    beam_scene,
    constant_frequency,
    impact_absorber,
    simulate,
)
from impact_env.curve import CurveCase, performance_curves
from impact_env.ensemble import LaneLevels, Members
from impact_env.loads import Loads, ShakenBase, Tone, Tones
from impact_env.results import Envelope

EVERYTHING_BUT_SERIES = replace(EVERYTHING, series=False)


def require_equal(first: Any, second: Any) -> None:
    """Compare two values part by part, arrays bit by bit."""
    assert type(first) is type(second)
    if is_dataclass(first):
        for field in fields(first):
            require_equal(getattr(first, field.name), getattr(second, field.name))
    elif isinstance(first, np.ndarray):
        assert first.dtype == second.dtype
        assert first.shape == second.shape
        assert first.tobytes() == second.tobytes()
    elif isinstance(first, tuple):
        assert len(first) == len(second)
        for part, other in zip(first, second, strict=True):
            require_equal(part, other)
    else:
        assert first == second


def forced() -> Response:
    scene = beam_scene(
        Beam(modes=2, modal_frequency_ratio={2: 5.5}), impact_absorber(1e-4, 0.7, 0.1)
    )
    drive = Drive(8.0, constant_frequency(scene.model.resonance_omega(1), 1.0, 3.0), 0.3)
    return simulate(scene, drive, Exact(), record=EVERYTHING)


def shaken() -> Response:
    model = cantilever()
    schedule = constant_frequency(model.resonance_omega(1), 1.0, 3.0)
    tones = Tones((Tone(0.1, order=1.0), Tone(0.05, order=2.0)), schedule=schedule)
    return simulate(Scene(model), Loads((ShakenBase(schedule, acceleration=0.5), tones)))


@pytest.mark.parametrize("ending", ["json", "npz"])
@pytest.mark.parametrize("run", [forced, shaken])
def test_a_response_comes_back_with_every_bit(run: Any, ending: str, tmp_path: Path) -> None:
    response = run()
    file = tmp_path / f"run.{ending}"
    response.save(file)
    loaded = Response.load(file)
    require_equal(loaded, response)
    again = simulate(loaded.scene, loaded.drive, loaded.method, record=Record())
    assert again.level == response.level
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


@pytest.mark.parametrize("ending", ["json", "npz"])
def test_a_curve_and_its_parts_come_back_with_every_bit(ending: str, tmp_path: Path) -> None:
    scene = beam_scene(Beam(modes=2))
    case = CurveCase(scene, np.array([1.0, 2.0]), 1, (0.98, 1.0), 100.0)
    (curve,) = performance_curves([case], members=2, threads=1)
    for part, kind in (
        (curve, PerformanceCurve),
        (curve.lanes, LaneLevels),
        (curve.members, Members),
    ):
        file = tmp_path / f"part.{ending}"
        part.save(file)
        require_equal(kind.load(file), part)
    with pytest.raises(ParameterError, match="a file of a PerformanceCurve"):
        PerformanceCurve.load(file)


def test_missing_levels_stay_missing(tmp_path: Path) -> None:
    levels = LaneLevels(*np.full((6, 3), np.nan), complete=False)
    levels.save(tmp_path / "levels.json")
    require_equal(LaneLevels.load(tmp_path / "levels.json"), levels)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("other.txt", "", r"path = .* is not allowed: a name in \.json or \.npz"),
        ("none.json", None, "there is no such file"),
        ("broken.json", "{", "a file of a Response"),
        ("broken.npz", "no archive", "a file of a Response"),
        ("list.json", "[1, 2]", "a file of a Response"),
        ("class.json", json.dumps({"class": "os.system", "fields": {}}), "class = 'os.system'"),
        ("half.json", json.dumps({"class": "Response", "fields": {}}), "a file of a Response"),
    ],
)
def test_what_is_no_file_of_a_result_is_refused(
    name: str, content: str | None, message: str, tmp_path: Path
) -> None:
    file = tmp_path / name
    if content is not None:
        file.write_text(content)
    with pytest.raises(ParameterError, match=message):
        Response.load(file)


def test_nothing_is_written_under_a_name_that_is_refused(tmp_path: Path) -> None:
    levels = LaneLevels(*np.zeros((6, 1)), complete=True)
    with pytest.raises(ParameterError, match=r"path = .*\.csv"):
        levels.save(tmp_path / "levels.csv")
    assert not list(tmp_path.iterdir())


def test_tables_of_a_run_have_its_numbers() -> None:
    pandas = pytest.importorskip("pandas")
    response = forced()
    frame = response.to_dataframe()
    assert isinstance(frame, pandas.DataFrame)
    assert list(frame) == [
        "time_s",
        "tip_displacement_m",
        "tip_velocity_m_s",
        "absorber_displacement_m",
        "absorber_velocity_m_s",
    ]
    assert np.array_equal(frame["tip_displacement_m"], response.history.tip_displacement)
    impacts = response.impacts.to_dataframe()
    assert len(impacts) == response.impact_count
    assert np.array_equal(impacts["impulse_n_s"], response.impacts.impulse)
    envelope = Envelope(np.arange(3.0), np.array([-1.0, -2.0]), np.array([1.0, 2.0])).to_dataframe()
    assert np.array_equal(envelope["end_s"][:-1], envelope["start_s"][1:])
    assert response.phases.to_dataframe()["kind"].isin([0, 1, 2]).all()


def test_a_table_of_what_was_not_recorded_is_refused_by_name() -> None:
    scene = beam_scene(Beam(modes=2), impact_absorber(1e-4, 0.7, 0.1))
    drive = Drive(8.0, constant_frequency(scene.model.resonance_omega(1), 1.0, 1.0))
    with pytest.raises(ParameterError, match=r"history = None .*series=True"):
        simulate(scene, drive, record=EVERYTHING_BUT_SERIES).to_columns()


def test_a_table_of_a_curve_has_a_row_for_each_run() -> None:
    level = np.arange(12.0).reshape(2, 3, 2)
    lanes = LaneLevels(level, 10 * level, level + 0.5, 2 * level, 3 * level, level / 2, True)
    members = Members([0.0, 1.0, 2.0], [1.0, 1.0, 1.0])
    curve = PerformanceCurve(np.array([1.0, 4.0]), members, lanes)
    columns = curve.to_columns()
    rows = list(zip(*columns.values(), strict=True))
    assert len(rows) == 12
    force, member, direction, value, ratio, largest, impacts, stuck = rows[9]
    assert (force, member, direction) == (4.0, 1, "down")
    assert value == level[1, 1, 1]
    assert (ratio, largest, impacts, stuck) == (value + 0.5, 2 * value, 3 * value, value / 2)


def test_a_result_as_a_dictionary_has_plain_values() -> None:
    plain = forced().to_dict()
    assert plain["scene"]["absorber"]["walls"] == {"gap": 1e-4, "restitution": 0.7}
    assert plain["level"]["value"] > 0
    json.dumps(plain)  # nothing in it that JSON does not know
