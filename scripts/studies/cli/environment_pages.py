"""A page for each environment, from its docstring and its arguments."""

# needs: env

import csv
import re
from inspect import getdoc
from typing import Any

import click
import numpy as np

from impact_env.envs import ENVIRONMENTS
from impact_env.envs.arguments import Argument, list_arguments, list_own_arguments
from impact_env.envs.settings import TaskSettings
from impact_env.extras import optional
from optimisation.cli.common import command
from optimisation.executors import Bar
from optimisation.files import DOCS, fill, markdown, read_json, replacing, write_json
from optimisation.rl.rules import CONSTANT, chosen
from studies.printed_blocks import run_source

FOLDER = DOCS / "environments"
OVERVIEW = DOCS / "environments.md"
LEADERBOARD = DOCS / "leaderboard.csv"
MEASURED = FOLDER / "measured.json"  # by page: ranges of the features, and what the example prints
ARGUMENTS = "arguments"  # markers in the overview
PREFIX = "ImpactAbsorber/"
# of random actions; percentiles
LANES = 64
STEPS = 200
SPAN = (1, 99)
# the registered name of each page's example and spaces, in the order of the overview
EXAMPLES = {
    "ActiveFriction": "ActiveFriction-v0",
    "ActiveGap": "ActiveGap-v0",
    "Structures": "Structures-v0",
    "Passage": "Passage-v0",
    "RawSensors": "RawSensors-v0",
    "FrictionChoice": "FrictionChoice-v1",
    "GapChoice": "GapChoice-v1",
    "SweepAndGap": "SweepAndGap-v1",
    "SweepRateV1": "SweepRate-v1",
    "SweepRate": "SweepRateHard-v0",
    "Passive": "Passive-v0",
}
HEADINGS = {
    "Action Space": "Action",
    "Observation Space": "Observation",
    "Rewards": "Reward",
    "Starting State": "Starting state",
    "Episode End": "End of an episode",
}
INTRODUCTION = (
    "<!-- written by reproduce environment-pages from the docstring in impact_env/envs -->"
)


def list_names(page: str) -> list[str]:
    """Return the registered names of a page's environment, without their prefix."""
    return [
        name.removeprefix(PREFIX)
        for name, entry in ENVIRONMENTS.items()
        if entry.place.rpartition(":")[2] == page
    ]


def read_sections(kind: type) -> dict[str, str]:
    """Return the sections of an environment's docstring by heading, as Markdown.

    The text before the first heading has an empty heading.
    """
    pieces = re.split(r"^## (.*)$", getdoc(kind) or "", flags=re.MULTILINE)
    texts = dict(zip(["", *pieces[1::2]], pieces[0::2], strict=True))
    return {heading: to_markdown(text) for heading, text in texts.items()}


def to_markdown(text: str) -> str:
    """Return a docstring's text as Markdown with a line for each paragraph.

    Code is in single backticks, and names of environments become links to their pages.
    """
    paragraphs = [
        part if part.lstrip().startswith(("-", "|")) else " ".join(part.split())
        for part in text.strip().split("\n\n")
    ]
    joined = "\n\n".join(paragraphs).replace("``", "`")
    return re.sub(
        r"`(?:impact_env\.[\w.]+\.)?(\w+)Env`",
        lambda match: f"[{EXAMPLES[match[1]]}]({match[1]}.md)",
        joined,
    )


def make_argument_table(arguments: list[Argument]) -> str:
    """Return the table of arguments."""
    rows = [f"| `{one.name}` | `{one.default}` | {one.meaning} |" for one in arguments]
    return "\n".join(["| argument | default | meaning |", "| --- | --- | --- |", *rows]).replace(
        "``", "`"
    )


def make_example(page: str) -> str:
    """Return an example in Python: an episode with the best constant action of the task."""
    name = EXAMPLES[page]
    rules = chosen()
    numbers = rules[name][CONSTANT]["numbers"] if name in rules else [0.0]
    action = "0" if page == "Passive" else str([round(number, 2) for number in numbers])
    return f"""import gymnasium, impact_env

env = gymnasium.make("{PREFIX}{name}")
observation, info = env.reset(seed=0)
score, intervals, over = 0.0, 0, False
while not over:
    observation, reward, terminated, truncated, info = env.step({action})
    score, intervals = score + float(reward), intervals + 1
    over = terminated or truncated
print(f"{{intervals}} intervals, score {{score:.3f}}")
"""


def describe_example(page: str) -> str:
    """Return the sentence before the example."""
    if page == "Passive":
        return "One episode:"
    best = "the best constant action" if EXAMPLES[page] in chosen() else "a constant action"
    return f"One episode with {best}:"


def measure_page(page: str) -> dict[str, Any]:
    """Return the ranges of the features under random actions, and the example's output."""
    with optional():
        import gymnasium
    env: Any = gymnasium.make_vec(PREFIX + EXAMPLES[page], num_envs=LANES)
    generator = np.random.default_rng(0)
    observations = [env.reset(seed=0)[0]]
    for _ in range(STEPS):
        actions = generator.uniform(-1, 1, env.action_space.shape).astype(env.action_space.dtype)
        observations.append(env.step(actions)[0])
    env.close()
    low, high = np.percentile(np.concatenate(observations), SPAN, axis=0)
    ranges = [f"{a:.2g} to {b:.2g}" for a, b in zip(low, high, strict=True)]
    return {"ranges": ranges, "printed": run_source("python", make_example(page))}


