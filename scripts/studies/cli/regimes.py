"""Regimes of a response: how long impacts last at each frequency, P(jump) of a sweep from that, and where it is periodic, where chaotic."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from impact_env.ensemble import Executor
from impact_env.parameters import positive, require
from impact_env.periodic.residence import Range
from optimisation.cli.common import BadInput, command, plain_errors
from optimisation.cli.scene_options import make_scene, refuse_parts, structure_option
from optimisation.executors import cluster_option, workers
from studies.regimes.measured import Case, Settings, cases, grid
from studies.regimes.study import JUMP, KINDS, OUT, QUICK_OUT, STUDY, place
from studies.runner import run

OWN = ("scene", "structure", "modes", "damping", "mass_ratio", "gap", "restitution", "friction_limit", "force")
NOT_ASKED = ("absorber", "contact_stiffness", "friction_stiffness", "stiffness", "absorber_damping")
QUICK = {"stay_members": 10, "stay_periods": 1000.0, "sweep_members": 10, "kind_members": 4, "settle": 200.0, "window": 60, "quick": True}
FAST = 300.0  # pseudo periods per percent: slower sweeps are left out of a quick look


def is_own(given: dict[str, Any]) -> bool:
    """Return whether options describe a scene of one's own."""
    return any(given[name] is not None for name in OWN)


def own_case(given: dict[str, Any]) -> Case:
    """Return the case that the options describe. Raises BadInput or ParameterError."""
    given = given | dict.fromkeys(NOT_ASKED) | {"resonance": 1}  # the one that is looked at
    refuse_parts(given)
    scene, _ = make_scene(given)
    if given["force"] is None:  # only a structure has a force that follows from the rule
        raise BadInput("a scene of your own needs --force")
    first, last = positive("--from", given["start"]), positive("--to", given["stop"])
    require(first != last, "--to", last, f"different from --from = {first}")
    ratios, step = grid(first, last, given["points"]), 0.05 * (1 if last > first else -1)
    sweep = Range(first - step / 50, first, last, last + step) if given["slowness"] else None
    return Case("own", str(scene), scene, given["force"], given["approach"] or first, ratios, given["slowness"], sweep, tuple(sorted(ratios)))


def chosen_settings(given: dict[str, Any], executor: Executor | None = None) -> Settings:
    """Return the settings of a run, by an executor as in `run_lanes`. Raises BadInput or ParameterError."""
    own = is_own(given)
    picked = (own_case(given),) if own else cases()
    counts = {} if given["members"] is None else dict.fromkeys(("stay_members", "sweep_members", "kind_members"), given["members"])
    times = {} if given["silence"] is None else {"silence": given["silence"]}
    if given["quick"] and not own:
        picked = tuple(_thinned(case) for case in picked)
    chosen = {**(QUICK if given["quick"] else {}), **counts, **times}
    return Settings(picked, **chosen, seed=given["seed"], threads=given["threads"], executor=executor)


def _thinned(case: Case) -> Case:
    fast = tuple(slowness for slowness in case.slownesses if slowness <= FAST)
    return replace(case, stay_ratios=case.stay_ratios[::9], kind_ratios=case.kind_ratios[::20], slownesses=fast[::2])


@command()
@click.option("--scene", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Structure and absorber from a .toml or .json file.")
@structure_option
@click.option("--modes", type=int, help="Number of modes of the paper's beam.")
@click.option("--damping", type=float, help="Modal damping ratio.")
@click.option("--mass-ratio", type=float, help="Absorber mass over beam mass.")
@click.option("--gap", type=float, help="Clearance to either wall in m.")
@click.option("--restitution", type=float, help="Coefficient of restitution.")
@click.option("--friction-limit", type=float, help="Friction limit in N; 0: no friction.")
@click.option("--force", type=float, help="Amplitude of the harmonic force in N.  [default: with --structure by the design rule]")
@click.option("--from", "start", type=float, default=0.99, show_default=True, help="Your scene: first frequency over the first resonance.")
@click.option("--to", "stop", type=float, default=0.95, show_default=True, help="Your scene: last frequency; sweeps go this way too.")
@click.option("--points", type=int, default=21, show_default=True, help="Your scene: number of frequencies.")
@click.option("--slowness", type=float, multiple=True, help="Your scene: pseudo periods per 1 % of a sweep; may be repeated.  [default: no sweeps]")
@click.option("--approach", type=float, help="Your scene: ratio at which runs come into impact.  [default: that of --from]")
@click.option("--silence", type=float, help="Pseudo periods without impact that end a stay.  [default: 100]")
@click.option("--members", type=click.IntRange(min=1), help="Runs at each frequency and slowness.  [default: 200; 40 to be classified]")
@click.option("--only", type=click.Choice([JUMP, KINDS]), multiple=True, help="Do this part only.")
@click.option("--quick", is_flag=True, help=f"A look: few frequencies and runs, into {QUICK_OUT} unless told otherwise.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the force's phases.")
@click.option("--threads", type=click.IntRange(min=1), help="Number of threads; the numbers do not depend on it.  [default: all cores]")
@cluster_option
@click.option("--redraw", is_flag=True, help="Draw figures and tables again from the numbers in --out; nothing is computed.")
@click.option("--resume", is_flag=True, help="Go on from the files in --out where a run was stopped.")
@click.option("--out", type=click.Path(path_type=Path), help=f"Folder.  [default: {OUT}; {QUICK_OUT} with --quick or a scene of your own]")
def main(**given: Any) -> None:
    """Measure how long the regime of impacts lasts, predict the jump of sweeps from that, and classify stationary responses.

    Without options of a scene the cases of docs/regimes.md are computed and the page's tables and figures are written. With a scene of your own,
    jump.json.gz and kinds.json.gz, CSV files and figures go to --out. Ctrl-C keeps what is finished.
    """
    small = is_own(given) or given["quick"]
    with plain_errors(), workers(given["threads"], None if given["redraw"] else given["cluster"]) as executor:
        where = place(given["out"] or (QUICK_OUT if small else OUT), small)
        run(STUDY, chosen_settings(given, executor), where, only=given["only"], redraw=given["redraw"], resume=given["resume"])
