"""scripts/benchmark_start.py on a small checkout, whose steps say what they were given."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from studies.cli import benchmark_start

SET_UP = """
import os, sys, time
from pathlib import Path
assert not {name for name in os.environ if name.startswith(("IMPACT_ENV_", "PYTHONPATH", "NUMBA_"))}, os.environ
assert not list(Path(os.environ["HOME"]).iterdir())
python = Path(__file__).parents[2] / ".venv" / "bin" / "python"
if "env" in sys.argv:
    (python.parent / "env").touch()
elif "kernels" in sys.argv:
    assert python.exists()
    while time.process_time() < 0.5:
        pass
else:
    python.parent.mkdir(parents=True)
    python.write_text(COMMAND)
    python.chmod(0o755)
"""


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a committed checkout with a set-up that installs nothing and a comparison that compares nothing."""
    root = tmp_path / "checkout"
    (root / "scripts" / "lib").mkdir(parents=True)
    command = f'#!/bin/sh\nexec {shlex.quote(sys.executable)} "$@"\n'
    (root / "scripts" / "lib" / "set_up.py").write_text(SET_UP.replace("COMMAND", repr(command)))
    run = root / "scripts" / "run"
    run.write_text('#!/bin/sh\n[ "$*" = "$1 --quick --out $4" ] && [ "$1" = compare_absorbers ] && mkdir "$4"\n')
    run.chmod(0o755)
    git = ["git", "-C", str(root), "-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "-q"], ["add", "-A"], ["commit", "-qm", "all"]):
        subprocess.run([*git, *words], check=True)
    monkeypatch.setattr(benchmark_start, "ROOT", root)
    monkeypatch.setattr(benchmark_start, "FIRST_CALL", "import sys; sys.exit(sys.argv[1:] != ['impact', 'exact', 'level and events'])")
    monkeypatch.setenv("IMPACT_ENV_CACHE", "somewhere")
    monkeypatch.setenv("PYTHONPATH", "somewhere")
    return root


@pytest.mark.usefixtures("checkout")
def test_every_step_is_timed_and_the_table_goes_to_the_page(tmp_path: Path) -> None:
    page, target = tmp_path / "page.md", tmp_path / "start.json"
    page.write_text("before\n<!-- start -->\n<!-- /start -->\nafter\n")
    result = CliRunner().invoke(benchmark_start.main, ["--quick", "--json", str(target), "--page", str(page)])
    assert result.exit_code == 0, result.output
    steps = json.loads(target.read_text())["steps"]
    assert [step["what"] for step in steps] == [
        *benchmark_start.STARTED,
        "to the table and the figure",
        "first call: impact, exact, level and events recorded",
    ]
    assert steps[1]["cpu_s"] >= 0.4 > steps[0]["cpu_s"]
    assert steps[3]["wall_s"] == pytest.approx(sum(step["wall_s"] for step in steps[:3]))
    assert [step["wanted_s"] for step in steps] == [None, None, None, 75.0, 15.0]
    text = page.read_text()
    assert all(step["what"] in text for step in steps)
    assert text.startswith("before\n")
    assert text.endswith("after\n")
