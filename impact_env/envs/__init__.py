"""Gymnasium environments: control tasks based on the simulator.

All physics comes from `impact_env.controlled`.

Importing this package does not import gymnasium; `register_environments` does, if it is installed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from impact_env.extras import optional


@dataclass(frozen=True)
class EnvironmentEntry:
    """An entry of the registry of environments.

    ``place`` is the module and the name of its classes without the endings Env and VectorEnv,
    ``arguments`` are their arguments, ``numbers`` is the number of values in an action, and
    ``has_split`` says whether a split exists.
    """

    place: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    numbers: int = 1
    has_split: bool = False


SWEEP_RATE, SWEEP_RATE_V1, GAP_CHOICE, SWEEP_AND_GAP, FRICTION_CHOICE = (
    f"impact_env.envs.choices:{name}"
    for name in ("SweepRate", "SweepRateV1", "GapChoice", "SweepAndGap", "FrictionChoice")
)
OPEN_DEFAULTS = {"impacts_limit": 100.0}  # what first versions were
V0_DEFAULTS = {"level_unit": "reference", **OPEN_DEFAULTS}
ENVIRONMENTS = {
    "ImpactAbsorber/SweepRate-v0": EnvironmentEntry(SWEEP_RATE),
    "ImpactAbsorber/GapChoice-v0": EnvironmentEntry(GAP_CHOICE, OPEN_DEFAULTS),
    "ImpactAbsorber/Passive-v0": EnvironmentEntry("impact_env.envs.choices:Passive"),
    "ImpactAbsorber/SweepRate-v1": EnvironmentEntry(SWEEP_RATE_V1),
    "ImpactAbsorber/SweepRateNoisy-v1": EnvironmentEntry(SWEEP_RATE_V1, {"observation_noise": 0.3}),
    "ImpactAbsorber/SweepRateDelayed-v1": EnvironmentEntry(SWEEP_RATE_V1, {"observation_delay": 4}),
    "ImpactAbsorber/SweepAndGap-v0": EnvironmentEntry(SWEEP_AND_GAP, V0_DEFAULTS, numbers=2),
    "ImpactAbsorber/FrictionChoice-v0": EnvironmentEntry(FRICTION_CHOICE, V0_DEFAULTS),
    "ImpactAbsorber/SweepRateHard-v0": EnvironmentEntry(SWEEP_RATE),
    "ImpactAbsorber/GapChoice-v1": EnvironmentEntry(GAP_CHOICE),
    "ImpactAbsorber/SweepAndGap-v1": EnvironmentEntry(SWEEP_AND_GAP, numbers=2),
    "ImpactAbsorber/FrictionChoice-v1": EnvironmentEntry(FRICTION_CHOICE),
    "ImpactAbsorber/ActiveFriction-v0": EnvironmentEntry("impact_env.envs.active:ActiveFriction"),
    "ImpactAbsorber/ActiveGap-v0": EnvironmentEntry("impact_env.envs.active:ActiveGap"),
    "ImpactAbsorber/Passage-v0": EnvironmentEntry("impact_env.envs.active:Passage", numbers=2),
    "ImpactAbsorber/Structures-v0": EnvironmentEntry(
        "impact_env.envs.active:Structures", has_split=True
    ),
    "ImpactAbsorber/RawSensors-v0": EnvironmentEntry("impact_env.envs.active:RawSensors"),
}


def register_environments() -> None:
    """Register the environments if gymnasium is installed.

    Names that are registered already are not changed.

    Only names are given, so nothing else is imported before an environment is made. There is no
    TimeLimit: the tasks end by themselves.
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


def take_first_step(name: str) -> None:
    """Take the first step in an environment with its default scene to compile its kernels.

    Needs gymnasium.
    """
    with optional():
        import gymnasium

    env = gymnasium.make(name)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.close()
