"""Parameters of an absorber from a measured response, with text, JSON, figures and card.

`calibrate` returns them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    count,
    count_from,
    instance,
    one_of,
    positive,
    require,
)
from impact_env.ensemble import LaneProgress
from impact_env.fields import check_fields
from impact_env.kernels.compiling.cache import hash_sources
from impact_env.laws import values
from impact_env.modes import Structure
from impact_env.parameters import SlidingAbsorber
from impact_env.plain import from_scene
from impact_env.scene import Scene
from optimisation.calibration.admission import require_plausible, require_reachable_gap
from optimisation.calibration.alternatives import list_alternatives
from optimisation.calibration.inference import (
    FIRST_RUNS,
    ROUND_RUNS,
    ROUNDS,
    Ensemble,
    Inference,
    infer,
    round_seed,
    simulate_ensemble,
)
from optimisation.calibration.linear_fit import LinearFit, fit_linear
from optimisation.calibration.measurement import (
    Measurement,
    read_measurements,
    require_moving,
)
from optimisation.calibration.parameters import (
    Prior,
    PriorInput,
    read_priors,
    require_impact_absorber,
    scene_with,
)
from optimisation.calibration.plan import FACTORS, MeasurementPlan, plan_measurement
from optimisation.calibration.posterior import Posterior
from optimisation.calibration.predictive import REPLICATES, PredictiveCheck, check_posterior
from optimisation.calibration.simulation import Simulator
from optimisation.checkpoint import Checkpoint
from optimisation.mounting import model_with_absorber_at
from optimisation.report.calibration_report import list_warnings, make_report
from optimisation.report.report import CompleteAnswer, Json, Report, Stages, silent_stages

Array = NDArray[np.float64]
NEVER = "never"
WHEN_REFUSED = "when-refused"
ALWAYS = "always"
ALTERNATIVES = (NEVER, WHEN_REFUSED, ALWAYS)


@dataclass(frozen=True)
class CalibrationRuns:
    """Numbers of simulated measurements and of rounds of a calibration.

    Attributes
    ----------
    first : int
        Simulations over the prior.
    each_round : int
        Simulations in each further round.
    rounds : int
        Largest number of rounds.
    replicates : int
        Simulations of the predictive check.
    """

    first: int = FIRST_RUNS
    each_round: int = ROUND_RUNS
    rounds: int = ROUNDS
    replicates: int = REPLICATES

    def __post_init__(self) -> None:
        check_fields(
            self,
            first=count_from(32),
            each_round=count_from(16),
            rounds=count_from(1),
            replicates=count_from(20),
        )


QUICK_RUNS = CalibrationRuns(96, 48, 2, 48)


@dataclass(frozen=True, eq=False)
class CalibratedModel:
    """A model of the absorber with its posterior and predictive check.

    ``resonance``: number of the resonance near which the structure was excited, from 1.
    """

    name: str
    scene: Scene
    inference: Inference
    check: PredictiveCheck
    resonance: int = 1

    @property
    def posterior(self) -> Posterior:
        """The posterior in SI units."""
        own = Posterior(self.inference.names, self.inference.values, self.check.explains)
        device = scene_with(self.scene, own.medians, self.resonance)
        return replace(own, device=values(device.absorber))


@dataclass(frozen=True, eq=False)
class CalibrationAnswer(CompleteAnswer):
    """Posterior of an absorber's parameters given measurements.

    Attributes
    ----------
    measurements : tuple
        Measurements.
    model : CalibratedModel
        The chosen model, with its posterior and predictive check.
    linear : LinearFit, optional
        Frequencies and damping from measurements without a moving absorber; None without such
        measurements.
    alternatives : tuple of CalibratedModel
        Other models, if they were compared.
    plan : MeasurementPlan, optional
        Expected width of the posterior after one more sweep at other forces.
    resonance : int
        Resonance near which the structure was excited, from 1.
    """

    measurements: tuple[Measurement, ...]
    model: CalibratedModel
    linear: LinearFit | None = None
    alternatives: tuple[CalibratedModel, ...] = ()
    plan: MeasurementPlan | None = None
    resonance: int = 1

    @property
    def posterior(self) -> Posterior:
        """The posterior of the parameters in SI units."""
        return self.model.posterior

    @property
    def models(self) -> dict[str, tuple[Inference, PredictiveCheck]]:
        """Inference and check of each model, by name; the chosen model comes first."""
        return {one.name: (one.inference, one.check) for one in (self.model, *self.alternatives)}

    @property
    def warnings(self) -> list[str]:
        """Sentences about failed checks and uncertain results."""
        lines = [] if self.linear is None else self.linear.warnings
        return lines + list_warnings(self.model.inference, self.model.check)

    def make_report(self) -> Report:
        """Return the content of the answer."""
        posterior = self.posterior.to_plain()
        posterior.pop("draws")
        priors = {one.name: one.to_plain() for one in self.model.inference.priors}
        report = make_report(
            self.measurements,
            self.models,
            self.linear,
            self.plan,
            self.warnings,
            {"posterior": posterior, "priors": priors},
        )
        data = {"posterior.json": self.posterior.to_plain(), "device.json": self.device_scene()}
        return replace(report, data=data)

    def device_scene(self) -> Json:
        """Return structure and absorber with the posterior's medians as plain data."""
        return from_scene(self.device)

    @property
    def device(self) -> Scene:
        """Structure and absorber with the posterior's medians."""
        return scene_with(self.model.scene, self.posterior.medians, self.resonance)


