"""Gymnasium environments: control tasks around the simulator. Physics only through `impact_env.controlled`.

Importing this package does not import gymnasium; `register_environments` does, if it is installed.
"""

from impact_env.envs.registration import ENVIRONMENTS, first_step, register_environments

__all__ = ["ENVIRONMENTS", "first_step", "register_environments"]
