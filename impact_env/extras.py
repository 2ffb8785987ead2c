"""Optional packages: the error of a failed import names the extra that installs them."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DISTRIBUTION = "impact-absorber-workbench"
OF_EXTRAS = {  # extras of pyproject.toml: the packages that they bring, as they are imported
    "env": ("gymnasium", "PIL", "pygame"),
    "rl": ("stable_baselines3", "torch", "tensorboard", "yaml", "sb3_contrib"),
    "offline": ("minari", "h5py"),
    "optimise": ("cvxpy", "optuna", "cmaes", "moocore"),
    "cluster": ("distributed",),
    "files": ("pyuff",),
    "dataframe": ("pandas",),
    "nastran": ("pyNastran", "cpylog"),
    "ansys": ("ansys",),
    "explore": ("starlette", "uvicorn", "websockets"),
    "peers": ("heyoka", "mpmath"),
}
EXTRAS = {package: extra for extra, packages in OF_EXTRAS.items() for package in packages}


class MissingExtraError(ModuleNotFoundError):
    """An optional package is not installed; the message says what installs it."""


def how_to_install(*extras: str) -> str:
    """Return the command that installs extras.

    It installs into the environment of a checkout if Python runs in this environment, and otherwise
    by pip.
    """
    set_up = ROOT / "scripts" / "lib" / "set_up.py"
    if Path(sys.prefix).resolve() == ROOT / ".venv" and set_up.exists():
        return f'python3 "{set_up}" {" ".join(extras)}'
    return f'pip install "{DISTRIBUTION}[{",".join(extras)}]"'


@contextmanager
def optional() -> Iterator[None]:
    """Replace the error of a failed import of an optional package in this context.

    Raises MissingExtraError with the command that installs the missing package.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in EXTRAS or isinstance(error, MissingExtraError):
            raise
        raise MissingExtraError(
            f"{package} is not installed; it comes with: {how_to_install(EXTRAS[package])}",
            name=error.name,
        ) from error
