"""One table for all results of periodic motions, in SI units.

It has a row for each orbit, branch, fold, birth and merger of isolas, and curve of bifurcations.
Rows are made from the plain values that JSON files contain, so that both agree.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

ORBIT_COLUMNS = (
    "number",  # of the branch or curve, or of the orbit in a list
    "kind",  # orbit, point of a branch, or what was located: fold, birth, torus, ...
    "method",  # exact orbits, or harmonic balance
    "modes",
    "omega_ratio",
    "omega_rad_s",
    "force_N",
    "mass_ratio",
    "gap_m",
    "restitution",
    "friction_limit_N",
    "damping_ratio",  # of the first mode, where it is the parameter
    "absorber_position",  # share of the beam's length, where it is the parameter
    "period_multiple",
    "symmetric",
    "impacts",
    "tip_max_m",
    "tip_rms_m",
    "stable",
    "slowly_stable",  # whether the slow pair of multipliers dies out
    "largest_multiplier",  # modulus, over half a period of a symmetric orbit
    "multiplier_real",  # of the multiplier on the unit circle at a bifurcation
    "multiplier_imag",
    "coefficient",  # of the normal form at a bifurcation
    "criticality",  # supercritical or subcritical
    "residual",
    "orbit",  # yes, or why it is none
)
EXACT_ORBITS = "exact orbits"
ORBIT = "orbit"
POINT = "point"
CONFIRMED = "yes"
Plain = Mapping[str, Any]
Row = tuple[object, ...]


def make_row(known: Mapping[str, object]) -> Row:
    """Return a row of `ORBIT_COLUMNS`, with empty entries for unknown values."""
    return tuple(known.get(name, "") for name in ORBIT_COLUMNS)


def read_orbit(plain: Plain) -> dict[str, object]:
    """Return the entries of a row for an orbit in its plain form.

    A scene of several absorbers has no common gap.
    """
    absorber = plain["scene"]["absorber"]
    single = absorber.get("kind") != "several"
    multipliers = plain.get("half_multipliers", plain.get("multipliers", []))
    known = {
        name: plain[name]
        for name in (
            "omega_ratio",
            "omega_rad_s",
            "force_N",
            "period_multiple",
            "tip_max_m",
            "tip_rms_m",
            "residual",
        )
    }
    scene = plain["scene"]
    known |= {
        "method": EXACT_ORBITS,
        "modes": scene.get("beam", {}).get("modes") or len(scene["model"]["omega_rad_s"]),
        "symmetric": int(plain["symmetric"]),
        "impacts": len(plain["impacts"]),
        "stable": int(plain["stable"]),
        "largest_multiplier": max((float(np.hypot(*pair)) for pair in multipliers), default=""),
        ORBIT: CONFIRMED,
    }
    if single:
        known |= {
            "mass_ratio": absorber.get("mass_ratio", ""),
            "gap_m": absorber.get("gap", ""),
            "restitution": absorber.get("restitution", ""),
            "friction_limit_N": absorber.get("friction_limit", 0.0),
        }
    return known


def _orbits_of(curve: Plain, points: int) -> list[dict[str, Any] | None]:
    """Return the orbit of each point of a curve's plain form.

    It is None for points without an orbit, as for all points of harmonic balance.
    """
    packed = curve.get("orbits")
    if packed is None:
        return [None] * points
    return [None if one is None else {**packed["common"], **one} for one in packed["points"]]


def _shared(orbits: list[dict[str, Any] | None], key: str) -> dict[str, object]:
    """Return the entries of a row that all orbits of a curve share, except the parameter."""
    first = next((one for one in orbits if one is not None), None)
    if first is None:
        return {}
    known = read_orbit(first)
    fixed: tuple[str, ...] = (
        "modes",
        "force_N",
        "mass_ratio",
        "gap_m",
        "restitution",
        "friction_limit_N",
    )
    if key != "omega_ratio":
        fixed += ("omega_ratio", "omega_rad_s")
    names = (*(name for name in fixed if name != key), "period_multiple", "symmetric")
    return {name: known[name] for name in names if name in known}


def branch_rows(curves: Iterable[Plain], key: str = "omega_ratio") -> Iterator[Row]:
    """Yield a row for each point of branches in their plain forms.

    The special points of each branch follow its points. ``key`` is the column of the branches'
    parameter. Points without a solution are left out.
    """
    for number, curve in enumerate(curves, 1):
        values = curve[key]
        orbits = _orbits_of(curve, len(values))
        shared = {
            **_shared(orbits, key),
            "number": number,
            "method": curve["method"],
            "period_multiple": curve["period"],
            "symmetric": int(curve["symmetric"]),
        }
        for k, (orbit, value) in enumerate(zip(orbits, values, strict=True)):
            if curve["tip_max_m"][k] is None:
                continue
            own: dict[str, object] = {} if orbit is None else read_orbit(orbit)
            own |= {name: curve[name][k] for name in ("tip_max_m", "tip_rms_m")}
            for name in ("stable", "slowly_stable"):
                if curve[name] is not None:
                    own[name] = int(curve[name][k])
            yield make_row({**own, **shared, "kind": POINT, key: value})
        for place in curve["located"]:
            pairs = place.get("multipliers") or [["", ""]]
            mark = {
                "kind": place["kind"],
                key: place[key],
                "tip_max_m": place["tip_max_m"],
                "multiplier_real": pairs[0][0],
                "multiplier_imag": pairs[0][1],
                "coefficient": place.get("coefficient", ""),
                "criticality": place.get("criticality", ""),
                ORBIT: CONFIRMED if curve["method"] == EXACT_ORBITS else "",
            }
            yield make_row({**shared, **mark})


def bifurcation_rows(curves: Iterable[Plain], key: str) -> Iterator[Row]:
    """Yield a row for each point of curves of bifurcations in their plain forms.

    The special points of each curve follow its points. ``key`` is the column of the second
    parameter.
    """
    for number, curve in enumerate(curves, 1):
        orbits = _orbits_of(curve, len(curve["value"]))
        head = {
            "number": number,
            "period_multiple": curve["period"],
            "symmetric": int(curve["symmetric"]),
        }
        shared = {
            name: value
            for name, value in _shared(orbits, key).items()
            if name not in ("omega_ratio", "omega_rad_s")
        }
        names = ("omega_ratio", "value", "multiplier", "coefficient", "criticality", "orbit")
        points = zip(orbits, *(curve[name] for name in names), strict=True)
        for orbit, ratio, value, (real, imaginary), coefficient, criticality, reason in points:
            own: dict[str, object] = {} if orbit is None else read_orbit(orbit)
            own |= {
                "kind": curve["kind"],
                "omega_ratio": ratio,
                key: value,
                "multiplier_real": real,
                "multiplier_imag": imaginary,
                "coefficient": coefficient,
                "criticality": criticality,
                ORBIT: reason,
            }
            yield make_row({**shared, **own, **head})
        for place in curve["located"]:
            mark = {
                "kind": place["kind"],
                "omega_ratio": place["omega_ratio"],
                key: place["value"],
                ORBIT: place["orbit"],
            }
            yield make_row({**shared, **mark, **head})
