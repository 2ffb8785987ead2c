"""The cache of compiled kernels.

It is numba's cache, but requires neither a writable folder nor undamaged files.

numba's cache does not detect an edit in an imported module, so the folder's name is a hash of the
package's sources. Nor does it detect a damaged file, whose content it would run.

Within that folder paths are relative to the package, so that compiled kernels can be copied to
another installation. A wheel for Linux contains some, compiled for any processor of the last ten
years or so: they are looked up last, and only read.
"""

from __future__ import annotations

import atexit
import hashlib
import io
import logging
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    UserProvidedCacheLocator,
)

PACKAGE = Path(__file__).resolve().parents[1]
LOG = logging.getLogger("impact_env")
LOCK_TIMEOUT_S = 60.0  # s to wait for another process that writes into the same folder
# folder of the kernels that came with the package; it does not exist in a checkout
SHIPPED = PACKAGE / "shipped"
# NUMBA_CPU_NAME and NUMBA_CPU_FEATURES with which the kernels of the package are compiled, and the
# processor features that the name stands for
SHIPPED_CPU = (
    "x86-64-v3",
    "",
)
SHIPPED_CPU_FEATURES = {
    "avx",
    "avx2",
    "bmi",
    "bmi2",
    "cx16",
    "f16c",
    "fma",
    "lzcnt",
    "movbe",
    "popcnt",
    "sahf",
    "sse3",
    "sse4.1",
    "sse4.2",
    "ssse3",
    "xsave",
}
# environment variable; with the value "host", kernels that came with the package are not used
HOST_VARIABLE = "IMPACT_ENV_KERNELS"


def hash_sources(package: Path = PACKAGE) -> str:
    """Return the 16 hexadecimal digits that name the folder of compiled kernels.

    They are from a hash of all sources below ``package``, of the compiler's versions and of whether
    the compiler checks bounds.
    """
    known = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        known.update(source.relative_to(package).as_posix().encode() + source.read_bytes())
    for module in (numba, llvmlite):
        known.update(module.__version__.encode())
    if numba.config.BOUNDSCHECK:
        known.update(b"BOUNDSCHECK")
    return known.hexdigest()[:16]


_hash_of_process = cache(hash_sources)  # of the sources that this process runs


@cache
def find_shipping_obstacle() -> str:
    """Return why kernels that came with the package are not used; an empty string if they are."""
    here = f"*.py{sys.version_info[0]}{sys.version_info[1]}*.nbi"
    if not SHIPPED.is_dir():
        return "none came with this package"
    if not any((SHIPPED / _hash_of_process()).rglob(here)):
        return (
            "those that came with this package are of other sources, or of another version of "
            "numba or Python"
        )
    if os.environ.get(HOST_VARIABLE) == "host" or (
        numba.config.CPU_NAME,
        numba.config.CPU_FEATURES,
    ) != (
        None,
        None,
    ):
        return f"{HOST_VARIABLE}, NUMBA_CPU_NAME or NUMBA_CPU_FEATURES asks for others"
    missing = SHIPPED_CPU_FEATURES - {
        name for name, present in llvmlite.binding.get_host_cpu_features().items() if present
    }
    return f"this processor lacks {', '.join(sorted(missing))}" if missing else ""


@dataclass(frozen=True)
class Folders:
    """The folders of compiled kernels."""

    write: Path | None  # new kernels are written here, and read; None: no folder is writable
    read: (
        Path | None
    )  # another folder, only read, such as in a container image; None: there is none


def choose_folders(parent: Path | None, name: str) -> Folders:
    """Return the `Folders` called ``name``, below ``parent`` or the user's temporary folder.

    The folder to write to is below the temporary folder if ``parent`` is None or not writable. A
    folder below ``parent`` that has kernels but is not writable becomes ``read``.
    """
    wanted = None if parent is None else parent / name
    if wanted is not None and _writable(wanted):
        return Folders(wanted, None)
    read = wanted if wanted is not None and _holds_kernels(wanted) else None
    private = _private_folder()
    write = None if private is None else private / name
    return Folders(write if write is not None and _writable(write) else None, read)


@cache
def find_folders() -> Folders:
    """Return the `Folders` of compiled kernels of this process.

    They lie below the folder that the variable ``IMPACT_ENV_CACHE`` names, else below the virtual
    environment of this process, else below the user's cache. Both are None if nothing is compiled
    (``NUMBA_DISABLE_JIT=1``). A warning is logged if no folder is writable.
    """
    if numba.config.DISABLE_JIT:
        return Folders(None, None)
    named = os.environ.get("IMPACT_ENV_CACHE")
    parent = None
    with suppress(RuntimeError):  # a user without a home
        if named:
            parent = Path(named)
        elif sys.prefix != sys.base_prefix:
            parent = Path(sys.prefix) / "kernel-cache"
        else:
            parent = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "impact_env"
    folders = choose_folders(parent, _hash_of_process())
    if folders.write is None:
        LOG.warning(
            "no folder can be written to (IMPACT_ENV_CACHE names one): kernels that are "
            "compiled now are compiled again in the next process"
        )
    return folders


def cache_folder() -> Path | None:
    """Return the folder to which new kernels of these sources are written, or None.

    None: no folder is writable, or nothing is compiled (``NUMBA_DISABLE_JIT=1``).
    """
    return find_folders().write


