"""Does it pay to choose the friction limit during a passage? Constant, by the force, by what is seen, and switched on the way."""

# needs: env, rl

from __future__ import annotations

from pathlib import Path

import click

from optimisation.files import require_writable, write_json
from optimisation.rl.friction_plans import compared, table


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.option("--machines", type=click.IntRange(min=2), default=96, show_default=True, help="Machines to choose on; eight times as many are judged.")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=Path("results/friction_choice"), show_default=True)
def main(machines: int, out: Path) -> None:
    """Find the best of each sort of plan for forces from 0.5 to 6 N, and judge it on other forces and phases; writes OUT/friction_choice.json."""
    require_writable("--out", out)
    results = compared(machines)
    write_json(out / "friction_choice.json", results)
    click.echo(table(results))


if __name__ == "__main__":
    main(prog_name="scripts/run friction_choice")
