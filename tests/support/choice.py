"""Which files of tests run at every save, which together, and which start first: by the processor's time with compiled kernels
(``scripts/test -n 0 --cpu FILE``). Used by noxfile.py and conftest.py."""

from pathlib import Path


def _files(words: dict[str, str]) -> tuple[str, ...]:
    return tuple(
        f"{folder}/test_{name}.py" for folder, names in words.items() for name in names.split()
    )


# some of every kind that say much in little time, 50 s of the processor; what takes long in them is marked slow
QUICK = _files(
    {
        "kernels": "check energies exact_contacts linear properties several",
        "simulator": "controlled ensemble model frequency plain structure",
        "periodic": "continuation periodic_closed_form periodic_orbits",
        "environments": "environments evaluation scores",
        "design": "bounds designs objectives structure_design",
        "studies": "study_pattern",
        "commands": "bad_input compare_absorbers sweep_script",
        "house": "docs",
    }
)

# all of them in runs one after the other: what a process has compiled and imported stays in its memory
PARTS = (
    "tests/kernels/test_[a-l]*.py",
    "tests/kernels/test_[m-z]*.py",
    "tests/simulator tests/periodic",
    "tests/design tests/house",
    "tests/environments",
    "tests/studies tests/commands",
)

# a line for each of `PARTS`, by processor time with compiled kernels (kinds.py compiles them before). Files that take most, in s:
# plain_python 90, interrupted 60, bifurcation_curves 50, printed_blocks, orbits_script and design_scripts 40, first_use, cluster and
# search_truth 33, training 28, bounds, structure_commands, kernel_cache, command, regimes, harmonic_balance and gap_search 20.
_LONGEST_FIRST = """
    kernels/bounds kernels/kernel_cache kernels/loads kernels/exact_contacts kernels/dense_motion kernels/budget kernels/energies
    kernels/plain_python kernels/search_truth kernels/regimes kernels/one_result kernels/verification kernels/several kernels/stepping
    periodic/bifurcation_curves simulator/first_use periodic/harmonic_balance simulator/controlled simulator/stop_and_passes simulator/places
    design/cluster design/limit_against_simulation design/gap_search design/precision design/answers design/study design/load_gap house/extras
    environments/training environments/suite environments/admission environments/leaks environments/active
    commands/interrupted commands/printed_blocks commands/orbits_script commands/design_scripts commands/structure_commands commands/command
    commands/explore commands/compare_absorbers commands/explore_browser studies/stability_report studies/benchmark_scripts
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

# tests marked plain run last, by kernels in plain Python: to compile these kinds of scenes takes longer than their few events
TESTS = Path(__file__).parents[1]


def plain_files() -> list[str]:
    """Return the files with tests marked plain, relative to the tests' folder."""
    return [
        path.relative_to(TESTS).as_posix()
        for path in sorted(TESTS.glob("*/test_*.py"))
        if "pytest.mark.plain" in path.read_text(encoding="utf-8")
    ]
