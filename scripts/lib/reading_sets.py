"""Count how much code a reader opens to answer five questions, and other measures.

The other measures also describe how readable the sources are. No limit is set on any of the
numbers.

``python scripts/lib/reading_sets.py`` runs each question's example and records every function of
the two packages that it enters, as somebody would who follows it in a debugger. A traced run is
taken instead of a search through the sources for names, since it also follows tables of functions
and methods of subclasses, and takes only the branch that runs. Functions that run only while a
module is imported do not count. The questions about the simulator run kernels in plain Python,
those about commands take compiled kernels as closed boxes. It prints, of each question: files,
functions, lines of these functions, and lines of these files.
"""

import argparse
import ast
import importlib
import io
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import tokenize
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("impact_env", "optimisation")
SOURCES = (*PACKAGES, "scripts", "tests")
FUNCTION = 1  # flag CO_OPTIMIZED of a code object: a function's, not a module's or a class's
SHORT = 4  # lines of a function that is better written where it is used, if that is one place
LAYOUT = {
    tokenize.NEWLINE,
    tokenize.NL,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.COMMENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
}


def simulate_force() -> Callable[[], object]:
    """Return a sweep of an impact absorber with friction."""
    import impact_env

    beam = impact_env.Beam(modes=2)
    scene = impact_env.beam_scene(beam, impact_env.impact_absorber(friction_limit=0.1))
    schedule = impact_env.linear_sweep(scene.model.resonance_omega(1), 0.98, 0.99, 100.0)
    return lambda: impact_env.simulate(scene, impact_env.Drive(12.0, schedule))


def step_environment() -> Callable[[], object]:
    """Return an action in an environment."""
    import gymnasium

    import impact_env  # noqa: F401 - registers the environments

    env: Any = gymnasium.make("ImpactAbsorber/SweepRate-v1", interval=2.0, limits=(0.97, 0.98))
    env.reset(seed=0)
    action = env.action_space.sample()
    return lambda: env.step(action)


def simulate_loads() -> Callable[[], object]:
    """Return a run under a load that a file describes."""
    import impact_env
    from impact_env.plain_loads import read_loads

    text = (
        '[load]\nkind = "tones"\nduration_s = 0.03\ntones = [{ amplitude_n = 9.0, frequency_hz = '
        "40.0 }]\n"
    )
    scene = impact_env.beam_scene(impact_env.Beam(modes=2), impact_env.impact_absorber(3e-4))

    def run() -> object:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "load.toml"
            file.write_text(text)
            loads = read_loads(file, scene.model.resonance_omega(1))
        return impact_env.simulate(scene, loads)

    return run


def command(*words: str) -> Callable[[], object]:
    """Return a call of a command, in a folder of its own."""

    def run() -> object:
        from click.testing import CliRunner

        from optimisation.cli.names import find_command, imported

        with tempfile.TemporaryDirectory() as folder:
            name, length = find_command(words)
            arguments = [*words[length:], "--out", folder]
            result = CliRunner().invoke(imported(name).main, arguments)
        if result.exit_code:
            raise SystemExit(f"{' '.join(words)}: {result.output}")
        return result

    return run


SMALL = ("--modes", "2", "--rate", "40", "--members", "2")
QUESTIONS: dict[str, tuple[str, Callable[[], Callable[[], object]], bool]] = {
    "a": ("a force amplitude, from simulate to the innermost kernel", simulate_force, True),
    "b": ("an action through env.step", step_environment, True),
    "c": ("a [load] table, from the file to the kernel", simulate_loads, True),
    "d": (
        "design gap, from the command line to the card",
        lambda: command("design", "gap", "--quick", "--force", "3.5", *SMALL),
        False,
    ),
    "e": (
        "design search",
        lambda: command(
            *("design", "search", "--quick", *SMALL, "--batch", "4", "--designs", "4"),
            "--no-figures",
        ),
        False,
    ),
}


