"""After Ctrl-C a command exits with code 130 and one line.

Finished results are saved. The same command continues from them or starts again.
"""

import hashlib
import importlib
import inspect
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from commands import call, done, load
from filelock import FileLock
from places import ROOT

from optimisation.cli.group import file_of, missing_extras
from optimisation.files import read_json
from optimisation.tuned import den_hartog

CONSOLE = "from optimisation.cli.start import main; main()"
SIMULATE = "impact_env.ensemble.simulate"
MEASURE = "optimisation.problem.measure"
SUMMARY = "summary.json"
PERIODIC = "impact_env.periodic"
FAST = "--rate 100 --threads 1"
DESIGNS = f"--modes 2 --members 2 --batch 4 --designs 5 {FAST}"
PLAIN = "--concept friction --no-figures --audit 0"
ORBITS = "--modes 1 --restitution 0.75 --force 1.5 --from 0.92 --to 0.94 --points 3"
RESPONSE = "--modes 3 --friction-limit 0.01 --method exact --from 0.93 --to 0.95 --rate 20"
ISOLA = "--modes 3 --from 0.93 --map-modes 1,3 --map-friction-limits 0,0.01"
REGIMES = (
    "--modes 2 --friction-limit 0.025 --force 1.5 --quick --members 6 --points 3 --from 0.98 --to "
    "0.96 --approach 1 --only jump --threads 1"
)


class Stop(NamedTuple):
    """A command that is interrupted at call number ``at`` of a function.

    For a generator, ``at`` counts the values that it yields.

    ``partial_file`` is the JSON file that it leaves (None: none). ``same`` is the file that in the
    end equals that of a run without interruption. Where the command continues from saved results,
    ``calls`` counts the calls of both runs together, the interrupted call included.
    """

    name: str
    line: str
    function: str
    at: int
    partial_file: str | None
    same: str | None
    calls: int | None = None
    again: str = ""


STOPS = (
    Stop(
        "sweep",
        "--modes 2 --from 0.98 --to 1 --rate 10 --members 3 --json a.json",
        SIMULATE,
        1,
        None,
        "a.json",
    ),
    Stop(
        "compare_absorbers",
        f"--resonances 1 1 --forces 2 --members 2 {FAST} --out .",
        SIMULATE,
        9,
        SUMMARY,
        "runs.csv",
    ),
    Stop(
        "design_gap",
        f"--force 3.5 --modes 2 --gaps 3 --members 2 {FAST} --out .",
        SIMULATE,
        5,
        SUMMARY,
        "levels.csv",
    ),
    Stop(
        "design_place",
        (
            "--force 3.5 --modes 2 --mass-ratio 0.02 --mass-ratio 0.03 --position 1 --members 1 "
            f"{FAST} --no-card --out ."
        ),
        SIMULATE,
        45,
        SUMMARY,
        "places.csv",
    ),
    Stop(
        "mass_ratios",
        f"--mass-ratio 0.02 --resonances 1 1 --members 1 {FAST}",
        SIMULATE,
        2,
        None,
        None,
    ),
    Stop(
        "optimise_design",
        f"{DESIGNS} {PLAIN} --out .",
        MEASURE,
        4,
        f"friction/{SUMMARY}",
        "friction/designs.csv",
    ),
    Stop(
        "pareto", f"{DESIGNS} --out .", MEASURE, 4, f"resonances/{SUMMARY}", "resonances/front.csv"
    ),
    Stop(
        "orbits",
        f"{ORBITS} --json a.json",
        "optimisation.cli.periodic_orbits.all_orbits_over",
        2,
        "a.json",
        "a.json",
    ),
    Stop(
        "orbits",
        f"{ORBITS} --symmetric --json a.json",
        "optimisation.cli.periodic_orbits.orbits_over",
        2,
        "a.json",
        "a.json",
    ),
    Stop(
        "frequency_response",
        f"{RESPONSE} --resume kept.json --json a.json",
        f"{PERIODIC}.overview.sweep_envelope",
        2,
        "a.json",
        "a.json",
        3,
    ),
    Stop(
        "isola",
        f"{ISOLA} --resume kept.json --json a.json",
        f"{PERIODIC}.isolas.make_cell",
        3,
        "a.json",
        "a.json",
        5,
    ),
    Stop(
        "manifold",
        "--modes 1 --points 2 --forces 3 --map-modes 1 --json a.json",
        f"{PERIODIC}.slow_manifold.closed_form_orbits",
        4,
        "a.json",
        "a.json",
    ),
    Stop(
        "periodic basins",
        (
            "--modes 1 --restitution 0.75 --over frequency 0.92 0.94 --points 3 --starts 2 "
            "--threads 1 --json a.json"
        ),
        f"{PERIODIC}.basins.settle_runs",
        2,
        "a.json",
        "a.json",
    ),
    Stop(
        "periodic basins",
        (
            "--modes 1 --over frequency 0.92 0.94 --points 2 --map force 1 2 --map-points 2 "
            "--threads 1 --json a.json"
        ),
        f"{PERIODIC}.attractors.settle_motion",
        3,
        "a.json",
        "a.json",
    ),
    Stop(
        "periodic diagram",
        (
            "--modes 1 --restitution 0.75 --over frequency 0.92 0.94 --points 2 --no-branches "
            "--json a.json"
        ),
        f"{PERIODIC}.diagrams.settle_motion",
        3,
        "a.json",
        "a.json",
    ),
    Stop(
        "periodic section",
        "--modes 1 --restitution 0.75 --frequency 0.93 --starts 3 --threads 1 --json a.json",
        f"{PERIODIC}.attractors.settle_motion",
        2,
        "a.json",
        "a.json",
    ),
    Stop(
        "regimes",
        f"{REGIMES} --out .",
        "studies.regimes.measured.residence_times",
        2,
        "jump.json.gz",
        "jump_stay.csv",
        4,
        "--resume",
    ),
)


