"""What commands refuse: a line, and what its one message holds. Exit code 2, nothing computed, nothing written."""

import gzip
import os
import re
import shlex
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from commands import call
from places import EXAMPLES, ROOT

from optimisation.cli.group import file_of, files, imported, missing_extras

GIVEN = {  # files that lie in the folder of the call
    "file": "",
    "bare.md": "no markers\n",
    "kept.json": '{"form": "another"}',
    "good.toml": "[beam]\nmodes = 2\n",
    "bad.toml": "[beam]\nlength = 2\n",
    "other/jumps.json.gz": '{"part": "cost", "rows": []}',
    "paper/paper/jump.json.gz": '{"rows": []}',
}
GIVEN_BYTES = {name: gzip.compress(text.encode(), mtime=0) if name.endswith(".gz") else text.encode() for name, text in GIVEN.items()}
NOWHERE = "--json = nowhere/a.json is not allowed: a file in a folder that exists"
BOTH = "--threads = 2 is not allowed: with --cluster"
CLUSTER = "--cluster 127.0.0.1:1"
MARKERS = "one pair of markers"
EARLIER = "an earlier run of this command wrote"
ORBITS = "--modes 1"
BALANCE = "--modes 2 --method balance --no-sweeps"
# command: the start of its lines, and what follows it with the message that it gets
BAD: dict[str, tuple[str, dict[str, str]]] = {
    "sweep": (
        "--json a.json",
        {
            "--modes 0": "modes = 0 is not allowed",
            "--modes ten": "'ten' is not a valid integer",
            "--method runge-kutta": "for rigid walls or rigid friction Exact or Moreau",
            "--absorber tuned --gap 1e-3": "--gap does not go with --absorber tuned",
            "--absorber none --mass-ratio 0.1": "--mass-ratio does not go with --absorber none",
            "--absorber friction --restitution 1": "--restitution does not go with --absorber friction",
            "--absorber friction --contact-stiffness 1": "--contact-stiffness does not go with --absorber friction",
            "--stiffness 700": "--stiffness does not go with --absorber impact",
            "--steps-per-period 20": "--steps-per-period does not go with --method exact",
            "--most-events 5 --method moreau": "--most-events does not go with --method moreau",
            "--periods 10": "--periods is for a constant frequency",
            "--from 1 --to 1": "it needs --periods",
            "--from 1 --to 1 --periods 5 --rate 1": "--rate does not go with a constant frequency",
            "--from 1 --to 1 --periods 5 --down": "--down swaps --from and --to",
            "--from 1.06 --to 0.9 --down": "--down swaps --from and --to",
            "--from 1 --to 1 --periods 1e9 --plot a.png": "--plot of 1e+09 pseudo periods needs",
            f"{CLUSTER}": "--cluster needs --members above 1",
            "--scene bad.toml": "scene.beam.length = 2 is not allowed: only the keys length_m",
            "--scene none.toml": "none.toml' is not allowed: TOML that can be read",
            "--scene file": "a name that ends in .toml or .json",
            "--scene good.toml --modes 2": "--modes does not go with --scene",
            "--scene good.toml --absorber impact": "--absorber does not go with --scene",
            "--scene good.toml --gap 0": "--gap does not go with --scene",
            "--scene good.toml --damping 0": "--damping does not go with --scene",
            "--scene good.toml --steps-per-period 20": "--steps-per-period does not go with --method exact",
            "--structure {steel} --scene x.toml": "--scene does not go with --structure",
            "--structure none.toml": "file = 'none.toml' is not allowed: TOML that can be read",
            "--json nowhere/a.json": NOWHERE,
            "--json other": "is a directory",
            "--json /dev/null": "a plain file",
            "--plot a.txt": "a name that ends in .png, .pdf, .svg",
        },
    ),
    "compare_absorbers": (
        "",
        {
            "--members 0": "0 is not in the range x>=1",
            "--out file": "--out = 'file' is not allowed",
            "--structure {steel} --gap 1e-3 --force 1": "gap = 0.001 is not allowed: left out beside a force",
            "--structure {steel} --resonances 1 99": "resonance = 99 is not allowed: a mode of the model, 1 to 10",
            f"{CLUSTER} --threads 2": BOTH,
            CLUSTER: "--cluster = 127.0.0.1:1 is not allowed: an address",
        },
    ),
    "render_episode": (
        "--gif a.gif",
        {
            "--gif no/such/folder/a.gif": "--gif",
            "--gif film.mp4": ".gif",
            "--action 2": "--action",
            "--env nothing": "--env",
            "--interval 0.01": "interval = 0.01",
            "--force -1": "force = -1",
            "--agent {root}/optimisation/rl/trained/ActiveGap-v0_ppo.zip --interval 3": "--interval",
        },
    ),
    "design_gap": (
        "",
        {
            "": "--force is missing",
            "--force 0": "force = 0.0 is not allowed",
            "--force 3 --force 4": "--force is given 2 times: once is allowed",
            "--force 3 --gaps 4": "gaps = 4 is not allowed: an odd",
            "--force 3 --force-tolerance 0.4": "force_tolerance = 0.4 is not allowed: from 0 to 0.3",
            "--force 3 --device nowhere/a.json": "--device = nowhere/a.json is not allowed",
            "--force 3 --device a.toml": "--device = a.toml is not allowed: a name that ends in .json",
            "--force 3 --scene {steel} --structure {steel}": "--structure does not go with --scene",
            "--force 3 --scene {steel}": "a scene with one impact absorber between rigid walls",
            "--force 3 --members 0": "0 is not in the range x>=1",
            "--force 3 --rate 0": "--rate",
            "--force 3 --out file": "--out = 'file' is not allowed",
            "--force 35 --resonance 2 --position 0.8": "= 4.937 is not allowed",
            "--structure {steel} --force 1 --modes 3": "--modes does not go with --structure",
            "--structure {frame} --force 1 --position 0.5": "position = 0.5 is not allowed: the number of one of the structure's places",
        },
    ),
    "optimise_design": (
        "",
        {
            "--at 1:1e300 --at 2:1": "force = 1e+300 is not allowed: above 0 and at most 1e+12 N",
            "--rate 1e-9": "rate = 1e-09 is not allowed: from 1.6e-06 to 320 %",
            "--fix mass_ratio 100": "at most 1: an absorber no heavier than the structure",
            "--study nowhere/a.journal": "study file = nowhere/a.journal is not allowed: a file that can be written to, in a folder that exists",
            "--study /dev/full": "study file = /dev/full is not allowed",
            "--at one": "'one'",
            "--concept all --study x.journal": "--study = x.journal",
            "--out file": "--out = 'file/impact' is not allowed",
            f"{CLUSTER} --threads 2": BOTH,
            "--structure {steel} --at 1:1 --resonances 1 2": "--resonances = (1, 2) is not allowed: beside --at",
            "--structure {frame} --free position": "position = 'free' is not allowed: left out on a modal model",
        },
    ),
    "pareto": (
        "",
        {
            "--at 1:1e300 --at 2:1": "force = 1e+300 is not allowed",
            "--fix mass_ratio 100": "mass_ratio = 100.0 is not allowed",
            "--study nowhere/a.journal": "study file = nowhere/a.journal is not allowed",
            "--at 1:3.5": "two resonances",
            "--against all": "'all' is not one of",
            "--designs 1": "1 is not in the range x>=2",
        },
    ),
    "mass_ratios": (
        "",
        {
            "--page bare.md": MARKERS,
            "--rate 1e-9": "rate = 1e-09 is not allowed",
            "--mass-ratio 100": "mass_ratio = 100.0 is not allowed",
            f"{CLUSTER} --threads 2": BOTH,
        },
    ),
    "tune_ltva": (
        "--quick",
        {
            "--low 0.9 --high 1.06": "scoring range (low, high) = (0.9, 1.06) is not allowed: a scoring range that holds both peaks",
            "--resonance 0": "0 is not in the range x>=1",
            "--out file": "--out = 'file' is not allowed",
            "--page bare.md": MARKERS,
            "--structure {steel} --damping 0.1": "--damping does not go with --structure",
        },
    ),
    "orbits": (
        ORBITS,
        {
            "--modes 0": "modes = 0",
            "--gap 0": "gap = 0",
            "--from 1 --to 0.9": "--from = 1",
            "--at 2": "--at = 2",
            "--along force --at 0.95": "--along, --over and --at go together",
            "--along force --over 2 2 --at 0.95": "--over = (2.0, 2.0) is not allowed",
            "--folds --thresholds": "--folds does not go with --thresholds",
            "--folds --at 0.95": "--at does not go with --folds",
            "--points 1": "points = 1",
            "--json nowhere/a.json": NOWHERE,
            "--json a.txt": "--json = a.txt",
            "--structure {steel}": "--modes does not go with --structure",
        },
    ),
    "frequency_response": (
        BALANCE,
        {
            "--restitution 0.7": "--method = 'balance'",
            "--from 1 --to 0.9": "--to = 0.9",
            "--plot a.txt": "--plot = a.txt",
            "--json nowhere/a.json": NOWHERE,
            "--harmonics 0": "harmonics = 0",
            "--absorber friction --gap 1e-3": "--gap does not go with --absorber friction",
            "--restitution 0.7 --contact-stiffness 1e4": "left out with contact_stiffness",
            "--members 1": "--members does not go without --envelope",
            "--envelope 1": "points = 1",
            f"--envelope 2 {CLUSTER} --threads 2": BOTH,
            "--structure {steel} --scene x.toml": "--scene does not go with --structure",
            "--resume kept.json": "--resume = kept.json",
        },
    ),
    "isola": (
        "--modes 3",
        {
            "--map-friction-limits -1": "friction limit = -1",
            "--resume kept.txt": "--resume = kept.txt",
            "--map-modes 1,5 --map-restitutions 1": "modes = 5",
            "--map-modes x": "--map-modes = 'x'",
            "--from 1 --to 0.9": "frequency range",
            "--structure {steel}": "--modes does not go with --structure",
        },
    ),
    "balance_error": ("", {"--harmonics ten": "--harmonics", "--at 0.9 --force 0.5": "frequency = "}),
    "doctor": ("", {"--json nowhere/a.json": NOWHERE, "--json a.txt": "--json = a.txt", "extra": "unexpected extra argument"}),
    "prepare": ("", {"everything": "'everything' is not one of 'environments', 'all'", "--threads 2": "No such option"}),
    "cache": ("", {"empty": "'empty' is not one of 'info', 'clear'", "info --older": "--older goes with clear alone"}),
    "record_demonstrations": ("", {"--task nothing": "'nothing' is not one of"}),
    "train": ("", {"--algorithm nothing": "'nothing' is not one of"}),
    "judge": ("", {"--task nothing": "'nothing' is not one of", "--board a.txt": ".csv", "--page tasks.md": "--board"}),
    "admit_tasks": (
        "",
        {
            "--task nothing": "'nothing' is not one of",
            "--json nowhere/a.json": NOWHERE,
            "--page bare.md": MARKERS,
            "--judged 2": "2 is not in the range",
            "--json kept.json --redraw": EARLIER,
        },
    ),
    "benchmark": (
        "",
        {"--json nowhere/a.json": NOWHERE, "--repeats 0": "0 is not in the range", "--unknown": "--unknown", "--page bare.md": MARKERS},
    ),
    "benchmark_energies": ("", {"--json nowhere/a.json": NOWHERE, "--page none.md": "none.md"}),
    "benchmark_explorer": ("", {"--json nowhere/a.json": NOWHERE, "--page bare.md": MARKERS, "--picture a.gif": "--picture = a.gif is not allowed"}),
    "benchmark_envs": ("", {"--json nowhere/a.json": NOWHERE, "--page bare.md": MARKERS}),
    "benchmark_periodic": ("", {"--json nowhere/a.json": NOWHERE, "--page bare.md": MARKERS}),
    "benchmark_start": ("--quick", {"--json nowhere/a.json": NOWHERE, "--page bare.md": MARKERS}),
    "cost_of_exact": ("", {"--json nowhere/a.json": NOWHERE, "--page bare.md": MARKERS}),
    "reference_levels": ("", {"--json nowhere/a.json": NOWHERE, "--members 0": "0 is not in the range", "--page bare.md": MARKERS}),
    "load_answers": ("--quick", {"--members 0": "0 is not in the range", "--redraw --out no": "--redraw", "--only all": "'all' is not one of"}),
    "search_methods": ("--quick", {f"{CLUSTER} --threads 2": BOTH, "--question nothing": "'nothing' is not one of"}),
    "friction_branches": ("--quick", {f"{CLUSTER} --threads 2": BOTH}),
    "your_structure": ("", {"--page none.md": "none.md"}),
    "check_gaps": ("--quick", {f"{CLUSTER} --threads 2": BOTH, "--rate 0": "rate = 0.0 is not allowed", "--page none.md": "none.md"}),
    "error_vs_runtime": (
        "",
        {
            "--only everything": "'everything' is not one of",
            "--redraw --out no": "--redraw",
            "--redraw --only jumps --out other": "jumps.json.gz",
            "--out file/below --only jumps": "--out = 'file/below' is not allowed",
            "--scene nothing": "'nothing'",
        },
    ),
    "findings": (
        "--out .",
        {
            "--redraw --part place": EARLIER,
            "--quick --part robustness": EARLIER,
            "--part colour": "'colour' is not one of",
            f"{CLUSTER} --threads 2": BOTH,
        },
    ),
    "reproduce_paper": (
        "--out no",
        {
            "--figure three": "'three' is not one of",
            "--seed -1": "-1 is not in the range",
            f"{CLUSTER} --threads 2": BOTH,
            "--figure jump --out paper": "jump.json.gz is not allowed: a file that an earlier run of this command wrote",
        },
    ),
    "regimes": (
        "--out no",
        {
            "--modes 2": "needs --force",
            "--force 1 --from 0.9 --to 0.9": "--to = 0.9 is not allowed",
            "--force 1 --points 1": "points = 1 is not allowed",
            "--force 1 --silence 0": "silence = 0.0 is not allowed",
            "--silence 1e9": "stay_periods = 8000.0 is not allowed",
            "--force 1 --approach -1": "approach_ratio = -1.0 is not allowed",
            f"{CLUSTER} --threads 2": BOTH,
            "--structure {steel} --modes 3": "--modes does not go with --structure",
        },
    ),
    "structure": (
        "",
        {
            "": "Missing argument 'FILE'",
            "bad.toml": "length",
            "{steel} --near 0 0 0": "--near is for a Universal File with nodes, or matrices with the key coordinates",
            "{steel} --plot a.txt": "--plot = a.txt",
            "{steel} --json nowhere/a.json": NOWHERE,
        },
    ),
    "explore": (
        "--no-browser",
        {
            "--port 65536": "65536 is not in the range",
            "--structure nowhere.toml": "nowhere.toml",
            "--structure bad.toml": "length",
            "--host nowhere.invalid": "--port = 8651 is not allowed: one that is free at nowhere.invalid",
        },
    ),
    "specialisation": ("", {"--redraw --out .": "--redraw", "--out file/below": "--out = 'file/below' is not allowed"}),
    "stability": (
        "",
        {"--workers 0": "--workers", "--redraw --out .": "--redraw", "--out file/below": "--out = 'file/below' is not allowed", "--slow": "--slow"},
    ),
}


