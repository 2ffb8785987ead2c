from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from places import ROOT, SUPPORT

pytest.importorskip("optuna")
pytest.importorskip("cmaes")

from design_studies import BATCH, Model, problem, settings

from optimisation.designs import design_space
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.search.journal import StudyError, repair
from optimisation.search.settings import Rung, Settings
from optimisation.search.study import DesignStudy, opened

DESIGNS = 3 * BATCH + 1


def results(study: DesignStudy) -> list[tuple[object, ...]]:
    return [(e.number, dict(e.design.values), e.score, e.rungs) for e in study.told]


def whole(sampler: str, designs: int = DESIGNS) -> list[tuple[object, ...]]:
    objectives = 2 if sampler == "nsga2" else 1
    with opened(problem(objectives), settings(sampler)) as study:
        assert study.run(designs, Model())
        return results(study)


@pytest.mark.parametrize("sampler", ["cma", "nsga2", "random"])
def test_study_in_a_file_equals_one_in_memory_and_follows_from_its_seed(tmp_path: Path, sampler: str) -> None:
    objectives = 2 if sampler == "nsga2" else 1
    with opened(problem(objectives), settings(sampler), tmp_path / "a.journal") as study:
        assert study.run(DESIGNS, Model())
        found = results(study)
    assert found == whole(sampler)
    assert len(found) == DESIGNS
    with opened(problem(objectives), settings(sampler, seed=1)) as study:
        study.run(DESIGNS, Model())
        assert [r[1] for r in results(study)[1:]] != [r[1] for r in found[1:]]


def test_first_design_is_the_papers_scaled_to_the_structure(tmp_path: Path) -> None:
    with opened(problem(), settings(), tmp_path / "a.journal") as study:
        study.run(2, Model())
        assert study.told[0].design.values["gap"] == pytest.approx(study.problem.units.gap(0.02), rel=1e-12)
        assert study.told[0].design.values["restitution"] == 0.7
        assert len(study.told) == BATCH + 1  # whole batches
    with opened(problem(), replace(settings(), from_scratch=True)) as study:
        study.run(2, Model())
        assert study.told[0].design.values["gap"] != study.problem.space.default.values["gap"]


@pytest.mark.parametrize("sampler", ["cma", "nsga2", "random"])
def test_study_goes_on_from_any_line_of_its_journal(tmp_path: Path, sampler: str) -> None:
    """A process can be killed between any two lines, and in the middle of one: the resumed study is the same each time."""
    objectives, file = 2 if sampler == "nsga2" else 1, tmp_path / "study.journal"
    with opened(problem(objectives), settings(sampler), file) as study:
        study.run(DESIGNS, Model())
    lines, expected = file.read_bytes().splitlines(keepends=True), whole(sampler)
    for cut in range(0, len(lines), 2 if sampler == "cma" else 5):
        torn = lines[cut][: len(lines[cut]) // 2] if cut % 3 else b""
        file.write_bytes(b"".join(lines[:cut]) + torn)
        with opened(problem(objectives), settings(sampler), file) as study:
            assert study.run(DESIGNS, Model())
            assert results(study) == expected, f"cut at line {cut}: {lines[cut][:80]!r}"


@pytest.mark.skipif(importlib.util.find_spec("torch") is None, reason="the Gaussian process needs torch")
def test_gaussian_process_goes_on_where_it_was_broken_off(tmp_path: Path) -> None:
    chosen = Settings("gp", 2, (Rung(4),))
    with opened(problem(), chosen) as study:
        study.run(5, Model())
        expected = results(study)
    chunks = len(problem().conditions)
    for stop in (4 * chunks,):
        file = tmp_path / f"{stop}.journal"
        with opened(problem(), chosen, file) as study:
            assert not study.run(5, Model(stop=stop))
        with opened(problem(), chosen, file) as study:
            assert study.run(5, Model())
            assert results(study) == expected


@pytest.mark.parametrize("stop", [0, 11, 30])
def test_interrupt_keeps_what_is_finished_and_runs_nothing_twice(tmp_path: Path, stop: int) -> None:
    first, second = Model(stop=stop), Model()
    with opened(problem(), settings(), tmp_path / "a.journal") as study:
        assert not study.run(DESIGNS, first)
    with opened(problem(), settings(), tmp_path / "a.journal") as study:
        assert study.run(DESIGNS, second)
        assert results(study) == whole("cma")
    uninterrupted = Model()
    with opened(problem(), settings()) as study:
        study.run(DESIGNS, uninterrupted)
    # a design whose last chunk was not reached begins again; all others keep their runs
    repeated = Counter(first.seen + second.seen) - Counter(uninterrupted.seen)
    assert len({run[:2] for run in repeated}) <= 1


@pytest.mark.same_bits
def test_killed_process_loses_nothing(tmp_path: Path) -> None:
    """Kill -9 at a few moments; the next process goes on, and each design's runs are made once but for the one that was under way."""
    file, log = tmp_path / "a.journal", tmp_path / "log"
    log.touch()
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(SUPPORT), str(ROOT)])}
    kills = 0
    for wait in (9, 30):
        process = subprocess.Popen([sys.executable, str(SUPPORT / "killed_study.py"), str(file), str(log), str(DESIGNS)], env=environment)
        until = time.monotonic() + 60
        while process.poll() is None and len(log.read_text().splitlines()) < wait and time.monotonic() < until:
            time.sleep(0.002)
        process.kill()
        process.wait()
        kills += 1
    with opened(problem(), settings(), file) as study:
        assert study.run(DESIGNS, Model(log=log))
        assert results(study) == whole("cma")
    times = Counter(log.read_text().splitlines())
    assert sum(times.values()) - len(times) <= 2 * kills  # the chunks, two a design, of the design under way at each kill


