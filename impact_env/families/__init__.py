"""From scene and method to kernels: the families, and the table that finds the one. No other module looks at kinds of scenes."""

from impact_env.families.family import Family, Observers
from impact_env.families.table import family, kernel_key

__all__ = ["Family", "Observers", "family", "kernel_key"]
