"""Options of the commands: the table of shared options, and dataclasses of options.

A dataclass of options becomes a command line.

A command declares its options as fields of a frozen dataclass: ``force: float | None =
option("force")`` takes the row ``force`` of `TABLE`, with changes for this command (another
default, say). An option of one command alone has its `OptionSpec` there.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import click

from impact_env.drive import PAPER_LIMITS
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam, RigidWalls

FILE = click.Path(dir_okay=False, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)
FIGURES = (".png", ".pdf", ".svg")
SECTIONS = ("Structure", "Absorber", "Excitation", "Computation", "Runs", "Output")
HELP_ALL = "help_all"  # in the context's meta: all options are listed
Group = TypeVar("Group")
Command = Callable[..., Any]


def at_least(minimum: int) -> click.IntRange:
    """Return the type of integers from a smallest one on."""
    return click.IntRange(min=minimum)


class Words(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """A value of several words or parts.

    Parameters
    ----------
    name : str
        What the value is called.
    parse : callable
        Returns the value of a text; raises ValueError if it has another form.
    form : str
        The form that is allowed, in words, with an example.
    """

    def __init__(self, name: str, parse: Callable[[str], Any], form: str = "") -> None:
        self.name = name
        self.parse = parse
        self.form = form

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> Any:
        """Return the value, or fail with a description of the allowed form.

        A value that is already parsed is returned unchanged.
        """
        if not isinstance(value, str):
            return value
        try:
            return self.parse(value)
        except ValueError:
            self.fail(f"{value!r} is not {self.form}", param, ctx)


def parse_resonance_and_force(text: str) -> tuple[int, float]:
    """Return resonance and force in N of RESONANCE:FORCE."""
    resonance, force = text.split(":")
    return int(resonance), float(force)


def parse_resonances(text: str) -> tuple[int, int]:
    """Return two resonances, counted from 1; one stands for twice the same."""
    first, *others = map(int, text.split())
    (second,) = others or [first]
    return first, second


def parse_distribution(text: str) -> tuple[str, tuple[str, ...]]:
    """Return name and words of NAME=5% or NAME=LOW:HIGH.

    The older form has blanks in place of the signs.
    """
    name, equals, words = text.partition("=")
    if equals:
        return name, tuple(words.split(":"))
    name, *older_words = text.split(" ")
    return name, tuple(older_words)


def is_posterior_file(text: str) -> bool:
    """Return whether a value of --uncertain is the name of a posterior's file."""
    return text.lower().endswith((".json", ".json.gz"))


def count_uncertain_words(words: Sequence[str]) -> int:
    """Return the number of words after --uncertain that form its value.

    They are NAME=VALUE, or in the older form a name followed by one word in % or by two words.
    """
    if "=" in words[0] or is_posterior_file(words[0]):
        return 1
    percent = [word.endswith("%") for word in words[1:3]]
    return 2 if percent[:1] == [True] and percent[1:] != [True] else 3


def count_integers(words: Sequence[str]) -> int:
    """Return how many words after --resonances are its value: two integers, or one word."""
    return 2 if len(words) > 1 and words[0].isdigit() and words[1].isdigit() else 1