class Trace:
    """Records the functions of the packages that run, in all threads.

    Functions that run during an import are not recorded.
    """

    def __init__(self) -> None:
        self.codes: set[CodeType] = set()
        self.roots = tuple(str(ROOT / package) + os.sep for package in PACKAGES)
        self.importing = threading.local()

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if code.co_name == "<module>" and event in ("call", "return"):
            depth = getattr(self.importing, "depth", 0)
            self.importing.depth = depth + (1 if event == "call" else -1)
            return
        importing = getattr(self.importing, "depth", 0) > 0
        is_function = bool(code.co_flags & FUNCTION)
        if (
            event == "call"
            and is_function
            and not importing
            and code.co_filename.startswith(self.roots)
        ):
            self.codes.add(code)

    def run(self, function: Callable[[], object]) -> None:
        """Run a function under observation."""
        threading.setprofile(self)
        sys.setprofile(self)
        try:
            function()
        finally:
            sys.setprofile(None)
            threading.setprofile(None)


def function_ends(file: Path) -> dict[int, int]:
    """Return the last line of each function in a file, by its first one, decorators included."""
    ends = {}
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
            ends[first] = node.end_lineno or node.lineno
    return ends


def measure_question(name: str) -> dict[str, Any]:
    """Run a question's example in this process and count what it enters."""
    trace = Trace()
    trace.run(QUESTIONS[name][1]())
    files: dict[Path, set[int]] = {}
    for code in trace.codes:
        files.setdefault(Path(code.co_filename), set()).add(code.co_firstlineno)
    functions = 0
    lines: set[tuple[Path, int]] = set()
    for file, starts in files.items():
        ends = function_ends(file)
        for start in starts & ends.keys():
            functions += 1
            lines |= {(file, line) for line in range(start, ends[start] + 1)}
    return {
        "files": len(files),
        "functions": functions,
        "lines": len(lines),
        "lines_of_files": sum(len(file.read_text().splitlines()) for file in files),
        "names": sorted(str(file.relative_to(ROOT)) for file in files),
    }


def measure_in_process(name: str) -> dict[str, Any]:
    """Return `measure_question`'s counts from a process of its own."""
    plain = {"NUMBA_DISABLE_JIT": "1"} if QUESTIONS[name][2] else {}
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, __file__, "--question", name],
        env=os.environ | plain | {"PYTHONPATH": path, "MPLBACKEND": "Agg"},
        stdout=subprocess.PIPE,
        check=True,
        text=True,
    )
    counts: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return counts


def files_of(folder: str, suffix: str = "py") -> list[Path]:
    """Return a folder's files with a suffix, Python files unless another one is given."""
    return sorted((ROOT / folder).rglob(f"*.{suffix}"))


def count_tokens(file: Path) -> int:
    """Return the number of tokens of a file, without comments and layout."""
    text = io.StringIO(file.read_text(encoding="utf-8"))
    return sum(token.type not in LAYOUT for token in tokenize.generate_tokens(text.readline))


def repeated_classes() -> dict[str, list[str]]:
    """Return the files of each class name that is defined more than once in the packages."""
    places: dict[str, list[str]] = {}
    for file in (file for package in PACKAGES for file in files_of(package)):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name, []).append(str(file.relative_to(ROOT)))
    return {name: files for name, files in sorted(places.items()) if len(files) > 1}


def _functions(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("__"):
            yield node


def list_public_names() -> set[str]:
    """Return the names that users of the packages know.

    They are the names in ``__all__``, those in code on pages of the documentation, and the methods
    of classes in its reference, which lists all members.
    """
    pages = [ROOT / "README.md", *files_of("docs", "md")]
    names: set[str] = set()
    for page in pages:
        for code in re.findall(r"```.*?```|`[^`]+`", page.read_text(encoding="utf-8"), re.DOTALL):
            names |= set(re.findall(r"\w+", code))
    reference = "".join(page.read_text(encoding="utf-8") for page in files_of("docs/site", "rst"))
    classes = re.findall(r"^\.\. autoclass:: (?:\w+\.)*(\w+)", reference, re.MULTILINE)
    for file in (file for package in PACKAGES for file in files_of(package)):
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Assign | ast.AugAssign) and "__all__" in ast.unparse(node):
                constants = [part for part in ast.walk(node) if isinstance(part, ast.Constant)]
                names |= {str(constant.value) for constant in constants}
            elif isinstance(node, ast.ClassDef) and node.name in classes:
                methods = [part for part in node.body if isinstance(part, ast.FunctionDef)]
                names |= {method.name for method in methods if not method.name.startswith("_")}
    return names


