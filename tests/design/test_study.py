import os
import sqlite3
import subprocess
import sys
from collections import Counter
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from design_studies import BATCH, Bowl, Model, problem, settings
from places import ROOT, fresh

from impact_env.checks import ParameterError
from impact_env.ensemble import Executor
from optimisation.checkpoint import Checkpoint, key_of, open_run_cache, source_hash
from optimisation.objectives import Condition
from optimisation.problem import Problem
from optimisation.search.find import SearchOptions, find, identity, run_study
from optimisation.search.judge import SearchResult
from optimisation.search.settings import Rung, SearchSettings
from optimisation.search.study import DesignStudy
from optimisation.space import design_space

optuna = pytest.importorskip("optuna")
pytest.importorskip("cmaes")


DESIGNS = 3 * BATCH + 1
Result = tuple[object, ...]


def search(
    file: Path | None, tested: Problem, chosen: SearchSettings, designs: int = DESIGNS
) -> tuple[list[Result], int]:
    """Return a search's result with the runs that a file holds, and how many runs it made."""
    with open_run_cache(Model(), identity(tested, chosen.describe()), file) as ledger:
        study, _, cost = run_study("search", tested, chosen, designs, ledger)
    return [(e.number, dict(e.design.values), e.score, e.rungs) for e in study.evaluated], cost.runs


@pytest.mark.parametrize("sampler", ["cma", "nsga2", "random"])
def test_study_goes_on_from_any_piece_of_its_file(tmp_path: Path, sampler: str) -> None:
    """A study continues from any part of its file.

    A process can be killed after any run. The resumed study is always the same as that in memory,
    and computes only the missing runs.
    """
    tested = problem(2 if sampler == "nsga2" else 1)
    file = tmp_path / "study.journal"
    expected, runs = search(None, tested, settings(sampler))
    assert [result[1] for result in search(None, tested, settings(sampler, 1))[0][1:]] != [
        result[1] for result in expected[1:]
    ]
    search(file, tested, settings(sampler), BATCH + 1)
    assert search(file, tested, settings(sampler))[0] == expected  # a larger budget
    whole = file.read_bytes()
    for cut in range(0, 60, 5):
        file.write_bytes(whole)
        with closing(sqlite3.connect(file, isolation_level=None)) as opened:
            (stored,) = opened.execute(
                "SELECT count(*) FROM pieces WHERE rowid <= ? AND name <> 'identity'", (cut,)
            ).fetchone()
            opened.execute("DELETE FROM pieces WHERE rowid > ?", (cut,))
        resumed, made = search(file, tested, settings(sampler))
        assert resumed == expected, f"cut at piece {cut}"
        assert made < runs if stored else made == runs


def test_a_study_that_was_broken_off_goes_on_where_it_is() -> None:
    study = DesignStudy(problem(), settings())
    model = Model(stop=11)
    assert not study.run(DESIGNS, model)
    assert study.run(DESIGNS, Model())
    assert [(e.number, dict(e.design.values), e.score, e.rungs) for e in study.evaluated] == search(
        None, problem(), settings()
    )[0]


def test_optuna_reads_the_designs_of_a_study(tmp_path: Path) -> None:
    study, _ = search(tmp_path / "a.journal", problem(), settings())
    storage = optuna.storages.JournalStorage(
        optuna.storages.journal.JournalFileBackend(str(tmp_path / "a.journal.optuna"))
    )
    trials = optuna.load_study(study_name=None, storage=storage).trials
    assert [trial.number for trial in trials] == [number for number, *_ in study]
    assert trials[0].values == list(study[0][2].values)


# The file: written whole or not at all, for one process at a time, and refused where it is
# something else.


def test_pieces_survive_a_process_that_is_killed(tmp_path: Path) -> None:
    code = "import pathlib, sys; from optimisation.checkpoint import Checkpoint\n"
    code += (
        "kept, n = Checkpoint(pathlib.Path(sys.argv[1])), 0\nwhile True: kept.store(str(n), [n] * "
        "1000); n += 1; print(n, flush=True)"
    )
    file = tmp_path / "kept"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [sys.executable, "-c", code, file], env=environment, stdout=subprocess.PIPE, text=True
    ) as process:
        last = [int(process.stdout.readline()) for _ in range(20)][-1]
        process.kill()
        last = max([last, *map(int, process.stdout.read().split()[:-1])])
    with closing(Checkpoint(file)) as cache:
        assert len(cache.known) >= last
        assert all(values == [int(name)] * 1000 for name, values in cache.known.items())


def test_a_file_that_cannot_be_used_is_refused_in_one_line_and_stays(tmp_path: Path) -> None:
    good, words, another, torn = (tmp_path / name for name in ("good", "words", "another", "torn"))
    with closing(Checkpoint(good)) as cache:
        cache.store("a", [1.0, float("nan")] * 10000)
        with pytest.raises(ParameterError, match=r"--resume = .*good is in use by another process"):
            Checkpoint(good)
        cache._file.execute("PRAGMA max_page_count = 1")  # as on a full disk
        with pytest.raises(OSError, match="full"):
            cache.store("b", [1.0] * 100000)
    with closing(Checkpoint(good)) as cache:
        assert list(cache.known) == ["a"]
    words.write_text('{"form": "pieces 1", "pieces": []}\n')  # what was written here before
    with closing(sqlite3.connect(another)) as other:
        other.execute("CREATE TABLE moments (x REAL)")
    torn.write_bytes(good.read_bytes()[:9000])
    for file in (words, another, torn):
        before = file.read_bytes()
        with pytest.raises(
            ParameterError,
            match=(
                rf"--resume = .*{file.name} is not allowed: a file that this option has written "
                r"before"
            ),
        ):
            Checkpoint(file)
        assert file.read_bytes() == before
    with pytest.raises(
        ParameterError, match="a file that can be written to, in a folder that exists"
    ):
        Checkpoint(tmp_path / "nowhere" / "a")


