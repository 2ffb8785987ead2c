"""Initialisation from demonstrations: an actor learns to do in each situation what was done there (behaviour cloning), before it is trained."""

from typing import Any

import numpy as np

from impact_env.extras import optional
from impact_env.parameters import require
from optimisation.rl.demonstrations import Demonstrations
from optimisation.rl.models import Model

with optional():
    import torch

EPOCHS, BATCH, LEARNING_RATE = 40, 256, 1e-3


def imitate(model: Model, shown: Demonstrations, seed: int, epochs: int = EPOCHS) -> float:
    """Fit the mean action of a PPO or SAC model to demonstrations by least squares; return the mean squared error at the end.

    Raises ParameterError if the demonstrations' observations or actions are of another size than the model's.
    """
    policy: Any = model.policy
    tools: Any = torch
    observations, actions = (torch.from_numpy(np.concatenate(parts)) for parts in ([o[:-1] for o in shown.observations], shown.actions))
    sizes = (model.observation_space.shape, model.action_space.shape)
    shapes = (tuple(observations.shape[1:]), tuple(actions.shape[1:]))
    require(shapes == sizes, "shapes of demonstrations", shapes, f"{sizes}, those of the environment")
    actor = getattr(model, "actor", None)
    parameters = list((policy if actor is None else actor).parameters())
    optimiser: Any = tools.optim.Adam(parameters, lr=LEARNING_RATE)
    generator: Any = tools.Generator().manual_seed(seed)
    mean: Any = (lambda seen: policy.get_distribution(seen).distribution.mean) if actor is None else (lambda seen: actor(seen, deterministic=True))
    for _ in range(epochs):
        for part in tools.randperm(len(observations), generator=generator).split(BATCH):
            loss = tools.nn.functional.mse_loss(mean(observations[part]), actions[part])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
    with torch.no_grad():
        return float(torch.nn.functional.mse_loss(mean(observations), actions))
