"""Make or complete the environment in .venv.

Only one call runs at a time. After a call that was interrupted, the next one starts from an empty
folder.

Arguments are layers: "main", "test", "env", "rl", ... are files in requirements/; "kernels"
compiles the kernels into their cache. Only the standard library is used, as this runs before
anything is installed.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

ROOT = Path(__file__).resolve().parents[2]
PYTHON = (
    "Scripts/python.exe" if sys.platform == "win32" else "bin/python"
)  # in a virtual environment


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def stamp_text(root: Path, layer: str) -> bytes:
    """Return a layer's stamp, the bytes that it is made from; environment.sh compares the same."""
    layers = ["main"] if layer == "main" else ["main", layer]
    files = [root / "pyproject.toml", *(root / "requirements" / f"{name}.txt" for name in layers)]
    return os.fsencode(root.as_posix()) + b"\n" + b"".join(file.read_bytes() for file in files)


def hold(file: int) -> bool:
    """Lock a file for this process, and return whether no other process holds the lock.

    The operating system releases the lock when the process ends, however it ends.
    """
    try:
        if sys.platform == "win32":
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


@contextmanager
def lock(root: Path) -> Iterator[None]:
    """Hold the checkout's lock."""
    with (root / ".venv.lock").open("w") as handle:
        if not hold(handle.fileno()):
            say("Another call is setting up the environment; waiting for it ...")
            while not hold(handle.fileno()):
                time.sleep(0.2)
        yield


class SetUp:
    """One checkout's environment."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.folder = root / ".venv"
        self.python = self.folder / PYTHON
        self.stamps = self.folder / "stamps"
        self.incomplete = self.folder / "incomplete"

    def usable(self) -> bool:
        """Return whether the existing folder can be completed instead of made again.

        It can if no installation was interrupted, the folder has not been moved, and its Python
        still exists.
        """
        main = self.stamps / "main"
        moved = main.exists() and not main.read_bytes().startswith(
            os.fsencode(self.root.as_posix()) + b"\n"
        )
        return os.access(self.python, os.X_OK) and not self.incomplete.exists() and not moved

    def is_current(self, layer: str) -> bool:
        stamp = self.stamps / layer
        return stamp.exists() and stamp.read_bytes() == stamp_text(self.root, layer)

    def pip(self, *arguments: str) -> None:
        command = [
            str(self.python),
            "-m",
            "pip",
            "install",
            "-qq",
            "--no-input",
            "--no-compile",
            "--disable-pip-version-check",
            *arguments,
        ]
        subprocess.run(command, check=True, cwd=self.root, stdin=subprocess.DEVNULL)

    def install(self, layers: list[str]) -> None:
        """Install all layers in one call of pip.

        Two layers that require different versions of a package are thus an error.
        """
        requirements = self.root / "requirements"
        self.pip(
            "-c",
            str(requirements / "main.txt"),
            *(word for layer in layers for word in ("-r", str(requirements / f"{layer}.txt"))),
        )

    def make(self, layers: list[str]) -> None:
        """Install what is not current; a folder that was left half-made is made again."""
        if not self.usable():
            shutil.rmtree(self.folder, ignore_errors=True)
        due = [layer for layer in dict.fromkeys(["main", *layers]) if not self.is_current(layer)]
        if not due:
            return
        fresh = not self.folder.exists()
        self.folder.mkdir(exist_ok=True)
        self.incomplete.touch()
        if "main" in due:
            say("Setting up .venv (once, half a minute to two minutes) ...")
            if fresh:
                subprocess.run([sys.executable, "-m", "venv", str(self.folder)], check=True)
            self.install(["main"])
            self.pip("--no-deps", "--no-build-isolation", "--editable", str(self.root))
        if added := [layer for layer in due if layer != "main"]:
            time_needed = (
                "several minutes, as torch is large" if "rl" in added else "up to a minute"
            )
            say(f"Adding to .venv: {', '.join(added)} (once, {time_needed}) ...")
            self.install(added)
        # as pip would, on all cores; a file that is no Python of today is left
        subprocess.run(
            [str(self.python), "-m", "compileall", "-qq", "-j", "0", str(self.folder)],
            stdin=subprocess.DEVNULL,
        )
        self.stamps.mkdir(exist_ok=True)
        for layer in due:
            (self.stamps / layer).write_bytes(stamp_text(self.root, layer))
        self.incomplete.unlink()

    def warm_kernels(self) -> None:
        """Compile the kernels into their cache.

        A failure is printed, not raised: the kernels are then compiled on first use.
        """
        if not (self.root / "impact_env" / "warm_up.py").exists():
            return
        stamp = Path(os.environ.get("IMPACT_ENV_CACHE") or self.folder / "kernel-cache") / "warm"
        started = time.time()
        package = self.root / "impact_env"
        files = [
            package / "warm_up.py",
            self.root / "requirements" / "main.txt",
            *(package / "kernels").rglob("*.py"),
        ]
        if stamp.exists() and all(file.stat().st_mtime <= stamp.stat().st_mtime for file in files):
            return
        say(
            "Compiling the kernels (once for each version of the sources, some 20 s on two "
            "cores) ..."
        )
        stamp.parent.mkdir(parents=True, exist_ok=True)
        command = [str(self.python), "-m", "impact_env.warm_up"]
        if subprocess.run(command, cwd=self.root, stdin=subprocess.DEVNULL).returncode:
            say(
                "warning: the kernels could not be compiled in advance; they are compiled "
                "when they are first used"
            )
            return
        stamp.touch()
        os.utime(stamp, (started, started))


def main(layers: list[str]) -> int:
    set_up = SetUp(ROOT)
    try:
        with lock(ROOT), ThreadPoolExecutor(1) as background:
            set_up.make([])
            kernels = (
                background.submit(set_up.warm_kernels) if "kernels" in layers else None
            )  # which need no other package
            set_up.make([layer for layer in layers if layer != "kernels"])
            if kernels:
                kernels.result()
    except KeyboardInterrupt:
        say("\nSet-up was broken off; the next call does it again.")
        return 130
    except (subprocess.CalledProcessError, OSError) as error:
        say(f"error: the set-up failed, and the next call does it again: {error}")
        if isinstance(error, subprocess.CalledProcessError) and "venv" in error.cmd:
            say(
                "On Debian and Ubuntu the module venv is a package of its own: apt install "
                "python3-venv"
            )
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
