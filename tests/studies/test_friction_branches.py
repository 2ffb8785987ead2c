"""The table on friction and branches: it goes on where it was stopped, stands on its page, and less damping gets fewer members."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from studies.cli import friction_branches

pytest.importorskip("optuna")

from studies.cli.friction_branches import CASES, LIMITS, Row


def test_it_goes_on_where_it_was_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    numbers, page = tmp_path / "friction.json", tmp_path / "page.md"
    page.write_text("before\n<!-- friction_branches -->\nold\n<!-- /friction_branches -->\nafter\n")
    line = ["--members", "8", "--threads", "1", "--json", str(numbers), "--page", str(page)]
    done: list[tuple[float, float]] = []
    stop_at = 2

    def fake(damping: float, gap: float, members: int, _executor: object, **_: object) -> Iterator[Row]:
        if len(done) == stop_at:
            raise KeyboardInterrupt
        done.append((damping, gap))
        assert members in (friction_branches.members_of(damping, 8), friction_branches.members_of(damping, 4))
        yield from (Row(damping, gap, limit, 0.2 * damping / 0.01, 0.1, 0.3, None) for limit in LIMITS)

    monkeypatch.setattr(friction_branches, "rows", fake)
    stopped = CliRunner().invoke(friction_branches.main, line)
    assert stopped.exit_code == 130
    assert len(json.loads(numbers.read_text())["rows"]) == 2 * len(LIMITS)
    stop_at = 99
    whole = CliRunner().invoke(friction_branches.main, line)
    assert whole.exit_code == 0, whole.output
    assert done == list(CASES)
    text = page.read_text()
    assert "old" not in text
    assert text.startswith("before\n")
    assert text.count(" 4.0 |") == len(LIMITS)  # 0.2 % damping
    assert "kernels" in text
    content = json.loads(numbers.read_text())
    assert content["complete"]
    assert [row["members"] for row in content["rows"][:: len(LIMITS)]] == [8, 4, 4, 2]
    other = CliRunner().invoke(friction_branches.main, ["--members", "4", *line[2:]])
    assert other.exit_code == 0, other.output
    assert done == [*CASES, *CASES]  # other numbers are no earlier run of these