@dataclass(frozen=True, kw_only=True)
class OptionSpec:
    """One option of a command line.

    Attributes
    ----------
    names : tuple of str
        As it is typed, the first one in messages; a switch of two sides as
        ``("--card/--no-card",)``, an argument without dashes.
    help : str
        What it is, in one sentence without its full stop; ``unit`` and ``allowed`` are added to it.
    more : str
        Further sentences, which only --help-all prints.
    type : Any
        Type of its value as click takes it: `float`, `int`, a tuple of types, one of click's own
        types; `bool` for a switch.
    unit, allowed : str
        Unit of the value, and the values that are allowed, in words, where the type does not say
        so.
    default : Any
        Value where it is not given.
    default_text : str
        Words of the help in place of a default.
    metavar : str
        Name of its value in the help.
    multiple : bool
        Whether it may be repeated.
    required : bool
        Whether it must be given.
    flag_value : Any
        Value where the option stands without one.
    usual : bool
        Whether --help lists it; --help-all lists every option.
    section : str
        Heading in the help, one of `SECTIONS`.
    older : tuple of str
        Names of the version before, which are taken with a warning.
    hidden : bool
        Whether no help lists it.
    count_words : callable, optional
        Number of words on the command line that are its value, where that differs.
    """

    names: tuple[str, ...]
    help: str
    more: str = ""
    type: Any = float
    unit: str = ""
    allowed: str = ""
    default: Any = None
    default_text: str = ""
    metavar: str = ""
    multiple: bool = False
    required: bool = False
    flag_value: Any = None
    usual: bool = False
    section: str = "Computation"
    older: tuple[str, ...] = ()
    hidden: bool = False
    count_words: Callable[[Sequence[str]], int] | None = None

    @property
    def sentence(self) -> str:
        """Return the help's first sentence, with unit and allowed values."""
        unit = f", in {self.unit}" if self.unit else ""
        allowed = f", {self.allowed}" if self.allowed else ""
        return f"{self.help}{unit}{allowed}."

    def make_parameter(self, parameter: str) -> click.Parameter:
        """Return click's option or argument, which sets a parameter of this name."""
        if not self.names[0].startswith("-"):
            settings = {} if self.default is None else {"default": self.default}
            return click.Argument([parameter], type=self.type, required=self.required, **settings)
        return TableOption(self, parameter)

    def __call__(self, command: Command) -> Command:
        """Add the option to a command that is declared by decorators.

        The name of the option determines the parameter that it sets.
        """
        parameter = self.names[0].partition("/")[0].lstrip("-").replace("-", "_")

        def make(_names: Sequence[str], **_: Any) -> click.Option:
            return TableOption(self, parameter)

        return click.option(cls=make)(command)  # type: ignore[arg-type]


