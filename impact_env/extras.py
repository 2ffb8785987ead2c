"""Packages that not everyone needs: an import that fails says which extra of this package brings them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

DISTRIBUTION = "impact-absorber-workbench"
# as they are imported; the extras of pyproject.toml that bring them
EXTRAS = {
    "gymnasium": "env",
    "stable_baselines3": "rl",
    "torch": "rl",
    "tensorboard": "rl",
    "yaml": "rl",
    "sb3_contrib": "rl",
    "PIL": "env",
    "pygame": "env",
    "minari": "offline",
    "h5py": "offline",
    "cvxpy": "optimise",
    "optuna": "optimise",
    "cmaes": "optimise",
    "distributed": "cluster",
    "pyuff": "files",
    "heyoka": "peers",
    "mpmath": "peers",
}


def how_to_install(package: str) -> str:
    """Return the command that installs an optional package."""
    return f'pip install "{DISTRIBUTION}[{EXTRAS[package]}]"'


@contextmanager
def optional() -> Iterator[None]:
    """Surround imports of optional packages; raises ModuleNotFoundError with the command that installs the one that is missing."""
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in EXTRAS or str(error).endswith(how_to_install(package)):
            raise
        raise ModuleNotFoundError(f"{package} is not installed; it comes with: {how_to_install(package)}", name=error.name) from error
