"""The stability report's work as tasks for processes, and its results as plain values."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import lru_cache

from impact_env import ParameterError, SlidingAbsorber
from optimisation.executors import PoolOutcome, PoolTask
from studies.stability import cells, checks, eigen, limits
from studies.stability import soak as soaks
from studies.stability.cases import StabilityCase, cases
from studies.study import Json

CELL_LIMIT_S = 90.0
QUICK_CELL_LIMIT_S = 30.0
LONG_LIMIT_S = 400.0
OTHER_LIMIT_S = 120.0


@lru_cache(maxsize=1)
def _by_name() -> dict[tuple[str, str], StabilityCase]:
    return {(case.group, case.name): case for case in cases()}


def run_cell(group: str, name: str, method: str) -> Json:
    """Run a case with a method."""
    values = asdict(cells.measure(_by_name()[group, name], method))
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in values.items()
    }


def run_limit(method: str, what: str, damping_ratio: float) -> Json:
    """Find a step limit."""
    own = (method, what, damping_ratio)
    return limits.find_limit(
        next(case for case in limits.CASES if (case.method, case.what, case.damping_ratio) == own)
    )


def run_soak(name: str, lengths: tuple[int, ...]) -> Json:
    """Do one very long run."""
    return soaks.soak(next(case for case in soaks.CASES if case.name == name), lengths)


# the section of what a task returns, and the keys by which it is known there, which are the task's
# first arguments
SECTIONS: dict[Callable[..., Json], tuple[str, tuple[str, ...]]] = {
    run_cell: ("cells", ("group", "case", "method")),
    run_limit: ("limits", ("method", "what", "damping_ratio")),
    eigen.accuracy: ("eigen", ("elements",)),
    run_soak: ("soaks", ("name",)),
    checks.check: ("checks", ("name",)),
}


def _kind(case: StabilityCase, method: str) -> str:
    """Name the kernels that a case needs."""
    try:
        scene, _, _ = case.build()
    except ParameterError:
        return f"{method}, refused"
    absorber = scene.absorber
    parts = (
        (absorber.walls, absorber.friction)
        if isinstance(absorber, SlidingAbsorber)
        else (absorber,)
    )
    wide = ", wide" if scene.model.modes > 60 else ""
    return f"{method}, {', '.join(type(part).__name__ for part in parts)}{wide}"


def tasks(quick: bool) -> list[PoolTask]:
    """Return all tasks, the longest first and those of one case one after the other."""
    lengths = soaks.QUICK_LENGTHS if quick else soaks.LENGTHS
    limit = QUICK_CELL_LIMIT_S if quick else CELL_LIMIT_S
    searches = -(-(checks.QUICK_SEARCHES if quick else checks.SEARCHES) // len(checks.CASES))
    return [
        *(
            PoolTask(checks.check, (name, searches), f"check {name}", LONG_LIMIT_S)
            for name in checks.CASES
        ),
        *(
            PoolTask(run_soak, (case.name, lengths), f"soak {case.name}", LONG_LIMIT_S)
            for case in soaks.CASES
        ),
        *(
            PoolTask(run_cell, (case.group, case.name, method), _kind(case, method), limit)
            for case in cases(quick)
            for method in case.methods
        ),
        *(
            PoolTask(run_limit, (x.method, x.what, x.damping_ratio), "limits", OTHER_LIMIT_S)
            for x in (limits.QUICK if quick else limits.CASES)
        ),
        *(
            PoolTask(eigen.accuracy, (elements,), "eigenproblem", OTHER_LIMIT_S)
            for elements in (eigen.QUICK_ELEMENTS if quick else eigen.ELEMENTS)
        ),
    ]


def failures(results: Json) -> Iterator[str]:
    """Yield a line for each thing that is wrong."""
    for cell in results["cells"]:
        if cell["verdict"] == cells.FAILED:
            yield f"{cell['group']}: {cell['case']}, {cell['method']}: {cell['reason']}"
    for limit in results["limits"]:
        if not limit["agrees"]:
            result = limit["found_s"]
            theory = limit["theory_s"]
            yield (
                f"step limit of {limit['method']}, {limit['what']}, D = "
                f"{limit['damping_ratio']:g}: {result:.6g} s, theory {theory:.6g} s"
            )
    for entry in results["eigen"]:
        if entry["wrong"] or entry["error"]:
            yield (
                f"eigenproblem with {entry['elements']} elements: "
                f"{entry['error'] or entry['rounding']}"
            )
    for soak in results["soaks"]:
        if not soak["passed"]:
            yield f"soak, {soak['name']}: {soak['reason']}"
    for result in results["checks"]:
        if not result["passed"]:
            yield (
                f"searches, {result['name']}: {result['misses']} of {result['searches']} missed "
                f"an event, {result['first']}"
            )
    yield from (f"{lost['what']}: {lost['error']}" for lost in results["lost"])


def gather(outcomes: Sequence[PoolOutcome], order: Sequence[PoolTask]) -> Json:
    """Return the results of finished tasks by section, in the given order.

    A cell that was lost by a time limit or a crash is a failed cell.
    """
    results: Json = {name: [] for name in ("cells", "limits", "eigen", "soaks", "checks", "lost")}
    place = {(task.function, task.arguments): number for number, task in enumerate(order)}
    for outcome in sorted(
        outcomes, key=lambda outcome: place[outcome.task.function, outcome.task.arguments]
    ):
        task = outcome.task
        section, _ = SECTIONS[outcome.task.function]
        if outcome.value is not None:
            results[section].append(outcome.value)
        elif task.function is run_cell:
            group, case, method = task.arguments
            results["cells"].append(
                asdict(cells.Cell(group, case, method, cells.FAILED, outcome.error))
            )
        else:
            results["lost"].append({"what": f"{section} {task.arguments}", "error": outcome.error})
    return results


def finished(order: Sequence[PoolTask], earlier: Json) -> list[PoolOutcome]:
    """Return the outcomes of an earlier run; a task that was lost there has none."""
    result = []
    for task in order:
        section, keys = SECTIONS[task.function]
        own = list(task.arguments[: len(keys)])
        result += [
            PoolOutcome(task, entry, "", 0.0)
            for entry in earlier.get(section, ())
            if [entry[name] for name in keys] == own
        ][:1]
    return result
