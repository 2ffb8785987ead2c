"""Where commands begin: Ctrl-C while packages are still being imported ends with one line, as it does later."""

import sys

INTERRUPTED = 130  # the shell's exit code after Ctrl-C


def main(name: str = "impact-absorber") -> None:
    """Run `optimisation.cli.group.main` under a name; nothing of weight is imported before this."""
    try:
        from optimisation.cli.group import main as command

        command(prog_name=name)
    except KeyboardInterrupt:
        print("Broken off.", file=sys.stderr)
        sys.exit(INTERRUPTED)