class TableOption(click.Option):
    """An option that is described by an `OptionSpec`."""

    def __init__(self, spec: OptionSpec, parameter: str, **_: Any) -> None:
        settings: dict[str, Any] = {"type": spec.type}
        if spec.default is not None:  # for click None would be a value of its own
            settings["default"] = spec.default
        if spec.type is bool:
            settings = {"is_flag": True, "default": bool(spec.default)}
        elif spec.multiple:
            settings |= {"multiple": True, "default": spec.default or ()}
        if spec.flag_value is not None:
            settings |= {"is_flag": False, "flag_value": spec.flag_value}
        super().__init__(
            [*spec.names, parameter],
            help=spec.sentence,
            metavar=spec.metavar or None,
            required=spec.required,
            hidden=spec.hidden,
            **settings,
        )
        self.spec = spec

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Return the option with its value, and its sentence with the default.

        Further sentences follow if all options are listed.
        """
        if self.hidden:
            return None
        names = ", ".join(sorted(self.opts, key=len))
        if self.secondary_opts:
            names += f"/{self.secondary_opts[0]}"
        elif not self.is_flag:
            names += f" {self.value_name(ctx)}"
        words = [self.spec.sentence]
        if self.spec.more and ctx.meta.get(HELP_ALL):
            words.append(self.spec.more)
        default = self.default_words()
        if self.required:
            words.append("[required]")
        elif default:
            words.append(f"[default: {default}]")
        return names, " ".join(words)

    def value_name(self, ctx: click.Context) -> str:
        """Return what the value is called in the help."""
        if self.spec.metavar:
            return self.spec.metavar
        if isinstance(self.type, click.types.IntParamType):
            return "INTEGER"
        if isinstance(self.type, click.types.FloatParamType):
            return "NUMBER"
        return self.make_metavar(ctx)

    def default_words(self) -> str:
        """Return the default as the help prints it.

        The text is empty if there is no default or if it carries no information.
        """
        if self.spec.default_text:
            return self.spec.default_text
        value = self.spec.default
        if self.secondary_opts:
            return (self.opts if value else self.secondary_opts)[0]
        if self.is_flag or value is None or value == ():
            return ""
        if isinstance(value, tuple | list):
            return " ".join(map(str, value))
        return str(value)


def number(names: str, text: str, **changes: Any) -> OptionSpec:
    """Return an option with a number as its value."""
    return OptionSpec(names=(names,), help=text, **changes)


def switch(names: str, text: str, **changes: Any) -> OptionSpec:
    """Return an option without a value, or with two sides."""
    return OptionSpec(names=(names,), help=text, type=bool, **changes)


def file_spec(names: str, text: str, **changes: Any) -> OptionSpec:
    """Return an option that names a file to be written, or with another section one to be read."""
    settings: dict[str, Any] = {"type": FILE, "metavar": "FILE", "section": "Output"} | changes
    return OptionSpec(names=(names,), help=text, **settings)


LOADS_IN_SHORT = {  # short forms of --load, and the numbers of each
    "base": ("acceleration_m_s2",),
    "unbalance": ("unbalance_kg_m",),
    "random": ("low_hz", "high_hz", "value", "duration_s"),
    "shock": ("peak_n", "pulse_s", "duration_s"),
}
UNCERTAIN_MORE = (
    "damping, frequency, force, gap, restitution or friction: NAME=5% is normal with this "
    "standard deviation, cut at 3; NAME=LOW:HIGH is "
    "uniform, in SI units or in %; design gap also takes the posterior.json of calibrate."
)

# by the parameter that each sets; a command may give another default
TABLE: dict[str, OptionSpec] = {
    "structure": file_spec(
        "--structure",
        "Structure from a .toml or .json file in place of the paper's beam",
        more="Formats: docs/your_structure.md.",
        usual=True,
        section="Structure",
    ),
    "scene": file_spec(
        "--scene",
        "Structure and absorber from a .toml or .json file",
        more="As --device of the design commands writes it (docs/scenes.md).",
        usual=True,
        section="Structure",
    ),
    "modes": number(
        "--modes",
        "Number of modes of the beam",
        type=int,
        default_text=str(Beam.modes),
        section="Structure",
    ),
    "damping": number(
        "--damping",
        "Damping ratio of all modes of the beam",
        default_text=str(Beam.damping_ratio),
        section="Structure",
    ),
    "position": number(
        "--position",
        "Place of the absorber, over the length of a beam",
        more=(
            "And of the response, on the paper's beam; on modes the number of a place in the file."
        ),
        default=Beam.absorber_position,
        section="Structure",
    ),
    "mass_ratio": number(
        "--mass-ratio",
        "Absorber mass over the structure's",
        default=DEFAULT_MASS_RATIO,
        usual=True,
        section="Absorber",
    ),
    "mass_kg": number(
        "--mass-kg", "Absorber mass in place of the ratio", unit="kg", section="Absorber"
    ),
    "gap": number(
        "--gap", "Clearance to either wall", unit="m", default=RigidWalls.gap, section="Absorber"
    ),
    "restitution": number(
        "--restitution",
        "Coefficient of restitution",
        allowed="0 to 1",
        default=RigidWalls.restitution,
        section="Absorber",
    ),
    "friction_limit": number(
        "--friction-limit", "Friction limit, 0 for none", unit="N", section="Absorber"
    ),
    "load": file_spec(
        "--load",
        "Loads other than one force, from a file (docs/loads.md)",
        more="base, unbalance, tones, samples, random, shock; in short: "
        + ", ".join(":".join((kind, *names)).upper() for kind, names in LOADS_IN_SHORT.items())
        + ".",
        usual=True,
        section="Excitation",
    ),
    "force": number(
        "--force",
        "Amplitude of the harmonic force",
        unit="N",
        usual=True,
        section="Excitation",
    ),
    "force_tolerance": number(
        "--force-tolerance",
        "Share by which the force may be larger or smaller",
        allowed="0 to 0.3",
        section="Excitation",
    ),
    "resonance": number(
        "--resonance",
        "Resonance that frequencies refer to, counted from 1",
        type=int,
        default=1,
        usual=True,
        section="Excitation",
        older=("--resonances",),
    ),
    "resonances": number(
        "--resonances",
        "One or two resonances, counted from 1",
        type=Words("resonances", parse_resonances, "one or two resonances, as in 1 2"),
        metavar="R [R]",
        usual=True,
        section="Excitation",
        older=("--resonance",),
        count_words=count_integers,
    ),
    "at": number(
        "--at",
        "Resonance and force in N; may be repeated",
        type=Words("resonance:force", parse_resonance_and_force, "RESONANCE:FORCE, as in 1:3.5"),
        metavar="R:FORCE",
        multiple=True,
        usual=True,
        section="Excitation",
    ),
    "frequency": number(
        "--frequency",
        "Frequency of the force over the resonance",
        usual=True,
        section="Excitation",
        older=("--at",),
    ),
    "start": number(
        "--from",
        "First frequency over the resonance",
        default=PAPER_LIMITS[0],
        usual=True,
        section="Excitation",
    ),
    "stop": number(
        "--to",
        "Last frequency over the resonance",
        default=PAPER_LIMITS[1],
        usual=True,
        section="Excitation",
    ),
    "rate": number(
        "--rate",
        "Sweep rate, in % of the resonance per 100 pseudo periods",
        default_text="1, less by the square of damping below 1 %",
        section="Excitation",
        older=("--percent-per-100-periods",),
    ),
    "uncertain": OptionSpec(
        names=("--uncertain",),
        help="A quantity that is not known; may be repeated",
        more=UNCERTAIN_MORE,
        type=Words("name=5%|low:high", parse_distribution),
        metavar="NAME=5%|LOW:HIGH",
        multiple=True,
        count_words=count_uncertain_words,
    ),
    "free": OptionSpec(
        names=("--free",),
        help="Variable to search as well; may be repeated",
        type=str,
        metavar="NAME",
        multiple=True,
        usual=True,
    ),
    "constraint": OptionSpec(
        names=("--constraint",),
        help="Upper limit of a quantity in SI units; may be repeated",
        type=(str, float),
        metavar="NAME LIMIT",
        multiple=True,
    ),
    "contact": OptionSpec(
        names=("--contact",),
        help="Materials of absorber and wall, and radius of the rounder one in m",
        type=(str, str, float),
        metavar="MATERIAL MATERIAL RADIUS",
    ),
    "limit_level": number("--limit-level", "Level below which the device must stay", unit="m"),
    "points": number("--points", "Number of values from the first to the last", type=int),
    "starts": number(
        "--starts", "Runs from random initial states at each point, 0 for none", type=int
    ),
    "symmetric": switch("--symmetric", "Symmetric orbits only, which is quicker"),
    "over": OptionSpec(
        names=("--over",),
        help="Parameter and its range in SI units",
        type=(str, float, float),
        metavar="PARAMETER LOW HIGH",
        usual=True,
    ),
    "settle": number(
        "--settle",
        "Periods of the force within which a run settles",
        type=int,
        older=("--periods",),
    ),
    "window": number("--window", "Periods of the force by which a run is judged", type=int),
    "tasks": OptionSpec(
        names=("--task",),
        help="Task of the environments; may be repeated",
        type=str,
        metavar="TASK",
        multiple=True,
        usual=True,
    ),
    "episodes": number("--episodes", "Episodes of each policy", type=at_least(1), usual=True),
    "quick": switch("--quick", "A first answer from few runs", usual=True, section="Runs"),
    "members": number(
        "--members",
        "Runs of each point, other in phase and 1e-6 of force",
        type=at_least(1),
        section="Runs",
    ),
    "designs": number(
        "--designs",
        "Designs to search, rounded up to whole batches",
        type=at_least(2),
        usual=True,
        section="Runs",
    ),
    "batch": number("--batch", "Runs in one call", type=at_least(2), section="Runs"),
    "seed": number(
        "--seed",
        "Seed of all that is drawn at random",
        type=at_least(0),
        default=0,
        section="Runs",
    ),
    "threads": number(
        "--threads",
        "Number of threads; no result depends on it",
        type=at_least(1),
        default_text="all cores",
        section="Runs",
    ),
    "cluster": OptionSpec(
        names=("--cluster",),
        help="Send the runs to the workers of the Dask scheduler at this address",
        type=str,
        metavar="ADDRESS",
        section="Runs",
    ),
    "resume": file_spec(
        "--resume",
        "Save each finished part in this file, and continue from it",
        section="Runs",
    ),
    "study": file_spec(
        "--study",
        "File of the search, which continues from it",
        default_text="study.journal in the folder, quick.journal with --quick",
        section="Runs",
    ),
    "json": file_spec("--json", "Write the results", metavar="FILE|-", usual=True),
    "csv": file_spec("--csv", "Write a row for each point"),
    "plot": file_spec(
        "--plot",
        f"Draw the results: {', '.join(FIGURES[:-1])} or {FIGURES[-1]}",
        usual=True,
        older=("--figure",),
    ),
    "out": OptionSpec(
        names=("--out",),
        help="Folder for figures and tables",
        type=click.Path(path_type=Path),
        metavar="FOLDER",
        usual=True,
        section="Output",
    ),
    "history": file_spec(
        "--history",
        "Write or draw the motion of the run with the highest level",
        more=".csv or .npz (every sample, SI units), or .png, .pdf, .svg.",
    ),
    "device": file_spec("--device", "Write structure and recommended absorber as a scene, .json"),
    "no_card": switch(
        "--no-card",
        "Leave the card out",
        more="It says what the device bears, and what a tuned absorber or a damper would do.",
        section="Output",
    ),
    "page": file_spec("--page", "Write the table into this page"),
}


def option(row: str | OptionSpec, **changes: Any) -> Any:
    """Return a dataclass field that the command offers as an option.

    Parameters
    ----------
    row : str or OptionSpec
        Row of `TABLE`, or the option of one command alone.
    **changes
        Attributes of the row that differ for this command.
    """
    spec = replace(TABLE[row] if isinstance(row, str) else row, **changes)
    default = spec.default
    if spec.type is bool:
        default = bool(default)
    elif spec.multiple:
        default = default or ()
    return field(default=default, kw_only=True, metadata={"spec": spec})


def option_values(specs: Mapping[str, tuple[str, OptionSpec]]) -> Any:
    """Return a dataclass field that collects several options.

    Its value is a mapping of the given options by names of values.

    ``specs`` has the parameter of the command line and its option, by the name of the value.
    """
    return field(default_factory=dict, kw_only=True, metadata={"values": specs})


def list_specs(group: type) -> dict[str, OptionSpec]:
    """Return the options of a dataclass, by the parameters that they set."""
    specs: dict[str, OptionSpec] = {}
    for one in fields(group):
        if "spec" in one.metadata:
            specs[one.name] = one.metadata["spec"]
        specs |= dict(one.metadata.get("values", {}).values())
    return specs


def name_parameter(args: Sequence[str], usual: str | None = None) -> list[str]:
    """Return arguments with --over PARAMETER LOW HIGH in place of an older form.

    The older form is --along or --with PARAMETER and --over LOW HIGH.

    ``usual`` is the parameter where the older form had none; None: the older form always named it.
    """
    words = list(args)
    name = usual
    for older in ("--along", "--with"):
        if older in words[:-1]:
            k = words.index(older)
            name = words[k + 1]
            del words[k : k + 2]
            click.echo(
                (
                    f"warning: {older} {name} is --over {name} LOW HIGH now; the next version "
                    "does not know the older form"
                ),
                err=True,
            )
    if "--over" in words[:-1] and name is not None:
        k = words.index("--over") + 1
        if is_number(words[k]):
            words.insert(k, name)
    elif name != usual:
        words += ["--over", str(name)]
    return words


def is_number(text: str) -> bool:
    """Return whether a word is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def make_options(group: type[Group], values: Mapping[str, Any]) -> Group:
    """Return the dataclass with the values of a command line."""
    settings: dict[str, Any] = {}
    for one in fields(group):  # type: ignore[arg-type]
        if "spec" in one.metadata:
            settings[one.name] = values[one.name]
        elif "values" in one.metadata:
            settings[one.name] = {
                name: values[parameter]
                for name, (parameter, _) in one.metadata["values"].items()
                if values[parameter] is not None
            }
    return group(**settings)


