"""Compare methods that compute a posterior from simulated measurements.

The methods are the synthetic likelihood of calibrate, sbi's neural posterior and pyabc's ABC-SMC.
"""

import importlib
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import cache, partial
from types import ModuleType
from typing import Any, NamedTuple

import click
import numpy as np
import scipy

from optimisation.calibration.inference import (
    Ensemble,
    infer,
    measure_sensitivity,
    simulate_ensemble,
)
from optimisation.calibration.likelihood import RegressionStatistics, fit_regression_statistics
from optimisation.calibration.simulation import Simulator
from optimisation.cli.common import BadInput, command
from studies.cli.check_calibration import (
    KINDS,
    MODEL,
    RIGS,
    SEED,
    SHARE_IN_INTERVAL,
    first_ensemble,
    make_simulator,
    measure,
)
from studies.study import (
    Array,
    Json,
    Measurement,
    OutputPaths,
    Study,
    add_table_options,
    format_table,
    make_rows_study,
    run,
)

NAME = "compare_inference"  # also the page's marker
RIG = RIGS[0]
TRUTHS = 10
FIRST_RUNS = 256
ROUND_RUNS = 128
ROUNDS = 3
SWEEPS = FIRST_RUNS + ROUNDS * ROUND_RUNS  # of calibrate, for one truth
MORE_SWEEPS = 2 * SWEEPS
POPULATION = 100  # of ABC-SMC
DRAWS = 2000
LIKELIHOOD = "synthetic likelihood (calibrate)"
NEURAL = "neural posterior (sbi), of the whole prior"
NEURAL_ROUNDS = "neural posterior (sbi), in rounds"
ABC = "ABC-SMC (pyabc)"
PACKAGES = {NEURAL: "sbi", NEURAL_ROUNDS: "sbi", ABC: "pyabc"}
NEEDS = {
    LIKELIHOOD: "numpy, scipy",
    NEURAL: "sbi, torch",
    NEURAL_ROUNDS: "sbi, torch",
    ABC: "pyabc, pandas, SQLAlchemy",
}


class Setting(NamedTuple):
    """A method with the number of sweeps that it may simulate."""

    method: str
    sweeps: int


SETTINGS = (
    Setting(LIKELIHOOD, SWEEPS),
    Setting(NEURAL, SWEEPS),
    Setting(ABC, SWEEPS),
    Setting(LIKELIHOOD, MORE_SWEEPS),
    Setting(NEURAL, MORE_SWEEPS),
    Setting(ABC, MORE_SWEEPS),
    Setting(NEURAL_ROUNDS, SWEEPS),  # the slowest is the last
)


class Answer(NamedTuple):
    """Draws (N, P) of a posterior with weights (N,), and CPU seconds of the method.

    The seconds do not include the simulations.
    """

    draws: Array
    weights: Array
    seconds: float


def import_method(name: str) -> ModuleType:
    """Return an optional package; raise BadInput if it is not installed."""
    package, _, _ = name.partition(".")
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise BadInput(
            f"The comparison needs {package}, which is not installed: pip install {package}"
        ) from error


class CountedSimulation:
    """Simulates ensembles of a truth's measurement, and counts sweeps and CPU seconds."""

    def __init__(self, simulator: Simulator) -> None:
        self.simulator = simulator
        self.seconds = 0.0
        self.sweeps = 0

    def __call__(self, shares: Array, seed: int) -> Ensemble:
        """Return the ensemble at shares (N, P)."""
        start = time.process_time()
        ensemble = simulate_ensemble(self.simulator, RIG.priors, shares, seed)
        self.seconds += time.process_time() - start
        self.sweeps += len(shares)
        return ensemble


def infer_by_likelihood(simulation: CountedSimulation, sweeps: int, number: int) -> Answer:
    """Return the posterior of calibrate, which stops early where two rounds agree."""
    first = first_ensemble(RIG.name, FIRST_RUNS)
    start = time.process_time()
    inference = infer(
        simulation.simulator,
        RIG.priors,
        seed=number,
        first=first,
        round_runs=(sweeps - FIRST_RUNS) // ROUNDS,
        rounds=ROUNDS,
        simulate=lambda shares, k: simulation(shares, 1000 * number + k),
    )
    seconds = time.process_time() - start - simulation.seconds
    return Answer(inference.shares, np.ones(len(inference.shares)), seconds)