class CheckpointedSimulation:
    """Simulation of the ensembles of a calibration, each with a checkpoint entry and progress."""

    def __init__(
        self,
        name: str,
        simulator: Simulator,
        priors: Sequence[Prior],
        seed: int,
        checkpoint: Checkpoint,
        stages: Stages,
    ) -> None:
        self.name = name
        self.simulator = simulator
        self.priors = priors
        self.seed = seed
        self.checkpoint = checkpoint
        self.stages = stages
        basis = {
            "model": name,
            "scene": str(simulator.scene),
            "omega": simulator.scene.model.omega.tolist(),
            "damping": simulator.scene.model.damping_ratio.tolist(),
            "observed": simulator.observed.tolist(),
            "priors": [[one.name, *one.to_plain()] for one in priors],
            "seed": seed,
            "kernels": hash_sources(),
        }
        self.basis = hashlib.sha256(json.dumps(basis, sort_keys=True).encode()).hexdigest()

    def __call__(self, shares: Array, number: int) -> Ensemble:
        """Return the ensemble of a round, from the checkpoint if it is stored there.

        ``shares`` (N, P) of the priors are the parameters, ``number`` is that of the round.
        """
        key = f"{self.basis} round {number}"
        known = self.checkpoint.known.get(key)
        if known is not None and np.allclose(known["shares"], shares, atol=1e-9):
            return Ensemble(shares, np.array(known["statistics"], dtype=np.float64))
        label = f"{self.name}, round {number + 1}"
        with self.stages(label, len(shares)) as show:
            ensemble = simulate_ensemble(
                self.simulator, self.priors, shares, round_seed(self.seed, number), show
            )
        self.checkpoint.store(
            key, {"shares": shares.tolist(), "statistics": ensemble.statistics.tolist()}
        )
        return ensemble


def calibrate_model(
    name: str,
    simulator: Simulator,
    priors: Sequence[Prior],
    runs: CalibrationRuns,
    seed: int,
    checkpoint: Checkpoint,
    stages: Stages,
) -> CalibratedModel:
    """Return the posterior of a model, and its predictive check."""
    simulation = CheckpointedSimulation(name, simulator, priors, seed, checkpoint, stages)
    inference = infer(
        simulator,
        priors,
        seed=seed,
        first_runs=runs.first,
        round_runs=runs.each_round,
        rounds=runs.rounds,
        simulate=simulation,
    )
    with stages(f"{name}, predictive check", runs.replicates) as show:
        check = check_posterior(
            simulator,
            simulator.statistics,
            inference,
            round_seed(seed, runs.rounds + 1),
            runs.replicates,
            show,
        )
    return CalibratedModel(name, simulator.scene, inference, check, simulator.resonance)


