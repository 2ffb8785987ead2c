"""Comparisons of absorbers have correct files and summaries.

They are tested under a swept force and under loads.
"""

import contextlib
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy
from commands import done, load, read
from drawing import line, saved_figures
from load_cases import KINDS, MASS, OMEGA, chain, tables_of

from impact_env import Beam, simulate
from impact_env.ensemble import Lane, Threads, draw_members
from impact_env.frequency import find_steady_start
from impact_env.level import response_level
from impact_env.loads import Loads, Shock
from impact_env.modes import ModalModel, modal_model
from impact_env.scene import Scene
from optimisation import comparison
from optimisation.answers.comparison import ComparisonAnswer
from optimisation.cli import compare as command
from optimisation.cli.group import imported
from optimisation.comparison import (
    FORCE_SPAN,
    IMPACT,
    LTVA_PAPER,
    LTVA_PAPER_WIDE,
    LTVA_TUNED_WIDE,
    NONE,
    Comparison,
    compare,
    force_grid,
)
from optimisation.files import replacing, write_csv, write_json
from optimisation.measures import measure_lane, measure_of
from optimisation.report.comparison_report import CURVE_COLUMNS, RUN_COLUMNS, summary
from optimisation.tuned import den_hartog, under_loads

FILES = {
    "runs.csv",
    "curves.csv",
    "summary.json",
    "comparison.png",
    "frequency.csv",
    "frequency.png",
    "card.html",
    "card.json",
}
KEYS = [
    "none",
    "impact",
    "friction",
    "ltva_paper",
    "ltva_tuned",
    "ltva_paper_wide",
    "ltva_tuned_wide",
]


def small(*_own: object, **options: object) -> Comparison:
    """Compare on two modes, fast: the numbers do not matter here."""
    return compare(Beam(modes=2), **(options | {"percent_per_100_periods": 40.0}))


@pytest.fixture(scope="module", autouse=True)
def quickly_tuned() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "optimisation.comparison.minimax", den_hartog
        )  # in closed form, and as good here
        yield


@pytest.fixture(scope="module")
def study() -> Comparison:
    return small(forces=4, members=3, seed=1)


def test_forces_cover_the_range_and_gather_at_the_design_force() -> None:
    forces = force_grid(3.5, 24)
    assert len(forces) == 24
    assert forces[[0, -1]] == pytest.approx(3.5 * np.array(FORCE_SPAN))
    assert np.all(np.diff(forces) > 0)
    assert np.sum((forces > 1.75) & (forces < 5.6)) >= 9


def test_study_holds_every_concept_near_both_resonances(study: Comparison) -> None:
    assert study.complete
    assert [part.resonance for part in study.resonances] == [1, 2]
    for part in study.resonances:
        assert list(part.curves) == KEYS == [concept.key for concept in study.concepts]
        assert all(curve.level.shape == (4, 3, 2) for curve in part.curves.values())
        assert part.limit.shape == (4,)
        assert part.limit[0] == 0
        np.testing.assert_allclose(
            part.curves[NONE].median / part.forces, part.curves[NONE].median[0] / part.forces[0]
        )
    content = json.loads(json.dumps(summary(study), allow_nan=False))
    assert content["complete"] is True
    part = content["resonances"]["1"]
    assert list(part["concepts"]) == KEYS
    impact = part["concepts"][IMPACT]
    tuned = part["concepts"][LTVA_PAPER]
    assert impact["absorber"] == {
        "mass_ratio": 0.02,
        "walls": {"gap": 1e-3, "restitution": 0.7},
        "friction": {"limit": 0.1, "static_ratio": 1.0},
        "gravity": 0.0,
    }
    assert impact["optimum"]["force_n"] in part["forces_n"]
    assert tuned["optimum"]["force_n"] is None
    assert tuned["at_best_force_of_impact_absorber"]["force_n"] == impact["optimum"]["force_n"]


def test_runs_of_the_papers_absorbers_start_in_the_steady_state(study: Comparison) -> None:
    """Runs of the paper's absorbers start in the steady state.

    The level of one run of the impact absorber is that of a separate run from the steady state. A
    run from rest has another level at this rate, because of the transient.
    """
    part = study.resonances[1]
    case = part.cases[IMPACT]
    force = float(part.forces[0])
    down = case.schedules()[1]
    (drive,) = draw_members(3, 1)[1:2].drives(force, down)
    steady, rest = (
        simulate(case.scene, drive, initial=start).recorded.level.value
        for start in (find_steady_start(case.scene, drive), None)
    )
    assert part.curves[IMPACT].level[0, 1, 1] == pytest.approx(steady, rel=1e-12)
    assert abs(rest / steady - 1) > 1e-3


