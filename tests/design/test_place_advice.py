"""Advice on place, mass and gap is correct.

The map of the linear structure, the search over places and the command's files are tested.
"""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import call, done, load
from core import STEEL
from design_studies import search_swept
from places import EXAMPLES

from impact_env import Beam, Drive, ModalModel, Scene, load_structure, modal_model, simulate
from impact_env.checks import ParameterError
from impact_env.drive import linear_sweep
from impact_env.ensemble import draw_members
from impact_env.frequency import find_steady_start
from impact_env.level import response_level
from impact_env.modes import mode_shapes
from impact_env.plain import to_scene
from impact_env.plain_files import read_plain
from optimisation.bounds import design_gap, reach, resonance_limit
from optimisation.contact import YieldLimit
from optimisation.frequency_levels import find_worst_run
from optimisation.gap_advice import Limits
from optimisation.measures import Prediction
from optimisation.mounting import model_with_absorber_at
from optimisation.place_advice import (
    LIGHTEST,
    SURE,
    PlacedDevice,
    advise_place,
    probability_lower,
    recommend,
)
from optimisation.place_map import expected_gap_and_share, find_places, map_places, shortlist
from optimisation.report.place_report import place_with
from optimisation.sweep_range import stationary_level
from studies.cli import check_places

SMALL = Beam(modes=2)
FAST = {"percent_per_100_periods": 40.0, "threads": 1}


def test_the_map_is_that_of_each_place_alone() -> None:
    """The map of places agrees with each place alone.

    The map computes all places at once. The design rule, its reach and the limit use one model for
    each place, other equations and a refined grid.
    """
    places = find_places(replace(STEEL, modes=6, response_position=0.9))
    forces = {1: 2.0, 3: 5.0}
    place_map = map_places(places, forces, 0.03)
    mass = 0.03 * places.model.beam_mass
    for k in (3, 17, 25, 39):
        model = places.model_at(k)
        for row, (resonance, force) in enumerate(forces.items()):
            rule = design_gap(model, mass, force, resonance)
            assert place_map.rule[row, k] == pytest.approx(rule, rel=1e-3)
            assert place_map.reach[row, k] == pytest.approx(reach(model, mass, resonance), rel=1e-3)
    single = map_places(places, {1: 2.0}, 0.03)
    for k in (25, 39):
        gap = float(single.gap[k])
        limit = resonance_limit(
            places.model_at(k), mass, gap, 2.0, 1, 0.9, at=places.model.level_shape
        )
        without = 2.0 * stationary_level(places.model, 1, (0.9, 1.06))
        assert single.limit[k] == pytest.approx(float(limit) / without, abs=2e-3)


def test_reach_of_one_mode_by_hand() -> None:
    """The reach of one mode agrees with its formula.

    The receptances of one mode are one fraction: kappa = m Omega^2 phi^2/(omega^2 - Omega^2 + 2 i D
    omega Omega), G_f in proportion.
    """
    omega = 100.0
    damping = 0.01
    shape = 1.5
    force_shape = 0.6
    mass = 0.02
    model = ModalModel(
        np.array([omega]), np.array([damping]), np.array([force_shape]), np.array([shape]), 1.0
    )
    place_map = map_places(find_places(model), {1: 3.0}, mass)
    stuck = 1 / math.sqrt(1 + mass * shape**2)
    shift_of_usual = 1 - 1 / math.sqrt(1 + 0.02 * shape**2)
    low = 1 - 0.07 * (1 - stuck) / shift_of_usual
    # |G_f|/|kappa| = phi_f/(m Omega^2 phi), the largest at the lower end
    rule = 3.0 * force_shape / (mass * (low * omega) ** 2 * shape) * math.pi / 4
    ratio = np.linspace(0.99, 1.01, 20001)
    free = 3.0 * np.max(
        shape * force_shape / omega**2 / np.abs(1 - ratio**2 + 2j * damping * ratio)
    )
    assert place_map.rule[0, 0] == pytest.approx(rule, rel=1e-6)
    assert place_map.reach[0, 0] == pytest.approx(free / rule, rel=1e-4)


