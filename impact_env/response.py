"""Former place of the names of `impact_env.results`."""

from impact_env.results import *  # noqa: F403
