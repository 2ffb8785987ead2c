"""Options of the tests.

They choose the tests to run and record the processor time of each.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest
from choice import QUICK, ROOT
from hypothesis import settings
from plugins import CPUTimes, round_models

settings.register_profile("workbench", derandomize=True, deadline=None)
settings.load_profile("workbench")

# their commands write some hundred figures, whose pixels no test counts: most of a figure's time
# goes by its pixels
DRAWING = ("commands", "design", "studies")
COARSE_DPI = 40.0


@pytest.fixture(autouse=True, scope="module")
def draw_coarsely(request: pytest.FixtureRequest) -> Iterator[None]:
    """Let commands write figures with fewer pixels in the folders that write many."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.parent.name in DRAWING:
            from optimisation.report.report import write_figure

            patch.setattr(write_figure, "__defaults__", (COARSE_DPI,))
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
