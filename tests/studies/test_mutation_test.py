"""Planted faults: the list fits the sources, and a fault is caught, survives or is refused."""

from pathlib import Path

import pytest
from places import ROOT

from impact_env.checks import ParameterError
from studies.cli import mutation_test
from studies.cli.mutation_test import CAUGHT, EXPECTED, SURVIVES, Fault, judge_fault, read_faults

FAULT = Fault("half", "sums", "sums.py", "return a + b", "return a - b", "tests/test_sums.py")
TEXT = "[[fault]]\n" + "\n".join(
    f'{name} = "{getattr(FAULT, name)}"' for name in ("name", "part", "file", "old", "new", "tests")
)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkout of one function and two tests, of which the second one notices nothing."""
    (tmp_path / "sums.py").write_text("def total(a, b):\n    return a + b\n")
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "test_sums.py").write_text(
        "from sums import total\n\n\n"
        "def test_total():\n    assert total(2, 1) == 3\n\n\n"
        "def test_nothing():\n    assert total(2, 0) == 2\n"
    )
    monkeypatch.setattr(mutation_test, "ROOT", tmp_path)
    monkeypatch.setattr(mutation_test, "COPIED", ("sums.py", "tests"))
    return tmp_path


def write_list(package: Path, text: str) -> Path:
    file = package / "faults.toml"
    file.write_text(text)
    return file


def test_the_list_fits_the_sources_and_names_tests_that_exist() -> None:
    faults = read_faults()
    assert len(faults) >= 60
    for fault in faults:
        for word in fault.tests.split():
            if word.startswith("tests/"):
                assert (ROOT / word.partition("::")[0]).is_file(), fault.name


def test_a_fault_is_caught_or_survives(package: Path) -> None:
    (fault,) = read_faults(write_list(package, TEXT))
    assert fault == FAULT
    caught = judge_fault(fault)
    assert (caught.verdict, caught.test) == (CAUGHT, "test_sums.py::test_total")
    blind = FAULT.__dict__ | {"tests": "tests/test_sums.py -k 'nothing and not total'"}
    assert judge_fault(Fault(**blind)).verdict == SURVIVES
    explained = judge_fault(Fault(**blind | {"survives": "b is 0"}))
    assert (explained.verdict, explained.test) == (EXPECTED, "b is 0")
    assert (package / "sums.py").read_text().count("a + b") == 1
    with pytest.raises(ParameterError, match="tests that run"):
        judge_fault(Fault(**FAULT.__dict__ | {"tests": "tests/test_sums.py -k other"}))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('old = "return a + b"', 'old = "a"', "stands once in sums.py, not 3 times"),
        ('old = "return a + b"', 'old = "c"', "stands once in sums.py, not 0 times"),
        ('new = "return a - b"', 'new = "return a + b"', "other than old"),
        ('file = "sums.py"', 'file = "none.py"', "a file of the checkout, not 'none.py'"),
        ("[[fault]]", f"{TEXT}\n[[fault]]", "names of their own"),
        ('tests = "', 'test = "', "keys of a fault"),
        ("[[fault]]", "[[", "faults.toml"),
    ],
)
def test_a_list_that_does_not_fit_is_refused(
    package: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(ParameterError, match=message):
        read_faults(write_list(package, TEXT.replace(old, new, 1)))
