"""Commands at their limits: one message and the right exit code, from fresh processes where that is what counts."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from places import ROOT

pytest.importorskip("optuna")
pytest.importorskip("cmaes")

import click
from click.testing import CliRunner
from commands import FAST, call, load

from optimisation.cli.common import end_early, json_option, name_files, plain_errors
from optimisation.evaluation import Threads
from optimisation.extremes import usable_force, usable_mass_ratio, usable_rate
from optimisation.files import write_json


@pytest.mark.parametrize("name", ["optimise_design", "pareto"])
@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["--at", "1:1e300", "--at", "2:1"], ["force = 1e+300 is not allowed", "at most 1e+12 N"]),
        (["--rate", 1e-9], ["rate = 1e-09 is not allowed", "from 1.6e-06 to 320 %"]),
        (["--rate", 1e9], ["rate = 1000000000.0 is not allowed", "from 1.6e-06 to 320 %"]),
        (["--fix", "mass_ratio", 100], ["mass_ratio = 100.0 is not allowed", "at most 1: an absorber no heavier than the structure"]),
        (["--study", "nowhere/a.journal"], ["study file = nowhere/a.journal is not allowed", "in a folder that exists"]),
        (["--study", "/dev/full"], ["study file = /dev/full is not allowed"]),
    ],
)
def test_what_no_study_can_use_is_one_message(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str, arguments: list[object], names: list[str]
) -> None:
    monkeypatch.setattr(Threads, "run", lambda *_: pytest.fail("computed"))
    result = call(load(name, monkeypatch), *arguments, "--out", tmp_path)
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.count("Error") == 1
    assert all(part in result.stderr for part in names), result.stderr
    assert not [file for file in tmp_path.rglob("*") if file.is_file()]


def test_bounds_of_what_is_usable() -> None:
    assert usable_force("force", 1e12) == 1e12
    assert usable_mass_ratio("mass", 1) == 1.0
    assert usable_rate("rate", 400, [(0.9, 1.1)]) == 400.0  # 20 % in 5 periods
    assert usable_rate("rate", 1e-4, [(0.9, 1.1), (0.5, 1.6)]) == 1e-4  # the default at the least damping that has one of its own
    for function, value in ((usable_force, 1.1e12), (usable_force, 0.0), (usable_mass_ratio, 1.01), (usable_mass_ratio, -1.0)):
        with pytest.raises(ValueError, match=r"number = .* is not allowed"):
            function("number", value)
    for rate in (401.0, 1.9e-6, float("nan"), 0.0):
        with pytest.raises(ValueError, match=r"rate = .* is not allowed"):
            usable_rate("rate", rate, [(0.9, 1.1)])


@pytest.mark.parametrize("concept", ["impact", "friction"])
def test_no_winner_is_exit_code_1_and_the_files_say_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, concept: str) -> None:
    limit = ["--constraint", "mass_ratio", 0.001, "--no-figures"]  # the absorber has 2 %
    result = call(load("optimise_design", monkeypatch), *FAST, "--concept", concept, "--designs", 5, *limit, "--out", tmp_path)
    assert result.exit_code == 1, result.output
    assert result.stderr == "No winner: no design kept all constraints; loosen them, or search longer.\n"
    assert (tmp_path / concept / "summary.json").exists()


def test_quick_and_full_studies_lie_side_by_side(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    script, small = load("optimise_design", monkeypatch), [*FAST, "--concept", "friction", "--designs", 5, "--no-figures", "--out", tmp_path]
    for look in (["--quick", "--rate", 4], [], ["--quick", "--rate", 4], []):
        result = call(script, *small, *look)
        assert result.exit_code == 0, result.output
    assert {file.name for file in (tmp_path / "friction").glob("*.journal")} == {"study.journal", "quick.journal"}


def test_full_disk_is_one_message_and_exit_code_1() -> None:
    import click

    @click.command()
    def command() -> None:
        with plain_errors():
            raise OSError(28, "No space left on device", "results/study.journal")

    result = CliRunner().invoke(command)
    assert result.exit_code == 1
    assert result.output == "Error: results/study.journal: No space left on device\n"


def heed_interrupts() -> None:
    """Let a process that is about to start notice Ctrl-C, also where these tests run in the background of a shell, which ignores it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal as a terminal does")