def together(start: str, line: str) -> str:
    """Return a line behind what all of a command's lines start with, but for options that the line gives itself."""
    for option in re.findall(r"--(?:json|gif|modes|out)\b", line):
        start = re.sub(rf"{option} \S+", "", start)
    return " ".join(f"{start} {line}".split())


LINES = [(name, together(start, line), words) for name, (start, lines) in BAD.items() for line, words in lines.items()]


def test_each_command_is_in_the_table() -> None:
    assert set(BAD) == {name for commands in files().values() for name in commands}


@pytest.mark.parametrize(("name", "line", "words"), LINES, ids=[f"{name} {line}" for name, line, _ in LINES])
def test_what_cannot_be_done_is_one_message(name: str, line: str, words: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    file = file_of(name)
    assert file is not None
    if missing_extras(file) or (CLUSTER in line and find_spec("distributed") is None):
        pytest.skip("a package that it needs is not installed")
    command = imported(name)  # before anything is in the place of what its modules import
    for own, content in GIVEN_BYTES.items():
        (tmp_path / own).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / own).write_bytes(content)
    monkeypatch.chdir(tmp_path)
    if CLUSTER in line:
        monkeypatch.setattr("optimisation.search.cluster.Workers.__init__.__defaults__", (1.0,))
    for computing in ("impact_env.ensemble.Threads.each", "impact_env.ensemble.each_lane"):
        monkeypatch.setattr(computing, lambda *_, **__: pytest.fail("computed"))
    places = {"steel": EXAMPLES / "steel_beam_tip.toml", "frame": EXAMPLES / "frame.toml", "root": ROOT}
    result = call(command, *shlex.split(line.format(**places)))
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.count("Error: ") == 1
    assert "Traceback" not in result.stderr
    assert words in " ".join(result.stderr.split()), result.stderr
    assert {str(path.relative_to(tmp_path)): path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == GIVEN_BYTES


@pytest.mark.slow
def test_a_process_ends_with_code_2(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "optimisation.cli.group", "sweep", "--gap", "-1", "--json", str(tmp_path / "sweep.json")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "Error: gap = -1.0 is not allowed: a number in m, 0 or above (infinity: no wall)\n"
    assert list(tmp_path.iterdir()) == []
