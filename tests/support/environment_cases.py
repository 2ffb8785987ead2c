"""Short episodes of every environment, and how tests make them; needs Gymnasium."""

from typing import Any

import gymnasium
import numpy as np

from impact_env.envs import ENVIRONMENTS

NAMES = tuple(ENVIRONMENTS)
SWEEP, GAP, PASSIVE, V1, NOISY, DELAYED, OPEN_ADAPTIVE, OPEN_FRICTION = NAMES[:8]
HARD, GAP1, ADAPTIVE, FRICTION, ACTIVE_FRICTION, ACTIVE_GAP, LIMITED, STRUCTURES = NAMES[8:16]
(RAW,) = NAMES[16:]
PAIRS = (OPEN_ADAPTIVE, ADAPTIVE, LIMITED)  # which take two numbers
RUBBING = {
    "modes": 2,
    "absorber_options": {"friction_limit": 0.025},
}  # one kind of scene for most tests: one kernel to compile
SHAKEN = {
    "kind": "random",
    "quantity": "base_acceleration",
    "spectrum": [[20.0, 0.5], [60.0, 0.5]],
    "duration_s": 2.0,
    "seed": 4,
}
SHORT = {
    SWEEP: RUBBING
    | {
        "interval": 5.0,
        "limits": (0.96, 0.98),
        "rates": (2.0, 20.0),
        "direction": "random",
        "force": (1.0, 2.0),
        "time_budget": 60.0,
    },
    GAP: {
        "hold": (10.0, 30.0),
        "time_budget": 60.0,
        "force": (1.0, 6.0),
        "frequency_ratio": (0.97, 1.03),
    }
    | RUBBING,
    PASSIVE: {"limits": (0.96, 0.98), "rate": 4.0, "direction": "random", "force": (1.0, 2.0)}
    | RUBBING,
}
BRIEF = {
    "interval": 5.0,
    "limits": (0.96, 0.98),
    "rates": (2.0, 20.0),
    "direction": "random",
    "time_budget": 60.0,
}
SHORT |= dict.fromkeys((V1, NOISY, DELAYED), BRIEF) | {ADAPTIVE: BRIEF | RUBBING}
SHORT |= {FRICTION: {"limits": (0.96, 0.98), "direction": "random", "friction_range": (0.01, 5.0)}}
SHORT |= {ACTIVE_FRICTION: {"time_budget": 5.0}, ACTIVE_GAP: {"time_budget": 5.0}}
SHORT |= {
    LIMITED: {"limits": (0.97, 0.99), "scenes": 3},
    STRUCTURES: {"time_budget": 5.0, "structures": 5},
    RAW: {"time_budget": 5.0},
}
SHORT |= {
    OPEN_FRICTION: SHORT[FRICTION],
    OPEN_ADAPTIVE: SHORT[ADAPTIVE],
    HARD: SHORT[SWEEP],
    GAP1: SHORT[GAP],
}


def make(name: str, **arguments: Any) -> Any:
    return gymnasium.make(name, **(SHORT[name] | arguments))


def vector(name: str, lanes: int, **arguments: Any) -> Any:
    return gymnasium.make_vec(name, num_envs=lanes, **(SHORT[name] | arguments))


def actions(name: str, steps: int, lanes: int) -> np.ndarray:
    if name == PASSIVE:
        return np.zeros((steps, lanes), dtype=np.int64)
    return (
        np.random.default_rng(5)
        .uniform(-1, 1, (steps, lanes, 2 if name in PAIRS else 1))
        .astype(np.float32)
    )


def played(env: Any, act: Any = 0, **reset: Any) -> list[Any]:
    """Return the results of each step of an episode.

    ``act`` is the action, or a function of the observation that returns it.
    """
    observation = env.reset(**reset)[0]
    steps = []
    while not steps or not (steps[-1][2] or steps[-1][3]):
        steps.append(env.step(act(observation) if callable(act) else act))
        observation = steps[-1][0]
    return steps