def make_feature_table(observation: str, ranges: list[str]) -> str:
    """Return the section on the observation, with the ranges as a column of its table."""
    text, _, table = observation.partition("\n\n| ")
    if not table:
        return text
    lines = [line for line in table.splitlines() if re.match(r"(\| )?\d+ \|", line)]
    rows = [
        [cell.strip() for cell in line.strip("| ").split("|")] + [span]
        for line, span in zip(lines, ranges, strict=True)
    ]
    header = ("#", "feature", "unit and scale", f"{SPAN[0]} to {SPAN[1]} % under random actions")
    lines = ["| " + " | ".join(row) + " |" for row in (header, ["---"] * len(header), *rows)]
    return text + "\n\n" + "\n".join(lines)


def make_scores(names: list[str]) -> str:
    """Return the table of scores from the leaderboard, empty for an environment without."""
    with LEADERBOARD.open(encoding="utf-8", newline="") as file:
        entries = [row for row in csv.DictReader(file) if row["task"] in names]
    rows = [
        (
            f"`{row['task']}`",
            row["policy"],
            f"{float(row['score']):.3f} [{float(row['low']):.3f}, {float(row['high']):.3f}]",
        )
        for row in sorted(entries, key=lambda row: (names.index(row["task"]), -float(row["score"])))
    ]
    return markdown(("environment", "policy", "score"), rows) if rows else ""


def make_page(page: str, measured: dict[str, Any]) -> str:
    """Return the text of the page of one environment."""
    with optional():
        import gymnasium
    kind: Any = type(gymnasium.make(PREFIX + EXAMPLES[page]).unwrapped)
    texts = read_sections(kind)
    names = list_names(page)
    env = kind()
    own, other = list_own_arguments(kind.kind.groups, kind.kind.defaults)
    picture = DOCS / "tasks" / f"{EXAMPLES[page]}.png"
    facts = {
        "names": ", ".join(f"`{PREFIX}{name}`" for name in names),
        "action space": f"`{env.action_space}`",
        "observation space": f"`{env.observation_space}`",
        "control interval": f"{env.task.interval:g} pseudo periods",
    }
    parts = [f"# {EXAMPLES[page]}", texts[""], texts["Description"]]
    parts.append(
        "\n".join(
            ["| | |", "| --- | --- |", *(f"| {key} | {value} |" for key, value in facts.items())]
        )
    )
    example = f"```python\n{make_example(page)}```\n\n```text\n{measured['printed']}```"
    parts.append(f"{describe_example(page)}\n\n{example}")
    if picture.exists():
        caption = f"An episode of {EXAMPLES[page]}: observations, actions and level"
        parts.append(f"![{caption}](../tasks/{picture.name})")
    for heading, title in HEADINGS.items():
        text = texts[heading]
        if heading == "Observation Space":
            text = make_feature_table(text, measured["ranges"])
            numbers = [str(k) for k, one in enumerate(env.task.features, 1) if one.measured]
            text += (
                f"\n\nSensors measure features {', '.join(numbers)}: noise, drift and delay apply "
                "to these."
            )
        parts.append(f"## {title}\n\n{text}")
    if scores := make_scores(names):
        parts.append(
            "## Scores\n\nMeans of 256 test seeds with 95 % intervals "
            "([baselines](../tasks.md#which-tasks-are-open), "
            f"[leaderboard](../tasks.md#the-leaderboard)).\n\n{scores}"
        )
    remark = texts["Arguments"].partition("- `")[0].strip()
    defaults = ", ".join(f"`{one.name}={one.default}`" for one in other)
    shared = "[Those of all environments](../environments.md#arguments)"
    shared += (
        f" have these other defaults here: {defaults}." if defaults else " have their defaults."
    )
    arguments = "\n\n".join(filter(None, (remark, make_argument_table(own), shared)))
    parts.append(f"## Arguments\n\n{arguments}")
    parts.append(f"## Versions\n\n{texts['Version History']}")
    return "\n\n".join([*parts[:1], INTRODUCTION, *parts[1:]]) + "\n"


def make_shared_table() -> str:
    """Return the table of the arguments of all environments."""
    further = [
        Argument("render_mode", "None", 'Frames: `"rgb_array"`, or `"human"` for a window.'),
        Argument("vector_reward", "False", "Whether the reward is minus the vector of costs."),
    ]
    return make_argument_table([*list_arguments(TaskSettings, {}), *further])


def read_measured() -> dict[str, Any]:
    """Return the ranges and outputs of earlier runs, by page."""
    return dict(read_json(MEASURED)) if MEASURED.exists() else {}


@command()
@click.option("--measure", is_flag=True, help="Simulate again for ranges and printed outputs.")
def main(measure: bool) -> None:
    """Write the page of each environment and the arguments that all have."""
    measured = {} if measure else read_measured()
    for page in Bar(list(EXAMPLES), desc="environments", unit="page", leave=False):
        if page not in measured:
            measured[page] = measure_page(page)
    FOLDER.mkdir(exist_ok=True)
    write_json(MEASURED, {page: measured[page] for page in EXAMPLES})
    for page in EXAMPLES:
        with replacing(FOLDER / f"{page}.md") as temporary:
            temporary.write_text(make_page(page, measured[page]), encoding="utf-8")
    fill(OVERVIEW, OVERVIEW, {ARGUMENTS: make_shared_table()})
    click.echo(f"written: {FOLDER} and {OVERVIEW}")