@pytest.mark.parametrize(
    ("other", "chosen", "names"),
    [
        (problem(members=3), settings(rungs=(Rung(3),)), ["problem.members is 4 there and 3 here"]),
        (
            problem(conditions=(Condition(1, 3.5), Condition(2, 20.0))),
            settings(),
            ["problem.conditions[1].force is 35.0 there and 20.0 here"],
        ),
        (problem(), settings("random"), ["search.sampler is 'cma' there and 'random' here"]),
    ],
)
def test_study_of_something_else_is_refused(
    tmp_path: Path, other: Problem, chosen: SearchSettings, names: list[str]
) -> None:
    search(tmp_path / "a.journal", problem(), settings(), 2)
    before = (tmp_path / "a.journal").read_bytes()
    with pytest.raises(ParameterError) as error:
        search(tmp_path / "a.journal", other, chosen)
    assert all(name in str(error.value) for name in [*names, "another file"])
    assert (tmp_path / "a.journal").read_bytes() == before


# Whole searches go on from their file, also in the judging, and only where they are the same
# search.


def case(kind: str) -> tuple[Problem, SearchOptions, type[Bowl] | type[Model]]:
    """Return a small search by SciPy, with a Gaussian process, or in batches."""
    if kind in ("friction", "tuned"):
        wide = (
            {"conditions": tuple(replace(c, limits=(0.5, 1.6)) for c in problem().conditions)}
            if kind == "tuned"
            else {}
        )
        return problem(space=design_space(kind), **wide), SearchOptions(30, modes=False), Bowl
    return problem(), SearchOptions(20, sampler=kind, batch=BATCH, modes=False), Model


def list_results(findings: SearchResult) -> list[tuple[object, ...]]:
    assert findings.finished
    score = findings.verdict.winner.score
    return [
        *((e.number, dict(e.design.values), e.score) for e in findings.evaluated),
        (dict(findings.verdict.winner.design.values), score),
    ]


@pytest.mark.parametrize("kind", ["friction", "tuned", "gp", "cma"])
def test_search_goes_on_where_it_was_broken_off_and_runs_nothing_twice(
    tmp_path: Path, kind: str
) -> None:
    tested, plan, executor = case(kind)
    whole = executor()
    expected = list_results(find(tested, plan, None, whole))
    last = len(whole.calls) - 3
    for stop in (
        (5, last) if kind == "gp" else (0, 31, last)
    ):  # a search that fits its model again at every step takes seconds
        file = tmp_path / f"{stop}.journal"
        first = executor(stop=stop)
        second = executor()
        try:
            assert not find(tested, plan, file, first).finished
        except KeyboardInterrupt:
            assert stop > 31  # it came while the finalists were judged
        assert list_results(find(tested, plan, file, second)) == expected
        assert Counter(first.calls + second.calls) == Counter(whole.calls)
        again = executor()
        assert list_results(find(tested, plan, file, again)) == expected
        assert again.calls == []


def test_changed_sources_are_another_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """For searches by SciPy and by Optuna; versions of the packages count like the code."""
    tested, plan, executor = case("friction")
    find(tested, plan, tmp_path / "scipy.journal", executor())
    search(tmp_path / "cma.journal", problem(), settings(), 2)
    monkeypatch.setattr(
        "optimisation.search.find.source_hash",
        lambda *tested: source_hash(*tested) | {"code": "0" * 16},
    )
    with pytest.raises(
        ParameterError,
        match=r"sources\.code is '[0-9a-f]{16}' there and '0{16}' here; choose another file",
    ):
        find(tested, plan, tmp_path / "scipy.journal", executor())
    with pytest.raises(ParameterError, match=r"sources\.code is"):
        search(tmp_path / "cma.journal", problem(), settings())


@pytest.mark.same_bits
def test_key_is_the_same_in_another_process_and_differs_with_all_that_a_run_is_made_of() -> None:
    code = "from design_studies import problem; from optimisation.checkpoint import key_of\n"
    code += "g = problem(); print(*map(key_of, g.chunks(g.space.default, g.ensemble, g.rate)))"
    other_process = fresh("-c", code, PYTHONHASHSEED=7).stdout.split()
    tested = problem()

    def keys(other: Problem, rate: float = tested.rate) -> list[str]:
        return [key_of(chunk) for chunk in other.chunks(other.space.default, other.ensemble, rate)]

    here = keys(tested)
    assert here == other_process
    assert len(set(here)) == len(here) == 2
    detuned = tuple(replace(c, detuning=0.01) for c in tested.conditions)
    for other in (
        problem(seed=1),
        problem(conditions=detuned),
        problem(members=3),
        problem(beam=replace(tested.beam, modes=3)),
    ):
        assert not set(keys(other)) & set(here)
    assert not set(keys(tested, 2 * tested.rate)) & set(here)


def test_abandoned_runs_are_stored_as_such(tmp_path: Path) -> None:
    class Failing(Bowl):
        def value(self, chunk: object, lane: object) -> float:
            return np.nan if self.calls[-1][0] > 1.0 else super().value(chunk, lane)

    tested, plan, _ = case("friction")
    failing: Executor = Failing()
    findings = find(tested, plan, tmp_path / "a.journal", failing)
    assert any(e.score.failed for e in findings.evaluated)
    again = Failing()
    assert list_results(find(tested, plan, tmp_path / "a.journal", again)) == list_results(findings)
    assert again.calls == []
