from __future__ import annotations

import pytest

from impact_env import warm_up


def test_every_variant_is_compiled_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warm_up, "ABSORBERS", {"linear scenes": lambda: None})
    lines: list[str] = []
    assert warm_up.main([], lines.append) == 0
    assert len(lines) == len(warm_up.RECORDS) + 1
    assert all(line.rstrip().endswith(" s") for line in lines[:-1])


def test_environments_take_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("gymnasium")
    assert [name for name, _ in warm_up.environments()] == list(warm_up.ENVIRONMENTS)
    monkeypatch.setattr(warm_up, "ENVIRONMENTS", ["ImpactAbsorber/Passive-v0"])
    lines: list[str] = []
    assert warm_up.main(["environments"], lines.append) == 0
    assert "Passive" in lines[0]


def test_other_words_are_refused() -> None:
    lines: list[str] = []
    assert warm_up.main(["everything"], lines.append) == 2
    assert "everything is not allowed" in lines[0]


def test_all_is_the_main_job_and_more() -> None:
    names = [name for name, _ in warm_up.everything()]
    assert len(set(names)) == len(names)
    assert {name for name, _ in warm_up.main_job() + warm_up.environments()} < set(names)
