"""Harmonic balance beside the exact orbit: what scripts/run balance_error computes and prints."""

from __future__ import annotations

from typing import Any

from impact_env.modes import modal_model
from impact_env.parameters import Beam, ParameterError, count, positive, require
from impact_env.periodic.balance_error import BalanceRow, Exact, balance_rows, exact_orbit, settings_of
from impact_env.periodic.case import Case
from optimisation.progress import BAR, Bar


def numbers(option: str, text: str) -> list[float]:
    """Return comma-separated numbers above 0; raises ParameterError that names the option."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise ParameterError(f"{option} = {text!r} is not allowed: numbers with commas between") from error
    return [positive(option, value) for value in values]


def computed(given: dict[str, Any]) -> tuple[Exact, list[BalanceRow], bool]:
    """Do what the options ask for; False: ended by Ctrl-C."""
    harmonics = [count("--harmonics", round(h), 1, 1000) for h in numbers("--harmonics", given["harmonics"])]
    weights, low, high = numbers("--weights", given["weights"]), positive("--from", given["start"]), positive("--to", given["stop"])
    require(low < given["at"] < high, "--at", given["at"], f"between --from = {low} and --to = {high}")
    model = modal_model(Beam(modes=given["modes"]))
    case = Case(model, given["at"] * float(model.omega[0]), given["force"], given["gap"], 1.0, given["friction_limit"])
    exact, rows, complete = exact_orbit(case, low, high), [], True
    settings = settings_of(harmonics, weights, given["growing"])
    try:
        with Bar(total=len(settings), desc="harmonic balance", bar_format=BAR, leave=False) as bar:
            for row in balance_rows(exact, low, high, settings, given["branches"]):
                rows.append(row)
                bar.update()
    except KeyboardInterrupt:
        complete = False
    return exact, rows, complete
