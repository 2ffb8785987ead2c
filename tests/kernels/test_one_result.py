import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from places import ROOT, SUPPORT


def run(*words: str, folder: Path | None = None) -> str:
    """Return what the scene gives in a fresh process; ``folder``: its kernel cache, None: that of these tests."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(SUPPORT), str(ROOT)])}
    if folder is not None:
        environment["IMPACT_ENV_CACHE"] = str(folder)
    result = subprocess.run([sys.executable, str(SUPPORT / "one_result.py"), *words], env=environment, capture_output=True, text=True, timeout=580)
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


@cache
def truth() -> str:
    return run()


@pytest.mark.parametrize("words", [[], ["frictionless"], ["none", "stuck", "tuned", "damper", "moreau"], ["moreau", "damper", "tuned", "none"]])
def test_one_scene_gives_one_result_whatever_its_process_ran_before(words: list[str]) -> None:
    assert run(*words) == truth()


@pytest.mark.parametrize("words", [["none", "child"], ["none", "dask"]])
def test_a_study_s_child_and_a_worker_give_the_same(words: list[str]) -> None:
    if "dask" in words:
        pytest.importorskip("distributed")
    assert run(*words) == truth()


def test_a_mixed_batch_gives_the_same_on_any_number_of_threads() -> None:
    alone = run("threads", "1")
    assert [run("threads", "2"), run("threads", "4")] == [alone, alone]