@cache
def train_on_prior(sweeps: int) -> tuple[Any, RegressionStatistics, float]:
    """Return the neural posterior trained once on sweeps over the prior.

    The scale of the statistics and the CPU seconds of the training are also returned.
    """
    ensemble = first_ensemble(RIG.name, sweeps).finite
    scale, _ = fit_regression_statistics(ensemble.shares, ensemble.statistics)
    start = time.process_time()
    trained = train_posterior(NeuralTrainer(sweeps), ensemble, scale)
    return trained, scale, time.process_time() - start


class SilentTracker:
    """Tracker of sbi that discards the metrics of a training.

    The default writes a folder ``sbi-logs``.
    """

    log_dir = None

    def log_metric(self, *args: Any, **kwargs: Any) -> None:
        """Take a metric."""

    def log_metrics(self, *args: Any, **kwargs: Any) -> None:
        """Take metrics."""

    def log_params(self, *args: Any, **kwargs: Any) -> None:
        """Take parameters."""

    def add_figure(self, *args: Any, **kwargs: Any) -> None:
        """Take a figure."""

    def flush(self) -> None:
        """Do nothing; sbi calls it at the end."""


class NeuralTrainer:
    """Neural posterior estimation of sbi with its defaults: a masked autoregressive flow."""

    def __init__(self, seed: int) -> None:
        self.torch = import_method("torch")
        inference = import_method("sbi.inference")
        utils = import_method("sbi.utils")
        self.torch.manual_seed(seed)
        self.torch.set_num_threads(1)
        count = len(RIG.priors)
        self.prior = utils.BoxUniform(self.torch.zeros(count), self.torch.ones(count))
        self.inference = inference.NPE(
            prior=self.prior, show_progress_bars=False, tracker=SilentTracker()
        )

    def tensor(self, values: Array) -> Any:
        """Return an array as a tensor."""
        return self.torch.as_tensor(np.asarray(values), dtype=self.torch.float32)


def scaled(statistics: Array, scale: RegressionStatistics) -> Array:
    """Return statistics (N, D) in deviations over the prior."""
    return np.asarray((statistics - scale.mean) / scale.scale)


def train_posterior(
    trainer: NeuralTrainer, ensemble: Ensemble, scale: RegressionStatistics, proposal: Any = None
) -> Any:
    """Return the posterior after one more round of training.

    ``proposal`` is the distribution from which the parameters of the round were drawn.
    """
    shares = trainer.tensor(ensemble.shares)
    statistics = trainer.tensor(scaled(ensemble.statistics, scale))
    appended = trainer.inference.append_simulations(shares, statistics, proposal=proposal)
    estimator = appended.train(show_train_summary=False)
    return trainer.inference.build_posterior(estimator)


def draw_neural(
    trained: Any, trainer: NeuralTrainer, observed: Array, scale: RegressionStatistics, draws: int
) -> Array:
    """Return draws (N, P) of a neural posterior at observed statistics (D,)."""
    at = trainer.tensor(scaled(observed[None], scale))
    return np.asarray(trained.sample((draws,), x=at, show_progress_bars=False), dtype=np.float64)


def infer_by_neural_posterior(simulation: CountedSimulation, sweeps: int, number: int) -> Answer:
    """Return the neural posterior that is trained once, on sweeps over the whole prior."""
    trainer = NeuralTrainer(number)
    trained, scale, seconds = train_on_prior(sweeps)
    draws = draw_neural(trained, trainer, simulation.simulator.observed, scale, DRAWS)
    return Answer(draws, np.ones(len(draws)), seconds)


def infer_by_neural_rounds(simulation: CountedSimulation, sweeps: int, number: int) -> Answer:
    """Return the neural posterior after several rounds.

    As in calibrate, each round draws its parameters from the posterior of the previous one.
    """
    first = first_ensemble(RIG.name, FIRST_RUNS).finite
    start = time.process_time()
    scale, _ = fit_regression_statistics(first.shares, first.statistics)
    trainer = NeuralTrainer(number)
    observed = simulation.simulator.observed
    at = trainer.tensor(scaled(observed[None], scale))
    trained = train_posterior(trainer, first, scale)
    for k in range(ROUNDS):
        runs = (sweeps - FIRST_RUNS) // ROUNDS
        shares = draw_neural(trained, trainer, observed, scale, runs)
        ensemble = simulation(shares, 1000 * number + k).finite
        trained = train_posterior(trainer, ensemble, scale, trained.set_default_x(at))
    draws = draw_neural(trained, trainer, observed, scale, DRAWS)
    seconds = time.process_time() - start - simulation.seconds
    return Answer(draws, np.ones(len(draws)), seconds)


