"""What a first use from Python tells: one line after a second of compiling, wherever stderr goes, and nothing in a warm run."""

import gc
import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core import event
from places import ROOT, SUPPORT

from impact_env import Beam, Drive, Record, beam_scene, constant_frequency, friction_damper, impact_absorber, impact_absorbers, simulate
from impact_env.kernels.compiling.parts import COMPILING
from impact_env.kernels.exact.rigid import exact_lane
from impact_env.modes import modal_model
from impact_env.periodic.case import Case
from impact_env.periodic.survey import orbits_over
from impact_env.periodic.validation import shortest_validation

RUN = """
from impact_env import Beam, Drive, beam_scene, constant_frequency, first_use, simulate
first_use.PATIENCE = 0.3  # s: the smallest kernel is compiled in a few seconds
scene = beam_scene(Beam(modes=2))
simulate(scene, Drive(1.0, constant_frequency(scene.model.resonance_omega(1), 1.0, 3.0)))
"""
SMALL = """
import time
import numba
from impact_env import first_use, on_compile
from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.compiling.parts import only_kept, NotKept
first_use.PATIENCE = 0.0

def wait(_):
    time.sleep(0.5)  # which counts, so that it takes longer than no time

def kernel(value):
    def add(x):
        return x + value
    return jit(add)

on_compile(wait)
with first_use.CompilingFor("a scene", "a method"):
    for value in (1, 2):
        kernel(value)(1)
"""
LOGGED = "import logging; logging.basicConfig(level=logging.INFO, format='LOG %(name)s: %(message)s')"
OWN = """
end_all = on_compile(lambda about: print(about.what, about.state, about.seconds > 0.4))

def fail(about):
    raise ValueError("a callback of one's own")

end_fail = on_compile(fail)
numba.njit(lambda x: x + 1)(1)  # someone else's
print("third")
kernel(3)(1)
end_fail()
try:
    with only_kept():
        kernel(4)(1)
except NotKept:
    print("not kept")
kernel(3)(1)  # is kept
end_all()
end_all()  # once more is no error
kernel(5)(1)
"""
pty = pytest.importorskip("pty")


def script(code: str, folder: Path) -> tuple[list[str | Path], dict[str, str]]:
    """Return words and variables of a process that runs code with a folder for kernels."""
    if not (file := folder / "script.py").exists() or file.read_text() != code:
        file.write_text(code)  # older numba goes by the time of its last change
    return [sys.executable, file], os.environ | {"PYTHONPATH": str(ROOT), "IMPACT_ENV_CACHE": str(folder)}


def on_a_terminal(code: str, folder: Path) -> str:
    """Run code in a fresh process whose stderr is a terminal, and return what it wrote there."""
    ours, theirs = pty.openpty()
    words, environment = script(code, folder)
    process = subprocess.Popen(words, env=environment, stderr=theirs)
    os.close(theirs)
    text = b""
    while True:
        try:
            piece = os.read(ours, 1024)
        except OSError:  # Linux's way to tell that the other end is closed
            piece = b""
        if not piece:
            break
        text += piece
    os.close(ours)
    assert process.wait() == 0, text.decode()
    return text.decode()


