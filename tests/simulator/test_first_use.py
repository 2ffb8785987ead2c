"""Compilation at a first use is reported correctly.

Kernels that another process compiles, and those that validations of orbits compile, are tested as
well.
"""

import gc
import time
from functools import partial
from pathlib import Path

import pytest
from numba.core import event
from places import SUPPORT, fresh

from impact_env import (
    Beam,
    ParameterError,
    RungeKutta,
    beam_scene,
    first_use,
    impact_absorber,
    prepare,
)
from impact_env.kernels.compiling.parts import COMPILING
from impact_env.kernels.exact.rigid import rigid_lane
from impact_env.modes import modal_model
from impact_env.periodic.case import Case
from impact_env.periodic.survey import orbits_over
from impact_env.periodic.validation import shortest_validation
from impact_env.prepare import Preparation

STARTED = """
import os
from impact_env import Beam, Drive, beam_scene, constant_frequency, on_compile, simulate
on_compile(lambda about: (print(about.what, flush=True), os._exit(0)))  # what it is for; nothing needs to be compiled
scene = beam_scene(Beam(modes=2))
simulate(scene, Drive(1.0, constant_frequency(scene.model.resonance_omega(1), 1.0, 3.0)))
"""
PREPARED = """
from impact_env import Beam, Drive, beam_scene, constant_frequency, first_use, is_ready, on_compile, prepare, simulate
first_use.SILENT_SECONDS = 0.0
scene, told = beam_scene(Beam(modes=2)), []
on_compile(told.append)
before = is_ready(scene)
work = prepare(scene)
early = work.wait(0.0)
print(before, early, work.wait(120.0), work.done, is_ready(scene), 0.5 < work.elapsed == work.elapsed)
simulate(scene, Drive(1.0, constant_frequency(scene.model.resonance_omega(1), 1.0, 3.0)))
print(len(told))
"""
SMALL = """
import time
import numba
from impact_env import first_use, on_compile
from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.compiling.parts import only_cached, NotCached
first_use.SILENT_SECONDS = 0.0

def wait(_):
    time.sleep(0.5)  # which counts, so that it takes longer than no time

def kernel(value):
    def add(x):
        return x + value
    return jit(add)

on_compile(wait)
with first_use.compiling_for("a scene", "a method"):
    for value in (1, 2):
        kernel(value)(1)
"""
LOGGED = (
    "import logging; logging.basicConfig(level=logging.INFO, format='LOG %(name)s: %(message)s')"
)
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
    with only_cached():
        kernel(4)(1)
except NotCached:
    print("not kept")
kernel(3)(1)  # is kept
end_all()
end_all()  # once more is no error
kernel(5)(1)
first_use.SILENT_SECONDS = 1000.0
with first_use.compiling_for("a scene", "a method"):
    kernel(6)(1)  # takes less: is not reported
"""


def run_code(code: str, folder: Path) -> tuple[list[str], list[str]]:
    """Run code in a new process with a folder for kernels.

    Return the lines of stdout and stderr.
    """
    if not (file := folder / "script.py").exists() or file.read_text() != code:
        file.write_text(code)  # older numba goes by the time of its last change
    done = fresh(file, IMPACT_ENV_CACHE=folder)
    return done.stdout.splitlines(), done.stderr.splitlines()


def test_a_run_tells_what_its_kernels_are_for(tmp_path: Path) -> None:
    assert run_code(STARTED, tmp_path)[0] == ["the kernels of: 2 modes, no absorber, Exact()"]


def test_kernels_are_prepared_by_another_process_and_a_warm_run_tells_nothing(
    tmp_path: Path,
) -> None:
    assert run_code(PREPARED, tmp_path) == (["False False True True True True", "0"], [])


def test_a_preparation_can_be_ended() -> None:
    scene = beam_scene(Beam(modes=3))
    work = prepare(scene)
    work.cancel()
    assert work.done
    assert not work.wait(0.0)
    with pytest.raises(ParameterError, match="method = RungeKutta"):
        prepare(beam_scene(Beam(), impact_absorber()), RungeKutta())


@pytest.mark.parametrize("way", ["wait", "done"])
def test_elapsed_is_the_time_until_the_process_ended(way: str) -> None:
    """Also where it is looked at long after the end."""
    began = time.monotonic()
    work = Preparation(partial(time.sleep, 0.3))
    if way == "wait":
        assert work.wait()
    while not work.done:
        time.sleep(0.01)
    latest = time.monotonic() - began
    time.sleep(0.3)
    assert 0.3 < work.elapsed <= latest
    assert work.elapsed == work.elapsed
    assert work.wait(1e30)


def test_compilation_is_reported_once_and_callbacks_are_called_until_they_are_removed(
    tmp_path: Path,
) -> None:
    line = "impact_env: compiling the kernels of: a scene, a method. Once for a kind of scene"
    out, error = run_code(SMALL + OWN, tmp_path)
    assert out == ["third", "kernels started False", "kernels finished True", "not kept"]
    assert error.count("ValueError: a callback of one's own") == 2
    lines = [one for one in error if one.startswith(line)]
    assert len(lines) == 2
    assert "`impact-absorber prepare" in lines[0]
    assert run_code(SMALL + OWN, tmp_path) == (["third", "not kept"], [])  # all others are kept
    error = run_code(LOGGED + SMALL, tmp_path)[1]
    assert [one.startswith(f"LOG impact_env: {line}") for one in error] == [True, True]


def test_garbage_is_looked_for_seldom_while_something_compiles_and_as_before_after_that() -> None:
    before = gc.get_threshold()
    with event.trigger_event(COMPILING):
        assert gc.get_threshold()[0] > 10 * before[0]
    assert gc.get_threshold() == before


@pytest.mark.parametrize(
    ("way", "runs"),
    [
        ("well", ["False 1 1 0 None True", "True 0 1 0 None True"]),
        ("badly", ["False 1 0 0 None True"]),
    ],
    ids=["well", "badly"],
)
def test_a_kernel_comes_from_the_other_process_or_else_from_here(
    tmp_path: Path, way: str, runs: list[str]
) -> None:
    for expected in runs:
        done = fresh(SUPPORT / "other_process.py", way, IMPACT_ENV_CACHE=tmp_path)
        assert done.stdout.strip() == expected, done.stderr
        assert all(line.startswith("impact_env: compiling ") for line in done.stderr.splitlines())


def test_the_shortest_trial_has_the_kernels_of_trials() -> None:
    model = modal_model(Beam(modes=2))
    case = Case(model, 0.95 * float(model.omega[0]), 1.5, friction_limit=0.01)
    shortest_validation(case)
    known = list(rigid_lane.signatures)
    assert any(result.orbits for result in orbits_over(case, [0.95, 0.96]))
    assert rigid_lane.signatures == known


def test_a_cache_that_cannot_be_written_to_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(first_use, "cache_folder", lambda: tmp_path / "used" / "hash")
    monkeypatch.setenv("IMPACT_ENV_CACHE", str(tmp_path / "used"))
    assert first_use.describe_unused_cache() == ""
    monkeypatch.setenv("IMPACT_ENV_CACHE", "/nowhere")
    line = first_use.describe_unused_cache()
    assert line == (
        " IMPACT_ENV_CACHE = '/nowhere' cannot be written to: "
        f"kernels are kept in {tmp_path / 'used'}."
    )
    monkeypatch.setattr(first_use, "cache_folder", lambda: None)
    assert "kept nowhere" in first_use.describe_unused_cache()
    monkeypatch.delenv("IMPACT_ENV_CACHE")
    assert first_use.describe_unused_cache() == ""