def test_one_gap_for_two_resonances_lies_between_theirs() -> None:
    """One gap for two resonances lies between their own gaps.

    If both have the same best gap, the level is the higher of both. Otherwise the gap is a
    compromise, and the level is higher.
    """
    reaches = np.array([[4.0, 4.0], [2.0, 2.0]])
    rule = np.array([[1e-3, 1e-3], [1.22e-3, 4e-3]])
    gap, share = expected_gap_and_share(rule, reaches)
    single = [expected_gap_and_share(rule[k : k + 1], reaches[k : k + 1]) for k in (0, 1)]
    assert single[0][0][0] == pytest.approx(single[1][0][0], rel=0.02)
    assert gap[0] == pytest.approx(single[0][0][0], rel=0.1)
    assert share[0] == pytest.approx(max(single[0][1][0], single[1][1][0]), rel=0.1)
    assert single[0][0][1] < gap[1] < single[1][0][1]
    assert share[1] > 1.2 * share[0]


def test_places_of_a_beam_leave_out_what_is_held() -> None:
    assert find_places(Beam()).names[0] == "0.025"
    assert find_places(Beam()).names[-1] == "1"
    both = find_places(Beam(ends="pinned-pinned", absorber_position=0.4))
    assert (both.names[0], both.names[-1]) == ("0.025", "0.975")
    shapes = mode_shapes(both.structure, [float(name) for name in both.names])  # type: ignore[arg-type]
    assert np.array_equal(both.shapes, shapes)
    assert both.structure.response_position == 0.4  # type: ignore[union-attr]
    own = both.subset([0.3, 0.31])
    assert own.names == ("0.3", "0.31")
    assert own.model_at(1).tip_shape == pytest.approx(
        modal_model(replace(both.structure, absorber_position=0.31)).tip_shape  # type: ignore[type-var]
    )


@pytest.mark.parametrize(("name", "own"), [("frame", "138"), ("measured", "5")])
def test_places_of_a_file_are_its_nodes_in_the_direction_of_the_one_it_lists(
    name: str, own: str
) -> None:
    """Places of a file are its nodes, in the direction of the listed absorber.

    Each mode has the same sign at all places, such that the listed absorber moves up. The listed
    place has the shape of the structure in the file.
    """
    file = EXAMPLES / f"{name}.toml"
    structure = load_structure(file)
    assert isinstance(structure, ModalModel)
    places = find_places(structure, file)
    k = places.names.index(own)
    assert np.array_equal(places.shapes[k], structure.tip_shape)
    response = {"frame": "20", "measured": "6"}[name]
    assert np.allclose(places.shapes[places.names.index(response)], structure.level_shape)
    assert places.model_at(k).level_shape == pytest.approx(structure.level_shape)
    if name == "frame":
        assert places.points is not None
        assert places.points[k] == pytest.approx([0.6, 0.4, 0.0])
        assert len(places) == 213  # half of the rows, those across
        assert len({tuple(point) for point in places.points.tolist()}) == 213
        side = places.names.index("8")  # where the force acts, across too
        assert np.allclose(places.shapes[side], structure.force_shape)
        assert place_with(places, structure.force_shape) == side
        assert place_with(places, structure.level_shape) == places.names.index("20")
        assert place_with(places, 1.01 * structure.force_shape) is None


def test_places_of_a_model_are_those_that_it_lists() -> None:
    model = modal_model(SMALL)
    several = replace(model, absorber_shapes=np.array([model.tip_shape, 0.5 * model.tip_shape]))
    places = find_places(several)
    assert (places.names, places.kind) == (("1", "2"), "place")
    assert np.array_equal(places.model_at(1).tip_shape, 0.5 * model.tip_shape)
    assert np.array_equal(places.model_at(1).level_shape, model.tip_shape)
    with pytest.raises(ParameterError, match="position = 3 is not allowed: a place of the str"):
        places.subset([3])


def test_places_to_simulate_differ() -> None:
    """Thousands of nodes beside each other are one place."""
    model = modal_model(SMALL)
    near = 1 - 1e-3 * np.arange(100)
    shapes = np.vstack([near[:, None] * model.tip_shape, 0.7 * model.tip_shape])
    places = find_places(replace(model, absorber_shapes=shapes))
    chosen = shortlist(places, map_places(places, {1: 3.5}, 0.02), 4)
    assert chosen[0] == 0
    assert np.all(np.diff(places.shapes[chosen, 0]) < -0.04 * places.shapes[0, 0])


