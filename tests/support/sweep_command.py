"""Calls of scripts/sweep.py in this process, for its tests."""

from __future__ import annotations

from click.testing import CliRunner, Result

from optimisation.cli import sweep

SHORT = ["--modes", "2", "--from", "0.98", "--to", "1", "--rate", "10"]  # 20 pseudo periods


def call(*arguments: str) -> Result:
    """Call the command; the result has exit code and output."""
    return CliRunner().invoke(sweep.main, list(arguments))
