"""All tasks by name: the one place where a name is looked up."""

from __future__ import annotations

from impact_env.parameters import require
from optimisation.rl.tasks import adaptive, friction, gap, passage, sweep
from optimisation.rl.tasks.task import Task

FIRST = {task.name: task for task in (sweep.TASK, gap.TASK)}
SUITE = {task.name: task for task in (*passage.TASKS, adaptive.TASK, friction.TASK)}  # in which feedback pays
TASKS = FIRST | SUITE
WITH_ROOM = {
    "active_friction": "ImpactAbsorber/ActiveFriction-v0",
    "active_gap": "ImpactAbsorber/ActiveGap-v0",
    "limited_passage": "ImpactAbsorber/Passage-v0",
    "structures": "ImpactAbsorber/Structures-v0",
}  # whose rules and oracles `optimisation.rl.admission` finds
TRAINED = {name: task.env_id for name, task in TASKS.items()} | WITH_ROOM
GROUPS: dict[str, tuple[str, ...]] = {"both": tuple(FIRST), "suite": tuple(SUITE), "all": tuple(TASKS)}  # of tasks, as commands take them
GROUPS_HELP = "; ".join(f"{name}: {task.env_id.split('/')[1]}" for name, task in TASKS.items()) + "; both: the first two; suite: the others."
TRAINED_GROUPS = GROUPS | {"room": tuple(WITH_ROOM)}
TRAINED_HELP = f"{GROUPS_HELP} room: {', '.join(name.split('/')[1] for name in WITH_ROOM.values())}."


def task_named(name: str) -> Task:
    """Return a task by its name; raises ParameterError for one that is not in `TASKS`."""
    require(name in TASKS, "task", name, f"one of {', '.join(TASKS)}")
    return TASKS[name]