def infer_by_abc(simulation: CountedSimulation, sweeps: int, number: int) -> Answer:
    """Return the weighted draws of ABC-SMC on one linear statistic for each parameter.

    This is semi-automatic ABC (Fearnhead and Prangle 2012).
    """
    pyabc = import_method("pyabc")
    first = first_ensemble(RIG.name, FIRST_RUNS).finite
    start = time.process_time()
    used = measure_sensitivity(first).used
    statistic, _ = fit_regression_statistics(first.shares, first.statistics[:, used])
    names = [prior.name for prior in RIG.priors]
    calls = iter(range(10**9))

    def simulate_once(values: Any) -> dict[str, Array]:
        shares = np.array([[values[name] for name in names]])
        ensemble = simulation(shares, 10**6 * (number + 1) + next(calls))
        return {"statistics": statistic.compute(ensemble.statistics[:, used])[0]}

    prior = pyabc.Distribution(**{name: pyabc.RV("uniform", 0, 1) for name in names})
    np.random.seed(number)  # noqa: NPY002 - pyabc draws from numpy's global generator
    abc = pyabc.ABCSMC(
        simulate_once,
        prior,
        pyabc.AdaptivePNormDistance(p=2),
        population_size=POPULATION,
        sampler=pyabc.SingleCoreSampler(),
    )
    observed = statistic.compute(simulation.simulator.observed[None, used])[0]
    with tempfile.TemporaryDirectory() as folder:
        abc.new(f"sqlite:///{folder}/abc.db", {"statistics": observed})
        history = abc.run(max_total_nr_simulations=sweeps - FIRST_RUNS)
        frame, weights = history.get_distribution()
        draws = np.asarray(frame[names], dtype=np.float64)
    seconds = time.process_time() - start - simulation.seconds
    return Answer(draws, np.asarray(weights, dtype=np.float64), seconds)


METHODS: dict[str, Callable[[CountedSimulation, int, int], Answer]] = {
    LIKELIHOOD: infer_by_likelihood,
    NEURAL: infer_by_neural_posterior,
    NEURAL_ROUNDS: infer_by_neural_rounds,
    ABC: infer_by_abc,
}


