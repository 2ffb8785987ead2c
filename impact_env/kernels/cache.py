"""Where compiled kernels are kept, and numba's cache without its demand for a folder that can be written to.

numba's cache does not notice an edit in an imported module, so the folder carries a hash of the package's sources.
"""

from __future__ import annotations

import atexit
import hashlib
import logging
import os
import shutil
import stat
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, UserProvidedCacheLocator

PACKAGE = Path(__file__).resolve().parent
LOG = logging.getLogger("impact_env")
PATIENCE = 60.0  # s to wait for another process that writes into the same folder


def digest(package: Path = PACKAGE) -> str:
    """Return the hash of all sources below ``package`` and of the compiler's versions: the name of the folder."""
    known = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        known.update(source.relative_to(package).as_posix().encode() + source.read_bytes())
    for module in (numba, llvmlite):
        known.update(module.__version__.encode())
    return known.hexdigest()[:16]


@dataclass(frozen=True)
class Folders:
    """``write``: where new kernels are kept, None where nothing can be written; ``read``: one that is only read, as an image's, or None."""

    write: Path | None
    read: Path | None


def choose(parent: Path | None, name: str) -> Folders:
    """Return the folders ``name`` in ``parent`` (None: there is none) or, if that cannot be written to, in the user's temporary folder."""
    wanted = None if parent is None else parent / name
    if wanted is not None and _writable(wanted):
        return Folders(wanted, None)
    read = wanted if wanted is not None and _holds_kernels(wanted) else None
    private = _private_folder()
    write = None if private is None else private / name
    return Folders(write if write is not None and _writable(write) else None, read)


@cache
def folders() -> Folders:
    """Return the folders of this process; ``IMPACT_ENV_CACHE`` names another parent folder than the user's cache."""
    named = os.environ.get("IMPACT_ENV_CACHE")
    try:
        parent = Path(named) if named else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "impact_env"
    except RuntimeError:  # a user without a home
        parent = None
    found = choose(parent, digest())
    if found.write is None:
        LOG.warning("no folder can be written to (IMPACT_ENV_CACHE names one): kernels that are compiled now are compiled again in the next process")
    return found


def cache_folder() -> Path | None:
    """Return the folder in which new kernels of these sources are kept, or None where nothing can be written."""
    return folders().write


def _writable(folder: Path) -> bool:
    """Make a folder and try to write into it: what a system allows is not always what its permissions say."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _holds_kernels(folder: Path) -> bool:
    try:
        return any(folder.glob("*/*.nbi"))
    except OSError:
        return False


def _private_folder() -> Path | None:
    """Return a temporary folder that only this user can write to: what is read from it is run."""
    try:
        parent = Path(tempfile.gettempdir())
        folder = parent / f"impact_env-{os.getuid() if hasattr(os, 'getuid') else os.environ.get('USERNAME', 'user')}"
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        if _is_ours(folder):
            return folder
        own = tempfile.mkdtemp(prefix="impact_env-", dir=parent)  # someone else was first: a folder for this process alone
    except OSError:
        return None
    atexit.register(shutil.rmtree, own, ignore_errors=True)
    return Path(own)


def _is_ours(folder: Path) -> bool:
    state = folder.lstat()
    if not stat.S_ISDIR(state.st_mode):
        return False
    # elsewhere than on POSIX systems the temporary folder is the user's own
    return not hasattr(os, "getuid") or (state.st_uid == os.getuid() and not state.st_mode & 0o022)


class _Locator(UserProvidedCacheLocator):
    """Place of a function's kernels in the folder to write to; numba's own would refuse the function if there is none."""

    def __init__(self, py_func: Any, py_file: str) -> None:
        super().__init__(py_func, py_file)
        self._cache_path = _place(folders().write, py_file)

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Locator:
        return cls(py_func, py_file)


def _place(folder: Path | None, file: str) -> str:
    return os.devnull if folder is None else str(folder / UserProvidedCacheLocator.get_suitable_cache_subpath(file))


class _Place(CompileResultCacheImpl):
    _locator_classes = [_Locator]  # noqa: RUF012 - numba's own is such a list


class KernelCache(FunctionCache):
    """numba's cache of a function, with a second folder that is only read, and without errors where nothing can be read or written."""

    _impl_class = _Place

    def __init__(self, py_func: Any) -> None:
        super().__init__(py_func)
        read = folders().read
        self._read_only = None
        if read is not None:
            locator = self._impl.locator
            place = _place(read, py_func.__code__.co_filename)
            self._read_only = IndexDataCacheFile(place, self._impl.filename_base, locator.get_source_stamp())

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        for file in (self._cache_file, self._read_only):
            data = None
            with suppress(OSError):
                data = None if file is None else file.load(self._index_key(sig, target_context.codegen()))
            if data is not None:
                return self._impl.rebuild(target_context, data)
        return None

    def _save_overload(self, sig: Any, data: Any) -> None:
        folder = folders().write
        if folder is None:
            return
        from filelock import FileLock  # only a process that compiles needs it

        try:
            # an index is read, changed and written: without a lock two processes would lose each other's entries
            with FileLock(folder / "lock", timeout=PATIENCE):
                super()._save_overload(sig, data)
        except OSError as error:  # a full disk, or a lock that another process never gives back, must not stop a simulation
            _say_once(str(error))


@cache
def _say_once(why: str) -> None:
    LOG.warning("compiled kernels cannot be kept: %s", why)


def keep(kernel: Any) -> Any:
    """Give a function that numba compiles this cache, and return it."""
    kernel._cache = KernelCache(kernel.py_func)
    return kernel
