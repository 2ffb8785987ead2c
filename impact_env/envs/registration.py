"""Names of the environments, and their entry in gymnasium's registry."""

from __future__ import annotations

from impact_env.extras import optional

ENVIRONMENTS = {
    "ImpactAbsorber/SweepRate-v0": "impact_env.envs.sweep_rate:SweepRate",
    "ImpactAbsorber/GapChoice-v0": "impact_env.envs.gap_choice:GapChoice",
    "ImpactAbsorber/Passive-v0": "impact_env.envs.passive:Passive",
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
            register(id=name, entry_point=f"{entry}Env", vector_entry_point=f"{entry}VectorEnv")


def first_step(name: str) -> None:
    """Take the first step in an environment with its default scene, which compiles its kernels. Needs gymnasium."""
    with optional():
        import gymnasium

    env = gymnasium.make(name)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.close()