def _writable(folder: Path) -> bool:
    """Return whether a folder can be written to; make it if it does not exist.

    A file is written to find out, because permissions are not always what a system enforces.
    """
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
    """Return a temporary folder that only this user can write to, None if none can be made.

    Others must not write to it, because code that is read from it is run. If another user owns the
    usual name, the folder is for this process alone and removed at its exit.
    """
    try:
        parent = Path(tempfile.gettempdir())
        user = os.getuid() if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
        folder = parent / f"impact_env-{user}"
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        if _is_private(folder):
            return folder
        own = tempfile.mkdtemp(
            prefix="impact_env-", dir=parent
        )  # someone else was first: a folder for this process alone
    except OSError:
        return None
    atexit.register(shutil.rmtree, own, ignore_errors=True)
    return Path(own)


def _is_private(folder: Path) -> bool:
    state = folder.lstat()
    if not stat.S_ISDIR(state.st_mode):
        return False
    # elsewhere than on POSIX systems the temporary folder is the user's own
    return not hasattr(os, "getuid") or (state.st_uid == os.getuid() and not state.st_mode & 0o022)


class _Locator(UserProvidedCacheLocator):
    """The location of a function's compiled code in the folder to write to.

    numba's own locator would refuse the function if no folder is writable.
    """

    def __init__(self, py_func: Any, py_file: str) -> None:
        super().__init__(py_func, py_file)
        self._cache_path = _cache_path(find_folders().write, py_file)

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Locator:
        return cls(py_func, py_file)

    def get_source_stamp(self) -> object:
        """Return the stamp of a function's source.

        It is the name of the folder, or numba's own stamp for a function outside of the package.
        """
        return (
            _hash_of_process()
            if PACKAGE in Path(self._py_file).resolve().parents
            else super().get_source_stamp()
        )


def _cache_path(folder: Path | None, file: str) -> str:
    if folder is None:
        return os.devnull
    path = Path(file).resolve()
    if PACKAGE not in path.parents:
        return str(folder / UserProvidedCacheLocator.get_suitable_cache_subpath(file))
    return str(folder / "_".join(path.parent.relative_to(PACKAGE.parent).parts))


class _CacheImpl(CompileResultCacheImpl):
    _locator_classes = [_Locator]  # noqa: RUF012 - numba's own is such a list


class _ChecksummedFile(IndexDataCacheFile):
    """numba's index and data files, each followed by a digest of its content.

    numba does not read the digest. A file without a correct digest is treated as absent.

    Each data file contains its kernel's key too, and is ignored for another key: after an index was
    lost, a new index may give a kernel the file number of another kernel's data.
    """

    def save(self, key: Any, data: Any) -> None:
        super().save(key, (key, data))

    def load(self, key: Any) -> Any:
        entry = super().load(key)
        return entry[1] if entry is not None and entry[0] == key else None

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        content = io.BytesIO()
        yield content
        with super()._open_for_write(filepath) as file:
            file.write(content.getvalue() + hashlib.sha256(content.getvalue()).digest())

    def _load_index(self) -> Any:
        return super()._load_index() if _is_undamaged(self._index_path) else {}

    def _load_data(self, name: str) -> Any:
        return super()._load_data(name) if _is_undamaged(self._data_path(name)) else None


def _is_undamaged(path: str) -> bool:
    """Return whether a file ends with the digest of its content; True if there is no file.

    A warning is logged if it does not.
    """
    try:
        content = Path(path).read_bytes()
    except FileNotFoundError:
        return True
    if hashlib.sha256(content[:-32]).digest() == content[-32:]:
        return True
    _warn_once(f"damaged kernels in {Path(path).parents[1]} are compiled anew")
    return False


class KernelCache(FunctionCache):
    """numba's cache of a function, with additional folders that are only read.

    It raises no error if no undamaged file can be read or nothing can be written: then the function
    is compiled, and compiled again in the next process.
    """

    _impl_class = _CacheImpl

    def __init__(self, py_func: Any) -> None:
        super().__init__(py_func)
        identity = self._impl.filename_base, self._impl.locator.get_source_stamp()
        self._cache_file = _ChecksummedFile(self._cache_path, *identity)
        self._read_only, self._shipped = (
            _ChecksummedFile(_cache_path(folder, py_func.__code__.co_filename), *identity)
            for folder in (find_folders().read, SHIPPED / _hash_of_process())
        )

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        types, (system, *processor), *code = self._index_key(sig, target_context.codegen())
        for file, wanted in (
            (self._cache_file, processor),
            (self._read_only, processor),
            (self._shipped, SHIPPED_CPU),
        ):
            if file is self._shipped and find_shipping_obstacle():
                break
            data = None
            with suppress(OSError):
                data = file.load((types, (system, *wanted), *code))
            if data is not None:
                return self._impl.rebuild(target_context, data)
        return None

    def _save_overload(self, sig: Any, data: Any) -> None:
        folder = find_folders().write
        if folder is None:
            return
        from filelock import FileLock  # only a process that compiles needs it

        try:
            # an index is read, changed and written: without a lock two processes would lose each
            # other's entries
            with FileLock(folder / "lock", timeout=LOCK_TIMEOUT_S):
                super()._save_overload(sig, data)
        # a full disk, or a lock that another process never releases, must not stop a simulation
        except OSError as error:
            _warn_once(f"compiled kernels cannot be kept: {error}")


@cache
def _warn_once(what: str) -> None:
    LOG.warning(what)


def attach_cache(kernel: Any) -> Any:
    """Attach a `KernelCache` to a function that numba compiles, and return the same function."""
    kernel._cache = KernelCache(kernel.py_func)
    return kernel
