import os
import subprocess
import sys
from functools import cache

import pytest
from places import ROOT, SUPPORT


def run(*words: str) -> str:
    """Return the scene's result in a fresh process."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(SUPPORT), str(ROOT)])}
    result = subprocess.run([sys.executable, str(SUPPORT / "one_result.py"), *words], env=environment, capture_output=True, text=True, timeout=580)
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


@cache
def truth() -> str:
    return run()


@pytest.mark.parametrize("words", [["frictionless", "stuck", "moreau", "damper", "tuned", "none"], ["none", "child"], ["none", "dask"]])
def test_one_scene_gives_one_result_whatever_its_process_ran_before_and_in_a_child_and_on_a_worker(words: list[str]) -> None:
    if "dask" in words:
        pytest.importorskip("distributed")
    assert run(*words) == truth()


def test_a_mixed_batch_gives_the_same_on_any_number_of_threads() -> None:
    assert run("threads", "1") == run("threads", "4")
