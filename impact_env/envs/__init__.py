"""Gymnasium environments: control tasks around the simulator. Physics only through `impact_env.controlled`.

Importing this package does not import gymnasium; `register_environments` does, if it is installed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from impact_env.extras import optional


@dataclass(frozen=True)
class Entry:
    """A registered name: the place of its classes, without Env and VectorEnv, their arguments, numbers of an action, whether there is a split."""

    place: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    numbers: int = 1
    has_split: bool = False


HARD, V1, GAP, ADAPTIVE, FRICTION = (
    f"impact_env.envs.choices:{name}"
    for name in ("SweepRate", "SweepRateV1", "GapChoice", "SweepAndGap", "FrictionChoice")
)
OPEN = {"impacts_limit": 100.0}  # what first versions were
TOLD = {"level_unit": "reference", **OPEN}
ENVIRONMENTS = {
    "ImpactAbsorber/SweepRate-v0": Entry(HARD),
    "ImpactAbsorber/GapChoice-v0": Entry(GAP, OPEN),
    "ImpactAbsorber/Passive-v0": Entry("impact_env.envs.choices:Passive"),
    "ImpactAbsorber/SweepRate-v1": Entry(V1),
    "ImpactAbsorber/SweepRateNoisy-v1": Entry(V1, {"observation_noise": 0.3}),
    "ImpactAbsorber/SweepRateDelayed-v1": Entry(V1, {"observation_delay": 4}),
    "ImpactAbsorber/SweepAndGap-v0": Entry(ADAPTIVE, TOLD, numbers=2),
    "ImpactAbsorber/FrictionChoice-v0": Entry(FRICTION, TOLD),
    "ImpactAbsorber/SweepRateHard-v0": Entry(HARD),
    "ImpactAbsorber/GapChoice-v1": Entry(GAP),
    "ImpactAbsorber/SweepAndGap-v1": Entry(ADAPTIVE, numbers=2),
    "ImpactAbsorber/FrictionChoice-v1": Entry(FRICTION),
    "ImpactAbsorber/ActiveFriction-v0": Entry("impact_env.envs.active:ActiveFriction"),
    "ImpactAbsorber/ActiveGap-v0": Entry("impact_env.envs.active:ActiveGap"),
    "ImpactAbsorber/Passage-v0": Entry("impact_env.envs.active:Passage", numbers=2),
    "ImpactAbsorber/Structures-v0": Entry("impact_env.envs.active:Structures", has_split=True),
}


def register_environments() -> None:
    """Register the environments if gymnasium is installed; what is registered already stays as it is.

    Only names are given, so nothing else is imported before an environment is made. There is no TimeLimit: the tasks end by themselves.
    """
    try:
        from gymnasium.envs.registration import register, registry
    except ImportError:
        return
    for name, entry in ENVIRONMENTS.items():
        if name not in registry:
            register(
                id=name,
                entry_point=f"{entry.place}Env",
                vector_entry_point=f"{entry.place}VectorEnv",
                kwargs=dict(entry.arguments),
            )


def first_step(name: str) -> None:
    """Take the first step in an environment with its default scene, which compiles its kernels. Needs gymnasium."""
    with optional():
        import gymnasium

    env = gymnasium.make(name)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.close()
