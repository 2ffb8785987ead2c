"""The posterior as a file: joint draws of all parameters, with their sources.

Commands read the file to design under the uncertainty of the measured parameters.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError, numbers, one_of, require
from impact_env.plain_files import find_unreadable
from optimisation.calibration.parameters import PARAMETERS, UNITS
from optimisation.files import read_json

Array = NDArray[np.float64]
FORMAT = "impact-absorber posterior"
VERSION = 1
LEAST_DRAWS = 50
INTERVAL = (0.05, 0.5, 0.95)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Posterior of a calibration.

    Attributes
    ----------
    names : tuple of str
        Parameters, (P,).
    draws : array, (N, P)
        Draws in SI units.
    explains : bool or None
        Whether the model explains the measurement, None if not checked.
    device : mapping of str to float
        All values of the absorber by their plain names, with the medians of free parameters; empty
        if not known.
    """

    names: tuple[str, ...]
    draws: Array
    explains: bool | None = None
    device: Mapping[str, float] = field(default_factory=dict)

    @property
    def quantiles(self) -> Array:
        """5, 50 and 95 % of each parameter, (3, P)."""
        return np.asarray(np.quantile(self.draws, INTERVAL, axis=0))

    @property
    def medians(self) -> dict[str, float]:
        """Medians by name."""
        return dict(zip(self.names, self.quantiles[1].tolist(), strict=True))

    @property
    def correlation(self) -> Array:
        """Correlation of the parameters, (P, P).

        It is 0 with a parameter whose draws are all equal.
        """
        varies = np.ptp(self.draws, axis=0) > 0
        correlation = np.eye(len(varies))
        if np.sum(varies) > 1:
            correlation[np.ix_(varies, varies)] = np.corrcoef(self.draws[:, varies].T)
        return correlation

    def column(self, name: str) -> Array:
        """Return the draws (N,) of a parameter."""
        return self.draws[:, self.names.index(name)]

    def to_plain(self) -> dict[str, Any]:
        """Return the posterior as JSON values."""
        low, median, high = self.quantiles.tolist()
        return {
            "format": FORMAT,
            "version": VERSION,
            "parameters": {
                name: {"unit": UNITS[name], "median": median[k], "low": low[k], "high": high[k]}
                for k, name in enumerate(self.names)
            },
            "correlation": self.correlation.round(4).tolist(),
            "model_explains_measurement": self.explains,
            "device": dict(self.device),
            "draws": [[float(f"{value:.7g}") for value in row] for row in self.draws],
        }


def read_posterior(path: Path, option: str = "--uncertain") -> Posterior:
    """Return the posterior of a file that `calibrate` has written.

    Raises ParameterError, which begins with the ``option``, for any other file.
    """
    allowed = "a posterior.json that calibrate has written"
    try:
        content = read_json(path)
    except (OSError, ValueError) as error:
        reason = find_unreadable(path) or error
        raise ParameterError(f"{option} = {path} is not allowed: {allowed} ({reason})") from error
    if not (isinstance(content, Mapping) and content.get("format") == FORMAT):
        raise ParameterError(f"{option} = {path} is not allowed: {allowed}")
    return from_plain(content, f"{option} {path.name}")


def from_plain(content: Mapping[str, Any], path: str) -> Posterior:
    """Return the posterior of JSON values; raises ParameterError for what does not fit."""
    require(
        content.get("version") == VERSION, f"{path}: version", content.get("version"), f"{VERSION}"
    )
    table = content.get("parameters")
    require(isinstance(table, Mapping) and len(table) > 0, f"{path}: parameters", table, "a table")
    assert isinstance(table, Mapping)
    names = tuple(one_of(f"{path}: parameters", name, PARAMETERS) for name in table)
    allowed = f"{LEAST_DRAWS} rows or more of {len(names)} finite numbers"
    draws = numbers(f"{path}: draws", content.get("draws"), allowed)
    ok = draws.ndim == 2 and draws.shape[1:] == (len(names),) and len(draws) >= LEAST_DRAWS
    require(ok and bool(np.all(np.isfinite(draws))), f"{path}: draws", draws.shape, allowed)
    explains = content.get("model_explains_measurement")
    device = content.get("device", {})
    known = isinstance(device, Mapping) and all(
        name in PARAMETERS and isinstance(value, int | float) and math.isfinite(value)
        for name, value in device.items()
    )
    require(known, f"{path}: device", device, "finite numbers by the names of parameters")
    return Posterior(names, draws, explains if isinstance(explains, bool) else None, dict(device))
