"""Studies for tests of searches.

The module has a problem without simulation, whose measures follow from the design in microseconds,
and executors that count runs or interrupt them.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impact_env import Beam
from impact_env.ensemble import Lane, Threads
from impact_env.modes import ModalModel
from impact_env.parameters import SlidingAbsorber
from optimisation.absorber_rules import scaled_absorber
from optimisation.gap_advice import Advice, search_gap
from optimisation.load_cases import swept_force
from optimisation.measures import Chunk
from optimisation.objectives import Condition, Objective
from optimisation.problem import Problem, evaluate
from optimisation.search.settings import Rung, SearchSettings
from optimisation.space import Design, design_space

Array = NDArray[np.float64]
BATCH = 4


def problem(objectives: int = 1, **changes: object) -> Problem:
    """Return a problem of two free variables and ``objectives`` 1 or 2."""
    several = tuple(Objective(resonance=r) for r in (1, 2)) if objectives == 2 else (Objective(),)
    options = {
        "space": design_space("impact", ["gap", "restitution"]),
        "conditions": (Condition(1, 3.5), Condition(2, 35.0)),
        "objectives": several,
        "beam": Beam(modes=2, elements=4),
        "members": 4,
        "rate": 100.0,
    }
    return Problem(**(options | changes))


def settings(
    sampler: str = "cma", seed: int = 0, rungs: tuple[Rung, ...] = (Rung(1, 1.0, 0.5), Rung(4))
) -> SearchSettings:
    return SearchSettings(sampler, BATCH, rungs if sampler != "nsga2" else rungs[-1:], seed)


def search_swept(
    model: ModalModel,
    force: float,
    resonance: int = 1,
    absorber: SlidingAbsorber | None = None,
    rate: float | None = None,
    **options: object,
) -> Advice:
    """Return the gap for a swept force, of the absorber by rules if none is given."""
    own = scaled_absorber(model, force, resonance) if absorber is None else absorber
    return search_gap(swept_force(model, force, resonance, own.mass_ratio, rate), own, **options)


def values_of(problem: Problem, design: Design | None = None) -> Array:
    """Return the measures of one design for all members, simulated in this thread.

    ``design`` None is the default design.
    """
    ((_, values),) = evaluate(
        problem, [design or problem.space.default], problem.ensemble, problem.rate, Threads(1)
    )
    return values


@dataclass
class Model:
    """An executor that replaces the simulator by a formula.

    The formula is a bowl around gap 0.6 mm and restitution 0.5, with a ripple by phase.

    ``calls`` counts the runs of each chunk; a ``log`` gets a line for each; KeyboardInterrupt comes
    in place of chunk number ``stop``.
    """

    stop: int | None = None
    log: Path | None = None
    calls: list[tuple[object, ...]] = field(default_factory=list)

    def each(self, _function, chunks, _kinds):
        for k, chunk in enumerate(chunks):
            if self.stop is not None and len(self.calls) == self.stop:
                raise KeyboardInterrupt
            self.calls.append(self.about(chunk))
            if self.log is not None:
                with self.log.open("a") as file:
                    file.write(repr(self.calls[-1]) + "\n")
            yield k, np.array([[self.value(chunk, lane)] for lane in chunk.lanes])

    def about(self, chunk: Chunk) -> tuple[object, ...]:
        walls = chunk.lanes[0].scene.absorber.walls
        drive = chunk.lanes[0].drive
        return walls.gap, walls.restitution, drive.amplitude, drive.phase, drive.schedule.times[-1]

    def value(self, chunk: Chunk, lane: Lane) -> float:  # noqa: ARG002 - others need it
        """Return the level of a lane in m."""
        walls = lane.scene.absorber.walls
        best = 6e-4 if lane.drive.amplitude < 10 else 9e-4  # another one for the second resonance
        bowl = np.log(walls.gap / best) ** 2 + (walls.restitution - 0.5) ** 2
        return float(
            1e-4 * (1 + bowl) * (1 + 0.01 * np.sin(7 * lane.drive.phase + 1e4 * walls.gap))
        )


class Bowl(Model):
    """The same executor for concepts without walls.

    Its formula is a bowl in the logarithms of the absorber's parameters.
    """

    def about(self, chunk: Chunk) -> tuple[object, ...]:
        absorber = chunk.lanes[0].scene.absorber
        drive = chunk.lanes[0].drive
        numbers = (
            (absorber.friction.limit,)
            if isinstance(absorber, SlidingAbsorber)
            else (absorber.stiffness, absorber.damping)
        )
        return *numbers, drive.amplitude, drive.phase, len(chunk.lanes)

    def value(self, chunk: Chunk, lane: Lane) -> float:  # noqa: ARG002 - as above
        numbers = [float(x) for x in self.calls[-1][:-3]]
        bottom = [0.3] if len(numbers) == 1 else [600.0, 0.5]
        return float(
            1e-4
            * (
                1
                + sum(np.log(x / best) ** 2 for x, best in zip(numbers, bottom, strict=True))
                + 0.01 * np.sin(lane.drive.phase)
            )
        )
