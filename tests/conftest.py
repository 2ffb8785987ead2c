"""Options of the tests.

They choose the tests to run and record the processor time of each.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest
from choice import QUICK, ROOT
from hypothesis import settings
from plugins import CPUTimes, draw_few_figures, round_models

settings.register_profile("workbench", derandomize=True, deadline=None)
settings.load_profile("workbench")

# their commands write some hundred figures, which would take a third of their time
DRAWING = ("commands", "design", "environments", "periodic", "studies")


@pytest.fixture(autouse=True, scope="module")
def draw_each_kind_once(request: pytest.FixtureRequest) -> Iterator[None]:
    """Draw one figure of each kind, with few pixels, in the folders that write many."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.parent.name in DRAWING:
            draw_few_figures(patch)
        yield


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("workbench")
    group.addoption(
        "--quick",
        action="store_true",
        help="the tests to run at every save: some of every kind, none that is marked slow",
    )
    group.addoption(
        "--cpu",
        metavar="FILE",
        type=Path,
        help="add each test's processor time to a file of JSON lines; with -n 0",
    )
    group.addoption(
        "--kernels",
        choices=["compiled", "plain"],
        help="leave out the tests marked plain, or all others",
    )
    group.addoption(
        "--rounding",
        metavar="N",
        type=int,
        help="other last bits in every modal model: 0 to 7, as another machine has them",
    )


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        (
            "plain: a few events of a kind of scene that no other test compiles; scripts/test "
            "runs it in plain Python"
        ),
    )
    config.addinivalue_line(
        "markers",
        "same_bits: compares digit for digit, often with another process; left out by --rounding",
    )
    config.addinivalue_line(
        "markers",
        (
            "slow: takes long for its file; left out by --quick, and by .ci/run with the "
            "arithmetic of an old processor"
        ),
    )
    if config.getoption("--rounding") is not None:
        round_models(config.getoption("--rounding"))
    if config.getoption("--cpu"):
        config.pluginmanager.register(CPUTimes(config.getoption("--cpu")))


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    is_selectable = config.getoption("--quick") and collection_path.name.startswith("test_")
    if is_selectable and collection_path.relative_to(ROOT).as_posix() not in QUICK:
        return True
    return None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--quick"):
        slow = [item for item in items if item.get_closest_marker("slow")]
        config.hook.pytest_deselected(items=slow)
        items[:] = [item for item in items if item not in slow]
    if config.getoption("--rounding") is not None:
        items[:] = [item for item in items if not item.get_closest_marker("same_bits")]
    if chosen := config.getoption("--kernels"):
        items[:] = [
            item
            for item in items
            if (item.get_closest_marker("plain") is not None) == (chosen == "plain")
        ]