@pytest.mark.parametrize("start", [["-c", "from optimisation.cli.start import main; main()"], ["-m", "optimisation.cli.group"]])
def test_interrupt_during_imports_is_one_line(tmp_path: Path, start: list[str]) -> None:
    """A module that takes for ever stands first on the path: the signal comes while it is being imported."""
    (tmp_path / "cmaes.py").write_text("")
    mark = tmp_path / "there"
    (tmp_path / "tqdm.py").write_text(f"import pathlib, time\npathlib.Path({str(mark)!r}).touch()\ntime.sleep(100)\n")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    process = subprocess.Popen(
        [sys.executable, *start, "optimise_design"],
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_interrupts,
    )
    until = time.monotonic() + 120
    while not mark.exists() and process.poll() is None and time.monotonic() < until:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (130, "", "Broken off.\n")


@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal as a terminal does")
def test_interrupt_before_the_console_command_has_begun_is_one_line(tmp_path: Path) -> None:
    mark = tmp_path / "there"
    (tmp_path / "click.py").write_text(f"import pathlib, time\npathlib.Path({str(mark)!r}).touch()\ntime.sleep(100)\n")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    command = [sys.executable, "-c", "from optimisation.cli.start import main; main()"]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=heed_interrupts)
    until = time.monotonic() + 120
    while not mark.exists() and process.poll() is None and time.monotonic() < until:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (130, "", "Broken off.\n")


def test_certificate_that_is_not_optimal_leaves_its_cell_empty(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("cvxpy")
    from optimisation.convex import NotOptimalError
    from optimisation.tuned.certificate import certify

    script, calls = load("tune_ltva", monkeypatch), []

    def once(*given: object) -> object:
        calls.append(given)
        if len(calls) == 2:
            raise NotOptimalError("largest amplitude: the solver ended with status 'optimal_inaccurate'")
        return certify(*given)  # type: ignore[arg-type]

    monkeypatch.setattr("optimisation.tuned.certificate.certify", once)
    result = call(script, "--modes", 2, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert "Not proved, paper's values: largest amplitude: the solver ended with status 'optimal_inaccurate'" in result.stderr
    rows = [line for line in result.stdout.splitlines() if line.startswith("|")][2:]
    proved = [row.strip("| ").split("|")[-1].strip() if row.count("|") == 10 else None for row in rows]
    cells = [row.split("|")[-2].strip() for row in rows]
    assert [cell == "" for cell in cells] == [k == 1 for k in range(len(rows))], (cells, proved)
    lines = (tmp_path / "tunings.csv").read_text().splitlines()
    assert sum(line.endswith(",") for line in lines) == 1


@pytest.mark.parametrize("name", ["compare_absorbers", "findings", "optimise_design"])
def test_cluster_is_an_option_of_commands_with_many_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("optimisation.search.cluster.Workers.__init__.__defaults__", (1.0,))
    monkeypatch.setattr(Threads, "run", lambda *_: pytest.fail("computed"))
    script = load(name, monkeypatch)
    for arguments, names in (
        (["--threads", 2], "--threads = 2 is not allowed: with --cluster"),
        ([], "--cluster = 127.0.0.1:1 is not allowed: an address"),
    ):
        result = call(script, "--cluster", "127.0.0.1:1", *arguments, "--out", tmp_path)
        assert result.exit_code == 2, result.output
        assert result.stdout == ""
        assert names in result.stderr


def test_json_alone_goes_to_standard_output_and_what_is_finished_after_an_early_end() -> None:
    @click.command()
    @json_option("Numbers.", "target")
    def command(target: Path) -> None:
        click.echo("a table")
        write_json(target, [1])
        name_files([target])
        end_early(False)

    result = call(command, "--json", "-")
    assert (result.exit_code, json.loads(result.stdout)) == (130, [1])
    assert "a table\n\nwritten: standard output\nStopped early" in result.stderr
