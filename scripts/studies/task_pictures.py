"""A picture of an episode of a task: what is observed, what is done, and what comes of it, by the chosen rule and by a constant action."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from impact_env.extras import optional
from optimisation.files import replacing
from optimisation.report.figures import BLACK, BLUE, ORANGE, write_figure
from optimisation.rl.families import Array, Random
from optimisation.rl.rules import CONSTANT, EIGHT, TASKS, policies

SEED, DPI = 3, 90
COLOURS = (BLUE, ORANGE)


@dataclass(frozen=True)
class Episode:
    """Times (n + 1,) in pseudo periods, observations (n + 1, features), actions (n, numbers), and levels (n,) over those without absorber.

    ``cumulative``: a level is the passage's so far, and not the mean over the last pseudo period, or interval if that is longer.
    """

    features: list[str]
    times: Array
    observations: Array
    actions: Array
    levels: Array
    cumulative: bool


def actors(task: str) -> dict[str, Any]:
    """Return the chosen rule and constant, and chance for a task that has none."""
    chosen = policies(task) if task in TASKS else {}
    return {"the chosen rule": chosen[EIGHT], CONSTANT: chosen[CONSTANT]} if chosen else {"random actions": Random()}


def episode(task: str, policy: Any) -> Episode:
    """Play an episode."""
    with optional():
        import gymnasium
    env: Any = gymnasium.make(f"ImpactAbsorber/{task}")
    seen, info = env.reset(seed=SEED)
    policy.start(1)
    times, observations, actions, levels, over = [float(info["time"])], [seen], [], [], False
    while not over:
        action = policy.act(seen[None])[0]
        seen, reward, end, cut, info = env.step(action)
        over = end or cut
        times.append(float(info["time"]))
        observations.append(seen)
        actions.append(action)
        levels.append(float(info.get("relative_level", -float(reward))))
    env.close()
    cumulative = "relative_level" in info
    shares = 1 if cumulative else len(levels)  # of a mean, as rewards are
    last = max(1, round(1 / env.unwrapped.task.interval))
    means = [shares * float(np.mean(levels[max(0, k + 1 - last) : k + 1])) for k in range(len(levels))]
    features = [feature.name for feature in env.unwrapped.task.features]
    return Episode(features, np.array(times), np.array(observations), np.array(actions), np.array(means), cumulative)


def draw(path: Path, task: str, found: Mapping[str, Episode]) -> None:
    """Draw the observations of the first episode, and actions and levels of all."""
    first = next(iter(found))
    features, observations, times = found[first].features, found[first].observations, found[first].times
    figure = Figure(figsize=(8.6, 6.0), layout="constrained")
    seen, done, came = figure.subplots(3, 1, sharex=True, height_ratios=(0.24 * len(features), 1, 1.2))
    shown = observations.T / np.maximum(np.abs(observations).max(axis=0), 1e-12)[:, None]
    edges = np.append(times, 2 * times[-1] - times[-2])
    seen.pcolormesh(edges, np.arange(len(features) + 1), shown, cmap="RdBu_r", vmin=-1, vmax=1)
    seen.set_yticks(np.arange(len(features)) + 0.5, features, fontsize=8)
    seen.invert_yaxis()
    figure.suptitle(f"{task}: what is observed (blue below 0, red above), what is done, and the level", fontsize=10)
    for (name, one), colour in zip(found.items(), COLOURS, strict=False):
        for values, style, label in zip(one.actions.T, ("-", (0, (2, 1))), (name, f"{name}: second number"), strict=False):
            done.stairs(values, one.times, baseline=None, color=colour, ls=style, lw=1.3, label=label)
        came.stairs(one.levels, one.times, baseline=None, color=colour, lw=1.3)
    came.axhline(1.0, color=BLACK, lw=0.8, ls=":")
    done.set(ylabel="action", ylim=(-1.08, 1.08))
    came.set(ylabel="level so far" if found[first].cumulative else "RMS and prices")
    came.set(xlabel="time in pseudo periods", xlim=(0, max(one.times[-1] for one in found.values())))
    came.set_ylim(bottom=min(0.0, *(float(one.levels.min()) for one in found.values())))
    for panel in (done, came):
        panel.grid(True, color="0.9", lw=0.7)
    figure.align_ylabels([done, came])
    figure.legend(*done.get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        write_figure(figure, temporary, DPI)


def save_picture(path: Path, task: str) -> None:
    """Draw an episode of a task."""
    draw(path, task, {name: episode(task, policy) for name, policy in actors(task).items()})
