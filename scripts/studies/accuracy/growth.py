"""Growth of errors: largest Lyapunov exponent of each scene from twin trajectories.

The impact times of the twins are also compared one by one.

Two runs of the exact method differ by a small amount. After each stretch their distance is noted
and scaled back (G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Meccanica 15, 1980). The
mean logarithm of the growth is the exponent.
"""

from functools import partial
from operator import itemgetter

import numpy as np
from matplotlib.figure import Figure

from impact_env import Drive, Exact, InitialState, constant_frequency, simulate
from optimisation.report.report import figure_of
from studies.accuracy.cases import (
    BARE,
    COLOURS,
    MARKERS,
    RECORD,
    AccuracyCase,
    AccuracySettings,
    Cases,
    Row,
    case,
    kind_named,
    number,
    plain,
    select_page_rows,
    unique,
)
from studies.study import Array, format_table

NAME = "growth"
KINDS = (
    "friction damper",
    "impact, e = 1",
    "impact, e = 0.7",
    "impact, e = 0.7, with friction",
    "compliant walls, soft",
    "compliant walls, stiff",
)
STRETCH = (
    0.5  # pseudo periods at most; less where impacts are many, since the distance has to stay small
)
STRETCH_IMPACTS = 3.0
DISTANCE = 1e-8  # of the state's norm
LEAST_PERIODS = 10.0  # pseudo periods in all
SETTLING = 4  # stretches until the difference points where it grows most
TWIN_DISTANCE = 1e-15
FOLLOWED = 40  # impacts
MOST_PERIODS = 80.0


class _Continued:
    """A case at a constant frequency, which can be gone on with from any state and time."""

    def __init__(self, it: AccuracyCase) -> None:
        self.it = it
        self.scene = it.scene
        self.reference = self.scene.model.resonance_omega(1)
        self.weights = it.weights
        self.stretch = STRETCH
        trial = 10
        self.stretch = min(
            STRETCH,
            STRETCH_IMPACTS
            * STRETCH
            * trial
            / max(1, self.run(it.initial.vector(it.scene), 0, trial)[1]),
        )

    def norm(self, state: Array) -> float:
        return float(np.sqrt(np.sum(self.weights * state**2)))

    def initial(self, state: Array) -> InitialState:
        """Return a start; one that rounding has put outside the cavity is put onto the wall."""
        n = self.it.modes
        state = state.copy()
        walls = getattr(self.scene.absorber, "walls", None)
        if walls is not None and hasattr(walls, "restitution"):
            tip = float(self.scene.model.tip_shape @ state[:n])
            state[n] = tip + np.clip(state[n] - tip, -walls.gap, walls.gap)
        return InitialState(state[:n], state[n + 1 : 2 * n + 1], float(state[n]), float(state[-1]))

    def drive(self, section: int, periods: float) -> Drive:
        ratio = self.it.omega / self.reference
        phase = self.it.phase + self.it.omega * section * self.stretch * self.it.period
        return Drive(
            self.it.kind.force,
            constant_frequency(self.reference, ratio, periods),
            float(np.mod(phase, 2 * np.pi)),
        )

    def run(self, state: Array, section: int, stretches: int = 1) -> tuple[Array, int]:
        response = simulate(
            self.scene,
            self.drive(section, stretches * self.stretch),
            Exact(),
            initial=self.initial(state),
            record=BARE,
        )
        return response.end_state, response.impact_count

    def impact_times(self, state: Array, section: int, periods: float) -> Array:
        response = simulate(
            self.scene,
            self.drive(section, periods),
            Exact(),
            initial=self.initial(state),
            record=RECORD,
        )
        return response.recorded.impacts.time[:FOLLOWED]


def _direction(run: _Continued, generator: np.random.Generator) -> Array:
    """Return a random difference of norm one.

    All degrees of freedom have the same expected energy in it.
    """
    raw = generator.standard_normal(len(run.weights)) / np.sqrt(run.weights)
    return raw / run.norm(raw)


