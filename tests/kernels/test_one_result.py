from functools import cache

import pytest
from places import SUPPORT, fresh


@cache
def run(*words: str) -> str:
    """Return the scene's result in a fresh process."""
    return fresh(SUPPORT / "one_result.py", *words).stdout.strip()


@pytest.mark.parametrize(
    "words",
    [
        ["frictionless", "stuck", "moreau", "damper", "tuned", "none"],
        ["none", "child"],
        ["none", "dask"],
    ],
)
def test_one_scene_gives_one_result_whatever_its_process_ran_before_and_in_a_child_and_on_a_worker(
    words: list[str],
) -> None:
    if "dask" in words:
        pytest.importorskip("distributed")
    assert run(*words) == run()


def test_a_mixed_batch_gives_the_same_on_any_number_of_threads() -> None:
    assert run("threads", "1") == run("threads", "4")
