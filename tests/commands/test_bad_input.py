"""Commands refuse wrong input with exit code 2 and one message.

Nothing is computed or written. A table has the command lines and the text that each message must
contain.
"""

import errno
import gzip
import json
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

from optimisation.cli.group import file_of, imported, missing_extras, modules
from optimisation.cli.names import find_command

PLACES = {"steel": EXAMPLES / "steel_beam_tip.toml", "frame": EXAMPLES / "frame.toml", "root": ROOT}
INPUT_FILES = {  # files that lie in the folder of the call
    "file": "",
    "bare.md": "no markers\n",
    "kept.json": '{"form": "another"}',
    "good.toml": '[beam]\nmodes = 2\n[absorber]\nkind = "impact"\nrestitution = 0.7\n',
    "bad.toml": "[beam]\nlength = 2\n",
    "grams.toml": "[model]\nomega_rad_s = [252.0, 1580.0]\ndamping_ratio = [0.01, "
    "0.01]\nforce_shape_per_sqrt_kg = [0.5, -0.4]\n"
    "tip_shape_per_sqrt_kg = [2.66, -2.66]\nbeam_mass_kg = 563.7\n",
    "levels.toml": (
        '[measurement]\nkind = "levels"\nforces_n = [2.0]\nlevels_m = [1e-3]\nfrom_hz = '
        "36.0\nto_hz = 43.0\nduration_s = 5.0\n"
    ),
    "other/jumps.json.gz": '{"part": "cost", "rows": []}',
    "paper/paper/jump.json.gz": '{"rows": []}',
}
BINARY_INPUT_FILES = {
    name: gzip.compress(text.encode(), mtime=0) if name.endswith(".gz") else text.encode()
    for name, text in INPUT_FILES.items()
}
# for each command that has all options of the line and no other words for it, behind what its last
# lines begin with
COMMON = """
    --json nowhere/a.json -> --json = nowhere/a.json is not allowed: a file in a folder that exists
    --page bare.md -> one pair of markers
    --plot a.txt -> a name that ends in .png, .pdf, .svg
    --history nowhere/a.csv -> --history = nowhere/a.csv is not allowed
    --history a.txt -> --history = a.txt is not allowed: a name that ends in .csv, .npz, .png, .pdf, .svg
    --out file/below -> --out = 'file/below
    --members 0 -> 0 is not
    --scene x.toml --structure {steel} -> does not go with --s
    --cluster 127.0.0.1:1 --threads 2 -> --threads = 2 is not allowed: with --cluster
    --load random:20:60:0.05:1e9 -> load.duration_s = 1000000000.0 is not allowed: at most 4194304 samples
"""
# a command with what its lines begin with, and behind each line what its message holds
REFUSED = """
sweep --json a.json
    --mass-kg 0.01 --mass-ratio 0.02 -> --mass-kg does not go with --mass-ratio
    --absorber none --mass-kg 0.01 -> --mass-kg does not go with --absorber none
    --scene good.toml --mass-kg 0.01 -> --mass-kg does not go with --scene
    --modes 0 -> modes = 0 is not allowed
    --method runge-kutta -> for rigid walls or rigid friction Exact or Moreau
    --absorber tuned --gap 1e-3 -> --gap does not go with --absorber tuned
    --absorber none --mass-ratio 0.1 -> --mass-ratio does not go with --absorber none
    --steps-per-period 20 -> --steps-per-period does not go with --method exact
    --most-events 5 --method moreau -> --most-events does not go with --method moreau
    --periods 10 -> --periods is for a constant frequency
    --from 1 --to 1 -> it needs --periods
    --from 1 --to 1 --periods 5 --rate 1 -> --rate does not go with a constant frequency
    --from 1.06 --to 0.9 --down -> --down swaps --from and --to
    --from 1 --to 1 --periods 1e9 --plot a.png -> --plot of 1e+09 pseudo periods needs
    --cluster 127.0.0.1:1 -> --cluster needs --members above 1
    --scene bad.toml -> scene.beam.length = 2 is not allowed: only the keys length_m
    --scene file -> a name that ends in .toml or .json
    --scene good.toml --modes 2 -> --modes does not go with --scene
    --structure none.toml -> file = 'none.toml' is not allowed: a file that can be read: there is no such file
    --json other -> is a directory
    --json /dev/null -> a plain file
    --load shock:40:2 -> --load shock:40:2: SHOCK:PEAK_N:PULSE_S:DURATION_S, numbers
    --absorber none --load shock:40:0.01:2 --force 3 -> --force does not go with --load
    --absolute -> --absolute needs --measures
    --measures --method moreau -> --measures does not go with --method moreau
    --measures 2 -> measures = 2 is not allowed
    --measures --absolute -> absolute = True is not allowed: left out where the base does not move
compare
    --structure {steel} --gap 1e-3 --force 1 -> gap = 0.001 is not allowed: left out beside a force
    --structure {steel} --resonances 1 99 -> resonance = 99 is not allowed: a mode of the model, 1 to 10
    --scene good.toml --gap 1e-3 -> --gap does not go with --scene
    --scene good.toml --mass-kg 5 -> --mass-kg does not go with --scene
    --structure {steel} --load shock:20:0.01:1 --rate 1 -> --rate does not go with --load
    --cluster 127.0.0.1:1 -> --cluster = 127.0.0.1:1 is not allowed: an address
rl render --gif a.gif
    --gif no/such/folder/a.gif -> --gif
    --gif film.mp4 -> .gif
    --action 2 -> --action
    --interval 0.01 -> interval = 0.01
    --force -1 -> force = -1
    --agent {root}/optimisation/rl/trained/ActiveGap-v0_ppo.zip --interval 3 -> --interval
design gap
    -> --force is missing
design gap --force 3
    --force 0 -> force = 0.0 is not allowed
    --force 4 --force 3 -> --force is given 2 times: once is allowed
    --rate 0 -> = 0.0 is not allowed
    --gaps 4 -> gaps = 4 is not allowed: an odd
    --force-tolerance 0.4 -> force_tolerance = 0.4 is not allowed: from 0 to 0.3
    --device nowhere/a.json -> --device = nowhere/a.json is not allowed
    --scene {steel} -> a scene with one impact absorber between rigid walls
    --scene good.toml --mass-ratio 0.01 -> --mass-ratio does not go with --scene
    --force 1e-9 -> --force = '1e-09 N' is not allowed: one for which the design rule gives a gap from 0.001 mm to 10 m
    --force 1e9 -> are all numbers in SI units?
    --contact steel pom -1 -> radius of --contact in m = -1.0 is not allowed
    --contact steel pom 0.01 --no-card -> --contact does not go with --no-card
    --free restitution --restitution 0.2 -> --free restitution does not go with --restitution
    --free friction_limit --friction-limit 0 -> --free friction_limit does not go with --friction-limit
    --scene good.toml --free friction_limit -> --free friction_limit does not go with a device that has no friction
    --structure grams.toml -> absorber mass = '11.27 kg' is not allowed: less beside the 0.1413 kg that mode 1 moves at its place
    --structure {frame} --position 0.5 -> position = 0.5 is not allowed: the number of one of the structure's places
    --structure {steel} --load shock:20:0.01:1 --rate 1 -> --rate does not go with --load
    --structure {steel} --load shock:20:0.01:1 --free restitution -> --free does not go with --load
    --structure {steel} --load shock:20:0.01:1 --history a.csv -> --history does not go with --load
    --scene good.toml --mass-kg 5 -> --mass-kg does not go with --scene
    --uncertain gap=5% --uncertain gap=6% -> --uncertain gap is given twice
    --uncertain gap=1e-3:2e-3 -> in %, as the number itself is searched
    --uncertain friction=5% --friction-limit 0 -> uncertain friction
    --tolerances -> --tolerances needs --limit-level
    --structure {steel} --load shock:20:0.01:1 --sobol -> --sobol does not go with --load
    --structure {steel} --load shock:20:0.01:1 --tolerances -> --tolerances does not go with --load
    --contact steel wood 0.01 -> material = 'wood' is not allowed: one of steel
    --mass-kg 0.01 --mass-ratio 0.02 -> --mass-kg does not go with --mass-ratio
    --mass-kg 5 -> mass_kg = 5.0 is not allowed: above 0 and at most the structure's 0.5637 kg
design place
    -> --force is missing: the amplitude of the harmonic force in N, or --at RESONANCE:FORCE
    --at 3 -> '3' is not RESONANCE:FORCE, as in 1:3.5
    --at 1:3 --at 1:4 -> --at 1:4 is not allowed: each resonance once
    --at 1:3 --resonances 1 2 -> --resonances does not go with --at
    --at 99:3 -> resonance = 99 is not allowed: a mode of the model, 1 to 10
design place --force 3
    --at 1:3 -> --force does not go with --at
    --force 0 -> force = 0.0 is not allowed
    --resonances 1 99 -> resonance = 99 is not allowed: a mode of the model, 1 to 10
    --mass-ratio 100 -> mass_ratio = 100.0 is not allowed
    --mass-kg 0.01 --mass-ratio 0.02 -> --mass-kg does not go with --mass-ratio
    --mass-kg 5 -> mass_kg = 5.0 is not allowed: above 0 and at most the structure's 0.5637 kg
    --position 1.2 -> position
    --structure {frame} --position 7 -> position = 7.0 is not allowed: a row of the structure
    --structure {steel} --damping 0.1 -> --damping does not go with --structure
    --structure grams.toml -> are the mass in kg, the shapes in 1/sqrt(kg)
    --scene good.toml --mass-kg 5 -> --mass-kg does not go with --scene
    --scene {steel} -> a scene with one impact absorber between rigid walls
    --restitution 2 -> restitution = 2.0 is not allowed
    --friction-limit -1 -> friction_limit = -1.0 is not allowed
    --rate 0 -> rate = 0.0 is not allowed
    --force-tolerance 0.4 -> force_tolerance = 0.4 is not allowed: from 0 to 0.3
    --limit-level 0 -> limit_level = 0.0 is not allowed
    --constraint stroke -1 -> constraint stroke = -1.0 is not allowed
    --constraint weight 1 -> 'weight' is not one of 'stroke', 'impact_speed'
    --device nowhere/a.json -> --device = nowhere/a.json is not allowed
design place --force 1e-9
    --load random:20:60:0.05:1e9 -> --load is not possible here
    -> force = '1e-09 N near resonance 1, mass ratio 0.01' is not allowed: one for which the design rule gives a gap
design search
    --at 1:1e300 --at 2:1 -> force = 1e+300 is not allowed: above 0 and at most 1e+12 N
    --rate 1e-9 -> rate = 1e-09 is not allowed: from 2.92e-06 to 583.2 %
    --fix mass_ratio 100 -> at most 1: an absorber no heavier than the structure
    --study nowhere/a.journal -> study file = nowhere/a.journal is not allowed: a file that can be written to, in a folder that exists
    --study /dev/full -> study file = /dev/full is not allowed
    --concept all --study x.journal -> --study = x.journal
    --concept all --history x.csv -> --history = x.csv is not allowed: with one concept
    --concept all --json x.json -> --json = x.json is not allowed: with one concept
    --mass-ratio 0.02 --fix mass_ratio 0.03 -> --mass-ratio does not go with --fix mass_ratio
    --structure {steel} --at 1:1 --resonances 1 2 -> --resonances = (1, 2) is not allowed: beside --at
    --structure {frame} --free position -> position = 'free' is not allowed: left out on a modal model
    --structure {steel} --load shock:20:0.01:1 --at 1:3 -> --at does not go with --load
    --structure {steel} --load shock:20:0.01:1 --uncertain gap=5% -> --uncertain does not go with --load
design pareto
    --at 1:3.5 -> two resonances
    --designs 1 -> 1 is not in the range x>=2
    --structure {steel} --load shock:20:0.01:1 --against resonances -> --against does not go with --load
design masses
    --mass-ratio 100 -> mass_ratio = 100.0 is not allowed
    --mass-ratio 0.02 --mass-kg 0.01 -> --mass-kg does not go with --mass-ratio
    --resonances 1 2 3 -> unexpected extra argument
    --resonances one -> 'one' is not one or two resonances
design tune --quick
    --load random:20:60:0.05:1e9 -> --quick does not go with --load
    --from 0.9 --to 1.06 -> scoring range (low, high) = (0.9, 1.06) is not allowed: a scoring range that holds both peaks
    --structure {steel} --damping 0.1 -> --damping does not go with --structure
    --structure grams.toml -> absorber mass = '11.27 kg' is not allowed: less beside the 0.1413 kg that mode 1 moves at its place
    --scene good.toml --mass-ratio 0.1 -> --mass-ratio does not go with --scene
    --structure {steel} --load shock:20:0.01:1 --from 0.8 -> --from does not go with --load
periodic orbits --modes 1
    --modes 0 -> modes = 0
    --gap 0 -> gap = 0
    --from 1 --to 0.9 -> --from = 1
    --from 0.9 --to 1 --frequency 2 -> --frequency = 2
    --frequency 0 -> --frequency = 0
    --over force 1 2 -> --over goes with --frequency
    --over force 2 2 --frequency 0.95 -> --over = (2.0, 2.0) is not allowed
    --over frequency 0.9 1 --frequency 0.95 -> --over frequency is for scenes of several absorbers
    --over colour 1 2 --frequency 0.95 -> 'colour' is not one of
    --folds --thresholds -> --folds does not go with --thresholds
    --folds --frequency 0.95 -> --frequency does not go with --folds
    --mass-kg 5 -> mass_kg = 5.0 is not allowed
    --mass-kg 0.01 --mass-ratio 0.01 -> --mass-kg does not go with --mass-ratio
    --points 1 -> points = 1
    --json a.txt -> --json = a.txt
    --structure {steel} -> --modes does not go with --structure
    --curve fold -> --curve goes with --over
    --curve fold --over frequency 0.9 1 -> --over frequency does not go with --curve
    --plot a.txt -> goes with --curve
    --curve fold --over force 2 3 -> a range around 1.5
    --curve fold --over friction-limit 0 1 -> friction limits above 0
periodic folds --modes 1
    --from 1 --to 0.9 -> --from = 1
    --csv nowhere/a.csv -> --csv = nowhere/a.csv is not allowed
periodic curves --modes 1
    --over force 2 3 -> a range around 1.5
    --over friction-limit 0 1 -> friction limits above 0
    --over position 0.9 1.2 -> absorber_position = 1.2 is not allowed
    -> Missing option '--over'
periodic curves --modes 1 --over force 1 2
    --kind cusp -> 'cusp' is not one of
    --modes 0 -> modes = 0
    --plot a.txt -> --plot = a.txt
periodic branches --modes 2
    --members 2 -> --members does not go without --envelope
periodic branches --modes 2 --method balance --no-sweeps --envelope 2
    --restitution 0.7 -> --method = 'balance'
    --from 1 --to 0.9 -> --to = 0.9
    --harmonics 0 -> harmonics = 0
    --hill -> --hill = True is not allowed: with harmonic balance and --contact-stiffness
    --absorber friction --gap 1e-3 -> --gap does not go with --absorber friction
    --restitution 0.7 --contact-stiffness 1e4 -> 1 for harmonic balance
    --envelope 1 -> points = 1
    --rate 0 -> --rate = 0.0 is not allowed
    --resume kept.json -> --resume = kept.json
periodic isola --modes 3
    --map-friction-limits -1 -> friction limit = -1
    --resume kept.json -> --resume = kept.json is not allowed: a file that this option has written before, or none yet
    --map-modes 1,5 --map-restitutions 1 -> modes = 5
    --from 1 --to 0.9 -> frequency range
    --structure {steel} -> --modes does not go with --structure
periodic manifold --modes 3
    --resonance 4 -> --resonance = 4
    --points -1 -> --points = -1
    --csv a.csv -> --csv is for a map
    --map-modes 1,5 -> modes = 5
    --map-mass-ratios 0 -> mass_ratio = 0
    --force 0 -> force amplitude = 0
    --orbit-forces 1,a -> --orbit-forces = '1,a'
    --from -1 -> frequency ratio = -1
    --structure {steel} -> --modes does not go with --structure
periodic basins --modes 1
    --frequency 0 -> --frequency = 0
    --force -1 -> --force = -1
    --starts 0 -> starts = 0
    --seed -1 -> -1 is not in the range
    --reach 0 -> reach = 0
    --match 0 -> --match = 0
    --burn-in -1 -> --burn-in = -1
    --settle 10 -> periods = 10
    --window 8 -> window = 8
    --longest 13 -> most_multiple = 13
    --over gap 2e-3 1e-3 -> --over = (0.002, 0.001) is not allowed
    --over gap -1e-3 1e-3 -> gap = -0.001
    --over frequency 0 1 -> --over frequency = 0
    --over restitution 0.5 1.5 -> restitution = 1.5
    --over colour 0 1 -> 'colour' is not one of
    --over force 1 2 --points 1 -> --points = 1
    --map force 1 2 -> --map needs --over
    --random-start -> --random-start and --map-points go with --map
    --over gap 1e-3 2e-3 --map gap 1e-3 2e-3 -> two different parameters
    --over gap 1e-3 2e-3 --map force 1 2 --starts 3 -> --starts does not go with --map
    --over gap 1e-3 2e-3 --map force 1 2 --map-points 1 -> --map-points = 1
    --structure {steel} -> --modes does not go with --structure
    --friction-limit -1 -> friction limit = -1
periodic diagram --modes 1
    --over force 2 2 -> --over = (2.0, 2.0) is not allowed
    -> Missing option '--over'
periodic diagram --modes 1 --over force 1 2
    --points 1 -> --points = 1
    --starts -1 -> starts = -1
    --branch-period 0 -> --branch-period = 0
    --settle 1 -> periods = 1
    --frequency -1 -> --frequency = -1
    --structure {steel} -> --modes does not go with --structure
periodic section --modes 1
    --starts -1 -> --starts = -1
    --seed -1 -> -1 is not in the range
    --window 0 -> window = 0
    --force 0 -> --force = 0
    --structure {steel} -> --modes does not go with --structure
periodic balance-error
    --frequency 0.9 --force 0.5 -> frequency =
doctor
prepare
cache
    info --older -> --older goes with clear alone
rl demonstrations
rl train
    --from nowhere -> start = 'nowhere' is not allowed: rule, agent, none, or the path
rl evaluate
    --board a.txt -> .csv
    --page bare.md -> --board
rl export
    --out file/below -> --out = file/below is not allowed
    -> --agent = None is not allowed: either --agent FILE or --task TASK
    --agent file -> agent = 'file' is not allowed: a file that train wrote
    --task Passage-v0 --policy rule12 -> for rule12 one of
    --task ActiveGap-v0 --to c --out a.txt -> --out = a.txt is not allowed: a name that ends in .c
reproduce admit-tasks
    --json kept.json --redraw -> an earlier run of this command wrote
reproduce judge-agents
    --out file/below -> --out
    --page bare.md -> markers
reproduce real-controller
    --agent file -> agent = 'file' is not allowed: a file that train wrote
reproduce memory-trial
    --seeds 0 -> 0 is not
reproduce compare-training
    --method PPO2 -> 'PPO2' is not one of
reproduce constrain-training
    --steps 0 -> 0 is not
reproduce read-rules
    --agent good.toml -> agent = 'good.toml' is not allowed
    --json a.txt -> --json = a.txt is not allowed
reproduce benchmark
reproduce benchmark-energies
reproduce benchmark-explorer
    --picture a.gif -> --picture = a.gif is not allowed
reproduce benchmark-envs
reproduce benchmark-periodic
reproduce benchmark-calibration
reproduce benchmark-sectors
reproduce benchmark-start --quick
reproduce cost-of-exact
reproduce reference-levels
reproduce load-answers --quick
    --redraw --out no -> --redraw
reproduce search-methods --quick
reproduce friction-branches --quick
reproduce your-structure
    --page none.md -> none.md
    --page bare.md -> printed blocks
reproduce mutation-test
    --only nothing -> --only = nothing is not allowed
reproduce check-places --quick
    --judges 0 -> 0 is not
reproduce manifold-gaps
    --page none.md -> none.md
reproduce environment-pages
    --measure=3 -> does not take a value
reproduce command-table
    --page nowhere/a.md -> --page = 'nowhere/a.md' is not allowed: a file in a folder that exists
reproduce compare-chain
reproduce which-blades
reproduce check-calibration --quick
    --truths 0 -> 0 is not in the range
reproduce compare-inference --quick
    --truths 0 -> 0 is not in the range
reproduce check-plan --quick
    --truths 0 -> 0 is not in the range
reproduce check-gaps --quick
    --rate 0 -> rate = 0.0 is not allowed
reproduce error-vs-runtime
    --redraw --out no -> --redraw
    --redraw --only jumps --out other -> jumps.json.gz
reproduce findings --out .
    --redraw --part place -> an earlier run of this command wrote
    --quick --part robustness -> an earlier run of this command wrote
reproduce paper --out no
    --figure jump --out paper -> jump.json.gz is not allowed: a file that an earlier run of this command wrote
reproduce regimes --out no
    --modes 2 -> needs --force
    --force 1 --from 0.9 --to 0.9 -> --to = 0.9 is not allowed
    --force 1 --points 1 -> points = 1 is not allowed
    --force 1 --silence 0 -> silence = 0.0 is not allowed
    --silence 1e9 -> stay_periods = 8000.0 is not allowed
    --force 1 --approach -1 -> approach_ratio = -1.0 is not allowed
structure
    -> Missing argument 'FILE'
structure {steel}
    --near 0 0 0 -> --near is for files with nodes
calibrate levels.toml
    -> statistics = 1 is not allowed: 3 or more, as many as there are free parameters
    --free gap 2e-3 1e-3 -> from 0 on, the lower one first
    --free height -> free = 'height' is not allowed
    --free gap --free gap -> --free gap is given twice
    --plan a -> --plan = 'a' is not allowed: numbers with commas between
    --plan 0 -> plan = 0.0 is not allowed
    --resonance 99 -> resonance = 99 is not allowed: a mode of the model, 1 to 10
    --mass-kg 5 -> mass_kg = 5.0 is not allowed
    --gap -1 -> gap = -1.0 is not allowed
    --resume good.toml -> --resume = good.toml is not allowed: a file that this option has written before
    --scene good.toml --position 0.9 -> --position does not go with --scene
explore --no-browser
    --structure nowhere.toml -> nowhere.toml
    --structure bad.toml -> length
    --host nowhere.invalid -> --host = nowhere.invalid is not allowed: an address or a name of this machine
    --host 192.0.2.1 -> --host = 192.0.2.1 is not allowed: an address or a name of this machine
reproduce specialisation
    --redraw --out . -> --redraw
reproduce stability
    --redraw --out . -> --redraw
"""
BLOCKS = [
    (head, re.findall(r"^ +(.*?) ?-> (.+)", lines, re.M))
    for head, lines in re.findall(r"^(\w.*)\n((?: .*\n)*)", REFUSED, re.M)
]
LAST = {find_command(head.split())[0]: head for head, _ in BLOCKS}
OPTION = re.compile(r"(?<!\S)--[a-z-]+")


