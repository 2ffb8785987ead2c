"""Baselines: what needs no learning, by name, kind and numbers; and the names that tables, figures and stored files know them by."""

from __future__ import annotations

from dataclasses import dataclass

from optimisation.rl.tuning import Tuned

RANDOM = "random"
BEST_CONSTANT, BEST_SCHEDULE = "best constant rate", "best open-loop schedule"
WINDOWED, KNOTTED = "rule over the frequency", "schedule by knots"
BEST_PAIR, BEST_LIMIT = "best constant rate and gap", "best constant limit"
BEST_GAP, TUNED_TRUE, TUNED_ESTIMATE = "best fixed gap", "rule, true force, fitted", "rule, estimated force, fitted"
FEEDBACK, ORACLE = "feedback rule", "rule, true force"
WINDOW, BLIND = "slow window", "blind tries"


@dataclass(frozen=True)
class Baseline:
    """A policy by its name, kind and numbers; ``training`` says how they were chosen, None if they were not."""

    name: str
    kind: str
    parameters: tuple[float, ...]
    training: Tuned | None = None

    @classmethod
    def tuned(cls, name: str, kind: str, found: Tuned) -> Baseline:
        """Return the baseline of a kind with the numbers that a search found."""
        return cls(name, kind, found.parameters, found)
