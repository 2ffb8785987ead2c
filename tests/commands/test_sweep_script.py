"""The command sweep keeps its JSON format, and prints and draws its results.

Scenes from files are the same as those from options.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import SHORT, done
from commands import sweep as call
from drawing import line, saved_figures

from impact_env import Drive, Record, impact_absorber, simulate
from impact_env.drive import PAPER_LIMITS
from impact_env.ensemble import draw_members
from impact_env.methods import Exact, Moreau, RungeKutta
from impact_env.modes import modal_model
from impact_env.parameters import Beam, StuckAbsorber
from impact_env.plain import from_scene
from impact_env.scene import Scene, beam_scene
from optimisation.calibration.posterior import Posterior
from optimisation.cli import scene_options, sweep
from optimisation.cli.options import make_options
from optimisation.files import write_json

STRONG = [*SHORT[:-1], 40, "--force", 20]  # 5 pseudo periods
CONSTANT = ["--modes", "2", "--from", "1", "--to", "1"]
KEYS = {
    "impact_time_s": list,
    "impact_relative_velocity_m_s": list,
    "response_level_m": list,
    "level_frequency_ratio": list,
    "max_tip_m": float,
    "impacts": int,
    "stuck_time_s": float,
    "energy_balance_relative_error": float,
    "pseudo_periods": float,
    "start": str,
    "sweep_over_stationary_level": float,
    "wall_s": float,
    "omega_rad_s": list,
    "scene": dict,
}


def results(folder: Path, *arguments: str) -> dict[str, Any]:
    target = folder / "sweep.json"
    done(sweep, *arguments, "--json", target)
    return json.loads(target.read_text())


def options(*arguments: str) -> sweep.SweepOptions:
    with sweep.main.make_context("sweep", list(arguments)) as context:
        return make_options(sweep.SweepOptions, context.params)


@pytest.mark.parametrize(
    "arguments",
    [
        ["--absorber", "impact"],
        ["--absorber", "impact", "--restitution", "0.7", "--friction-limit", "0.1"],
        ["--absorber", "friction"],
        ["--absorber", "tuned"],
        ["--absorber", "impact", "--contact-stiffness", "1e6"],
        [
            "--absorber",
            "impact",
            "--friction-limit",
            "0.1",
            "--method",
            "moreau",
            "--steps-per-period",
            "40",
        ],
        ["--absorber", "impact", "--contact-stiffness", "1e6", "--method", "runge-kutta"],
    ],
    ids=" ".join,
)
def test_json_keeps_the_contract(arguments: list[str], tmp_path: Path) -> None:
    values = results(tmp_path, *STRONG, *arguments, "--energy")
    assert set(values) == set(KEYS) - {"wall_s"}
    assert all(isinstance(value, KEYS[key]) for key, value in values.items())
    assert all(
        math.isfinite(x)
        for key, value in values.items()
        if key not in ("scene", "start")
        for x in (value if KEYS[key] is list else [value])
    )
    assert (
        len(values["impact_time_s"])
        == len(values["impact_relative_velocity_m_s"])
        == values["impacts"]
    )
    assert len(values["response_level_m"]) == len(values["level_frequency_ratio"]) == 1
    assert len(values["omega_rad_s"]) == 2
    assert (values["impacts"] > 0) == ("impact" in arguments)
    assert values["pseudo_periods"] == pytest.approx(5)
    assert 0 < values["response_level_m"][0] < values["max_tip_m"]
    assert 0.98 <= values["level_frequency_ratio"][0] <= 1
    assert values["energy_balance_relative_error"] < (1e-9 if "--method" not in arguments else 0.1)
    assert list(tmp_path.iterdir()) == [tmp_path / "sweep.json"]


def test_frequencies_are_in_units_of_the_chosen_resonance_and_the_wall_time_is_that_of_a_bare_integration(
    tmp_path: Path,
) -> None:
    values = results(
        tmp_path, *CONSTANT, "--resonance", "2", "--periods", "10", "--absorber", "stuck", "--time"
    )
    assert set(values) == set(KEYS) - {"energy_balance_relative_error"}
    assert values["wall_s"] > 0
    assert values["stuck_time_s"] == pytest.approx(10 * 2 * math.pi / values["omega_rad_s"][1])


def test_too_fast_a_sweep_is_reported_and_nothing_where_nothing_is_swept() -> None:
    assert (
        "sweep over stationary"
        not in call(*CONSTANT, "--periods", "5", "--absorber", "none").output
    )
    assert "too fast for shares" in call(*SHORT, "--absorber", "none").output
    undamped = call(
        *SHORT, "--absorber", "none", "--damping", "0"
    )  # its stationary level has no end
    assert "0.000   without absorber, at 10 % per 100 pseudo periods: too fast" in undamped.output


def test_a_sweep_starts_from_the_chosen_state(tmp_path: Path) -> None:
    """A sweep starts from the chosen state.

    At a high resonance, below it, the level of a sweep from rest is that of its start, and a
    warning says so. From the steady state there is no warning.
    """
    arguments = ("--resonance", 4, "--from", 0.9, "--to", 0.95, "--force", 1, "--modes", 5)
    out = done(sweep, "--absorber", "none", *arguments, "--phase", 1.57).stdout
    assert "from rest" in out
    assert "Warning: the level was read at the start of the sweep" in out
    file = tmp_path / "a.json"
    steady = ("--start", "steady", "--members", 2, "--json", file)
    out = done(sweep, "--absorber", "none", *arguments, *steady).stdout
    assert "from the steady state" in out
    assert "at the start" not in out
    content = json.loads(file.read_text())
    assert content["start"] == "steady state"
    model = modal_model(Beam(modes=5))
    omega = 0.95 * model.omega[3]
    terms = model.omega**2 - omega**2 + 2j * model.damping_ratio * model.omega * omega
    level = abs(np.sum(model.tip_shape * model.force_shape / terms)) / np.sqrt(2)
    assert content["response_level_m"] == pytest.approx([level] * 2, rel=0.02)


def test_where_nothing_is_steady_is_refused() -> None:
    result = call("--load", "shock:40:0.0125:2", "--start", "steady")
    assert result.exit_code != 0
    assert "no steady state" in result.stderr


def test_members_are_reproducible_from_the_seed(tmp_path: Path) -> None:
    several = [*SHORT, "--absorber", "none", "--members", "5"]
    alone = results(tmp_path, *SHORT, "--absorber", "none")
    first = results(tmp_path, *several)
    again = results(tmp_path, *several)
    other = results(tmp_path, *several, "--seed", "1")
    assert first == again
    assert len(set(first["response_level_m"])) == len(first["level_frequency_ratio"]) == 5
    assert (
        first["response_level_m"][0] == alone["response_level_m"][0] == other["response_level_m"][0]
    )
    assert first["response_level_m"][1:] != other["response_level_m"][1:]
    assert first["max_tip_m"] == alone["max_tip_m"]


def test_a_dash_is_standard_output_and_all_else_goes_to_standard_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    alone = call(*SHORT, "--absorber", "none", "--json", "-")
    refused = call("--gap", "-1", "--json", "-")
    assert json.loads(alone.stdout) == results(tmp_path, *SHORT, "--absorber", "none")
    assert "response level" in alone.stderr
    assert (refused.exit_code, refused.stdout) == (2, "")
    assert [file.name for file in tmp_path.iterdir()] == ["sweep.json"]


def test_an_abandoned_run_leaves_no_file(tmp_path: Path) -> None:
    result = call(*STRONG, "--most-events", "9", "--json", str(tmp_path / "sweep.json"))
    assert result.exit_code == 1
    assert "more events than its budget" in result.output
    assert "10 events of 9 allowed" in result.output
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    [
        ["--plot", "a.png", *SHORT],
        ["--plot", "a.svg", *CONSTANT, "--periods", "0.02", "--force", "0"],
    ],
)
def test_plot_is_written(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    target = tmp_path / arguments[1]
    target.write_text("an older figure")
    drawn = saved_figures(monkeypatch)
    done(sweep, "--absorber", "none", *arguments)
    (figure,) = drawn
    parsed = options("--absorber", "none", *map(str, arguments[2:]))
    force = sweep.FORCE if parsed.force is None else parsed.force
    scene = scene_options.make_scene(parsed).scene
    limits = (parsed.start, parsed.stop)
    run = simulate(
        scene,
        Drive(force, sweep.make_schedule(parsed, scene, limits)),
        record=Record(series=True),
    )
    time = run.recorded.history.time
    x, y = line(figure.axes[0], "tip")
    np.testing.assert_allclose(
        y, 1e3 * run.recorded.history.tip_displacement, rtol=1e-9, atol=1e-12
    )
    schedule = run.drive.schedule
    if schedule.omegas[0] == schedule.omegas[1]:
        np.testing.assert_allclose(x, time / schedule.pseudo_period, rtol=1e-9)
    else:
        np.testing.assert_allclose(x, schedule.omega_at(time) / schedule.reference, rtol=1e-9)
    assert target.read_bytes()[:5] == (b"\x89PNG\r" if target.suffix == ".png" else b"<?xml")
    assert list(tmp_path.iterdir()) == [target]


def test_scene_from_a_file_is_the_scene_of_the_options(tmp_path: Path) -> None:
    options_alone = results(tmp_path, *SHORT, "--absorber", "stuck", "--mass-ratio", "0.03")
    assert options_alone["scene"] == from_scene(
        beam_scene(Beam(modes=2), StuckAbsorber(0.03)), Beam(modes=2)
    )
    as_toml = tmp_path / "a.toml"
    as_json = tmp_path / "a.json"
    modes = tmp_path / "modes.json"
    as_toml.write_text('[beam]\nmodes = 2\n[absorber]\nkind = "stuck"\nmass_ratio = 0.03\n')
    as_json.write_text(json.dumps(options_alone["scene"]))
    modes.write_text(json.dumps(from_scene(beam_scene(Beam(modes=2), StuckAbsorber(0.03)))))
    for file in (as_toml, as_json):
        assert results(tmp_path, "--scene", str(file), *SHORT[2:]) == options_alone
    of_modes = results(tmp_path, "--scene", str(modes), *SHORT[2:])
    assert of_modes.pop("scene") == json.loads(modes.read_text())
    assert of_modes == {key: value for key, value in options_alone.items() if key != "scene"}


def test_defaults_are_the_papers() -> None:
    parsed = options()
    scene, beam, force = scene_options.make_scene(parsed)
    assert beam == Beam()
    assert force is None
    schedule = sweep.make_schedule(parsed, scene, (parsed.start, parsed.stop))
    assert scene.model.modes == Beam.modes
    assert set(scene.model.damping_ratio) == {Beam.damping_ratio}
    assert tuple(schedule.omegas / schedule.reference) == pytest.approx(PAPER_LIMITS)
    assert schedule.periods == pytest.approx(1600)
    assert scene_options.make_method(parsed.method, parsed.steps_per_period) == Exact()
    assert scene_options.make_method("moreau", None) == Moreau()
    stepping = options("--method", "runge-kutta", "--steps-per-period", "50")
    assert scene_options.make_method(stepping.method, stepping.steps_per_period) == RungeKutta(50)


def test_members_have_the_parameters_of_a_posterior(tmp_path: Path) -> None:
    """Members have parameters drawn from a posterior.

    Levels are those of scenes with the drawn values. If all draws are equal, the band is a line
    through these levels.
    """
    draws = np.tile([1.5e-3, 0.4], (60, 1))
    write_json(tmp_path / "p.json", Posterior(("gap", "restitution"), draws).to_plain())
    arguments = [*SHORT[:-1], "20", "--gap", "1e-3", "--restitution", "0.7", "--uncertain"]
    target = tmp_path / "sweep.json"
    text = done(sweep, *arguments, tmp_path / "p.json", "--members", 3, "--json", target).output
    answer = json.loads(target.read_text())
    chosen = options(*map(str, SHORT[:-1]), "20")
    schedule = sweep.make_schedule(
        chosen, Scene(modal_model(Beam(modes=chosen.modes or 10))), (chosen.start, chosen.stop)
    )
    drives = draw_members(3, 0).drives(sweep.FORCE, schedule)
    expected = []
    for drive, absorber in zip(drives, [(1e-3, 0.7), (1.5e-3, 0.4), (1.5e-3, 0.4)], strict=True):
        scene = beam_scene(Beam(modes=chosen.modes or 10), impact_absorber(*absorber))
        expected.append(simulate(scene, drive).level.value)
    assert answer["response_level_m"] == pytest.approx(expected, rel=1e-9)
    assert "median of 2 draws of the posterior" in text
    low, median, high = (np.array(answer["band"][f"level_{share}_m"]) for share in (5, 50, 95))
    assert np.all(low <= median)
    assert np.all(median <= high)
    assert np.max(high) == pytest.approx(max(expected[1:]), rel=0.02)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--members", "1"], "--uncertain needs --members above 1"),
        (["--method", "moreau"], "--uncertain does not go with --method moreau"),
        (["--measures"], "--uncertain does not go with --measures"),
        (["--absorber", "tuned"], "one impact absorber, between walls"),
        (["--uncertain", "gap=5%"], "--uncertain gap is not allowed: the posterior.json"),
    ],
)
def test_what_does_not_go_with_a_posterior_is_one_message(
    more: list[str], words: str, tmp_path: Path
) -> None:
    write_json(tmp_path / "p.json", Posterior(("gap",), np.full((60, 1), 1e-3)).to_plain())
    result = call(*SHORT, "--uncertain", str(tmp_path / "p.json"), *more)
    assert result.exit_code == 2
    assert words in result.output
