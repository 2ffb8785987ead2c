"""Versions, extras, processor, threads and kernels."""

import importlib.util
import platform
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numba

import impact_env
from impact_env.ensemble import available_cores
from impact_env.extras import DISTRIBUTION, EXTRAS, how_to_install
from impact_env.kernels.compiling.cache import SHIPPED, find_shipping_obstacle
from optimisation.checkpoint import processor, versions
from optimisation.cli.cache import list_kernel_folders, parent_folders
from optimisation.cli.common import check_targets, command, plain_errors
from optimisation.cli.options import option
from optimisation.files import write_files

PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "matplotlib", "gymnasium", "torch")


def extras() -> dict[str, list[str]]:
    """Return the packages that each extra lacks here."""
    names = sorted(set(EXTRAS.values()))
    return {
        extra: [
            name
            for name, brings in EXTRAS.items()
            if brings == extra and importlib.util.find_spec(name) is None
        ]
        for extra in names
    }


def describe_installation() -> dict[str, Any]:
    """Return the description as plain data; sizes in bytes."""
    places = parent_folders()
    return {
        "package": {
            "name": DISTRIBUTION,
            "version": impact_env.__version__,
            "folder": str(Path(impact_env.__file__).parent),
        },
        "python": {"version": platform.python_version(), "program": sys.executable},
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "processor": processor(),
        "cores": available_cores(),
        "numba_threads": numba.get_num_threads(),
        "compiles": not vars(numba.config)["DISABLE_JIT"],
        "versions": versions(PACKAGES),
        "extras": extras(),
        "cache": [
            {
                "folder": str(place),
                "written": k == 0,
                "kept": [
                    {
                        "name": one.folder.name,
                        "kernels": one.kernels,
                        "size": one.size,
                        "current": one.current,
                    }
                    for one in list_kernel_folders(place)
                ],
            }
            for k, place in enumerate(places)
        ],
        "shipped": {
            "kernels": sum(1 for _ in SHIPPED.rglob("*.nbc")),
            "unused_because": find_shipping_obstacle(),
        },
    }


def lines(about: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the same as a name and a text for each line."""
    missing = {extra: packages for extra, packages in about["extras"].items() if packages}
    rows = [
        (
            about["package"]["name"],
            f"{about['package']['version']} in {about['package']['folder']}",
        ),
        ("Python", f"{about['python']['version']}, {about['python']['program']}"),
        ("system", about["system"]),
        ("processor", about["processor"]),
        (
            "threads",
            f"{about['cores']} cores may be used, numba takes up to {about['numba_threads']}",
        ),
        *about["versions"].items(),
        ("extras", ", ".join(extra for extra in about["extras"] if extra not in missing) or "none"),
        *(
            (f"no {extra}", f"lacks {', '.join(packages)}; it comes with: {how_to_install(extra)}")
            for extra, packages in missing.items()
        ),
    ]
    if not about["compiles"]:
        rows.append(
            ("compiled", "nothing: NUMBA_DISABLE_JIT is set, and kernels run in plain Python")
        )
    elif not about["cache"]:
        rows.append(
            (
                "compiled",
                (
                    "kept nowhere: no folder can be written to, and each process compiles anew; "
                    "IMPACT_ENV_CACHE names one"
                ),
            )
        )
    for place in about["cache"]:
        current = [one for one in place["kept"] if one["current"]]
        others = sum(one["size"] for one in place["kept"] if not one["current"])
        count = sum(one["kernels"] for one in current)
        size = sum(one["size"] for one in current)
        text = (
            f"{place['folder']}{'' if place['written'] else ' (only read)'}: {count} kernels of "
            f"today's sources, {size / 1e6:.1f} MB"
        )
        rows.append(
            ("compiled", text + (f", and {others / 1e6:.1f} MB of others" if others else ""))
        )
    shipped = about["shipped"]
    compiling = "`impact-absorber prepare --this-processor` compiles the usual ones for this one"
    used = f"{shipped['kernels']} kernels for many processors came with the package; {compiling}"
    rows.append(
        ("shipped", f"not used: {shipped['unused_because']}" if shipped["unused_because"] else used)
    )
    return rows


@dataclass(frozen=True, kw_only=True)
class DoctorOptions:
    """Options of ``doctor``."""

    json: Path | None = option("json", help="Write it as JSON, too")


@command(DoctorOptions, examples=("doctor",))
def main(options: DoctorOptions) -> None:
    """Describe this installation, for the report of an error.

    The description has versions, extras, processor, threads, and the folders of compiled kernels.
    """
    with plain_errors():
        check_targets({"json": options.json})
        about = describe_installation()
        rows = lines(about)
        width = max(len(name) for name, _ in rows)
        for name, text in rows:
            click.echo(f"{name:<{width}}  {text}")
        write_files({options.json: about})