def test_for_one_resonance_the_gap_is_that_of_the_gap_search() -> None:
    places = find_places(SMALL).subset([1.0])
    advice = advise_place(places, {1: 3.5}, mass_ratios=[0.02], members=2, **FAST)  # type: ignore[arg-type]
    best = advice.recommended
    assert best is not None
    alone = search_swept(model_with_absorber_at(SMALL, 1.0), 3.5, rate=40.0, members=2, threads=1)
    assert alone.recommended is not None
    assert best.absorber == alone.recommended.absorber
    (part,) = best.parts
    assert part.level == alone.recommended.level
    assert part.worst == pytest.approx(alone.recommended.worst, rel=1e-12)
    assert part.prediction is not None
    assert part.prediction.interval() == pytest.approx(
        (alone.recommended.low, alone.recommended.high)
    )
    assert best.share == pytest.approx(part.level / float(alone.check.without.median[0]))


def test_levels_of_two_resonances_are_those_of_runs_by_hand() -> None:
    """Levels of two resonances are those of separate runs.

    The level is the largest of sweeps up and down near each resonance, from the steady state, for
    each member. It is relative to that without absorber.
    """
    places = find_places(SMALL).subset([0.9, 1.0])
    forces = {1: 3.5, 2: 35.0}
    advice = advise_place(places, forces, mass_ratios=[0.03], members=2, **FAST)  # type: ignore[arg-type]
    best = advice.recommended
    assert best is not None
    model = places.model_at(best.place)
    members = draw_members(2, 0)

    def level(absorber: object, resonance: int, member: int) -> float:
        low, high = advice.study.ranges[resonance]
        omega = model.resonance_omega(resonance)
        levels = []
        for start, stop in ((low, high), (high, low)):
            drive = Drive(
                forces[resonance] * float(members.factors[member]),
                linear_sweep(omega, start, stop, 40.0),
                float(members.phases[member]),
            )
            scene = Scene(model, absorber)  # type: ignore[arg-type]
            run = simulate(scene, drive, initial=find_steady_start(scene, drive))
            assert run.level is not None
            levels.append(run.level.value)
        return max(levels)

    shares = []
    for member in range(2):
        own = [level(best.absorber, r, member) / level(None, r, 0) for r in forces]
        shares.append(max(own))
    assert best.share == pytest.approx(float(np.median(shares)), rel=1e-9)
    assert best.members == 2
    assert advice.sweeps == 2 * 2 * (1 + 2 * 3) + sum(one.sweeps for one in advice.devices)


def test_a_limit_of_the_stroke_cuts_the_gaps() -> None:
    places = find_places(SMALL).subset([1.0])
    free = advise_place(places, {1: 3.5}, mass_ratios=[0.02], members=1, **FAST)  # type: ignore[arg-type]
    assert free.recommended is not None
    most = 0.8 * free.recommended.gap
    advice = advise_place(
        places,
        {1: 3.5},
        mass_ratios=[0.02],
        members=1,
        limits=Limits(stroke=most),
        **FAST,  # type: ignore[arg-type]
    )
    assert advice.recommended is not None
    assert all(trial.gap <= most * (1 + 1e-12) for trial in advice.trials)
    assert 0.4 * most < advice.recommended.gap <= most * (1 + 1e-12)


def test_a_yield_stress_limits_the_impact_speed_at_each_place() -> None:
    """A yield stress limits the impact speed at each place.

    At the limit, Hertz' closed form gives 1.6 times the yield stress, for the mobility of the
    place.
    """
    stress = 12e6
    limit = YieldLimit(("steel", "pom"), 0.05, stress)
    advice = advise_place(
        SMALL,
        {1: 3.5},
        mass_ratios=[0.02],
        trial_places=2,
        members=1,
        yield_limit=limit,
        **FAST,  # type: ignore[arg-type]
    )
    best = advice.recommended
    assert best is not None
    model = advice.places.model_at(best.place)
    mass = 1 / (1 / (0.02 * model.beam_mass) + np.sum(model.tip_shape**2))
    stiff = 1 / ((1 - 0.3**2) / 210e9 + (1 - 0.37**2) / 2.8e9)
    # p = 3 F/(2 pi a^2), a^2 = R depth, F = 4/3 E* sqrt(R) depth^1.5, and the kinetic energy is
    # 8/15 E* sqrt(R) depth^2.5
    depth = (1.6 * stress * np.pi / (2 * stiff)) ** 2 * 0.05
    speed = np.sqrt(2 * 8 / 15 * stiff * np.sqrt(0.05) * depth**2.5 / mass)
    assert advice.study.speed_limit(model, 0.02) == pytest.approx(speed, rel=1e-3)
    free = advise_place(
        SMALL,
        {1: 3.5},
        mass_ratios=[0.02],
        trial_places=2,
        members=1,
        limits=Limits(impact_speed=100.0),
        **FAST,  # type: ignore[arg-type]
    ).recommended
    assert free is not None
    assert free.impact_speed is not None
    assert free.impact_speed > speed  # the limit is one here
    assert best.impact_speed is not None
    assert best.impact_speed < free.impact_speed
    assert advice.keeps_speed(best) == (best.impact_speed <= advice.study.speed_limit(model, 0.02))


