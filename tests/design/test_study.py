import os
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from design_studies import BATCH, Bowl, Model, problem, settings
from places import ROOT, SUPPORT

from impact_env.ensemble import Executor
from optimisation.designs import design_space
from optimisation.machine import fingerprint
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.search.find import Plan, find
from optimisation.search.judge import Findings
from optimisation.search.ledger import StudyError, key_of, repair
from optimisation.search.settings import Rung, Settings
from optimisation.search.study import DesignStudy, opened

pytest.importorskip("optuna")
pytest.importorskip("cmaes")


DESIGNS = 3 * BATCH + 1


def results(study: DesignStudy) -> list[tuple[object, ...]]:
    return [(e.number, dict(e.design.values), e.score, e.rungs) for e in study.told]


def whole(sampler: str = "cma", seed: int = 0) -> list[tuple[object, ...]]:
    with opened(problem(2 if sampler == "nsga2" else 1), settings(sampler, seed)) as study:
        assert study.run(DESIGNS, Model())
        return results(study)


@pytest.mark.parametrize("sampler", ["cma", "nsga2", "random"])
def test_study_goes_on_from_any_line_of_its_journal(tmp_path: Path, sampler: str) -> None:
    """A process can be killed between any two lines, and in the middle of one: the resumed study is the same each time, and that in memory."""
    objectives, file = 2 if sampler == "nsga2" else 1, tmp_path / "study.journal"
    with opened(problem(objectives), settings(sampler), file) as study:
        study.run(BATCH + 1, Model())
        study.run(DESIGNS, Model())  # a larger budget
    lines, expected = file.read_bytes().splitlines(keepends=True), whole(sampler)
    assert [result[1] for result in whole(sampler, 1)[1:]] != [result[1] for result in expected[1:]]
    for cut in range(0, len(lines) + 1, 5):
        torn = lines[cut][: len(lines[cut]) // 2] if cut % 3 and cut < len(lines) else b""
        file.write_bytes(b"".join(lines[:cut]) + torn)
        with opened(problem(objectives), settings(sampler), file) as study:
            assert study.run(DESIGNS, Model())
            assert results(study) == expected, f"cut at line {cut}"


@pytest.mark.parametrize("stop", [0, 11])
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
    file.write_bytes(b"some\ntext\n")
    with pytest.raises(StudyError, match="study file"), opened(problem(), settings(), file):
        pytest.fail("opened")


@pytest.mark.parametrize(
    ("other", "search", "names"),
    [
        (problem(members=3), settings(rungs=(Rung(3),)), ["problem.members is 4 there and 3 here"]),
        (problem(conditions=(Condition(1, 3.5), Condition(2, 20.0))), settings(), ["problem.conditions[1].force is 35.0 there and 20.0 here"]),
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


def test_study_in_use_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.journal"
    with opened(problem(), settings(), file), pytest.raises(StudyError, match="in use"), opened(problem(), settings(), file):
        pytest.fail("opened")


# Searches without Optuna go on from their file: killed anywhere, on a full disk, and only where they are the same search.


def case(kind: str) -> tuple[Problem, Plan, type[Bowl] | type[Model]]:
    """Return a small search by SciPy, or by one of the methods that model the noise."""
    if kind in ("friction", "tuned"):
        wide = {"conditions": tuple(replace(c, limits=(0.5, 1.6)) for c in problem().conditions)} if kind == "tuned" else {}
        return problem(space=design_space(kind), **wide), Plan(30, modes=False), Bowl
    return problem(), Plan(20, sampler=kind, modes=False), Model


def told(found: Findings) -> list[tuple[object, ...]]:
    assert found.finished
    score = found.verdict.winner.score
    return [*((e.number, dict(e.design.values), e.score) for e in found.told), (dict(found.verdict.winner.design.values), score)]


@pytest.mark.parametrize("kind", ["friction", "tuned", "map", "replicated"])
def test_search_goes_on_where_it_was_broken_off_and_runs_nothing_twice(tmp_path: Path, kind: str) -> None:
    given, plan, executor = case(kind)
    whole = executor()
    expected = told(find(given, plan, None, whole))
    last = len(whole.seen) - 3
    for stop in (5, last) if kind == "replicated" else (0, 31, last):  # a search that fits its model again at every step takes seconds
        file, first, second = tmp_path / f"{stop}.journal", executor(stop=stop), executor()
        try:
            assert not find(given, plan, file, first).finished
        except KeyboardInterrupt:
            assert stop > 31  # it came while the finalists were judged
        assert told(find(given, plan, file, second)) == expected
        assert Counter(first.seen + second.seen) == Counter(whole.seen)
        again = executor()
        assert told(find(given, plan, file, again)) == expected
        assert again.seen == []


def test_changed_sources_are_another_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """For both kinds of journal; versions of the packages count like the code."""
    given, plan, executor = case("friction")
    find(given, plan, tmp_path / "scipy.journal", executor())
    with opened(problem(), settings(), tmp_path / "cma.journal"):
        pass
    for file in ("scipy.journal", "cma.journal"):
        lines = (tmp_path / file).read_text().splitlines()
        head = next(line for line in lines if '"sources"' in line)
        assert all(f'"{name}":' in head for name in ("code", "numba", "numpy"))
    for module in ("find", "study"):
        monkeypatch.setattr(f"optimisation.search.{module}.fingerprint", lambda *given: fingerprint(*given) | {"code": "0" * 16})
    with pytest.raises(StudyError, match=r"sources\.code is '[0-9a-f]{16}' there and '0{16}' here; choose another file"):
        find(given, plan, tmp_path / "scipy.journal", executor())
    with pytest.raises(StudyError, match=r"sources\.code is"), opened(problem(), settings(), tmp_path / "cma.journal"):
        pytest.fail("opened")


@pytest.mark.same_bits
def test_key_is_the_same_in_another_process_and_differs_with_all_that_a_run_is_made_of() -> None:
    code = "from design_studies import problem; from optimisation.search.ledger import key_of\n"
    code += "g = problem(); print(*map(key_of, g.chunks(g.space.default, g.ensemble, g.rate)))"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(SUPPORT), str(ROOT)]), "PYTHONHASHSEED": "7"}
    there = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True).stdout.split()
    given = problem()

    def keys(other: Problem, rate: float = given.rate) -> list[str]:
        return [key_of(chunk) for chunk in other.chunks(other.space.default, other.ensemble, rate)]

    here = keys(given)
    assert here == there
    assert len(set(here)) == len(here) == 2
    detuned = tuple(replace(c, detuning=0.01) for c in given.conditions)
    for other in (problem(seed=1), problem(conditions=detuned), problem(members=3), problem(beam=replace(given.beam, modes=3))):
        assert not set(keys(other)) & set(here)
    assert not set(keys(given, 2 * given.rate)) & set(here)


def test_runs_that_were_given_up_are_kept_as_such(tmp_path: Path) -> None:
    class Failing(Bowl):
        def value(self, chunk: object, lane: object) -> float:
            return np.nan if self.seen[-1][0] > 1.0 else super().value(chunk, lane)

    given, plan, _ = case("friction")
    failing: Executor = Failing()
    found = find(given, plan, tmp_path / "a.journal", failing)
    assert any(e.score.failed for e in found.told)
    again = Failing()
    assert told(find(given, plan, tmp_path / "a.journal", again)) == told(found)
    assert again.seen == []
