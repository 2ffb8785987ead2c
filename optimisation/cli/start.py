"""Start of the commands: Ctrl-C during imports ends with one line.

Ctrl-C has the same effect later.
"""

import atexit
import os
import sys
from threading import Thread

INTERRUPTED = 130  # the shell's exit code after Ctrl-C
PATIENCE = 0.3  # s for what is to be done at the end of a process that leaves a compilation behind


def main(name: str = "impact-absorber") -> None:
    """Run `optimisation.cli.group.main` under a name; nothing of weight is imported before this."""
    try:
        from optimisation.cli.group import main as command

        command(prog_name=name)
    except KeyboardInterrupt:
        print("Broken off.", file=sys.stderr)
        leave(INTERRUPTED)
    except SystemExit as end:
        if end.code == INTERRUPTED:
            leave(INTERRUPTED)
        raise


def leave(code: int) -> None:
    """End the process with an exit code.

    While a kernel is being compiled, the process ends at once, because the compilation holds LLVM's
    locks and ignores signals.
    """
    parts = sys.modules.get("impact_env.kernels.compiling.parts")
    if parts is not None and parts.is_compiling():
        ending = Thread(target=atexit._run_exitfuncs, daemon=True)
        ending.start()
        ending.join(PATIENCE)
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(code)
    sys.exit(code)