def calibrate(
    measurements: Sequence[Measurement] | Path | str,
    structure: Structure,
    absorber: SlidingAbsorber,
    free: Mapping[str, PriorInput] | Sequence[str],
    *,
    resonance: int = 1,
    alternatives: str = WHEN_REFUSED,
    plan: Sequence[float] | None = None,
    runs: CalibrationRuns | None = None,
    seed: int = 0,
    threads: int | None = None,
    checkpoint: Checkpoint | None = None,
    stages: Stages = silent_stages,
) -> CalibrationAnswer:
    """Return the posterior of an absorber's parameters given a measured response.

    The command `calibrate` does the same.

    Parameters
    ----------
    measurements : path, or sequence of measurements
        File of measurements (docs/calibrate.md), or result of `read_measurements`.
    structure : Beam or ModalModel
        Structure that was measured.
    absorber : SlidingAbsorber
        Impact absorber. Its values are those of the parameters that are not free, and the centres
        of the usual ranges of those that are.
    free : dict or sequence of str
        Free parameters: names, or for each name None, (low, high), (low, high, "log") or (mean,
        deviation, "normal"), in SI units.
    resonance : int
        Resonance near which the structure was excited, from 1.
    alternatives : str
        Whether other models of the absorber are compared: "never", "when-refused" by the predictive
        check, or "always".
    plan : sequence of float, optional
        Factors of the measured load for which the benefit of one more sweep is computed; None: no
        plan.
    runs : CalibrationRuns, optional
        Numbers of simulated measurements.
    seed : int
        Seed of all random numbers.
    threads : int, optional
        Threads; the result does not depend on them. Default: all cores.
    checkpoint : Checkpoint, optional
        Storage of finished rounds, from which an interrupted calibration continues.
    stages : callable, optional
        Returns the progress callback of each stage.

    Returns
    -------
    CalibrationAnswer
        Result with `str`, `to_json`, `plot` and `save`.

    Raises
    ------
    ParameterError
        Measurements, structure and parameters do not fit together; raised before long simulations.
    KeyboardInterrupt
        The runs were stopped.

    Examples
    --------
    >>> from impact_env import impact_absorber, load_structure
    >>> arm = load_structure("arm.toml")  # doctest: +SKIP
    >>> absorber = impact_absorber(1e-3, 0.6, 0.1)
    >>> answer = calibrate("shaker.toml", arm, absorber, ["restitution"])  # doctest: +SKIP
    >>> answer.save("results/calibrate")  # doctest: +SKIP
    """
    own = measurements
    if isinstance(own, Path | str):
        own = read_measurements(Path(own))
    every = tuple(own)
    require(len(every) > 0, "measurements", every, "one or more")
    require_moving(every)
    alternatives = one_of("alternatives", alternatives, ALTERNATIVES)
    if plan is not None:
        plan = [positive("plan", factor) for factor in plan]
    absorber = instance("absorber", absorber, SlidingAbsorber)
    runs = CalibrationRuns() if runs is None else runs
    seed = count("seed", seed, 0)
    scene = Scene(model_with_absorber_at(structure), absorber)
    resonance = scene.model.check_resonance(resonance)
    require_plausible(every, structure, resonance)
    linear = fit_linear(structure, scene, every, resonance)
    if linear is not None:
        scene = linear.apply(scene, resonance)
    priors = read_priors(free, scene, resonance)
    middle = {one.name: float(one.at(np.array([0.5]))[0]) for one in priors}
    walls = require_impact_absorber(scene_with(scene, middle, resonance)).walls
    assert walls is not None
    require_reachable_gap(every, scene, walls.gap, resonance)
    simulator = Simulator(structure, scene, every, resonance, threads)
    checkpoint = Checkpoint() if checkpoint is None else checkpoint

    model = calibrate_model("model", simulator, priors, runs, seed, checkpoint, stages)
    others: list[CalibratedModel] = []
    wanted = alternatives == ALWAYS or (alternatives == WHEN_REFUSED and not model.check.explains)
    if wanted:
        for name, (other, own_priors) in list_alternatives(scene, priors, resonance).items():
            simulated = Simulator(structure, other, every, resonance, threads)
            others.append(
                calibrate_model(name, simulated, own_priors, runs, seed, checkpoint, stages)
            )
    planned = None
    if plan is not None:
        planned = _plan(structure, model, every, resonance, plan, seed, threads, stages)
    return CalibrationAnswer(every, model, linear, tuple(others), planned, resonance)


def _plan(
    structure: Structure,
    model: CalibratedModel,
    measurements: Sequence[Measurement],
    resonance: int,
    factors: Sequence[float],
    seed: int,
    threads: int | None,
    stages: Stages,
) -> MeasurementPlan:
    """Return the plan of one more sweep like the first measurement with a moving absorber."""
    first = next(one for one in measurements if one.absorber == "moving")
    chosen = tuple(factors) or FACTORS
    show: LaneProgress | None
    with stages("plan", len(chosen)) as show:
        return plan_measurement(
            structure,
            model.scene,
            first,
            model.posterior,
            resonance,
            factors=chosen,
            seed=seed,
            threads=threads,
            progress=show,
        )
