"""What figures and words of responses and curves show, by their data."""

from dataclasses import fields

import matplotlib as mpl
import numpy as np
import pytest

from impact_env import (
    Beam,
    Drive,
    Exact,
    PerformanceCurve,
    Response,
    beam_scene,
    constant_frequency,
    impact_absorber,
    impact_absorbers,
    linear_sweep,
)
from impact_env.ensemble import LaneLevels, draw_members
from impact_env.results import Envelope, History, ResponseLevel, html_table

SCENE = beam_scene(Beam(modes=2))
OMEGA = SCENE.model.resonance_omega(1)
CONSTANT = constant_frequency(OMEGA, 1.0, 4.0)


@pytest.fixture(autouse=True)
def _no_window() -> None:
    mpl.use("Agg")


def curve(level: np.ndarray) -> PerformanceCurve:
    """Return a curve with these levels (F, M, 2) in m, at 1, 2, ... N."""
    arrays = {
        field.name: level if field.name == "level" else np.zeros_like(level)
        for field in fields(LaneLevels)
        if field.name != "complete"
    }
    done = LaneLevels(**arrays, complete=not np.isnan(level).any())
    return PerformanceCurve(np.arange(1.0, len(level) + 1), draw_members(level.shape[1], 0), done)


def response(schedule: object, **recorded: object) -> Response:
    return Response(
        SCENE, Drive(2.0, schedule), Exact(), np.zeros(6), 1, 0.0, 10, 10, 0.0, **recorded
    )


def history(samples: int, end: float) -> History:
    """Return a motion of the first mode, cos(OMEGA t) / 1000."""
    time = np.linspace(0, end, samples)
    modal = np.zeros((samples, 2))
    modal[:, 0] = 1e-3 * np.cos(OMEGA * time)
    return History(
        time,
        modal,
        np.zeros((samples, 2)),
        np.zeros(samples),
        np.zeros(samples),
        SCENE.model.tip_shape,
    )


def test_a_curve_is_drawn_as_median_and_band_in_mm() -> None:
    level = (
        np.array([[[1.0, 2.0], [3.0, 1.0], [2.0, 4.0]], [[5.0, 5.0], [6.0, 7.0], [9.0, 8.0]]])
        * 1e-3
    )
    axes = curve(level).plot(label="one", color="tab:red")
    (line,) = axes.lines
    assert np.array_equal(line.get_xdata(), [1.0, 2.0])
    assert np.allclose(line.get_ydata(), [3.0, 7.0])  # the middle one of 2, 3, 4 and of 5, 7, 9
    (band,) = axes.collections
    corners = band.get_paths()[0].vertices
    assert np.allclose([corners[:, 1].min(), corners[:, 1].max()], [2.1, 8.8])
    assert axes.get_legend().get_texts()[0].get_text() == "one"
    assert curve(level).plot(axes) is axes
    assert len(axes.lines) == 2


def test_a_sweeps_envelope_is_drawn_over_the_frequency() -> None:
    schedule = linear_sweep(OMEGA, 0.9, 1.1, 10)
    motion = history(40_000, float(schedule.times[-1]))
    axes = response(schedule, history=motion, level=ResponseLevel(7e-4, 1.0, 1.01, 1e-3)).plot()
    (area,) = axes.collections
    corners = area.get_paths()[0].vertices
    assert len(corners) < 1500
    assert 0.9 <= corners[:, 0].min() < 0.901
    assert 1.099 < corners[:, 0].max() <= 1.1
    tip = 1e3 * 1e-3 * abs(SCENE.model.tip_shape[0])
    assert np.allclose([corners[:, 1].min(), corners[:, 1].max()], [-tip, tip], rtol=1e-3)
    (mark,) = axes.lines
    assert (float(mark.get_xdata()[0]), float(mark.get_ydata()[0])) == (1.01, 0.7)


def test_at_a_constant_frequency_it_is_drawn_over_time() -> None:
    envelope = Envelope(np.array([0.0, 0.5, 1.0]), np.array([-2e-3, -1e-3]), np.array([1e-3, 3e-3]))
    axes = response(CONSTANT, envelope=envelope).plot()
    corners = axes.collections[0].get_paths()[0].vertices
    assert {0.25, 0.75} == set(corners[:, 0])
    assert [corners[:, 1].min(), corners[:, 1].max()] == [-2.0, 3.0]
    assert axes.get_xlabel() == "time in s"


def test_responses_and_scenes_print_in_a_line_or_two() -> None:
    assert repr(SCENE) == "Scene(2 modes, no absorber)"
    summarised = response(CONSTANT, level=ResponseLevel(7e-4, 1.0, 1.01, 1e-3))
    text = " ".join(repr(summarised).split())
    assert text == (
        "Response(2 modes, no absorber 2 N from 0 to 0.09961 s, level 0.7 mm at 1.0100 of the "
        "resonance, 1 impact)"
    )
    assert "0.7 mm at 1.0100 of the resonance" in summarised._repr_html_()
    assert "&lt;script&gt;" in html_table("a", [("b", "<script>")])
    words = {
        impact_absorber(
            0.5e-3, 0.7, 0.1
        ): "impact absorber, mass ratio 0.02, gap 0.5 mm, restitution 0.7, friction limit 0.1 N",
        impact_absorbers(
            [1e-3, 2e-3], [0.5, 1.0]
        ): "at 0.5 of the length impact absorber, mass ratio 0.01, gap 1 mm",
    }
    for absorber, expected in words.items():
        assert expected in repr(beam_scene(Beam(modes=1), absorber))