def is_override(file: Path, name: str) -> bool:
    """Return whether a function is a method that a base class has, too.

    The base class may belong to a library. False if the file cannot be imported, which needs the
    libraries that it uses.
    """
    if str(ROOT) not in sys.path:
        sys.path.insert(0, str(ROOT))
    try:
        module = importlib.import_module(".".join(file.relative_to(ROOT).with_suffix("").parts))
    except ImportError:
        return False
    own = [kind for kind in vars(module).values() if isinstance(kind, type)]
    return any(
        name in vars(kind) and any(name in vars(base) for base in kind.__mro__[1:])
        for kind in own
        if kind.__module__ == module.__name__
    )


def small_functions_used_once(package: str) -> dict[str, bool]:
    """Return the short functions of a package that a single place uses.

    These functions have a name that no other function has, at most `SHORT` lines, and one place
    that names them. Methods that override a method of a base class do not count, because the base
    class calls them by name, nor do functions that are exported or documented: those with a name
    in `list_public_names`.

    The value of each is True if that place calls it. A function that is a value there, a property,
    or one with a cache cannot be written where it is used.
    """
    public = list_public_names()
    definitions: Counter[str] = Counter()
    uses: Counter[str] = Counter()
    called: set[str] = set()
    short: dict[str, Path] = {}
    for file in (file for folder in SOURCES for file in files_of(folder)):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
                uses[node.id] += 1
            elif isinstance(node, ast.Attribute):
                uses[node.attr] += 1
            elif isinstance(node, ast.Call):
                called.add(getattr(node.func, "id", getattr(node.func, "attr", "")))
        for function in _functions(tree):
            definitions[function.name] += 1
            body = function.body[bool(ast.get_docstring(function)) :]
            cached = any("cache" in ast.unparse(one) for one in function.decorator_list)
            if body and not cached and file.is_relative_to(ROOT / package):
                length = (body[-1].end_lineno or 0) - body[0].lineno + 1
                if length <= SHORT:
                    short[function.name] = file
    return {
        f"{file.relative_to(ROOT)} {name}": name in called
        for name, file in sorted(short.items(), key=lambda pair: (pair[1], pair[0]))
        if definitions[name] == 1
        and uses[name] == 1
        and name not in public
        and not is_override(file, name)
    }


def main() -> None:
    """Print the measures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--question", choices=QUESTIONS, help="one question, as JSON")
    parser.add_argument("--names", action="store_true", help="name files, classes and functions")
    options = parser.parse_args()
    if options.question:
        print(json.dumps(measure_question(options.question)))
        return
    print("What a reader opens:  files  functions  their lines  lines of the files")
    for key, (question, _, _) in QUESTIONS.items():
        measured = measure_in_process(key)
        counts = (
            measured["files"],
            measured["functions"],
            measured["lines"],
            measured["lines_of_files"],
        )
        print("({})  {:5} {:10} {:12,} {:19,}   {}".format(key, *counts, question))
        if options.names:
            print("".join(f"         {name}\n" for name in measured["names"]), end="")
    tokens = {folder: sum(map(count_tokens, files_of(folder))) for folder in SOURCES}
    words = ", ".join(f"{folder} {count:,}" for folder, count in tokens.items())
    print(f"Tokens of Python: {words}, together {sum(tokens.values()):,}")
    repeated = repeated_classes()
    print(f"Class names defined more than once: {len(repeated)}")
    if options.names:
        print(
            "".join(f"         {name}: {', '.join(at)}\n" for name, at in repeated.items()), end=""
        )
    for package in PACKAGES:
        small = small_functions_used_once(package)
        count = sum(small.values())
        print(
            f"Functions of at most {SHORT} lines used once in {package}: {len(small)}, "
            f"{count} of them by a call"
        )
        if options.names:
            print(
                "".join(
                    f"         {name}{'' if call else ' (a value)'}\n"
                    for name, call in small.items()
                ),
                end="",
            )


if __name__ == "__main__":
    main()
