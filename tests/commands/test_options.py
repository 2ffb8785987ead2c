"""Names of commands and options agree with one table.

Help fits on one screen, examples work, and names of the previous version are accepted.
"""

import json
import re
import shlex
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner, Result

from optimisation.cli.group import imported, main, make_group
from optimisation.cli.names import (
    GROUPS,
    HEADINGS,
    OLDER_DEFAULTS,
    OLDER_NAMES,
    find_command,
    list_commands,
)
from optimisation.cli.options import TABLE, TableOption, list_specs

SHIPPED = [name for names in HEADINGS.values() for name in names]
PROGRAM = "impact-absorber"
SCREEN = 40  # lines
WIDTH = 80  # columns
# options whose value is of another kind elsewhere: a list of harmonics, a name with its prior, a
# kind of file
OTHER_KINDS = {"--free", "--from", "--harmonics", "--to"}
# examples that take at most seconds, once kernels are compiled, and write into the folder
RUN = (
    "cache",
    "doctor",
    "periodic folds",
    "periodic isola",
    "periodic manifold",
    "periodic orbits",
    "sweep",
)


def invoke(*words: str) -> Result:
    return CliRunner().invoke(main, words, prog_name=PROGRAM)


def help_of(name: str, option: str = "--help") -> str:
    result = CliRunner(env={"COLUMNS": str(WIDTH)}).invoke(
        main, [*name.split(), option], prog_name=PROGRAM, terminal_width=WIDTH
    )
    assert result.exit_code == 0, result.output
    return result.stdout


def parse(line: str) -> dict[str, Any]:
    """Return the parameters of a command line, parsed by the group as for a user."""
    words = shlex.split(line)
    context = main.make_context(PROGRAM, list(words))
    command: click.Command = main
    while isinstance(command, click.Group):
        arguments = [*context._protected_args, *context.args]
        name, command, arguments = command.resolve_command(context, arguments)
        context = command.make_context(name, arguments, parent=context)
    return context.params


def options_of(name: str) -> list[TableOption]:
    return [one for one in imported(name).main.params if isinstance(one, TableOption)]


def examples() -> list[tuple[str, str]]:
    return [(name, line) for name in SHIPPED for line in imported(name).main.examples]


@pytest.mark.parametrize("name", ["", *(g for g in GROUPS if g != "reproduce"), *SHIPPED])
def test_help_is_one_screen(name: str) -> None:
    lines = help_of(name).splitlines()
    assert "UNSET" not in help_of(name)
    assert len(lines) <= SCREEN
    assert max(map(len, lines)) <= WIDTH


@pytest.mark.parametrize("name", SHIPPED)
def test_all_options_are_those_of_the_table(name: str) -> None:
    """All options of a command are those of the table.

    Click's options are those that the dataclass declares and that --help-all lists. Each name has
    one meaning.
    """
    command = imported(name).main
    offered = {option for one in command.params for option in one.opts if option[0] == "-"}
    everything = help_of(name, "--help-all") if "--help-all" in offered else help_of(name)
    short = help_of(name)
    for one in options_of(name):
        option = one.opts[0]
        listed = re.search(rf"^  {re.escape(option)}[ /\n]", everything, re.MULTILINE)
        assert bool(listed) != one.hidden
        usual = re.search(rf"^  {re.escape(option)}[ /\n]", short, re.MULTILINE)
        assert bool(usual) == (one.spec.usual and not one.hidden), option
    plain = [one for one in command.params if not isinstance(one, TableOption | click.Argument)]
    assert {one.opts[0] for one in plain} <= {"--help-all"}


def kind_of(one: TableOption) -> str:
    """Return what the value of an option is: a number, a text, or the name of another type."""
    if isinstance(one.type, click.types.IntParamType | click.types.FloatParamType):
        return "number"
    if isinstance(one.type, click.types.StringParamType | click.Choice):
        return "text"
    return type(one.type).__name__


def test_an_option_of_several_commands_is_one_row_of_the_table() -> None:
    users: dict[str, list[TableOption]] = {}
    for name in SHIPPED:
        for one in options_of(name):
            users.setdefault(one.spec.names[0], []).append(one)
    for option in users.keys() - OTHER_KINDS:
        assert len({kind_of(one) for one in users[option]}) == 1, option
        assert len({one.spec.unit for one in users[option]}) == 1, option
        assert len({one.spec.section for one in users[option]}) == 1, option


