"""What `design_gap --load` answers: the gap with the least measure under loads, and the one that is best over a tolerance of their intensity.

The search is that of `optimisation.gap_search`, on the measure that belongs to the loads (`optimisation.load_measures`). It begins at the design
rule's gap where the loads are one swept force, else, where there is no rule, at `START` times the free motion's RMS at the absorber, see
`load_measures.free_size`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_env.ensemble import Lane, Progress, draw_members, drives_of
from impact_env.loads import Loads, Member
from impact_env.methods import Exact, check_load
from impact_env.modes import ModalModel
from impact_env.parameters import DEFAULT_MASS_RATIO, SlidingAbsorber, count, impact_absorber, positive, require
from impact_env.scene import Scene
from impact_env.turning_loads import Force
from optimisation.bounds import design_gap
from optimisation.friction_rule import scaled_friction
from optimisation.gap_advice import MOST_TOLERANCE, TOLERANCE, Answer
from optimisation.gap_check import RESTITUTION
from optimisation.gap_search import MEMBERS, PAIRS, STEP, Table, answers, search, worst
from optimisation.load_comparison import runs_of
from optimisation.load_measures import DECAY, START, free_size, measure_of

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LoadAdvice:
    """The answers under ``loads``, whose measure they are told by, and what they rest on.

    ``start``: the gap (m) from which ``table`` counts; ``rule``: the design rule's gap (m), None where there is no rule; ``without`` (M,): the
    measure without absorber, member by member; ``mass`` in kg.
    """

    loads: Loads
    measure: str
    mass: float
    table: Table
    start: float
    rule: float | None
    free_rms: float
    tolerance: float
    without: Array
    sharp: Answer
    recommended: Answer

    @property
    def gaps(self) -> Array:
        """Gaps that were run, in m, rising."""
        return np.asarray(self.start * np.exp(STEP * np.array(sorted(self.table.levels))))

    @property
    def size_of(self) -> str:
        """What ``free_rms`` is, in words."""
        return "largest displacement over the root of two" if self.measure == DECAY else "RMS"

    @property
    def runs(self) -> list[Array]:
        """The members' measures at each of the gaps."""
        return [self.table.levels[step] for step in sorted(self.table.levels)]


def rule_gap(model: ModalModel, mass: float, loads: Loads, resonance: int) -> float | None:
    """Return the design rule's gap in m for loads that are one swept force, None for others; ``mass`` in kg."""
    part = loads.parts[0]
    return design_gap(model, mass, part.drive.amplitude, resonance) if len(loads.parts) == 1 and isinstance(part, Force) else None


def advise_for_loads(
    model: ModalModel,
    loads: Loads,
    resonance: int = 1,
    *,
    factor: float = 1.0,
    mass_ratio: float = DEFAULT_MASS_RATIO,
    restitution: float = RESTITUTION,
    friction_limit: float | None = None,
    tolerance: float = TOLERANCE,
    members: int = MEMBERS,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> LoadAdvice:
    """Search the gap of an impact absorber under ``factor`` times the loads.

    ``friction_limit`` in N at any gap; None: the paper's by the scaling law, in proportion to the gap. ``tolerance``: share of the intensity.
    ``progress`` is told finished runs and about how many there will be.
    Raises ParameterError for what is out of range and for loads that a structure cannot have, and where nothing moves at the absorber.
    """
    require(0 <= tolerance <= MOST_TOLERANCE, "force_tolerance", tolerance, f"from 0 to {MOST_TOLERANCE:g}, a share of the force")
    loads, none = loads.member(Member(factor=positive("force, a factor on the loads", factor))), Scene(model, None)
    check_load(none, loads, Exact())
    drives = drives_of(draw_members(count("members", members, 1), seed), loads)
    mass, rms = positive("mass_ratio", mass_ratio) * model.beam_mass, free_size(Lane(none, drives[0]))
    require(rms > 0, "load", 0.0, "one that moves the absorber's place")
    rule = rule_gap(model, mass, loads, resonance)
    start = START * rms if rule is None else rule

    def device(step: float) -> SlidingAbsorber:
        gap = start * float(np.exp(STEP * step))
        return impact_absorber(gap, restitution, scaled_friction(model, mass, gap) if friction_limit is None else friction_limit, mass_ratio)

    table = Table(power=0.0 if measure_of(loads) == DECAY else 1.0)
    pairs = PAIRS if members <= MEMBERS else 10 + 5 * members

    def look(step: float, number: int) -> Array:
        if progress is not None:
            progress(sum(map(len, table.levels.values())), pairs)
        kept = table.levels.get(step, np.empty(0))
        return np.append(kept, runs_of(model, [device(step)], drives[len(kept) : number], threads))

    search(look, 0, tolerance, members, pairs, table)
    sharp, recommended = (_answer(device(step), table, step, tolerance) for step in answers(table, tolerance, min(2, members)))
    without = runs_of(model, [None], drives, threads)[0]
    return LoadAdvice(loads, measure_of(loads), mass, table, start, rule, rms, tolerance, without, sharp, recommended)


def _answer(absorber: SlidingAbsorber, table: Table, step: float, tolerance: float) -> Answer:
    """Return a device of the table with its measure."""
    low, middle, high = np.quantile(table.levels[step], (0.05, 0.5, 0.95))
    steps, levels = table.known()
    largest = float(np.maximum(middle, worst(STEP * steps, levels, STEP * step, tolerance, table.power)))
    return Answer(absorber, float(middle), float(low), float(high), largest)