def test_probability_that_one_design_is_lower() -> None:
    generator = np.random.default_rng(0)
    first = Prediction(0.0, 0.1, 6)
    second = Prediction(0.12, 0.2, 4)
    draws = [
        one.centre + one.scale * generator.standard_t(one.freedoms, 200_000)
        for one in (first, second)
    ]
    assert probability_lower(first, second) == pytest.approx(
        float(np.mean(draws[0] < draws[1])), abs=5e-3
    )
    assert probability_lower(first, first) == pytest.approx(0.5, abs=1e-3)
    sure = Prediction(0.0, 0.0, 3)
    assert probability_lower(sure, replace(sure, centre=0.1)) == 1.0
    assert probability_lower(second, sure) + probability_lower(sure, second) == pytest.approx(
        1.0, abs=5e-3
    )


def placed(mass: float, worst: float, chance: float = 0.0) -> PlacedDevice:
    """A device with a mass, its level, and its chance to stay below any limit."""

    class Sure(PlacedDevice):
        def probability_below(self, limit: float) -> float:  # noqa: ARG002
            return chance

    return Sure(0, "1", mass, None, worst, worst, None, (), 1, (0.0, 0.0), 0, {})  # type: ignore[arg-type]


def test_the_lightest_device_that_will_do_is_recommended() -> None:
    devices = [placed(0.01, 0.4, 0.5), placed(0.02, 0.21, 0.96), placed(0.05, 0.2, 0.99)]
    assert recommend(devices, None) is devices[1]
    assert 0.21 <= LIGHTEST * 0.2 < 0.4
    assert recommend(devices, 1e-3) is devices[1]
    assert SURE == 0.95
    none = [placed(0.01, 0.4, 0.5), placed(0.05, 0.2, 0.7)]
    assert recommend(none, 1e-3) is none[1]
    assert recommend([placed(0.01, 0.4, math.nan), placed(0.02, 0.3, math.nan)], 1e-3) is not None
    assert recommend([], None) is None


def test_what_no_place_can_do_is_refused() -> None:
    model = modal_model(SMALL)
    still = replace(model, absorber_shapes=np.zeros((2, 2)))
    with pytest.raises(ParameterError, match="0 near resonance 1"):
        advise_place(still, {1: 3.5}, **FAST)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="force = '1e-09 N near resonance 1"):
        advise_place(SMALL, {1: 1e-9}, **FAST)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="resonance = 3 is not allowed: a mode"):
        advise_place(SMALL, {3: 1.0}, **FAST)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match=r"forces = \{\} is not allowed: at least one"):
        advise_place(SMALL, {}, **FAST)  # type: ignore[arg-type]


COMMAND = ["--at", "1:3.5", "--modes", 2, "--rate", 40, "--quick", "--threads", 1]


