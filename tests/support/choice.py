"""Choice and groups of the test files.

The module lists the groups of files that run together and the files that run at every save. The
choice follows from the processor's time with compiled kernels (``scripts/test -n 0 --cpu FILE``).
noxfile.py and conftest.py use it.
"""

from pathlib import Path


def _files(words: dict[str, str]) -> tuple[str, ...]:
    return tuple(
        f"tests/{folder}/test_{name}.py"
        for folder, names in words.items()
        for name in names.split()
    )


# Each group runs in a process of its own, two at a time, those that take longest first. What a
# process has compiled and imported stays in its memory: hence groups, and files of one folder, which
# import the same, in one of them.
KERNELS = ("tests/kernels/test_[m-z]*.py", "tests/kernels/test_[a-l]*.py")
OTHERS = (
    "tests/periodic/test_*.py",
    "tests/environments/test_*.py",
    "tests/commands/test_[d-h]*.py",
    "tests/design/test_[l-z]*.py",
    "tests/commands/test_[i-o]*.py",
    "tests/studies/test_*.py",
    "tests/simulator/test_*.py",
    "tests/design/test_[a-k]*.py",
    "tests/commands/test_[a-c]*.py",
    "tests/commands/test_[p-z]*.py",
    "tests/house/test_*.py",
)
GROUPS = (*KERNELS, *OTHERS)

# some of every kind that say much in little time; what takes long in them is marked slow
_QUICK = (
    {
        "simulator": "controlled ensemble model frequency plain structure",
        "kernels": "check energies exact_contacts linear properties several",
    },
    {
        "periodic": "continuation periodic_closed_form periodic_orbits",
        "commands": "bad_input sweep_script",
        "design": "bounds designs objectives structure_design",
        "studies": "study_pattern",
        "house": "docs",
        "environments": "environments scores",
    },
)
QUICK_GROUPS = tuple(" ".join(_files(words)) for words in _QUICK)
QUICK = tuple(name for words in _QUICK for name in _files(words))

# depend on the arithmetic of BLAS or torch: .ci/run runs them as on an old processor, too
ARITHMETIC_GROUPS = tuple(
    " ".join(_files(words))
    for words in (
        {"environments": "suite training"},
        {
            "kernels": "regimes linear exact_contacts",
            "periodic": "periodic_orbits published_orbits",
            "simulator": "model frequency structure",
            "design": "tuned",
        },
    )
)

ROOT = Path(__file__).parents[2]


def plain_files() -> list[str]:
    """Return the files with tests marked plain, relative to the checkout.

    They run by kernels in plain Python: to compile these kinds of scenes takes longer than their
    few events.
    """
    return [
        path.relative_to(ROOT).as_posix()
        for path in sorted(ROOT.glob("tests/*/test_*.py"))
        if "pytest.mark.plain" in path.read_text(encoding="utf-8")
    ]
