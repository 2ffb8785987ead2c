"""The controls of the explorer's page, and the scene that follows from their values.

The controls are one table. Values that a page sends are checked, never evaluated.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from impact_env.checks import ParameterError, one_of
from impact_env.curve import CurveCase
from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    Absorber,
    Beam,
    RigidWalls,
    TunedAbsorber,
    friction_damper,
    impact_absorber,
    impact_absorbers,
)
from impact_env.plain import Plain, from_disk, from_scene
from impact_env.scene import Scene
from impact_env.structures.cyclic import BladedDisk
from optimisation.bounds import design_force
from optimisation.disks import find_disk_range, find_excited_resonance
from optimisation.explore.control import Control, ControlValues, RefusedValues
from optimisation.explore.disk_controls import DISK_CONCEPTS, disk_controls, disk_of
from optimisation.explore.loading import LOADS, Loading
from optimisation.measures import SAMPLES
from optimisation.mounting import scene_on
from optimisation.sweep_range import find_common_range

PageModel = Structure | BladedDisk  # what a page's structure can be
CONCEPTS = {
    "impact": "impact absorber",
    "friction": "friction damper",
    "tuned": "tuned absorber",
    "two": "two impact absorbers",
    "none": "no absorber",
}
DIRECTIONS = {"both": "larger of up and down", "up": "up", "down": "down"}
VIEWS = {"levels": "level over the frequency", "orbits": "periodic motions"}
CHOICES = ("concept", "load", "direction", "view")
GROUPS = {
    "absorber": "Absorber",
    "load": "Load",
    "structure": "Structure",
    "numerics": "Numerics",
}
# each costs time in proportion, and a page is no place for long runs
MOST_MEMBERS = 64
MOST_MODES = 40
MOST_RESONANCE = 6
PAPER_FORCE = 3.5  # N
SLACK = 1e-9  # of a control's range: values that pass through units are rounded
LONGEST = 40  # characters of a refused value in its message


def find_default_force(structure: Structure, model: ModalModel) -> float:
    """Return the initial force in N of the page.

    It is the paper's force, or the design rule's force for the default gap.
    """
    if isinstance(structure, Beam) and structure == Beam():
        return PAPER_FORCE
    try:
        force = design_force(model, DEFAULT_MASS_RATIO * model.beam_mass, RigidWalls.gap)
    except ParameterError:  # the absorber's own place is a node
        return 1.0
    return float(f"{force:.3g}")


def load_controls(structure: Structure, model: ModalModel) -> list[Control]:
    """Return the controls of the loads' amplitudes.

    Their defaults are equivalent to about the same force at the first resonance.
    """
    force = find_default_force(structure, model)
    rows = [
        ("force", "Force", force, "N", 1.0, "Amplitude of the harmonic force."),
        (
            "unbalance",
            "Unbalance",
            round_to_two(force / model.resonance_omega(1) ** 2),
            "g mm",
            1e6,
            "Rotating mass times its radius; its force grows with the square of the frequency.",
        ),
    ]
    if model.base_participation is not None:
        worth = Loading("base", model, 1).worth
        if np.isfinite(worth) and worth > 0:
            base = round_to_two(force / worth)
            about = "Amplitude of the acceleration of the base on which the structure stands."
            rows.append(("base", "Base acceleration", base, "m/s²", 1.0, about))
    about = "RMS of a force with a flat spectrum from 0.5 to 1.5 times the resonance."
    rows.append(("random", "Random force", force, "N RMS", 1.0, about))
    return [
        Control(
            name,
            label,
            size / 100,
            size * 30,
            size,
            unit,
            per,
            log=True,
            loads=(name,),
            group="load",
            about=about,
        )
        for name, label, size, unit, per, about in rows
    ]


def round_to_two(value: float) -> float:
    """Return a number with two digits."""
    return float(f"{value:.2g}")


def absorber_controls() -> list[Control]:
    """Return the controls of absorbers on any structure."""
    tuned = TunedAbsorber()
    walls = RigidWalls()
    cavity = ("impact", "two")
    return [
        Control(
            "gap",
            "Gap to either wall",
            walls.gap / 50,
            50 * walls.gap,
            walls.gap,
            "mm",
            1e3,
            log=True,
            concepts=cavity,
            about="Distance from the middle of the cavity to either wall: half of the free travel.",
        ),
        Control(
            "second_gap",
            "Gap of the second",
            walls.gap / 50,
            50 * walls.gap,
            walls.gap / 2,
            "mm",
            1e3,
            log=True,
            concepts=("two",),
            about="The same of the second absorber.",
        ),
        Control(
            "restitution",
            "Restitution",
            0.0,
            1.0,
            0.7,
            concepts=cavity,
            about="Rebound speed over impact speed: 1 loses nothing, 0 does not rebound.",
        ),
        Control(
            "friction",
            "Friction limit",
            1e-4,
            20.0,
            0.0,
            "N",
            log=True,
            zero=True,
            concepts=cavity,
            about="Largest dry friction force between mass and structure.",
        ),
        Control(
            "damper_friction",
            "Friction limit",
            1e-4,
            100.0,
            0.5,
            "N",
            log=True,
            concepts=("friction",),
            about="Largest dry friction force between mass and structure.",
        ),
        Control(
            "stiffness",
            "Spring",
            tuned.stiffness / 1e3,
            tuned.stiffness * 1e3,
            tuned.stiffness,
            "N/m",
            log=True,
            concepts=("tuned",),
            about="Stiffness between mass and structure: tunes the absorber to a resonance.",
        ),
        Control(
            "damper",
            "Damper",
            tuned.damping / 1e3,
            tuned.damping * 1e3,
            tuned.damping,
            "N s/m",
            log=True,
            zero=True,
            concepts=("tuned",),
            about="Damping constant between mass and structure.",
        ),
        Control(
            "mass_ratio",
            "Mass",
            1e-3,
            0.2,
            DEFAULT_MASS_RATIO,
            "% of the structure's",
            100,
            log=True,
            concepts=tuple(name for name in CONCEPTS if name != "none"),
            about="Mass of the absorber, of two of both together.",
        ),
    ]


def place_controls(structure: Structure, model: ModalModel) -> list[Control]:
    """Return the controls of the absorbers' places.

    They are shares of a beam's length, or numbers of a model's places.
    """
    single = tuple(name for name in CONCEPTS if name not in ("two", "none"))
    if isinstance(structure, Beam):
        whole = False
        low = 0.05
        high = 1.0
        unit = "of the length"
        usual = (structure.absorber_position, 1.0, 0.6)
    else:
        whole = True
        low = 1.0
        high = float(len(model.places))
        unit = ""
        usual = (1, 1, min(2, len(model.places)))
    rows = (
        ("place", "Place" if isinstance(structure, Beam) else "Place, its number", single),
        ("first_place", "Place of the first", ("two",)),
        ("second_place", "Place of the second", ("two",)),
    )
    return [
        Control(name, label, low, high, value, unit, whole=whole, concepts=concepts)
        for (name, label, concepts), value in zip(rows, usual, strict=True)
    ]


def structure_controls(structure: Structure) -> list[Control]:
    """Return the controls of the structure, and of how much of it is computed."""
    modes = structure.modes
    resonance = Control(
        "resonance",
        "Resonance",
        1,
        min(MOST_RESONANCE, modes),
        1,
        whole=True,
        group="load",
        about="Which resonance the load passes, from the lowest.",
    )
    if not isinstance(structure, Beam):
        return [resonance]
    controls = [resonance]
    if isinstance(structure.damping_ratio, int | float):
        controls.append(
            Control(
                "damping",
                "Damping ratio",
                1e-4,
                0.1,
                float(structure.damping_ratio),
                "%",
                100,
                log=True,
                group="structure",
                about="Damping of each mode relative to critical damping.",
            )
        )
    about = "Modes of the beam that are computed; time grows with them."
    controls.append(
        Control("modes", "Modes", 1, MOST_MODES, modes, whole=True, group="numerics", about=about)
    )
    return controls


_CONTROLS: dict[int, tuple[PageModel, tuple[Control, ...]]] = {}
# by identity, and with the structure, so that the identity stays its own: a beam has no hash


def controls(structure: PageModel) -> tuple[Control, ...]:
    """Return the controls of a structure, in the order of the page."""
    if id(structure) not in _CONTROLS:
        _CONTROLS[id(structure)] = structure, make_controls(structure)
    return _CONTROLS[id(structure)][1]


def make_controls(structure: PageModel) -> tuple[Control, ...]:
    """Return the table of controls; those with one possible value are left out."""
    if isinstance(structure, BladedDisk):
        return disk_controls(structure)
    model = modal_model(structure)
    about = "Runs of each point; they differ in the phase and a millionth of the load."
    table = [
        *load_controls(structure, model),
        *absorber_controls(),
        *place_controls(structure, model),
        *structure_controls(structure),
        Control(
            "members", "Members", 1, MOST_MEMBERS, 4, whole=True, group="numerics", about=about
        ),
    ]
    return tuple(control for control in table if control.low < control.high)


def concepts_on(structure: PageModel) -> dict[str, str]:
    """Return the concepts that a structure can have, by name."""
    return DISK_CONCEPTS if isinstance(structure, BladedDisk) else CONCEPTS


def loads_on(structure: PageModel) -> dict[str, str]:
    """Return the loads that a structure can have, by name.

    Base motion is included only if the structure says how a base moves it.
    """
    names = {load for control in controls(structure) for load in control.loads}
    return {name: words for name, words in LOADS.items() if name in names}


def mass_of(structure: PageModel) -> float:
    """Return the mass in kg to which an absorber's mass ratio refers.

    It is the mass of the structure, or of a sector of a disk.
    """
    if isinstance(structure, BladedDisk):
        return structure.ring.sector_mass or 0.0
    return modal_model(structure).beam_mass


def controls_to_dict(structure: PageModel, name: str) -> dict[str, Any]:
    """Return the controls' description for the page."""
    return {
        "structure": name,
        "beam_mass_kg": mass_of(structure),
        "concepts": concepts_on(structure),
        "loads": loads_on(structure),
        "directions": DIRECTIONS,
        "views": VIEWS,
        "groups": GROUPS,
        "advice": not isinstance(structure, BladedDisk),
        "controls": [asdict(control) for control in controls(structure)],
    }


