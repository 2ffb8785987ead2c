"""What strangers meet: the page on a package index, the citation, and the files of a host, whose steps are calls of scripts."""

import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email import message_from_bytes
from email.message import Message
from pathlib import Path

import pytest
from places import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
ADDRESS = "https://host.example/owner/name"


def built(tmp_path: Path, address: str) -> Message:
    """Return the metadata of a wheel that is built with an address."""
    pytest.importorskip("hatchling")
    variables = os.environ | {"PROJECT_URL": address}
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, env=variables, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        return message_from_bytes(archive.read(name))


@pytest.mark.parametrize("address", ["", ADDRESS])
def test_the_page_on_an_index_has_no_link_that_leads_nowhere(tmp_path: Path, address: str) -> None:
    metadata = built(tmp_path, address)
    text = metadata.get_payload()
    links = re.findall(r"(!?)\[[^\]]*\]\(([^)\s]+)\)", text)
    assert all(link.startswith("https://") for _, link in links)
    assert "<!--" not in text
    own = [(figure, link.removeprefix(f"{ADDRESS}/")) for figure, link in links if link.startswith(ADDRESS)]
    for figure, link in own:
        kind, tag, path = link.split("/", 2)
        assert (kind, tag) == ("raw" if figure else "blob", f"v{PROJECT['version']}")
        assert (ROOT / path.partition("#")[0]).exists()
    assert (len(own) > 20) == bool(address)
    assert len(metadata.get_all("Project-URL", [])) == (4 if address else 0)
    assert "fifth, but only in a certain range of forces" in " ".join(text.split())
    assert metadata["Version"] == PROJECT["version"]


def test_the_version_is_one_everywhere() -> None:
    version = PROJECT["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    (first,) = re.findall(r"\A.*?^## \[(.*?)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE | re.DOTALL)
    assert first in (version, "Unreleased")


def steps(file: Path) -> list[str]:
    """Return the commands of a host's file, one for each entry of a matrix."""
    yaml = pytest.importorskip("yaml")
    found = []
    for job in yaml.safe_load(file.read_text())["jobs"].values():
        calls = job.get("strategy", {}).get("matrix", {}).get("call", [""])
        found += [step["run"].replace("${{ matrix.call }}", call) for step in job["steps"] if "run" in step for call in calls]
    return found


@pytest.mark.parametrize("name", ["tests", "release"])
def test_every_step_of_the_host_is_a_call_of_scripts(name: str) -> None:
    calls = steps(ROOT / ".github" / "workflows" / f"{name}.yml")
    assert calls
    for call in calls:
        program = call.split()[0]
        assert program.startswith(("scripts/", ".ci/"))
        assert os.access(ROOT / program, os.X_OK), call


def test_the_release_has_no_password_and_only_its_last_job_may_publish() -> None:
    yaml = pytest.importorskip("yaml")
    text = (ROOT / ".github" / "workflows" / "release.yml").read_text()
    assert "secrets." not in text
    about = yaml.safe_load(text)
    assert about["permissions"] == {"contents": "read"}
    assert [name for name, job in about["jobs"].items() if "permissions" in job] == ["publish"]


def test_a_wheel_from_the_source_distribution_is_the_same(tmp_path: Path) -> None:
    """The hook and the README that it reads are in the source distribution."""
    pytest.importorskip("hatchling")
    build = [sys.executable, "-m", "hatchling", "build", "-d", str(tmp_path)]
    subprocess.run([*build, "-t", "sdist"], cwd=ROOT, check=True, capture_output=True)
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as file:
        file.extractall(tmp_path / "source", **({"filter": "data"} if hasattr(tarfile, "data_filter") else {}))  # from Python 3.11.4 on
    (source,) = (tmp_path / "source").iterdir()
    subprocess.run([*build, "-t", "wheel"], cwd=source, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    (direct := tmp_path / "direct").mkdir()
    built(direct, "")
    (other,) = direct.glob("*.whl")
    with zipfile.ZipFile(wheel) as one, zipfile.ZipFile(other) as two:
        assert {i.filename: i.CRC for i in one.infolist()} == {i.filename: i.CRC for i in two.infolist()}
