"""Where the console command ``impact-absorber`` begins: Ctrl-C while packages are still being imported ends with one line, as it does later."""

from __future__ import annotations

import sys

INTERRUPTED = 130  # the shell's exit code after Ctrl-C


def main() -> None:
    """Run `optimisation.command.main`; nothing of weight is imported before this."""
    try:
        from optimisation.command import main as command

        command()
    except KeyboardInterrupt:
        print("Broken off.", file=sys.stderr)
        sys.exit(INTERRUPTED)