def broken_off(function: str, at: int, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Break a function off at its call number ``at``; return a list that grows with each call."""
    module, _, name = function.rpartition(".")
    whole = getattr(importlib.import_module(module), name)
    calls = list[str]()

    def counted() -> None:
        calls.append(function)
        if len(calls) == at:
            raise KeyboardInterrupt

    def stopped(*arguments: Any, **named: Any) -> Any:
        counted()
        return whole(*arguments, **named)

    def stopped_within(*arguments: Any, **named: Any) -> Iterator[Any]:
        results = whole(*arguments, **named)
        while True:
            counted()
            try:
                value = next(results)
            except StopIteration:
                return
            yield value

    monkeypatch.setattr(function, stopped_within if inspect.isgeneratorfunction(whole) else stopped)
    return calls


@pytest.mark.parametrize("stop", STOPS, ids=lambda stop: f"{stop.name}-{stop.function}")
def test_an_interrupted_command_saves_finished_parts_and_continues(
    stop: Stop, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = file_of(stop.name)
    assert file is not None
    if missing_extras(file):
        pytest.skip("a package that it needs is not installed")
    monkeypatch.setattr("optimisation.comparison.minimax", den_hartog)  # in closed form
    command = load(stop.name, monkeypatch)
    whole = tmp_path / "whole"
    parted = tmp_path / "parted"
    for folder in (whole, parted):
        folder.mkdir()
    monkeypatch.chdir(whole)
    done(command, *shlex.split(stop.line))
    monkeypatch.chdir(parted)
    calls = broken_off(stop.function, stop.at, monkeypatch)
    result = call(command, *shlex.split(stop.line))
    assert result.exit_code == 130, result.output
    assert "Traceback" not in result.output
    assert "Stopped early: " in result.stderr or result.stderr.endswith("Broken off.\n")
    if stop.partial_file is None:
        assert list(parted.iterdir()) == []
    else:
        resumed, wanted = (read_json(folder / stop.partial_file) for folder in (parted, whole))
        assert (
            resumed == wanted[: len(resumed)] != []
            if isinstance(resumed, list)
            else not resumed.get("complete", resumed.get("finished"))
        )
    done(command, *shlex.split(stop.line), *shlex.split(stop.again))
    assert stop.calls in (None, len(calls))
    if stop.same is not None:
        assert (parted / stop.same).read_text() == (whole / stop.same).read_text()


def heed_interrupts() -> None:
    """Let a process that is about to start react to Ctrl-C.

    A shell ignores the signal in background jobs, in which these tests may run.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal as a terminal does")
def test_during_imports_it_is_one_line(tmp_path: Path) -> None:
    """Ctrl-C during imports gives one line.

    A module that takes for ever is first on the path, so that the signal arrives while it is
    imported.
    """
    mark = tmp_path / "there"
    (tmp_path / "click.py").write_text(
        f"import pathlib, time\npathlib.Path({str(mark)!r}).touch()\ntime.sleep(100)\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    words = [sys.executable, "-c", CONSOLE, "optimise_design"]
    pipe = subprocess.PIPE
    process = subprocess.Popen(
        words,
        cwd=ROOT,
        env=environment,
        stdout=pipe,
        stderr=pipe,
        text=True,
        preexec_fn=heed_interrupts,
    )
    until = time.monotonic() + 120
    while not mark.exists() and process.poll() is None and time.monotonic() < until:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (130, "", "Broken off.\n")


ENDLESS = """
import ctypes, pathlib, sys
from impact_env.kernels.compiling import numba_internals
def compile_endlessly(*_):
    pathlib.Path("compiling").touch()
    while True:
        ctypes.CDLL(None).sleep(100)  # as LLVM it heeds no signal
numba_internals._WholeCompiler._compile_core = compile_endlessly
"""
SCENE = """
import impact_env as i
scene = i.beam_scene(absorber=i.impact_absorber())
load = i.Drive(1.0, i.linear_sweep(scene.model.resonance_omega(1)))
"""
COMPILING = {
    "sweep": CONSOLE,
    "sweep --members 2": CONSOLE,
    "orbits --at 0.95": CONSOLE,
    "optimise_design --quick": CONSOLE,
    "judge --task GapChoice-v1": CONSOLE,
    "simulate": SCENE + "i.simulate(scene, load)",
    "run_lanes": SCENE
    + (
        "from impact_env.ensemble import Lane, run_lanes\nassert not run_lanes([Lane(scene, "
        "load)] * 2).complete\nraise KeyboardInterrupt"
    ),
    "environment": "import gymnasium, impact_env.envs\nenv = "
    "gymnasium.make('ImpactAbsorber/GapChoice-v1')\nenv.reset(seed=0)\n"
    "env.step(env.action_space.sample())",
    "warm_up": "import time\nfrom functools import partial\nfrom pathlib import Path\nfrom "
    "impact_env.warm_up import warm_up\n"
    "warm_up([('a', Path('compiling').touch), *[('b', partial(time.sleep, 1000))] * 2], print, 2)",
}
NEEDED = {"optimise_design": "optuna", "judge": "gymnasium", "environment": "gymnasium"}


def interrupted(code: str, words: str, folder: Path, mark: Path) -> tuple[int, str]:
    """Return exit code and standard error of a process that is interrupted.

    The process gets the signal of a terminal when the file ``mark`` exists.
    """
    cache = folder / "cache"
    environment = os.environ | {"PYTHONPATH": str(ROOT), "IMPACT_ENV_CACHE": str(cache)}
    process = subprocess.Popen(
        [sys.executable, "-c", code, *shlex.split(words)],
        cwd=folder,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_interrupts,
    )
    until = time.monotonic() + 120
    while not mark.exists() and process.poll() is None and time.monotonic() < until:
        time.sleep(0.05)
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    try:
        _, err = process.communicate(timeout=60)
    except subprocess.TimeoutExpired:
        process.kill()
        raise
    return process.returncode, err


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal as a terminal does")
@pytest.mark.parametrize("words", COMPILING)
def test_a_compiler_that_never_ends_is_left_behind(words: str, tmp_path: Path) -> None:
    if words.split()[0] in NEEDED:
        pytest.importorskip(NEEDED[words.split()[0]])
    command = COMPILING[words] == CONSOLE
    code, err = interrupted(
        ENDLESS + COMPILING[words], words if command else "", tmp_path, tmp_path / "compiling"
    )
    if command:
        assert code == 130
        assert err.splitlines()[-1].startswith(("Broken off", "Stopped early"))
        assert "Traceback" not in err
    else:
        assert code == -signal.SIGINT  # what Python does with a KeyboardInterrupt that nobody takes
        assert err.splitlines()[-1] == "KeyboardInterrupt"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal as a terminal does")
def test_kernels_are_whole_after_a_compilation_that_was_left_behind(tmp_path: Path) -> None:
    """Kernels are complete after an abandoned compilation.

    The compiler is that of numba. The cache has only complete files, its lock is free, and no
    temporary file is left.
    """
    started = "from impact_env import on_compile\nfrom pathlib import Path\n"
    started += "on_compile(lambda about: Path('compiling').touch())\n" + SCENE
    code, err = interrupted(
        started + "i.simulate(scene, load)", "", tmp_path, tmp_path / "compiling"
    )
    assert (code, err.splitlines()[-1]) == (-signal.SIGINT, "KeyboardInterrupt")
    (cache,) = (tmp_path / "cache").iterdir()
    with FileLock(cache / "lock", timeout=0):
        pass
    files = [file for file in cache.rglob("*") if file.is_file() and file.name != "lock"]
    for file in files:
        assert file.suffix in (".nbi", ".nbc")
        content = file.read_bytes()
        assert hashlib.sha256(content[:-32]).digest() == content[-32:]
