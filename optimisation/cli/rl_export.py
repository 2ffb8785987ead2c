"""An agent or a rule for a controller: C source, ONNX or a table of numbers."""

# needs: env

from dataclasses import dataclass
from pathlib import Path

import click

from impact_env.checks import require
from optimisation.cli.common import check_target, command, name_files, plain_errors
from optimisation.cli.options import OptionSpec, file_spec, option
from optimisation.files import replacing, write_json
from optimisation.rl.agents import Agent, load_agent
from optimisation.rl.export import make_table, write_c, write_onnx
from optimisation.rl.families import FamilyPolicy
from optimisation.rl.rules import EIGHT, READ, TASKS, env_of, policies, read_off_agents

FORMS = {"c": ".c", "onnx": ".onnx", "table": ".json"}
POLICIES = ("rule", "rule12", "ppo", "sac", "rpi")


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Options of ``rl export``; None: not given."""

    agent: Path | None = option(
        file_spec("--agent", "File of an agent", section="Computation", usual=True)
    )
    task: str | None = option(
        OptionSpec(
            names=("--task",),
            help="Task whose rule, or agent that ships with the package, is written",
            more=f"{', '.join(TASKS)}.",
            type=click.Choice(list(TASKS)),
            metavar="TASK",
            usual=True,
        )
    )
    policy: str = option(
        OptionSpec(
            names=("--policy",),
            help=f"What of the task: {', '.join(POLICIES)}",
            type=click.Choice(POLICIES),
            metavar="NAME",
            default="rule",
            usual=True,
        )
    )
    form: str = option(
        OptionSpec(
            names=("--to",),
            help=f"What is written: {', '.join(FORMS)}",
            type=click.Choice(list(FORMS)),
            metavar="FORM",
            default="c",
            usual=True,
        )
    )
    out: Path | None = option(
        file_spec(
            "--out",
            "File that is written",
            usual=True,
            default_text="policy.c, policy.onnx or policy.json",
        )
    )


def read_policy(options: ExportOptions) -> tuple[Agent | FamilyPolicy, str]:
    """Return the policy of the options and its environment.

    Raises ParameterError unless exactly one policy is given.
    """
    require(
        (options.agent is None) != (options.task is None),
        "--agent",
        None if options.agent is None else str(options.agent),
        "either --agent FILE or --task TASK",
    )
    if options.agent is not None:
        agent = load_agent(options.agent)
        return agent, agent.env_id
    assert options.task is not None
    if options.policy == "rule":
        return policies(options.task)[EIGHT], env_of(options.task)
    if options.policy == "rule12":
        known = policies(options.task)
        tasks = [task for task in TASKS if task in read_off_agents()]
        require(READ in known, "--task", options.task, f"for rule12 one of {', '.join(tasks)}")
        return known[READ], env_of(options.task)
    return load_agent(options.task, options.policy), env_of(options.task)


@command(
    ExportOptions,
    examples=(
        "rl export --task ActiveFriction-v0 --out rule.c",
        "rl export --task ActiveGap-v0 --policy rpi --to onnx",
    ),
)
def main(options: ExportOptions) -> None:
    """Write an agent or a rule as a file that a controller runs without Python."""
    with plain_errors():
        out = options.out or Path(f"policy{FORMS[options.form]}")
        check_target("--out", out, (FORMS[options.form],))
        policy, env_id = read_policy(options)
        if options.form == "table":
            write_json(out, make_table(policy, env_id))
        elif options.form == "c":
            source = write_c(policy, env_id)
            with replacing(out) as temporary:
                temporary.write_text(source, encoding="utf-8")
        else:
            require(
                isinstance(policy, Agent),
                "--to",
                "onnx",
                "c or table for a rule; onnx for an agent",
            )
            assert isinstance(policy, Agent)
            model = write_onnx(policy)
            with replacing(out) as temporary:
                temporary.write_bytes(model)
        name_files([out])