def test_a_dataclass_of_options_has_no_other_fields_than_those_of_its_command() -> None:
    for name in SHIPPED:
        module = imported(name)
        (group,) = {
            hint
            for hint in module.main.callback.__wrapped__.__annotations__.values()
            if isinstance(hint, type)
        } or {None}
        assert group is not None, name
        specs = list_specs(group)
        parameters = [one.name for one in module.main.params if one.name != "help_all"]
        assert list(specs) == parameters
        declared = {one.name for one in fields(group) if "spec" in one.metadata}
        assert declared <= set(parameters)


@pytest.mark.parametrize(("name", "line"), examples())
def test_an_example_is_understood(name: str, line: str) -> None:
    assert find_command(shlex.split(line))[0] == name
    assert parse(line)
    assert len(f"  {PROGRAM} {line}") <= WIDTH


def test_every_command_has_an_example() -> None:
    assert {name for name, _ in examples()} == set(SHIPPED)


@pytest.mark.slow
@pytest.mark.parametrize("name", RUN)
def test_an_example_runs(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoke(*shlex.split(imported(name).main.examples[0]))
    assert result.exit_code == 0, result.output


# the whole of the version before's names, with the shortest line that each needs
OLDER_LINES = {
    "compare_absorbers": "--quick",
    "design_gap": "--force 3.5",
    "design_place": "--force 3.5",
    "optimise_design": "--at 1:3.5",
    "pareto": "--quick",
    "mass_ratios": "--members 2",
    "tune_ltva": "--quick",
    "frequency_response": "--modes 2",
    "balance_error": "",
    "orbits": "--modes 2",
    "isola": "--modes 2",
    "manifold": "--points 1",
    "train": "--quick",
    "judge": "--episodes 4",
    "record_demonstrations": "--episodes 2",
    "render_episode": "--frames 4",
}
# values of the version before that are others now
BEFORE = {
    "compare_absorbers": {"out": Path("results/compare_absorbers")},
    "optimise_design": {"out": Path("results/optimise_design")},
    "pareto": {"out": Path("results/pareto")},
    "tune_ltva": {"out": Path("results/tune_ltva")},
    "frequency_response": {"start": 0.88},
    "balance_error": {"start": 0.85, "stop": 1.1},
    "isola": {"stop": 1.0},
    "manifold": {"start": 0.92, "stop": 1.04},
}


@pytest.mark.parametrize("older", OLDER_NAMES)
def test_a_name_of_the_version_before_is_the_same_command(
    older: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert set(OLDER_LINES) == set(OLDER_NAMES)
    assert set(OLDER_DEFAULTS) == set(BEFORE)
    of_now = parse(f"{OLDER_NAMES[older]} {OLDER_LINES[older]}")
    assert capsys.readouterr().err == ""
    before = parse(f"{older} {OLDER_LINES[older]}")
    assert before == of_now | BEFORE.get(older, {})
    printed = capsys.readouterr()
    assert printed.out == ""
    (note,) = printed.err.splitlines()
    assert note.startswith(f"note: {older} is called {OLDER_NAMES[older]} now")
    assert f"  {older} " not in help_of("")


def test_an_older_name_has_the_same_output_to_the_byte(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    line = "--modes 1 --points 0 --json -"
    before = invoke("manifold", *line.split(), "--forces", "1,2")
    of_now = invoke("periodic", "manifold", *line.split(), "--orbit-forces", "1,2")
    assert before.exit_code == of_now.exit_code == 0
    assert before.stdout == of_now.stdout
    assert json.loads(before.stdout)
    command, option, *printed = before.stderr.splitlines()
    assert command.startswith("note: manifold is called periodic manifold now")
    assert option.startswith("warning: --forces is called --orbit-forces now")
    assert printed == of_now.stderr.splitlines()


OLDER_OPTIONS = {  # lines of the version before, and the same in options of now
    "periodic orbits --at 0.9": "periodic orbits --frequency 0.9",
    "periodic orbits --at 0.9 --along force --over 1 2": "periodic orbits --frequency 0.9 --over force 1 2",
    "periodic orbits --curve fold --with gap --over 1e-3 2e-3": "periodic orbits --curve fold --over gap 1e-3 2e-3",
    "periodic curves --over 1 2": "periodic curves --over force 1 2",
    "periodic curves --with gap --over 1e-3 2e-3": "periodic curves --over gap 1e-3 2e-3",
    "periodic basins --at 0.9 --periods 300": "periodic basins --frequency 0.9 --settle 300",
    "periodic basins --over force 1 2 --map gap 1 2 --random": "periodic basins --over force 1 2 --map gap 1 2 --random-start",
    "periodic diagram --over force 1 2 --random": "periodic diagram --over force 1 2 --random-start",
    "periodic section --at 0.9": "periodic section --frequency 0.9",
    "periodic balance-error --at 0.9": "periodic balance-error --frequency 0.9",
    "periodic manifold --forces 1,2": "periodic manifold --orbit-forces 1,2",
    "design tune --low 0.8 --high 1.2": "design tune --from 0.8 --to 1.2",
    "design search --over mean": "design search --combine mean",
    "design gap --uncertain gap 5%": "design gap --uncertain gap=5%",
    "design gap --uncertain force 3 4": "design gap --uncertain force=3:4",
    "design gap --uncertain damping -5% 5%": "design gap --uncertain damping=-5%:5%",
    "design gap --percent-per-100-periods 2": "design gap --rate 2",
    "design gap --resonances 2": "design gap --resonance 2",
    "compare --resonances 2 2": "compare --resonances 2",
    "compare --resonance 2": "compare --resonances 2",
    "sweep --figure a.png": "sweep --plot a.png",
    "prepare --host": "prepare --this-processor",
    "rl train --demonstrations sets/rule-v0": "rl train --from sets/rule-v0",
}


@pytest.mark.parametrize("before", OLDER_OPTIONS)
def test_an_option_of_the_version_before_is_the_same(before: str) -> None:
    assert parse(before) == parse(OLDER_OPTIONS[before])


def test_every_older_option_is_tested() -> None:
    known = {
        (option, name) for name in SHIPPED for one in options_of(name) for option in one.spec.older
    }
    tested = " ".join(OLDER_OPTIONS)
    assert {option for option, _ in known} <= set(re.findall(r"--[\w-]+", tested))


def test_an_older_option_is_named_on_standard_error(capsys: pytest.CaptureFixture[str]) -> None:
    parse("periodic section --at=0.9")
    assert capsys.readouterr() == (
        "",
        "warning: --at is called --frequency now; the next version does not know the older name\n",
    )


@pytest.mark.parametrize(
    ("words", "suggestion"),
    [
        ("desing", "design"),
        ("gap", "design gap"),
        ("isolas", "periodic isola"),
        ("compere", "compare"),
        ("optimise_desing", None),
        ("design gpa", "design gap"),
        ("periodic isolas", "periodic isola"),
        ("rl trian", "rl train"),
    ],
)
def test_an_unknown_command_suggests_the_nearest_name(words: str, suggestion: str | None) -> None:
    result = invoke(*words.split())
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"there is no command {words}" in result.stderr
    if suggestion is not None:
        assert re.search(rf"did you mean (.* or )?{suggestion}( or |\?)", result.stderr)


def test_commands_are_those_of_the_modules() -> None:
    known = list_commands()
    assert all(file.is_file() for file in known.values())
    for prefix in GROUPS:
        with click.Context(make_group(prefix)) as context:
            listed = make_group(prefix).list_commands(context)
        assert {f"{prefix} {name}" for name in listed} == {
            name for name in known if name.startswith(f"{prefix} ")
        }


def test_a_row_of_the_table_says_unit_default_and_what_is_allowed() -> None:
    spec = replace(TABLE["restitution"], usual=True)
    option = spec.make_parameter("restitution")
    with click.Context(click.Command("one")) as context:
        assert option.get_help_record(context) == (
            "--restitution NUMBER",
            "Coefficient of restitution, 0 to 1. [default: 1.0]",
        )
        gap = TABLE["gap"].make_parameter("gap")
        assert gap.get_help_record(context) == (
            "--gap NUMBER",
            "Clearance to either wall, in m. [default: 0.001]",
        )
