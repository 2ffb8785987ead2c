"""Results of finished pieces of long work in one file, keyed by what they depend on, from which a stopped or killed run goes on."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from impact_env.kernels.compiling.cache import digest
from impact_env.parameters import ParameterError
from impact_env.periodic.keeping import P
from optimisation.files import write_json

Json = dict[str, Any]
FORM = "pieces 1"


class Pieces:
    """Pieces that are kept in ``path`` (None: nowhere) for the work that ``basis`` describes; other work may have its pieces in the same file.

    A piece is known again by basis, name and the kernels' sources. Each is written as soon as it is finished, and the file is always whole. Raises
    ParameterError for a file that is something else.
    """

    def __init__(self, path: Path | None, basis: Json, option: str = "--resume") -> None:
        self._path = path
        self._basis = basis | {"kernels": digest()}
        self._known: dict[str, list[Json]] = {}
        self._refusal = f"{option} = {path} is not allowed: a file that this option has written before, or none yet"
        if path is not None and path.exists():
            self._known = self._read(path)

    def _read(self, path: Path) -> dict[str, list[Json]]:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            if content["form"] != FORM:
                raise ValueError(f"form {content['form']}")
            return {str(piece["name"]): list(piece["values"]) for piece in content["pieces"]}
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ParameterError(f"{self._refusal} ({error})") from error

    def __call__(self, name: Json, make: Callable[[], Iterator[P]], read: Callable[[Json], P], /) -> Iterator[P]:
        """Yield the pieces of ``make``, from the file by ``read`` if they were finished before for the same basis and ``name``."""
        key = json.dumps(self._basis | name, sort_keys=True)
        if key in self._known:
            try:
                pieces = [read(value) for value in self._known[key]]
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                raise ParameterError(f"{self._refusal} ({error})") from error
            yield from pieces
            return
        done: list[Json] = []
        for piece in make():
            done.append(piece.to_plain())
            yield piece
        if self._path is not None:
            self._known[key] = done
            write_json(self._path, {"form": FORM, "pieces": [{"name": k, "values": values} for k, values in self._known.items()]})