def test_larger_budget_continues_a_study(tmp_path: Path) -> None:
    with opened(problem(), settings(), tmp_path / "a.journal") as study:
        study.run(BATCH + 1, Model())
    model = Model()
    with opened(problem(), settings(), tmp_path / "a.journal") as study:
        study.run(DESIGNS, model)
        assert results(study) == whole("cma")
        again = Model()
        study.run(DESIGNS, again)
        assert again.seen == []


def test_torn_line_is_kept_beside_the_journal(tmp_path: Path) -> None:
    file = tmp_path / "a.journal"
    file.write_bytes(b'{"a":1}\n{"b":2')
    assert repair(file) == 6
    assert file.read_bytes() == b'{"a":1}\n'
    assert (tmp_path / "a.journal.damaged").read_bytes() == b'{"b":2\n'
    assert repair(file) == 0
    file.write_bytes(b'{"a":1}\nnonsense\n')
    assert repair(file) == 9
    file.write_bytes(b'{"a":1}\nnonsense\n{"b":2}\n')
    with pytest.raises(StudyError, match="line 2 of 3 is damaged"):
        repair(file)


@pytest.mark.parametrize(
    ("other", "search", "names"),
    [
        (problem(members=3), settings(rungs=(Rung(3),)), ["problem.members is 4 there and 3 here"]),
        (problem(conditions=(Condition(1, 3.5), Condition(2, 20.0))), settings(), ["problem.conditions[1].force is 35.0 there and 20.0 here"]),
        (problem(space=design_space("impact", ["gap", "friction_limit"])), settings(), ["problem.space"]),
        (problem(), settings(seed=3), ["search.seed is 0 there and 3 here"]),
        (problem(), settings("random"), ["search.sampler is 'cma' there and 'random' here"]),
    ],
)
def test_study_of_something_else_is_refused(tmp_path: Path, other: Problem, search: Settings, names: list[str]) -> None:
    with opened(problem(), settings(), tmp_path / "a.journal") as study:
        study.run(2, Model())
    before = (tmp_path / "a.journal").read_bytes()
    with pytest.raises(StudyError) as error, opened(other, search, tmp_path / "a.journal"):
        pytest.fail("opened")
    assert all(name in str(error.value) for name in [*names, "another file"])
    assert (tmp_path / "a.journal").read_bytes() == before


def test_file_that_is_no_study_is_refused(tmp_path: Path) -> None:
    for k, content in enumerate((b'{"a":1}\n{"b":2}\n', b"some\ntext\n")):
        file = tmp_path / f"{k}.journal"
        file.write_bytes(content)
        with pytest.raises(StudyError, match="study file"), opened(problem(), settings(), file):
            pytest.fail("opened")


def test_study_in_use_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.journal"
    with opened(problem(), settings(), file), pytest.raises(StudyError, match="in use"), opened(problem(), settings(), file):
        pytest.fail("opened")