def test_bands_are_predictions_and_levels_say_where_they_were_read(study: Comparison) -> None:
    part = study.resonances[0]
    curve = part.curves[IMPACT]
    k = part.best
    content = summary(study)["resonances"]["1"]["concepts"][IMPACT]
    here = content["at_best_force_of_impact_absorber"]
    rows = [np.log(curve.combined[j]) for j in (k - 1, k, k + 1) if 0 <= j < len(part.forces)]
    squares = sum(float(np.sum((row - row.mean()) ** 2)) for row in rows)
    freedoms = 2 * len(rows)
    half = scipy.stats.t.ppf(0.95, freedoms) * np.sqrt(squares / freedoms * (1 + 1 / 3))
    middle = np.log(curve.combined[k]).mean()
    assert np.log(here["response_level_5_to_95_percent_m"]) == pytest.approx(
        [middle - half, middle + half]
    )
    worse = np.argmax(curve.level[k], axis=1)
    ratios = curve.lanes.frequency_ratio[k, np.arange(3), worse]
    assert here["level_frequency_ratio"] == np.median(ratios)
    assert f"{np.median(ratios):.3f}" in str(ComparisonAnswer(study))
    assert content["sweep_limits"] == [0.9, 1.06]


def test_a_level_that_is_read_at_an_end_of_the_sweeps_is_warned_of(study: Comparison) -> None:
    """Of the absorbers that are inside the range the impact absorber is put at its end."""
    assert "impact absorber near" not in str(ComparisonAnswer(study))
    part = study.resonances[0]
    lanes = part.curves[IMPACT].lanes
    ends = replace(lanes, frequency_ratio=np.full_like(lanes.frequency_ratio, 0.9))
    curves = part.curves | {IMPACT: replace(part.curves[IMPACT], lanes=ends)}
    other = replace(study, resonances=(replace(part, curves=curves), *study.resonances[1:]))
    assert "impact absorber near resonance 1" in str(ComparisonAnswer(other))
    assert "0.900 (end)" in str(ComparisonAnswer(other))
    assert any("end of the sweeps" in line for line in ComparisonAnswer(other).report.warnings)


@pytest.mark.slow
def test_a_quick_comparison_writes_all_files(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("optimisation.cli.compare.compare", small)
    out = tmp_path / "new" / "folder"
    history = tmp_path / "run.npz"
    done(command, "--quick", "--seed", 4, "--out", out, "--history", history)
    assert {file.name for file in out.iterdir()} == FILES
    assert (out / "comparison.png").read_bytes().startswith(b"\x89PNG")
    content = json.loads((out / "summary.json").read_text())
    assert content["settings"] | {"members": 2, "seed": 4} == content["settings"]
    assert len(content["resonances"]["2"]["forces_n"]) == 10
    part = content["resonances"]["1"]
    best = part["concepts"][IMPACT]["optimum"]["force_n"]
    curves = [row for row in read(out / "frequency.csv") if row["resonance"] == "1"]
    assert {float(row["force_n"]) for row in curves} == {best}
    assert {row["absorber"] for row in curves} == {
        concept["label"]
        for key, concept in part["concepts"].items()
        if key not in (LTVA_PAPER_WIDE, LTVA_TUNED_WIDE)
    }
    runs = [
        float(row["response_level_m"])
        for row in read(out / "runs.csv")
        if (row["resonance"], row["concept"], float(row["force_n"])) == ("1", IMPACT, best)
    ]
    with np.load(history) as motion:
        level, _ = response_level(motion["displacement_m"], 32)
    assert level == pytest.approx(max(runs), rel=1e-12)
    assert [tuple(read(out / name)[0]) for name in ("runs.csv", "curves.csv")] == [
        RUN_COLUMNS,
        CURVE_COLUMNS,
    ]


def test_files_are_whole_or_absent(tmp_path: Path) -> None:
    write_csv(tmp_path / "a.csv", ["x", "y"], [[1, 0.1], [2, ""]])
    assert (tmp_path / "a.csv").read_text() == "x,y\n1,0.1\n2,\n"

    def rows() -> object:
        yield [1, 2]
        raise RuntimeError

    for write in (
        lambda: write_csv(tmp_path / "a.csv", ["x"], rows()),
        lambda: write_json(tmp_path / "a.json", [float("nan")]),
    ):
        with pytest.raises((RuntimeError, ValueError)):
            write()
    with contextlib.suppress(OSError), replacing(tmp_path / "b.txt") as temporary:
        temporary.write_text("half")
        raise OSError("disk full")
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]
    assert (tmp_path / "a.csv").read_text() == "x,y\n1,0.1\n2,\n"


# Under loads: the measure in closed form, and the command from files to files.


def test_the_decay_time_of_one_mode() -> None:
    """The decay time of one mode agrees with its closed form.

    The energy oscillates about its exponential by the damping ratio. A long decay averages these
    oscillations out.
    """
    shock = Loads((Shock("half-sine", 10.0, 0.0125, 2.0),), OMEGA[0])
    model = ModalModel(*(np.array([x]) for x in (OMEGA[0], 0.01, 0.6, 2.6)), MASS)
    assert measure_of(shock) == "decay"
    assert measure_lane(Lane(Scene(model), shock)) == pytest.approx(
        (1 - np.exp(-0.02 * OMEGA[0] * 2.0)) / (0.02 * OMEGA[0]), rel=0.02
    )


