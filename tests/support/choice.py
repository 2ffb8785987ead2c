"""Choice and order of the test files.

The module lists the files that run at every save, those that run together and those that start
first. The choice follows from the processor's time with compiled kernels (``scripts/test -n 0 --cpu
FILE``). noxfile.py and conftest.py use it.
"""

from pathlib import Path


def _files(words: dict[str, str]) -> tuple[str, ...]:
    return tuple(
        f"{folder}/test_{name}.py" for folder, names in words.items() for name in names.split()
    )


# some of every kind that say much in little time, 65 s of the processor; what takes long in them is
# marked slow
QUICK = _files(
    {
        "kernels": "check energies exact_contacts linear properties several",
        "simulator": "controlled ensemble model frequency plain structure",
        "periodic": "continuation periodic_closed_form periodic_orbits",
        "environments": "environments scores",
        "design": "bounds designs objectives structure_design",
        "studies": "study_pattern",
        "commands": "bad_input sweep_script",
        "house": "docs",
    }
)

# all of them in runs one after the other: what a process has compiled and imported stays in its
# memory
PARTS = (
    "tests/kernels/test_[a-l]*.py",
    "tests/kernels/test_[m-z]*.py",
    "tests/simulator tests/periodic",
    "tests/design tests/house",
    "tests/environments",
    "tests/studies tests/commands",
)

# a line for each of `PARTS`, by processor time with compiled kernels (kinds.py compiles them
# before). Files that take most, in s: printed_blocks 50, plain_python, interrupted,
# bifurcation_curves and docs (mypy) 40, orbits_script 35, dense_motion, first_use,
# harmonic_balance, cluster and search_truth 25, explore, training, design_scripts, kernel_cache and
# regimes 20.
_LONGEST_FIRST = """
    kernels/dense_motion kernels/kernel_cache kernels/loads kernels/bounds kernels/exact_contacts kernels/budget kernels/energies
    kernels/plain_python kernels/search_truth kernels/regimes kernels/one_result kernels/verification kernels/several kernels/stepping
    periodic/bifurcation_curves simulator/first_use periodic/harmonic_balance simulator/controlled simulator/stop_and_passes simulator/places
    house/docs design/cluster design/gap_search design/limit_against_simulation house/extras design/precision design/answers design/load_gap
    environments/training environments/suite environments/admission environments/leaks environments/active
    commands/printed_blocks commands/interrupted commands/orbits_script commands/explore_browser commands/compare_absorbers commands/explore
    commands/design_scripts commands/command commands/structure_commands studies/stability_report studies/benchmark_scripts
"""
LONGEST_FIRST = tuple("{}/test_{}.py".format(*word.split("/")) for word in _LONGEST_FIRST.split())

# depend on the arithmetic of BLAS or torch: .ci/run runs them as on an old processor, too
LEANING = _files(
    {
        "environments": "suite training",
        "kernels": "regimes linear exact_contacts",
        "periodic": "periodic_orbits published_orbits",
        "simulator": "model frequency structure",
        "design": "tuned",
    }
)

# tests marked plain run last, by kernels in plain Python: to compile these kinds of scenes takes
# longer than their few events
TESTS = Path(__file__).parents[1]


def plain_files() -> list[str]:
    """Return the files with tests marked plain, relative to the tests' folder."""
    return [
        path.relative_to(TESTS).as_posix()
        for path in sorted(TESTS.glob("*/test_*.py"))
        if "pytest.mark.plain" in path.read_text(encoding="utf-8")
    ]
