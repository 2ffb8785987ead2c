"""Settings of a search: method, batch, seed and rungs of successive halving.

Designs that compare badly on a rung are abandoned.

A design climbs rung by rung. On each rung the batch is run with more members or with a slower
sweep, and only the best share of the batch goes on (successive halving). What is left behind was
judged by the few runs it got, and is told to the method as worse than all that went on; only
designs that reached the last rung can win. A sweep ten times as fast takes a tenth of the time and
ranks designs much like the usual rate does, though not in the same order:
`optimisation.search.judge.audit` measures what the shortcut cost.
"""

from dataclasses import asdict, dataclass

import numpy as np

from impact_env.checks import (
    count,
    count_from,
    each_of,
    flag,
    fraction,
    kind_of,
    labelled,
    positive,
    require,
    word_of,
)
from impact_env.fields import check_fields
from optimisation.objectives import Score
from optimisation.problem import Problem
from optimisation.space import TUNED, Design


@dataclass(frozen=True, eq=False)
class EvaluatedDesign:
    """A design with its result in a search.

    ``number``: number of the design. ``rungs``: number of rungs on which it was run. Only a design
    that was run on all rungs can win.
    """

    number: int
    design: Design
    score: Score
    rungs: int


CMA = "cma"
NSGA2 = "nsga2"
RANDOM = "random"
SAMPLERS = {CMA: "CMA-ES", NSGA2: "NSGA-II", RANDOM: "random search"}
BATCHES = {CMA: 40, NSGA2: 20}
# searches that propose no batches: SciPy's (`optimisation.search.find`), and the Gaussian process
# (`optimisation.search.gaussian_process`)
SCIPY = "scipy"
GP = "gp"
# rate of the first rung over the usual one: faster still, the sweep is over before the response has
# built up
FAST = 10.0
FEW = 2  # members of the first rungs
RUNG_SHARES = (0.2, 0.25)  # shares that go on from the first rungs: of 40 designs 8, and then 2


def seed_of(seed: int, *numbers: int) -> int:
    """Return a seed of 31 bits that follows from a seed and numbers."""
    return int(np.random.SeedSequence([seed, *numbers]).generate_state(1)[0] >> 1)


@dataclass(frozen=True)
class Rung:
    """A rung of successive halving.

    ``members`` is the number of ensemble members, from the first; ``speed`` the sweep rate over the
    problem's; ``keep`` the share of designs that continue to the next rung.
    """

    members: int
    speed: float = 1.0
    keep: float = 1.0

    def __post_init__(self) -> None:
        check_fields(
            self,
            members=labelled("members of a rung", count_from(1)),
            speed=labelled("speed of a rung", positive),
            keep=labelled("share kept on a rung", fraction),
        )


@dataclass(frozen=True)
class SearchSettings:
    """Settings of a search.

    ``sampler``: one of `SAMPLERS`. ``batch``: number of designs in a batch, also the population of
    CMA-ES and NSGA-II. ``rungs``: from first to last.

    ``from_scratch``: the first design is a random one, and not the paper's.
    """

    sampler: str
    batch: int
    rungs: tuple[Rung, ...]
    seed: int = 0
    from_scratch: bool = False

    def __post_init__(self) -> None:
        check_fields(
            self,
            sampler=word_of(SAMPLERS),
            batch=count_from(2),
            rungs=each_of(kind_of(Rung)),
            seed=count_from(0),
            from_scratch=flag,
        )

    @property
    def members_a_design(self) -> float:
        """Mean cost of a design, in members at the problem's own rate.

        Designs that are abandoned early count with their smaller cost.
        """
        cost = 0.0
        going = 1.0
        below = None
        for rung in self.rungs:
            known = below.members if below is not None and below.speed == rung.speed else 0
            cost += going * max(0, rung.members - known) / rung.speed
            going = going * rung.keep
            below = rung
        return cost

    def check(self, problem: Problem) -> None:
        """Raise ParameterError unless the settings go with a problem."""
        name = self.sampler
        objectives = len(problem.objectives)
        require(name in SAMPLERS, "sampler", name, f"one of {', '.join(SAMPLERS)}")
        if name == CMA:
            require(
                objectives == 1,
                "sampler",
                name,
                f"one objective; for {objectives} use {NSGA2} or {RANDOM}",
            )
            require(
                len(problem.space.free) >= 2,
                "sampler",
                name,
                f"two or more free variables; for one use {RANDOM}",
            )
        last = self.rungs[-1] if self.rungs else None
        require(
            last is not None and last.speed == 1,
            "rungs",
            self.rungs,
            "one or more, the last at the problem's own sweep rate",
        )
        assert last is not None
        require(
            last.members == problem.members,
            "members of the last rung",
            last.members,
            f"the problem's {problem.members}",
        )
        require(
            objectives == 1 or len(self.rungs) == 1,
            "rungs",
            self.rungs,
            "a single one where there are several objectives: there is no one best share",
        )

    def describe(self) -> dict[str, object]:
        """Return the settings as JSON values."""
        rungs = [asdict(rung) for rung in self.rungs]
        return {
            "sampler": self.sampler,
            "batch": self.batch,
            "seed": self.seed,
            "rungs": rungs,
            "from_scratch": self.from_scratch,
        }

    def whole_batches(self, designs: int) -> int:
        """Return a number of designs rounded up to whole batches.

        The first batch has one design more, the paper's.
        """
        designs = count("designs", designs, 1)
        return 1 + self.batch * max(1, -(-(designs - 1) // self.batch))


def default_settings(
    problem: Problem,
    sampler: str | None = None,
    batch: int | None = None,
    seed: int = 0,
    screening: bool = True,
    from_scratch: bool = False,
) -> SearchSettings:
    """Return the default settings for a problem.

    They are CMA-ES for one objective and NSGA-II for several, with rungs unless ``screening`` is
    off.

    One free variable goes to the random search. A tuned absorber is linear: its runs are cheap and
    hardly differ, so it needs no rungs.
    """
    several = len(problem.objectives) > 1
    name = sampler or (NSGA2 if several else CMA if len(problem.space.free) > 1 else "random")
    require(name in SAMPLERS, "sampler", name, f"one of {', '.join(SAMPLERS)}")
    rungs: tuple[Rung, ...] = (Rung(problem.members),)
    if screening and not several and problem.space.concept != TUNED:
        few = min(FEW, problem.members)
        speed = FAST * problem.usual_rate / problem.rate
        if few < problem.members:
            rungs = (Rung(few, 1.0, RUNG_SHARES[1]), *rungs)
        if speed > 1 and not problem.under_loads:  # loads have no speed
            rungs = (Rung(few, speed, RUNG_SHARES[0]), *rungs)
    settings = SearchSettings(
        name, batch or BATCHES.get(name, BATCHES[CMA]), rungs, seed, from_scratch
    )
    settings.check(problem)
    return settings