PAPER = (
    "[beam]\nlength_m = 0.5\nbending_stiffness_n_m2 = 362.88\nmass_per_length_kg_m = "
    "1.1275\nmodes = 2\n"
)
CHAIN = (
    "[matrices]\nmass = 'm.npz'\nstiffness = 'm.npz'\nunits = 'kg, m, s'\nforce = 0\nabsorber = "
    "1\nmodes = 3\nmass_kg = 3\ndamping_ratio = 0.01\n"
)


NIGHTLY = {("matrices", kind) for kind in KINDS if kind != "shock"}  # 2 s of the processor each


@pytest.mark.slow
@pytest.mark.parametrize(
    ("structure", "kind"),
    [
        pytest.param(
            structure, kind, marks=pytest.mark.nightly if (structure, kind) in NIGHTLY else ()
        )
        for structure in ("the paper's beam", "matrices")
        for kind in KINDS
    ],
)
def test_each_kind_goes_through_sweep_and_comparison(
    kind: str, structure: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Each kind of load works in the commands sweep and compare.

    Linear concepts leave the same share of the response at each intensity, and the response without
    absorber grows with the intensity, except for a decay time.
    """
    few = {
        "GAPS": np.array([1.0, 3.0]),
        "LIMITS": np.array([0.3]),
        "BETWEEN": np.zeros(1),
    }  # their numbers do not matter here
    for name, value in few.items():
        monkeypatch.setattr(comparison, name, value)
    monkeypatch.setattr(under_loads, "MOST_TRIALS", 20)
    own = tmp_path / "structure.toml"
    omegas = modal_model(Beam(modes=2)).omega
    own.write_text(PAPER)
    if structure == "matrices":
        mass, stiffness = chain(tmp_path)
        omegas = np.sqrt(scipy.linalg.eigh(stiffness, mass, eigvals_only=True))
        own.write_text(CHAIN + "base_vector = [1.0, 1.0, 1.0]\n")
    omega = float(omegas[0])
    (tmp_path / "load.toml").write_text(tables_of(omega, tmp_path)[kind])
    options = ["--structure", own, "--load", tmp_path / "load.toml"]
    absorber = ("--restitution", 0.7) if kind == "force" else ("--absorber", "none")
    done(imported("sweep"), *options, *absorber, "--json", tmp_path / "out.json")
    output = json.loads((tmp_path / "out.json").read_text())
    assert output["response_level_m"][0] > 0
    assert output["pseudo_periods"] == pytest.approx(8, rel=1e-6)
    drawn = saved_figures(monkeypatch)
    result = done(command, *options, "--members", 1, "--forces", 2, "--out", tmp_path / "out")
    output = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert len(read(tmp_path / "out" / "runs.csv")) >= 4 * 2
    assert f"{output['ratio_5_50_95']['impact'][0][0][1]:.3f}" in result.output
    for band, panel in enumerate(drawn[0].axes):
        for name, label in (("impact", "impact absorber"), ("tuned", "tuned absorber")):
            median = [ratios[1] for ratios in output["ratio_5_50_95"][name][band]]
            np.testing.assert_allclose(line(panel, label)[1], median, rtol=1e-9)
    bands = (
        2 if kind in ("tones", "orders") else np.sum(omegas < 7 * omega) if kind == "base" else 1
    )
    assert len(output["without_absorber"]) == bands
    for band, (low, high) in enumerate(output["without_absorber"]):
        assert high / low == pytest.approx(1.0 if output["measure"] == "decay" else 25.0, rel=1e-6)
        assert np.ptp([bands[1] for bands in output["ratio_5_50_95"]["tuned"][band]]) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "more"), [("compare_absorbers", ["--forces", 2]), ("design_gap", [])]
)
def test_runs_under_loads_go_to_the_cluster_and_show_progress(
    name: str, more: list[object], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Workers in the place of a scheduler's get every run, and the numbers are those of threads."""
    for size, value in (("GAPS", comparison.GAPS[:1]), ("LIMITS", comparison.LIMITS[:1])):
        monkeypatch.setattr(comparison, size, value)
    monkeypatch.setattr(under_loads, "MOST_TRIALS", 2)
    monkeypatch.setattr("optimisation.executors.EVERY", 0.0)  # s between two lines
    here = []

    class Workers(Threads):
        def each(self, function: Any, items: Any, kinds: Any) -> Any:
            here.append(len(items))
            return super().each(function, items, kinds)

    @contextlib.contextmanager
    def workers(_threads: int | None, cluster: str | None) -> Iterator[Workers | None]:
        yield None if cluster is None else Workers(1)

    command = load(name, monkeypatch)
    monkeypatch.setattr(command, "workers", workers)
    options = ["--load", "shock:20:0.01:1", "--members", 1, *more]
    result = done(command, *options, "--out", tmp_path / "threads")
    assert not here
    assert {"compare_absorbers": "comparing: ", "design_gap": "simulating: "}[name] in result.stderr
    done(command, *options, "--cluster", "127.0.0.1:8786", "--out", tmp_path / "cluster")
    assert sum(here) > 5
    texts = [(tmp_path / where / "runs.csv").read_text() for where in ("threads", "cluster")]
    assert texts[0] == texts[1]