def together(start: str, line: str) -> str:
    """Return a command line with the options that all lines of a command share.

    Options that the line gives itself replace those of ``start``.
    """
    for option in OPTION.findall(line):
        start = re.sub(rf"{option} \S+", "", start) if option != "--quick" else start
    return f"{start} {line}"


def wrong(command: object, line: str, words: str) -> str:
    """Return the differences between a call and a refusal in one line.

    The call runs in the current folder. The refusal must contain ``words``. The text is empty if
    there are no differences.
    """
    for own, content in BINARY_INPUT_FILES.items():
        Path(own).parent.mkdir(parents=True, exist_ok=True)
        Path(own).write_bytes(content)
    result = call(command, *shlex.split(line.format(**PLACES)))
    message = " ".join(result.stderr.split())
    refused = (
        result.exit_code == 2
        and result.stdout == ""
        and message.count("Error: ") == 1
        and "Traceback" not in message
        and words in message
    )
    left = {
        str(path): path.read_bytes() for path in Path().rglob("*") if path.is_file()
    } == BINARY_INPUT_FILES
    return (
        ""
        if refused and left
        else (
            f"{line}: {result.exit_code}, {result.output} {result.exception!r}, "
            f"{'' if left else 'files'}"
        )
    )


def test_each_command_is_in_the_table() -> None:
    assert set(LAST) == modules().keys()


