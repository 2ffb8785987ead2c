"""One scene gives one result, bit by bit.

The result is the same after other runs, in a child process, on a worker, and on any number of
threads.
"""

import json
from importlib.util import find_spec

import pytest
from places import SUPPORT, fresh

OTHERS = ("frictionless", "stuck", "moreau", "damper", "tuned", "none")


@pytest.fixture(scope="module")
def alone() -> dict[str, str]:
    """Return the result of a process that runs nothing else."""
    return run_process()


def run_process(*words: str) -> dict[str, str]:
    """Return the results that a fresh process prints."""
    results: dict[str, str] = json.loads(fresh(SUPPORT / "one_result.py", *words).stdout)
    return results


def test_a_result_is_the_same_after_other_runs_in_a_child_and_on_a_worker(
    alone: dict[str, str],
) -> None:
    places = ["child", *(["worker"] if find_spec("distributed") else [])]
    results = run_process(*OTHERS, *places)
    assert results == dict.fromkeys(["here", *places], alone["here"])


def test_a_mixed_batch_gives_the_same_on_any_number_of_threads() -> None:
    results = run_process("threads")
    assert results["1"] == results["4"]
