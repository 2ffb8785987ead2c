"""The page of tasks: what each looks like from its own features, and whether it has room above rules of few numbers."""

import inspect
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from impact_env.envs.evaluation import interval
from impact_env.extras import optional
from optimisation.page import markdown
from optimisation.rl.admission import ROOM
from optimisation.rl.rules import EIGHT, TASKS
from studies.study import Json

NAMES = (*(name for name in TASKS if not name.startswith(("SweepRateNoisy", "SweepRateDelayed"))), "SweepRateHard-v0")
PICTURES = "tasks"  # folder beside the page
LANES, STEPS, SPAN = 64, 200, (1, 99)  # of random actions; percentiles


def rooms(found: Mapping[str, Json]) -> str:
    """Return the admission table: mean scores with their intervals over the judged seeds, and the room."""
    columns = list(dict.fromkeys(label for one in found.values() for label in one["scores"]))
    rows = []
    for name, one in found.items():
        cells = []
        for label in columns:
            scores = np.array(one["scores"][label]) if label in one["scores"] else None
            cells.append("-" if scores is None else told(scores))
        share = "{:.2f} [{:.2f}, {:.2f}]".format(*one[ROOM]) if ROOM in one else "-"
        verdict = ("admitted" if one["admitted"] else "no room shown") if ROOM in one else "for comparison"
        rows.append((f"`{name}`", *cells, share, verdict))
    return markdown(("task", *columns, ROOM, "verdict"), rows)


def told(scores: Any) -> str:
    """Return the mean of scores (runs, seeds) with its interval, and how many runs there are if there are several."""
    low, high = interval(np.mean, scores)
    runs = f" ({len(scores)} runs)" if len(scores) > 1 else ""
    return f"{scores.mean():.3f} [{low:.3f}, {high:.3f}]{runs}"


def searches(found: Mapping[str, Json]) -> str:
    """Return each rule's family and how it was tuned."""
    rows = []
    for name, one in found.items():
        effort, best = one["effort"], one["rules"][EIGHT]
        tried = ", ".join(f"{number:.3f}" for number in best["numbers"])
        spent, ahead = f"{effort['searched']} / {effort['judged']}", f"{effort['horizon']}, {effort['copies']}"
        rows.append((f"`{name}`", best["family"], tried, spent, ahead if ROOM in one else "-"))
    return markdown(("task", "best family", "its numbers", "seeds of search / judged", "planner: intervals ahead, copies"), rows)


def parts(kind: type) -> dict[str, str]:
    """Return the sections of an environment's docstring by heading; the text before the first is under an empty one."""
    pieces = re.split(r"^## (.*)$", inspect.getdoc(kind) or "", flags=re.MULTILINE)
    return {"": pieces[0].strip()} | {heading: text.strip() for heading, text in zip(pieces[1::2], pieces[2::2], strict=True)}


def described(names: Sequence[str] = NAMES) -> str:
    """Return a section for each environment, with the ranges of its features under random actions."""
    return "\n\n".join(section(f"ImpactAbsorber/{name}") for name in names)


def section(name: str) -> str:
    """Return the section of one environment."""
    with optional():
        import gymnasium
    env: Any = gymnasium.make_vec(name, num_envs=LANES)
    generator, seen = np.random.default_rng(0), [env.reset(seed=0)[0]]
    seen += [env.step(generator.uniform(-1, 1, env.action_space.shape).astype(np.float32))[0] for _ in range(STEPS)]
    low, high = np.percentile(np.concatenate(seen), SPAN, axis=0)
    text = parts(type(gymnasium.make(name).unwrapped))
    lines = [line for line in text["Observation Space"].splitlines() if re.match(r"\| \d+ \|", line)]
    rows = [[*(cell.strip() for cell in line.strip("| ").split("|")), f"{a:.2g} to {b:.2g}"] for line, a, b in zip(lines, low, high, strict=True)]
    table = markdown(("#", "feature", "unit and scale", f"{SPAN[0]} to {SPAN[1]} % under random actions"), rows)
    flat = {heading: re.sub(r"\s*\n\s*", " ", own) for heading, own in text.items()}
    head = f"## {name.split('/')[1]}\n\n{flat['']} {flat['Description']}\n\n**Action.** {flat['Action Space']}"
    short = name.split("/")[1]
    picture = f"![An episode of {short}: what is observed, what is done, and the level]({PICTURES}/{short}.png)"
    return f"{head}\n\n{table}\n\n**Score.** {flat['Rewards']}\n\n{picture}"