@pytest.fixture(scope="module")
def first_use(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """What was told when everything had to be compiled, and where it is kept."""
    folder = tmp_path_factory.mktemp("kernels")
    return folder, on_a_terminal(RUN, folder)


def test_the_first_use_is_told_once_and_a_warm_one_not_at_all(first_use: tuple[Path, str]) -> None:
    folder, told = first_use
    text = " ".join(told.split())
    assert text.count("impact_env: compiling the kernels of") == 1
    assert text.startswith("impact_env: compiling the kernels of: 2 modes, no absorber, Exact")
    assert "python -m impact_env.warm_up" in text
    assert on_a_terminal(RUN, folder) == ""


def without_a_terminal(code: str, folder: Path) -> tuple[list[str], list[str]]:
    """Run code in a fresh process and return the lines of stdout and stderr."""
    words, environment = script(code, folder)
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    return done.stdout.splitlines(), done.stderr.splitlines()


def test_a_log_takes_the_place_of_the_line(tmp_path: Path) -> None:
    text = on_a_terminal(LOGGED + SMALL, tmp_path)
    assert text.count("compiling") == 2
    assert text.startswith("LOG impact_env: impact_env: compiling the kernels of: a scene, a method")


def test_each_compilation_is_told_where_there_is_no_terminal(tmp_path: Path) -> None:
    lines = without_a_terminal(SMALL, tmp_path)[1]
    assert len(lines) == 2
    assert all(line.startswith("impact_env: compiling the kernels of: a scene, a method. Once for a kind of scene") for line in lines)
    assert without_a_terminal(SMALL, tmp_path)[1] == []


def test_what_takes_no_second_is_not_told(tmp_path: Path) -> None:
    assert without_a_terminal(SMALL.replace("PATIENCE = 0.0", "PATIENCE = 1000.0"), tmp_path) == ([], [])


def test_callbacks_are_told_of_our_kernels_until_they_are_taken_out(tmp_path: Path) -> None:
    out, error = without_a_terminal(SMALL + OWN, tmp_path)
    assert out == ["third", "kernels started False", "kernels finished True", "not kept"]
    assert error.count("ValueError: a callback of one's own") == 2


def test_garbage_is_looked_for_seldom_while_something_compiles_and_as_before_after_that() -> None:
    before = gc.get_threshold()
    with event.trigger_event(COMPILING):
        assert gc.get_threshold()[0] > 10 * before[0]
    assert gc.get_threshold() == before


def test_responses_and_scenes_are_shown_in_a_line_or_two() -> None:
    scene = beam_scene(Beam(modes=2))
    assert repr(scene) == "Scene(2 modes, no absorber)"
    run = simulate(scene, Drive(1.5, constant_frequency(scene.model.resonance_omega(1), 1.0, 3.0)))
    first, second = repr(run).splitlines()
    assert first == "Response(2 modes, no absorber"
    assert second.strip().startswith(f"1.5 N from 0 to {run.drive.schedule.times[-1]:.4g} s, level {1e3 * run.level.value:.4g} mm at ")
    assert second.endswith(", 0 impacts)")
    assert "level" not in repr(simulate(scene, run.drive, record=Record(level=False)))
    words = {
        impact_absorber(0.5e-3, 0.7, 0.1): "impact absorber, mass ratio 0.02, gap 0.5 mm, restitution 0.7, friction limit 0.1 N",
        friction_damper(): "friction damper, mass ratio 0.02, friction limit 0.5 N",
    }
    for absorber, expected in words.items():
        assert repr(beam_scene(Beam(modes=1), absorber)) == f"Scene(1 mode, {expected})"
    two = repr(beam_scene(Beam(), impact_absorbers([1e-3, 2e-3], [0.5, 1.0])))
    assert "at 0.5 of the length impact absorber, mass ratio 0.01, gap 1 mm" in two
    assert "at 1 of the length impact absorber, mass ratio 0.01, gap 2 mm" in two


# A kernel that another process compiles is loaded from there, or compiled here if that fails; and validations of orbits use the kernel meant.


@pytest.mark.parametrize(
    ("way", "first", "again"),
    [("well", "False 1 1 0 None True", "True 0 1 0 None True"), ("badly", "False 1 0 0 None True", ""), ("alone", "False 0 0 0 None True", "")],
)
def test_a_kernel_comes_from_the_other_process_or_else_from_here(tmp_path: Path, way: str, first: str, again: str) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "IMPACT_ENV_CACHE": str(tmp_path)}
    for told in (first, again) if again else (first,):
        words = [sys.executable, str(SUPPORT / "beside.py"), way]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=120)
        assert done.stdout.strip() == told, done.stderr
        assert all(line.startswith("impact_env: compiling ") for line in done.stderr.splitlines())


def test_the_shortest_trial_has_the_kernels_of_trials() -> None:
    model = modal_model(Beam(modes=2))
    case = Case(model, 0.95 * float(model.omega[0]), 1.5, friction_limit=0.01)
    shortest_validation(case)
    known = list(exact_lane.signatures)
    assert any(found.orbits for found in orbits_over(case, [0.95, 0.96]))
    assert exact_lane.signatures == known
