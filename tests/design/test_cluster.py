import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import distributed
import pytest
from cluster_check import problem
from commands import SHORT, done, load
from places import ROOT, SUPPORT, fresh

from impact_env import Beam
from optimisation.cli import periodic_branches
from optimisation.comparison import compare
from optimisation.problem import run_chunks
from optimisation.search.cluster import ClusterError, Workers
from optimisation.tuned import den_hartog

pytest.importorskip("distributed")
pytest.importorskip("optuna")


def test_workers_and_studies_give_what_threads_give_though_a_worker_is_killed() -> None:
    result = fresh(SUPPORT / "cluster_check.py")
    assert result.stdout.splitlines() == [
        "killed True",
        "runs True",
        "killed at once True True",
        "lanes True",
        "studies True",
    ], result.stdout + result.stderr


def test_no_scheduler_and_no_worker_are_clear_errors() -> None:
    with pytest.raises(ClusterError, match=r"--cluster = 127\.0\.0\.1:1 is not allowed"):
        Workers("127.0.0.1:1", patience=1.0)
    with distributed.LocalCluster(
        n_workers=0, processes=False, dashboard_address=":0", silence_logs=50
    ) as empty:
        tested = problem()
        chunks = tested.chunks(tested.space.default, tested.ensemble, tested.rate)
        with (
            Workers(empty.scheduler_address, patience=1.0) as workers,
            pytest.raises(ClusterError, match="one or more workers"),
        ):
            list(run_chunks(chunks, workers))


def test_worker_with_other_sources_is_refused_though_its_kernels_are_the_same(
    tmp_path: Path,
) -> None:
    """A worker with other sources is refused although its kernels are the same.

    The worker's copy of the project measures a tenth less. It must not contribute to the result,
    which would not show the difference.
    """
    for package in ("impact_env", "optimisation"):
        shutil.copytree(
            ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    measures = tmp_path / "optimisation" / "measures.py"
    before = measures.read_text()
    measures.write_text(before.replace("return read(response)\n", "return 0.9 * read(response)\n"))
    assert measures.read_text() != before
    tested = problem()
    chunks = tested.chunks(tested.space.default, tested.ensemble, tested.rate)
    assert len(chunks) > 1
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    with distributed.LocalCluster(
        n_workers=0, processes=False, protocol="tcp://", dashboard_address=":0", silence_logs=50
    ) as local:
        address = local.scheduler_address
        command = [
            sys.executable,
            "-m",
            "distributed.cli.dask_worker",
            address,
            "--no-nanny",
            "--nthreads",
            "1",
            "--no-dashboard",
        ]
        worker = subprocess.Popen(
            command,
            env=environment,
            cwd=tmp_path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            with (
                Workers(address, patience=120.0) as workers,
                pytest.raises(
                    ClusterError, match=r"worker = tcp://.* same version .*sources\.code is"
                ),
            ):
                list(run_chunks(chunks, workers))
        finally:
            worker.kill()
            worker.wait()


@pytest.fixture
def address() -> Iterator[str]:
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0", silence_logs=50
    ) as local:
        yield local.scheduler_address


def test_a_command_gives_with_a_cluster_what_it_gives_without(address: str, tmp_path: Path) -> None:
    line = [
        "--modes",
        "2",
        "--no-sweeps",
        "--method",
        "balance",
        "--friction-limit",
        "0.02",
        "--from",
        "1.02",
        "--to",
        "1.04",
    ]
    runs = ["--envelope", "2", "--members", "2", "--settle", "50", "--window", "20"]
    files = [tmp_path / name for name in ("a.json", "b.json")]
    for file, where in zip(files, (["--threads", "1"], ["--cluster", address]), strict=True):
        done(periodic_branches, *line, *runs, *where, "--json", str(file))
    here, remote = (json.loads(file.read_text()) for file in files)
    assert here == remote
    assert [point["omega_ratio"] for point in here["stationary"]] == [1.02, 1.04]


LINES: dict[str, list[object]] = {
    "design_gap": ["--force", 3.5, "--modes", 2, "--rate", 40, "--gaps", 3, "--no-card"],
    "compare_absorbers": ["--forces", 2],
    "mass_ratios": ["--mass-ratio", 0.02, "--resonances", 1, 1, "--rate", 100],
    "sweep": [*SHORT, "--absorber", "impact", "--force", 3.5],
}
RESULTS = {"design_gap": "levels.csv", "compare_absorbers": "runs.csv"}


@pytest.mark.parametrize("name", LINES)
def test_each_command_sends_its_runs_to_the_cluster_and_gives_the_same_numbers(
    name: str, address: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    sent = []
    each = Workers.each

    def counted(self, function, items, kinds):
        sent.append(len(items))
        return each(self, function, items, kinds)

    monkeypatch.setattr(Workers, "each", counted)
    monkeypatch.setattr("optimisation.comparison.minimax", den_hartog)
    command = load(name, monkeypatch)
    if name == "compare_absorbers":
        monkeypatch.setattr(
            command,
            "compare",
            lambda *_own, **options: compare(
                Beam(modes=2), **(options | {"percent_per_100_periods": 80.0})
            ),
        )
    texts = []
    members = ["--members", 2]
    for where in ([], ["--cluster", address]):
        folder = tmp_path / f"{len(where)}"
        folder.mkdir()
        files: list[object] = ["--out", folder] if name in RESULTS else []
        files = ["--json", "-"] if name == "sweep" else files
        result = done(command, *LINES[name], *members, *where, *files)
        texts.append((folder / RESULTS[name]).read_text() if name in RESULTS else result.stdout)
        assert bool(sent) == bool(where)
    assert texts[0] == texts[1]
