"""start.py SCRIPT [options]: runs a script; Ctrl-C while it is still importing ends with one line, as it does later."""

import runpy
import sys
from pathlib import Path

INTERRUPTED = 130  # the shell's exit code after Ctrl-C

if __name__ == "__main__":
    try:
        sys.argv = sys.argv[1:]
        sys.path[0] = str(Path(sys.argv[0]).parent)
        runpy.run_path(sys.argv[0], run_name="__main__")
    except KeyboardInterrupt:
        print("Broken off.", file=sys.stderr)
        sys.exit(INTERRUPTED)
