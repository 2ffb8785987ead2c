import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from commands import call, done

pytest.importorskip("stable_baselines3")
from PIL import Image, ImageSequence

from impact_env.envs.evaluation import play
from optimisation.cli import rl_render as render_episode
from optimisation.rl.agents import load_agent, packaged_file
from studies.cli import benchmark_envs


def test_films_are_whole_and_an_agent_acts_in_its_own_environment(tmp_path: Path) -> None:
    file = packaged_file("FrictionChoice-v1")
    target = tmp_path / "film.gif"
    played = play(load_agent(file), "ImpactAbsorber/FrictionChoice-v1", [2000403])
    whole = call(render_episode.main, "--agent", file, "--seed", 2000403, "--gif", target)
    assert f"{int(played.steps[0]) + 1} frames" in whole.output
    done(render_episode.main, "--gif", target, "--frames", 6, "--force", 2)
    with Image.open(target) as film:
        frames = [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(film)]
    assert len(frames) == 6
    assert all(np.any(a != b) for a, b in pairwise(frames))
    assert [path.name for path in tmp_path.iterdir()] == ["film.gif"]


def test_benchmark_prints_and_writes_what_it_measured(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(benchmark_envs, "QUICK_SECONDS", 0.02)
    monkeypatch.setattr(benchmark_envs, "REPEATS", 2)
    monkeypatch.setattr(benchmark_envs, "SETTLE", 2)
    monkeypatch.setattr(
        benchmark_envs,
        "cases",
        lambda: [
            benchmark_envs.single,
            lambda seconds, advance: benchmark_envs.vector(
                "native vector", "vector_entry_point", 64, seconds, advance
            ),
            lambda seconds, advance: benchmark_envs.vector(
                "Gymnasium's SyncVectorEnv", "sync", 2, seconds, advance
            ),
            lambda seconds, advance: benchmark_envs.task(
                "ImpactAbsorber/ActiveGap-v0", 64, seconds, advance
            ),
        ],
    )
    target = tmp_path / "speed.json"
    page = tmp_path / "page.md"
    page.write_text("<!-- speeds -->\n<!-- /speeds -->\n")
    result = done(benchmark_envs.main, "--quick", "--json", target, "--page", page)
    values = json.loads(target.read_text())
    speeds = {speed["name"]: speed for speed in values["speeds"]}
    assert all(
        len(speed["each"]) == benchmark_envs.REPEATS and min(speed["each"]) > 0
        for speed in speeds.values()
    )
    native = speeds["native vector"]["steps_per_s"]
    own = speeds["Gymnasium's SyncVectorEnv"]["steps_per_s"]
    printed = benchmark_envs.table(values["speeds"])
    assert printed in result.output
    assert f"<!-- speeds -->\n{printed}\n\n" in page.read_text()
    assert f" {native / own:.1f} |" in printed
    assert (
        f" {speeds['ActiveGap-v0']['steps_per_s'] / 4:,.0f} |" in printed
    )  # four steps are a pseudo period