def test_command_writes_what_python_says(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    command = load("design_place", monkeypatch)
    device = tmp_path / "device.json"
    history = tmp_path / "history.csv"
    result = done(
        command,
        *COMMAND,
        *["--mass-ratio", 0.02, "--mass-ratio", 0.04, "--members", 2],
        *["--device", device, "--history", history, "--out", tmp_path / "out"],
        *["--json", tmp_path / "all.json", "--limit-level", 1.0, "--contact", "steel", "pom", 0.05],
    )
    assert {file.name for file in (tmp_path / "out").iterdir()} == {
        "summary.json",
        "places.csv",
        "places.png",
        "frequency.csv",
        "frequency.png",
        "card.html",
        "card.json",
    }
    content = json.loads((tmp_path / "all.json").read_text())
    assert content == json.loads((tmp_path / "out" / "summary.json").read_text())
    advice = advise_place(
        SMALL,
        {1: 3.5},
        mass_ratios=[0.02, 0.04],
        trial_places=3,
        members=2,
        limit_level=1.0,
        **FAST,  # type: ignore[arg-type]
    )
    best = advice.recommended
    assert best is not None
    assert best.mass_ratio == 0.02  # the lightest below a metre
    own = content["recommended"]
    assert (own["place"], own["gap_m"], own["mass_ratio"]) == (best.name, best.gap, 0.02)
    assert own["resonances"][0]["level_m"] == best.parts[0].level
    assert f"at {best.name} of the length" in result.output
    scene = to_scene(read_plain(device), tmp_path)
    assert scene.absorber == best.absorber
    assert scene.model.tip_shape == pytest.approx(advice.places.model_at(best.place).tip_shape)

    with (tmp_path / "out" / "places.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 40
    assert float(rows[-1]["reach_1"]) == pytest.approx(float(advice.maps[1].reach[0, -1]))
    card = json.loads((tmp_path / "out" / "card.json").read_text())
    assert card["groups"]["Device"][0]["value"] == f"{best.name} of the length"

    touch = {
        row["label"]: row for row in card["groups"]["Contact, estimated after Hertz, without loss"]
    }
    assert float(touch["peak pressure"]["value"]) > 0

    # the motion is that of the worst run, to the last bit of its level
    with history.open(newline="") as file:
        motion = list(csv.DictReader(file))
    samples = np.array([float(row["displacement_m"]) for row in motion])
    member, direction = find_worst_run(best.runs[1])
    level, _ = response_level(samples, 32)
    assert level == pytest.approx(float(best.runs[1].level[0, member, direction]), rel=1e-12)
    relative = np.array([float(row["absorber_relative_m"]) for row in motion])
    assert best.gap * 0.98 < np.max(np.abs(relative)) <= best.gap * (1 + 1e-9)

    with (tmp_path / "out" / "frequency.csv").open(newline="") as file:
        curves = list(csv.DictReader(file))
    assert {row["absorber"] for row in curves} == {
        "recommended device, worst member",
        "no absorber",
    }
    own = [float(row["level_m"]) for row in curves if row["absorber"] != "no absorber"]
    assert 0.97 * level < max(own) < 1.2 * level


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (["--at", "1:3", "--force", 2], "--force does not go with --at"),
        (["--at", "1:3", "--at", "1:4"], "each resonance once"),
        ([], "--force is missing"),
        (["--force", 2, "--position", 2], "position = 2"),
        (["--load", "base:4"], "--load is not possible here"),
        (["--force", 2, "--constraint", "yield_stress", 65e6], "needs --contact"),
        (["--force", 2, "--contact", "steel", "pom", -1], "radius of --contact in m = -1"),
        (["--force", 2, "--contact", "steel", "cheese", 0.05], "material = 'cheese'"),
        (["--force", 2, "--contact", "steel", "pom", 0.05, "--no-card"], "with --no-card"),
    ],
)
def test_command_refuses(line: list[object], message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    result = call(load("design_place", monkeypatch), *line, "--modes", 2)
    assert result.exit_code == 2
    assert message in result.output


def test_the_table_of_scans_stands_on_its_page(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The table of scans is written into its page.

    Of two places of a beam the free end is far better. A scan by its own runs finds the same place,
    and a level close to that of the result.
    """
    case = check_places.Case(
        "beam", lambda: find_places(SMALL).subset([0.6, 1.0]), ((1, 3.5), (2, 35.0))
    )
    monkeypatch.setattr(check_places, "CASES", (case,))
    monkeypatch.setattr(check_places, "QUICK_CASES", (0,))
    page = tmp_path / "page.md"
    numbers = tmp_path / "numbers.json"
    page.write_text("<!-- check_places -->\nold\n<!-- /check_places -->\n")
    line = ["--quick", "--rate", 60, "--threads", 1, "--json", numbers, "--page", page]
    done(check_places.main, *line)
    (row,) = json.loads(numbers.read_text())["rows"]
    assert (row["place"], row["scan_place"], row["resonances"]) == ("1", "1", [1, 2])
    assert 0.5 < row["ratio"] < 1.5
    assert row["scan_sweeps"] == 2 * 2 * 2 * 4
    text = page.read_text()
    assert "old" not in text
    assert "| beam" in text
    assert "of 1, worst" in text