@pytest.mark.parametrize(
    ("head", "lines"),
    [
        pytest.param(head, lines, id=head, marks=pytest.mark.slow if head == "rl train" else ())
        for head, lines in BLOCKS  # rl train imports torch
    ],
)
def test_what_cannot_be_done_is_one_message(
    head: str, lines: list[tuple[str, str]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    name, length = find_command(head.split())
    start = " ".join(shlex.split(head)[length:])
    if missing_extras(file_of(name)):
        pytest.skip("a package that it needs is not installed")
    command = imported(name)  # before anything is in the place of what its modules import
    known = {option for parameter in command.main.params for option in parameter.opts}
    common = {
        line: words
        for line, words in re.findall(r"^ +(.*?) -> (.+)", COMMON, re.M)
        if set(OPTION.findall(line)) <= known
    }
    arguments = (common if head == LAST[name] else {}) | dict(lines)
    if find_spec("distributed"):
        monkeypatch.setattr("optimisation.search.cluster.Workers.__init__.__defaults__", (1.0,))
    monkeypatch.chdir(tmp_path)
    for computing in ("impact_env.ensemble.Threads.each", "impact_env.ensemble.each_lane"):
        monkeypatch.setattr(computing, lambda *_, **__: pytest.fail("computed"))
    unexpected = (
        wrong(command, together(start, line), words)
        for line, words in arguments.items()
        if find_spec("distributed") or "--cluster" not in line
    )
    assert not list(filter(None, unexpected))


FULL = {  # a word of the answer, by the line
    "structure {frame} --json a.json": "mass at the absorber",
    "doctor --json a.json": "numba",
    "sweep --modes 2 --from 0.98 --to 1 --rate 10 --json a.json": "response level",
    "periodic isola --modes 1 --from 0.93 --csv a.csv": "restitution",
    "periodic manifold --modes 1 --points 0 --json a.json": "classical",
    (
        "periodic section --structure {steel} --restitution 0.7 --gap 5e-4 --force 0.25 --settle "
        "100 --window 80 --json a.json"
    ): "rotation number",
    "design tune --quick --modes 2 --out .": "Den Hartog",
}


@pytest.mark.slow
@pytest.mark.parametrize("line", FULL)
def test_an_answer_is_printed_though_the_disk_is_full(
    line: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """And the error names the file that was asked for, not the one that was to become it."""

    def full(self: Path, _target: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(self))

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Path, "replace", full)
    words = shlex.split(line.format(**PLACES))
    name, length = find_command(words)
    words = words[length:]
    if missing_extras(file_of(name)):
        pytest.skip("a package that it needs is not installed")
    result = call(imported(name), *words)
    assert result.exit_code == 1
    assert FULL[line] in result.stdout
    file = "tunings.csv" if name == "design tune" else words[-1]
    assert re.fullmatch(
        rf"Error: (\S*/)?{re.escape(file)}: No space left on device", result.stderr.splitlines()[-1]
    )
    assert list(tmp_path.iterdir()) == []


def test_json_for_standard_output_needs_no_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system", "/tmp/tmpabcdef")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tempfile.mkdtemp", fails)
    monkeypatch.setattr("tempfile.TemporaryFile", fails)
    result = call(imported("structure"), str(PLACES["frame"]), "--json", "-")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["mass_kg"] > 0


@pytest.mark.slow
def test_a_process_ends_with_code_2(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "optimisation.cli.group",
        "sweep",
        "--gap",
        "-1",
        "--json",
        str(tmp_path / "sweep.json"),
    ]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert (
        done.stderr
        == "Error: gap = -1.0 is not allowed: a number in m, 0 or above (infinity: no wall)\n"
    )
    assert list(tmp_path.iterdir()) == []
