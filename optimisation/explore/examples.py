"""Structures and settings that the explorer's page offers as examples.

Each example demonstrates one effect.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from impact_env.checks import ParameterError
from impact_env.parameters import Beam
from impact_env.plain import to_structure
from impact_env.structures.cyclic import BladedDisk, ring_of_masses
from optimisation.calibration.posterior import Posterior
from optimisation.explore.control import RefusedValues
from optimisation.explore.settings import PageModel, parse_controls
from optimisation.report.calibration_report import in_display_unit

OWN = "own"  # the key of the structure that the explorer was started with
PAPER = "paper"
STEEL_ARM = {
    "beam": {
        "length_m": 0.8,
        "young_modulus_pa": 210e9,
        "density_kg_m3": 7850.0,
        "section": {"kind": "tube", "diameter_m": 0.04, "wall_m": 0.002},
        "tip_mass_kg": 0.5,
        "damping_ratio": 0.01,
        "force_position": 0.4,
        "modes": 6,
    }
}


SECTORS = 8


def make_disk() -> BladedDisk:
    """Return an example disk of blades of 1 kg at 100 Hz.

    They are damped by 1 %, weakly coupled, and excited by engine order 2.
    """
    ring = ring_of_masses(SECTORS, coupling=0.01, frequency=100.0, damping_ratio=0.01)
    return BladedDisk(ring, engine_order=2, amplitude=20.0)


@dataclass(frozen=True)
class PageStructure:
    """A structure that the page has, with its ``title``."""

    title: str
    structure: PageModel


@dataclass(frozen=True)
class Example:
    """An example setting of the page.

    It has the key of its structure, the values that differ from the defaults, and a description of
    what it shows.
    """

    title: str
    about: str
    structure: str
    values: dict[str, float | str] = field(default_factory=dict)


EXAMPLES = (
    Example(
        "It works",
        "The paper's absorber at 3.5 N: a fifth of the level without absorber.",
        PAPER,
        {"friction": 0.1},
    ),
    Example(
        "Too strong a force",
        "The same at 8 N: the cavity is too narrow, the mass moves with the structure.",
        PAPER,
        {"friction": 0.1, "force": 8.0},
    ),
    Example(
        "A steel arm",
        "A steel tube of 0.8 m with a tool of 0.5 kg and an absorber of 5 %, shaken with 20 N.",
        "arm",
        {"force": 20.0, "gap": 1.3e-3, "mass_ratio": 0.05, "members": 2},
    ),
    Example(
        "A bladed disk",
        "Eight blades with an absorber in each, under a force that travels around the disk.",
        "disk",
        {"mistuning": 0.01, "mass_ratio": 0.08, "gap": 1e-3},
    ),
)


def make_structures(structure: PageModel, title: str) -> dict[str, PageStructure]:
    """Return the structures of a page by their keys.

    The page's own structure is first, followed by those of the examples.
    """
    structures = {OWN: PageStructure(title, structure)}
    if not (isinstance(structure, Beam) and structure == Beam()):
        structures[PAPER] = PageStructure("the paper's beam", Beam())
    structures["disk"] = PageStructure(f"a disk of {SECTORS} blades", make_disk())
    structures["arm"] = PageStructure("a steel arm with a tool", to_structure(STEEL_ARM))
    return structures


CONTROL_NAMES = {"friction_limit": "friction"}  # of parameters whose control has another name
MEASURED = ("mass_ratio", "gap", "restitution", "friction_limit")


def make_measured_example(posterior: Posterior, structure: PageModel) -> Example:
    """Return the example of a device that `calibrate` has measured.

    Its setting has the posterior's medians, and its description the 90 % intervals.

    Raises ParameterError for a device that the page's controls do not have.
    """
    known = {**posterior.device, **posterior.medians}
    values: dict[str, float | str] = {
        CONTROL_NAMES.get(name, name): float(f"{known[name]:.5g}")
        for name in MEASURED
        if name in known
    }
    texts = []
    for k, name in enumerate(posterior.names):
        (low, median, high), unit = in_display_unit(name, posterior.quantiles[:, k])
        texts.append(f"{name} {median:.4g} ({low:.4g} to {high:.4g}) {unit}".rstrip())
    try:
        parse_controls(values, structure)
    except RefusedValues as error:
        raise ParameterError(f"--uncertain is not allowed on this structure: {error}") from error
    about = f"Median (90 % interval) of the calibration: {', '.join(texts)}."
    return Example("Your measured device", about, OWN, values)


def examples_to_list(
    structures: dict[str, PageStructure], more: Sequence[Example] = ()
) -> list[dict[str, Any]]:
    """Return the examples for the page, with the keys of their structures.

    The examples ``more`` are first.
    """
    rows = [asdict(example) for example in (*more, *EXAMPLES)]
    for row in rows:
        if row["structure"] not in structures:
            row["structure"] = OWN
    return rows