def weighted_quantiles(values: Array, weights: Array, shares: Sequence[float]) -> Array:
    """Return quantiles of weighted draws (N,)."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    middle = (total - 0.5 * weights[order]) / total[-1]
    return np.interp(shares, middle, values[order])


def measure_method(setting: Setting, number: int) -> list[Json]:
    """Return the row of one method and truth: those of `check_calibration`, by number."""
    seed = [SEED, 0, list(KINDS).index(MODEL), number]
    truth = np.random.default_rng(seed).random((1, len(RIG.priors)))
    simulator = make_simulator(RIG, measure(RIG, KINDS[MODEL], truth, seed))
    simulation = CountedSimulation(simulator)
    answer = METHODS[setting.method](simulation, setting.sweeps, number)
    weights = answer.weights / np.sum(answer.weights)
    quantiles = [
        weighted_quantiles(answer.draws[:, k], weights, [0.05, 0.5, 0.95])
        for k in range(len(RIG.priors))
    ]
    low, median, high = np.transpose(quantiles)
    return [
        {
            "method": setting.method,
            "sweeps": setting.sweeps,
            "simulated": simulation.sweeps,
            "number": number,
            "truth": truth[0].round(6).tolist(),
            "low": low.round(5).tolist(),
            "median": median.round(5).tolist(),
            "high": high.round(5).tolist(),
            "method_seconds": round(answer.seconds, 2),
        }
    ]


class ComparisonSettings(NamedTuple):
    """Numbers of truths, and which methods."""

    truths: int = TRUTHS
    settings: tuple[Setting, ...] = SETTINGS


def list_cases(settings: ComparisonSettings) -> dict[Any, Callable[[], list[Json]]]:
    """Return all methods and truths, method by method."""
    return {
        (one.method, one.sweeps, number): partial(measure_method, one, number)
        for one in settings.settings
        for number in range(settings.truths)
    }


def method_rows(rows: Sequence[Json]) -> list[Json]:
    """Return a row for each method and number of sweeps: coverage, width, interval score and cost.

    The interval score is the mean, over truths and parameters, of the width plus 2 / 0.1 times the
    distance of a truth that lies outside (Gneiting and Raftery, 2007,
    doi:10.1198/016214506000001437): narrow intervals that miss the truth have a large one.
    """
    result = []
    for method, sweeps in SETTINGS:
        own = [r for r in rows if (r["method"], r["sweeps"]) == (method, sweeps)]
        if not own:
            continue
        low, truth, high, median = (
            np.array([r[name] for r in own]) for name in ("low", "truth", "high", "median")
        )
        inside = (low <= truth) & (truth <= high)
        missed = np.maximum(low - truth, 0) + np.maximum(truth - high, 0)
        score = high - low + 2 / (1 - SHARE_IN_INTERVAL) * missed
        held = int(np.sum(inside))
        interval = scipy.stats.binomtest(held, inside.size).proportion_ci(0.95, "wilson")
        once = method == NEURAL
        simulated = FIRST_RUNS + np.mean([r["simulated"] for r in own])
        result.append(
            {
                "method": method,
                "sweeps": f"{sweeps}, once for all" if once else f"{simulated:.0f}",
                "truths": len(own),
                "inside": (
                    f"{100 * held / inside.size:.0f} ({100 * interval.low:.0f} to "
                    f"{100 * interval.high:.0f})"
                ),
                "width": format_percent(np.mean(high - low, axis=0)),
                "error": format_percent(np.mean(np.abs(median - truth), axis=0)),
                "score": 100 * float(np.mean(score)),
                "seconds": float(np.median([r["method_seconds"] for r in own])),
                "needs": NEEDS[method],
            }
        )
    return result


def format_percent(shares: Array) -> str:
    """Return shares (P,) in percent."""
    return " / ".join(f"{100 * one:.1f}" for one in shares)


def write_table(measured: Measurement) -> str:
    """Return the table of methods."""
    columns = {
        "method": "{method}",
        "sweeps": "{sweeps}",
        "truths": "{truths}",
        "in the 90 % interval, %": "{inside}",
        "width, restitution / friction / gap, % of the prior": "{width}",
        "error of the median, % of the prior": "{error}",
        "interval score, % of the prior": "{score:.1f}",
        "CPU time without sweeps, s": "{seconds:.3g}",
        "needs": "{needs}",
    }
    return format_table(columns, method_rows(measured.values["rows"]))


STUDY: Study[ComparisonSettings] = make_rows_study(
    NAME,
    "methods of inference beside the truth",
    cases=list_cases,
    key=lambda r: (r["method"], r["sweeps"], r["number"]),
    text=write_table,
    key_values=lambda _: {
        "first_runs": FIRST_RUNS,
        "round_runs": ROUND_RUNS,
        "rounds": ROUNDS,
    },
)
QUICK = ComparisonSettings(1, (Setting(LIKELIHOOD, SWEEPS),))


@command()
@click.option("--quick", is_flag=True, help="A look: one truth, by the synthetic likelihood.")
@click.option(
    "--truths",
    type=click.IntRange(min=1),
    default=TRUTHS,
    show_default=True,
    help="Truths from the prior.",
)
@add_table_options(NAME, "docs/calibrate.md")
def main(quick: bool, truths: int, place: OutputPaths) -> None:
    """Print coverage, width and cost of the posteriors of three methods.

    All methods use the same simulated measurements.

    The methods are the synthetic likelihood of calibrate, sbi's neural posterior and pyabc's
    ABC-SMC. sbi and pyabc are no part of any extra: pip install sbi pyabc. Ctrl-C prints, and
    writes, what is finished; with --json the same command goes on.
    """
    settings = QUICK if quick else ComparisonSettings(truths)
    for name in () if quick else ("sbi.inference", "pyabc"):
        import_method(name)
    run(STUDY, settings, place)