def parse_controls(plain: object, structure: PageModel) -> ControlValues:
    """Return the settings that a page sent, with defaults for missing ones.

    Raises RefusedValues with all errors.
    """
    errors: dict[str, str] = {}
    table = {control.name: control for control in controls(structure)}
    entries = dict(plain) if isinstance(plain, Mapping) else {}
    unknown = [str(name)[:LONGEST] for name in entries if name not in (*table, *CHOICES, "instant")]
    if unknown or not isinstance(plain, Mapping):
        errors[""] = f"values = {', '.join(unknown)} is not allowed: a table of the page's controls"
    numbers = {}
    for name, control in table.items():
        try:
            numbers[name] = read_number(control, entries.get(name, control.value))
        except ParameterError as error:
            errors[name] = str(error)
    options = dict(
        zip(CHOICES, (concepts_on(structure), loads_on(structure), DIRECTIONS, VIEWS), strict=True)
    )
    words = {}
    for name, known in options.items():
        try:
            words[name] = one_of(name, entries.get(name, next(iter(known))), known)
        except ParameterError as error:
            errors[name] = str(error)[:200]
    instant = entries.get("instant")
    if instant is not None and not (is_finite(instant) and 0 <= instant <= 1e12):
        errors["instant"] = "instant is not allowed: a time in s, 0 or above"
    modes = numbers.get("modes", math.inf)
    if numbers.get("resonance", 1) > modes:
        errors["resonance"] = (
            f"Resonance = {numbers['resonance']:g} is not allowed: a mode of the model, 1 to "
            f"{modes:g}"
        )
    if errors:
        raise RefusedValues(errors)
    if isinstance(structure, BladedDisk):
        order = replace(structure, engine_order=int(numbers["engine_order"]))
        numbers["resonance"] = find_excited_resonance(order)
        numbers["members"] = 1
    return ControlValues(
        words["concept"],
        words["load"],
        words["direction"],
        numbers,
        None if instant is None else float(instant),
        words["view"],
    )


