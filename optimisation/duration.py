"""How long the runs of a command will take, measured on a short run before they begin."""

import click

from impact_env.drive import Drive, constant_frequency
from impact_env.ensemble import available_cores
from impact_env.scene import Scene
from impact_env.sweep import simulate

LONG_S = 20.0  # from here on a command says how long it will take
PROBE_PERIODS = 50.0  # of a run that is timed: milliseconds


def seconds_per_period(scene: Scene, force: float, resonance: int) -> float:
    """Return the time in s that a pseudo period takes under a force in N at a resonance, without compilation: the shorter of two runs."""
    schedule = constant_frequency(scene.model.resonance_omega(resonance), 1.0, PROBE_PERIODS)
    return min(simulate(scene, Drive(force, schedule)).wall_time for _ in "12") / PROBE_PERIODS


def duration_in_words(seconds: float) -> str:
    """Return a time in s, min, h or days with two digits."""
    for unit, size in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{float(f'{seconds / size:.2g}'):g} {unit}"
    return f"{float(f'{seconds:.2g}'):g} s"


def announce_duration(
    scene: Scene, force: float, resonance: int, periods: float, runs: int, threads: int | None
) -> float:
    """Return about how long so many runs take in s, and print it on standard error where it is long; ``periods``: pseudo periods of a run.

    The run that is timed has fewer impacts than a whole sweep may have: within a factor of about three.
    """
    cores = min(threads or available_cores(), runs)
    seconds = runs * periods * seconds_per_period(scene, force, resonance) / cores
    if seconds > LONG_S:
        many = f"{runs} runs" if runs > 1 else "one run"
        click.echo(
            f"About {duration_in_words(seconds)}, within a factor of three: {many} of {periods:,.0f} pseudo periods. A higher --rate takes less.",
            err=True,
        )
    return seconds