def join_words(
    args: Sequence[str], counters: Mapping[str, Callable[[Sequence[str]], int]]
) -> list[str]:
    """Return arguments in which the words after each option of ``counters`` are joined.

    They become a single argument with blanks between the words.
    """
    joined: list[str] = []
    k = 0
    while k < len(args):
        word = args[k]
        joined.append(word)
        k += 1
        if word in counters and k < len(args):
            number_of_words = counters[word](args[k:])
            joined.append(" ".join(args[k : k + number_of_words]))
            k += number_of_words
    return joined


def rename_older(args: Sequence[str], parameters: Iterable[click.Parameter]) -> list[str]:
    """Return arguments in which names of the previous version are replaced by present ones.

    Each replacement prints a warning on stderr.
    """
    options = [one for one in parameters if isinstance(one, TableOption)]
    known = {name for one in parameters for name in (*one.opts, *one.secondary_opts)}
    renamed = {
        older: one.opts[0] for one in options for older in one.spec.older if older not in known
    }
    words = []
    for word in args:
        name, equals, value = word.partition("=")
        if name in renamed:
            click.echo(
                (
                    f"warning: {name} is called {renamed[name]} now; the next version does not "
                    "know the older name"
                ),
                err=True,
            )
            word = renamed[name] + equals + value
        words.append(word)
    return words