def replace_numbers(values: ControlValues, numbers: Mapping[str, float]) -> ControlValues:
    """Return the values with other numbers, each within its control's range as it is."""
    return replace(values, numbers={**values.numbers, **numbers})


def is_finite(value: object) -> bool:
    """Return whether a value of a message is a finite number."""
    try:
        return (
            isinstance(value, int | float)
            and not isinstance(value, bool)
            and math.isfinite(float(value))
        )
    except OverflowError:
        return False


def read_number(control: Control, value: object) -> float:
    """Return a control's value from a message; raises ParameterError in the page's unit."""
    if value is None:
        raise ParameterError(f"{control.label}: no number; allowed is {control.allowed}")
    if not is_finite(value) or not isinstance(value, int | float):
        raise ParameterError(
            f"{control.label} = {str(value)[:LONGEST]} is not allowed: {control.allowed}"
        )
    number = float(value)
    low = 0.0 if control.zero else control.low
    slack = SLACK * control.high
    inside = low - slack <= number <= control.high + slack
    if not inside or (control.whole and not number.is_integer()):
        words = f"{number * control.per:.6g} {control.unit}".rstrip()
        raise ParameterError(f"{control.label} = {words} is not allowed: {control.allowed}")
    return min(max(number, low), control.high)


def structure_of(values: ControlValues, structure: PageModel) -> Structure:
    """Return the structure with the page's modes and damping, if it is a beam.

    A disk is returned as its modal model.
    """
    if isinstance(structure, BladedDisk):
        return disk_of(values, structure).model
    if not isinstance(structure, Beam):
        return structure
    own = {"modes": int(values["modes"])} | (
        {"damping_ratio": values["damping"]} if "damping" in values.numbers else {}
    )
    return replace(structure, **own)  # type: ignore[arg-type]