def _grow(
    run: _Continued, settings: AccuracySettings, generator: np.random.Generator
) -> tuple[list[float], int, list[tuple[Array, int]]]:
    """Return growth per interval, number of impacts, and states along the motion.

    The growth is the natural logarithm of the ratio of distances in each interval. Each state comes
    with the number of its interval.
    """
    n = run.it.modes
    start = run.it.initial.vector(run.scene)
    state = start
    growth = []
    impacts = 0
    states = []
    size = DISTANCE * run.norm(state)
    difference = size * _direction(run, generator)
    stretches = int(
        np.clip(LEAST_PERIODS / run.stretch, settings.stretches, 5 * settings.stretches)
    )
    every = -(-stretches // settings.twins)
    for k in range(SETTLING + stretches):
        twin, _ = run.run(state + difference, k)
        state, hits = run.run(state, k)
        grown = run.norm(twin - state)
        if k >= SETTLING:
            impacts += hits
            growth.append(
                float(np.log(grown / size)) if grown > 0 else float(np.log(np.finfo(float).eps))
            )
            if (k - SETTLING) % every == 0:
                states.append((state, k + 1))
        difference = (
            (twin - state) * (size / grown) if grown > 0 else size * _direction(run, generator)
        )
        if grown == 0:  # both at rest in the cavity: the absorber's freedom must stay so
            difference[[n, 2 * n + 1]] = 0.0
    return growth, impacts, states


def _twins(
    run: _Continued,
    states: list[tuple[Array, int]],
    per_period: float,
    generator: np.random.Generator,
) -> Array:
    """Return the time differences (pairs, FOLLOWED) of the k-th impacts of twin runs.

    They are in pseudo periods, for two runs whose states differ by rounding. NaN stands where a run
    has no k-th impact.
    """
    periods = float(np.clip(1.3 * FOLLOWED / max(per_period, 1e-9), 1.0, MOST_PERIODS))
    off = np.full((len(states), FOLLOWED), np.nan)
    for row, (state, section) in zip(off, states, strict=True):
        nudged = state + TWIN_DISTANCE * run.norm(state) * _direction(run, generator)
        one, other = (run.impact_times(x, section, periods) for x in (state, nudged))
        both = min(len(one), len(other))
        row[:both] = np.abs(one[:both] - other[:both]) / run.it.period
    return off


key = itemgetter("scene", "modes")  # of a row: its case


def cases(settings: AccuracySettings) -> Cases:
    """Return a case for each scene and number of modes."""
    return {
        (name, modes): partial(_measured, name, modes, settings)
        for name, modes in settings.scenes_and_modes(KINDS)
    }


def _measured(name: str, modes: int, settings: AccuracySettings) -> list[Row]:
    """Return a row for the exponent, and one for each impact followed."""
    run = _Continued(case(kind_named(name), modes))
    generator = np.random.default_rng(settings.seed)
    growth, impacts, states = _grow(run, settings, generator)
    means = [np.mean(generator.choice(growth, len(growth))) for _ in range(1000)]
    low, high = np.quantile(means, [0.025, 0.975]) / run.stretch
    exponent = float(np.mean(growth)) / run.stretch
    per_period = impacts / (run.stretch * len(growth))
    shared = {"scene": name, "modes": run.it.modes}
    row: Row = {
        **shared,
        "impact": None,
        "exponent_per_period": exponent,
        "exponent_low": float(low),
        "exponent_high": float(high),
        "impacts_per_period": per_period,
        "factor_per_impact": float(np.exp(exponent / per_period)) if per_period > 0 else None,
        "difference_periods": None,
    }
    result = [row]
    if per_period > 0:
        off = _twins(run, states, per_period, generator)
        for k in range(FOLLOWED):
            earlier = off[:, k][np.isfinite(off[:, k])]
            if earlier.size:
                result.append(
                    {
                        **dict.fromkeys(row),
                        **shared,
                        "impact": k + 1,
                        "difference_periods": float(np.median(earlier)),
                    }
                )
    return result


def growth_table(rows: list[Row]) -> str:
    """Return a line for each scene and number of modes."""
    columns = {
        "scene": "{scene}",
        "modes": "{modes}",
        "exponent per pseudo period": "{exponent_per_period:.2f}",
        "95 %": "{exponent_low:.2f} to {exponent_high:.2f}",
        "impacts per pseudo period": "{impacts_per_period:.2f}",
        "factor per impact": "{factor}",
    }
    return format_table(
        columns,
        (
            {**row, "factor": number(row["factor_per_impact"], 3)}
            for row in select_page_rows(rows)
            if row["impact"] is None
        ),
    )


def growth_figures(all_rows: list[Row]) -> dict[str, Figure]:
    """Draw how twins drift apart, and the growth per impact over the number of modes."""
    exponents = [row for row in all_rows if row["impact"] is None]
    twins = [row for row in all_rows if row["impact"] is not None]
    scenes = unique(row["scene"] for row in exponents)
    modes = unique(row["modes"] for row in exponents)
    most = 10 if 10 in modes else modes[-1]
    figure, (left, right) = figure_of(11, 4.8, 1, 2)
    for scene, colour, marker in zip(scenes, COLOURS, MARKERS, strict=False):
        line = [row for row in twins if row["scene"] == scene and row["modes"] == most]
        if line:
            y = np.maximum([row["difference_periods"] for row in line], 1e-17)
            left.plot([row["impact"] for row in line], y, color=colour, marker=marker, ms=3.5, lw=1)
        points = [
            row
            for row in exponents
            if row["scene"] == scene and row["factor_per_impact"] is not None
        ]
        if points:
            factors = [row["factor_per_impact"] for row in points]
            right.plot(
                [row["modes"] for row in points],
                factors,
                color=colour,
                marker=marker,
                ms=6,
                lw=1,
                label=scene,
            )
    left.axhline(1.0, color="0.6", lw=0.8, ls=":")
    left.set(
        yscale="log",
        xlabel="impact",
        ylabel="difference of its time, pseudo periods",
        title=f"Twins that differ by rounding, {most} modes: median",
    )
    right.set(
        xscale="log",
        xlabel="number of modes",
        ylabel="factor by which errors grow per impact",
        title="From the largest Lyapunov exponent",
    )
    plain(right, modes)
    right.axhline(1.0, color="0.6", lw=0.8, ls=":")
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    for panel in (left, right):
        panel.grid(True, color="0.9", lw=0.6)
    return {"growth": figure}
