"""Episodes of a policy: one a lane of a native vector environment, each with the seed it is given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impact_env  # noqa: F401 - registers the environments
from impact_env.envs import ENVIRONMENTS
from impact_env.extras import optional
from impact_env.parameters import require
from optimisation.rl.policies import Informed, Policy

Array = NDArray[np.float64]
SWEEP, GAP = "ImpactAbsorber/SweepRate-v0", "ImpactAbsorber/GapChoice-v0"
PASSAGE, NOISY, DELAYED = "ImpactAbsorber/SweepRate-v1", "ImpactAbsorber/SweepRateNoisy-v1", "ImpactAbsorber/SweepRateDelayed-v1"
ADAPTIVE, FRICTION = "ImpactAbsorber/SweepAndGap-v0", "ImpactAbsorber/FrictionChoice-v0"
ACTION, AMPLITUDE = "action", "amplitude"


@dataclass(frozen=True)
class Episodes:
    """What came of one episode for each seed.

    ``seeds`` and ``scores`` (L,): sum of the rewards. ``steps`` (L,): control intervals. ``last`` holds info at the end by name, (L,) each, for
    example ``relative_level`` and ``time`` (pseudo periods). ``traces`` holds what was asked for by name, (steps, L), NaN after a lane's end.
    """

    seeds: tuple[int, ...]
    scores: Array
    steps: NDArray[np.int64]
    last: dict[str, Array]
    traces: dict[str, Array] = field(default_factory=dict)


def play(policy: Policy, name: str, seeds: Sequence[int], arguments: Mapping[str, Any] | None = None, record: Sequence[str] = ()) -> Episodes:
    """Play one episode a seed and return them; a lane equals the single environment ``name`` that is reset with its seed.

    ``arguments`` are the environment's. ``record`` names what goes into the traces: names of info, "action", and "amplitude" (the tip's over the
    interval as the observation has it, in half-clearances). A lane that is over rests until the last one is. Raises ParameterError for an
    unknown environment, no seeds, a name that info does not have, or actions of a wrong shape.
    """
    require(name in ENVIRONMENTS, "environment", name, f"one of {', '.join(ENVIRONMENTS)}")
    require(len(seeds) > 0, "seeds", seeds, "at least one seed")
    with optional():
        import gymnasium
    env = gymnasium.make_vec(name, num_envs=len(seeds), vectorization_mode="vector_entry_point", **(arguments or {}))
    try:
        return _play(policy, env, [int(seed) for seed in seeds], record)
    finally:
        env.close()


def _play(policy: Policy, env: Any, seeds: list[int], record: Sequence[str]) -> Episodes:
    lanes = len(seeds)
    policy.start(lanes)
    observations, info = env.reset(seed=seeds)
    known = [key for key in info if not key.startswith("_") and info[key].ndim == 1]
    for key in record:
        require(key in known or key in (ACTION, AMPLITUDE), "record", key, f"{ACTION}, {AMPLITUDE}, or one of {', '.join(known)}")
    scores, steps, going = np.zeros(lanes), np.zeros(lanes, dtype=np.int64), np.ones(lanes, dtype=np.bool_)
    last = {key: np.zeros(lanes) for key in known}
    rows: dict[str, list[Array]] = {key: [] for key in record}
    while going.any():
        actions = _actions(policy, observations, info, env.action_space.shape)
        observations, rewards, terminated, truncated, info = env.step(actions)
        over = terminated | truncated
        final = info.get("final_info", {})
        now = {key: np.where(over, final[key], info[key]) if over.any() else info[key] for key in known}
        now[ACTION] = actions[:, 0]
        if AMPLITUDE in record:
            now[AMPLITUDE] = _amplitudes(observations, info)
        for key in record:
            rows[key].append(np.where(going, now[key], np.nan))
        scores[going] += rewards[going]
        steps[going] += 1
        for key in known:
            last[key][going] = now[key][going]
        going &= ~over
        env.unwrapped.rest(~going)
    return Episodes(tuple(seeds), scores, steps, last, {key: np.stack(values) for key, values in rows.items()})


def _amplitudes(observations: NDArray[np.float32], info: dict[str, Any]) -> Array:
    """Return the amplitudes (L,) of the tip in the interval, from the last observation of an episode where it ended."""
    seen = observations.astype(np.float64)
    for lane in np.flatnonzero(info.get("_final_obs", [])).tolist():
        seen[lane] = info["final_obs"][lane]
    return np.hypot(seen[:, 0], seen[:, 1])


def _actions(policy: Policy, observations: NDArray[np.float32], info: dict[str, Any], shape: tuple[int, ...]) -> NDArray[np.float32]:
    if isinstance(policy, Informed):
        policy.inform({key: values for key, values in info.items() if not key.startswith("_") and not key.startswith("final_")})
    actions = policy.act(observations)
    require(actions.shape == shape, "actions", actions.shape, f"an array of shape {shape} from {policy.name}")
    return actions