def absorber_of(values: ControlValues) -> Absorber | None:
    """Return the absorber."""
    mass = values["mass_ratio"]
    if values.concept == "impact":
        return impact_absorber(values["gap"], values["restitution"], values["friction"], mass)
    if values.concept == "friction":
        return friction_damper(values["damper_friction"], mass)
    if values.concept == "tuned":
        return TunedAbsorber(mass, values["stiffness"], values["damper"])
    if values.concept == "two":
        gaps = (values["gap"], values["second_gap"])
        return impact_absorbers(
            gaps, places_of(values), values["restitution"], values["friction"], mass
        )
    return None


def places_of(values: ControlValues) -> tuple[float, ...]:
    """Return the absorbers' places."""
    names = ("first_place", "second_place") if values.concept == "two" else ("place",)
    return tuple(values.numbers.get(name, 1.0) for name in names)


def scene_of(values: ControlValues, structure: PageModel) -> Scene:
    """Return the scene; raises ParameterError where the values do not go together."""
    if isinstance(structure, BladedDisk):
        return disk_of(values, structure).scene()
    return scene_on(structure_of(values, structure), absorber_of(values), *places_of(values))


def sweep_range_of(values: ControlValues, structure: PageModel) -> tuple[float, float]:
    """Return the ends of the sweeps over the resonance.

    They are those of all commands for absorbers of this mass at these places.
    """
    if isinstance(structure, BladedDisk):
        return find_disk_range(disk_of(values, structure), values.resonance)
    own = structure_of(values, structure)
    models = [scene_on(own, None, place).model for place in places_of(values)]
    return find_common_range(models, values["mass_ratio"], values.resonance)


def sweeps_of(values: ControlValues) -> tuple[str, ...]:
    """Return the directions of the sweeps behind a level: one, or both."""
    if values.load == "random":
        return ("up",)
    return ("up", "down") if values.direction == "both" else (values.direction,)


def scene_file(values: ControlValues, structure: PageModel) -> Plain:
    """Return the scene in the form of `docs/scenes.md`."""
    if isinstance(structure, BladedDisk):
        return from_disk(disk_of(values, structure))
    return from_scene(scene_of(values, structure))


def load_files(values: ControlValues, structure: PageModel) -> dict[str, Plain]:
    """Return a load other than a swept force in the form of `docs/loads.md`, by file name.

    Each direction of `sweeps_of` has a file.
    """
    if values.load == "force":
        return {}
    scene = scene_of(values, structure)
    limits = sweep_range_of(values, structure)
    schedules = CurveCase(scene, np.ones(1), values.resonance, limits).schedules()
    loading = Loading(values.load, scene.model, values.resonance)
    sweeps = sweeps_of(values)
    return {
        load_name(sweep, sweeps): loading.file(
            values.intensity, schedules[("up", "down").index(sweep)]
        )
        for sweep in sweeps
    }


def load_name(sweep: str, sweeps: tuple[str, ...]) -> str:
    """Return the name of the load's file for the sweep of a direction."""
    return "load.json" if len(sweeps) == 1 else f"load_{sweep}.json"


def commands_of(values: ControlValues, structure: PageModel) -> list[str]:
    """Return the commands that make the runs behind the card's level.

    Each direction of `sweeps_of` has a command.
    """
    sweeps = sweeps_of(values)
    low, high = sweep_range_of(values, structure)
    lines = []
    for sweep in sweeps:
        words = [
            "impact-absorber sweep --scene scene.json",
            f"--resonance {values.resonance} --members {values.members}",
        ]
        if values.load != "random":
            words.append("--start steady")
        if values.load == "force":
            words.append(f"--force {values['force']:.17g} --from {low:.17g} --to {high:.17g}")
            words += ["--down"] * (sweep == "down")
        else:
            words.append(f"--load {load_name(sweep, sweeps)}")
        if values.load == "random":
            words.append(f"--measures {SAMPLES}")
        name = "sweep" if len(sweeps) == 1 else sweep
        words.append(f"--plot {name}.png --json {name}.json")
        lines.append(" ".join(words))
    return lines
