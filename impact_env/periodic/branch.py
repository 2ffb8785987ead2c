"""A branch of solutions as data: points, parameters, tangents, what was located on it, and why it ended."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.parameters import ParameterError, require
from impact_env.plain_files import replacing

Real = NDArray[np.float64]

# why a branch ended
CLOSED = "closed"  # it came back to its first point, or to a later one where the unknowns changed: an isola
LIMIT = "limit"  # the parameter's limit
COUNT = "number of points"
MINIMUM_STEP = "minimum step"  # no convergence, or a lost branch, whatever the step
STOPPED = "stopped"  # by Ctrl-C or the caller
SUFFIXES = (".json", ".npz")


def _frozen(values: Any) -> Real:
    array = np.array(values, dtype=np.float64, ndmin=1)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Located:
    """A point of the branch where something happens: ``kind`` is "fold", "branch point", "kink", or that of a monitor.

    It lies behind point number ``after``; ``tangent`` (n + 1,) is in the units of the branch's scaled arclength. ``exact`` is False where the
    root search broke down: then the point is the last one before it.
    """

    kind: str
    after: int
    point: Real
    parameter: float
    tangent: Real
    exact: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", _frozen(self.point))
        object.__setattr__(self, "tangent", _frozen(self.tangent))


@dataclass(frozen=True, eq=False)
class Branch:
    """Solutions z of residual(z, parameter) = 0 in the order of arclength, m of them.

    ``points`` m rows (n,), whose length changes where the caller changes its unknowns; ``parameters`` (m,); ``tangents`` m rows (n + 1,) in scaled
    units, the parameter's share last; ``ended`` one of the reasons above or the kind of a monitor, and ``message`` the same in words.
    """

    parameter: str
    points: tuple[Real, ...]
    parameters: Real
    tangents: tuple[Real, ...]
    located: tuple[Located, ...]
    ended: str
    message: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", tuple(_frozen(z) for z in self.points))
        object.__setattr__(self, "tangents", tuple(_frozen(t) for t in self.tangents))
        object.__setattr__(self, "parameters", _frozen(self.parameters) if len(self.points) else np.empty(0))
        lengths = {len(self.points), len(self.parameters), len(self.tangents)}
        require(len(lengths) == 1, "branch", sorted(lengths), "as many parameters and tangents as points")

    def __len__(self) -> int:
        return len(self.points)

    @property
    def closed(self) -> bool:
        """Whether the last point is the first one again, or a later one at which the unknowns changed."""
        return self.ended == CLOSED

    def of(self, kind: str) -> tuple[Located, ...]:
        """Return what was located of a kind, such as "fold"."""
        return tuple(event for event in self.located if event.kind == kind)

    def reversed(self) -> Branch:
        """Return the same points in the opposite order."""
        m = len(self)
        turned = [Located(e.kind, m - 2 - e.after, e.point, e.parameter, -e.tangent, e.exact) for e in reversed(self.located)]
        return Branch(
            self.parameter, self.points[::-1], self.parameters[::-1], tuple(-t for t in self.tangents[::-1]), tuple(turned), self.ended, self.message
        )

    def joined(self, backward: Branch) -> Branch:
        """Return one branch from a second one that left the same first point the other way: that one turned round, then this one."""
        before, shift = backward.reversed(), len(backward) - 1
        moved = tuple(Located(e.kind, e.after + shift, e.point, e.parameter, e.tangent, e.exact) for e in self.located)
        ended = self.ended if self.ended == backward.ended else f"{backward.ended}; {self.ended}"
        return Branch(
            self.parameter,
            before.points[:-1] + self.points,
            np.concatenate([before.parameters[:-1], self.parameters]),
            before.tangents[:-1] + self.tangents,
            before.located + moved,
            ended,
            f"at its begin: {backward.message}; at its end: {self.message}",
        )

    def save(self, path: Path | str) -> None:
        """Write the branch as plain data, JSON or compressed arrays by the name's ending; raises ParameterError for another ending."""
        path = Path(path)
        require(path.suffix.lower() in SUFFIXES, "branch file", str(path), f"a name that ends in {' or '.join(SUFFIXES)}")
        with replacing(path) as temporary:
            if path.suffix.lower() == ".json":
                temporary.write_text(json.dumps(self.to_plain(), allow_nan=False) + "\n", encoding="utf-8")
            else:
                _save_arrays(temporary, self)

    def to_plain(self) -> dict[str, Any]:
        """Return lists, numbers and strings."""
        events = [{**vars(e), "point": e.point.tolist(), "tangent": e.tangent.tolist()} for e in self.located]
        lists = {"points": [z.tolist() for z in self.points], "tangents": [t.tolist() for t in self.tangents]}
        words = {"parameter": self.parameter, "ended": self.ended, "message": self.message}
        return {**words, "parameters": self.parameters.tolist(), **lists, "located": events}

    @staticmethod
    def from_plain(plain: dict[str, Any]) -> Branch:
        """Return the branch of `to_plain`; raises ParameterError where a key is missing or has another form."""
        try:
            located = tuple(Located(**event) for event in plain["located"])
            words = (plain["ended"], plain["message"])
            return Branch(plain["parameter"], tuple(plain["points"]), plain["parameters"], tuple(plain["tangents"]), located, *words)
        except (KeyError, TypeError, ValueError) as error:
            raise ParameterError(f"branch = {type(plain).__name__} is not allowed: what Branch.to_plain returns ({error})") from error

    @staticmethod
    def load(path: Path | str) -> Branch:
        """Read what `save` wrote; raises ParameterError for a file that cannot be read or is something else."""
        path = Path(path)
        require(path.suffix.lower() in SUFFIXES, "branch file", str(path), f"a name that ends in {' or '.join(SUFFIXES)}")
        try:
            plain = json.loads(path.read_text(encoding="utf-8")) if path.suffix.lower() == ".json" else _load_arrays(path)
        except (OSError, ValueError, KeyError) as error:
            raise ParameterError(f"branch file = {str(path)!r} is not allowed: a branch that can be read ({error})") from error
        return Branch.from_plain(plain)


def _save_arrays(path: Path, branch: Branch) -> None:
    words = json.dumps({key: value for key, value in branch.to_plain().items() if key not in ("points", "parameters", "tangents")}, allow_nan=False)
    points, tangents = (np.concatenate(rows) if rows else np.empty(0) for rows in (branch.points, branch.tangents))
    lengths = np.array([len(z) for z in branch.points], dtype=np.int64)
    with path.open("wb") as file:
        np.savez_compressed(file, words=np.array(words), parameters=branch.parameters, lengths=lengths, points=points, tangents=tangents)


def _load_arrays(path: Path) -> dict[str, Any]:
    with np.load(path, allow_pickle=False) as data:
        plain: dict[str, Any] = json.loads(str(data["words"]))
        ends = np.cumsum(data["lengths"])[:-1]
        plain["parameters"] = data["parameters"]
        plain["points"] = np.split(data["points"], ends) if len(data["lengths"]) else []
        plain["tangents"] = np.split(data["tangents"], ends + np.arange(1, len(ends) + 1)) if len(data["lengths"]) else []
    return plain
