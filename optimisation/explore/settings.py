"""What can be set on the explorer's page: one table of controls, and from their values to a scene. What a page sends is checked, never evaluated."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impact_env.curve import CurveCase, Measure
from impact_env.drive import LEAST_DAMPING, Drive, Excitation, FrequencySchedule
from impact_env.ensemble import Lane
from impact_env.modes import ModalModel, Structure, modal_model
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    Absorber,
    Beam,
    ParameterError,
    RigidWalls,
    TunedAbsorber,
    count,
    friction_damper,
    impact_absorber,
    impact_absorbers,
    number,
    one_of,
    require,
)
from impact_env.plain import Plain, from_scene
from impact_env.plain_loads import to_loads
from impact_env.results import Record
from impact_env.scene import Scene
from impact_env.sweep import Stop, simulate
from optimisation.bounds import design_force, design_gap
from optimisation.measures import SAMPLES, START, read
from optimisation.mounting import scene_on
from optimisation.sweep_range import find_common_range

# What acts on the explorer's structure: a force, an unbalance or a base that is swept, or a random force. One table for page, runs and files.


LOADS = {
    "force": "swept force",
    "unbalance": "swept unbalance",
    "base": "swept base",
    "random": "random force",
}
BAND = (0.5, 1.5)  # of the resonance's frequency: where a random force has its flat spectrum
FULL = Record(events=True, series=True)
FINE = replace(FULL, samples_per_period=SAMPLES)


@dataclass(frozen=True, eq=False)
class Loading:
    """A ``kind`` of `LOADS` near a ``resonance`` of a ``model``. Its intensity is in N, kg m, m/s^2, or N (RMS) of a random force."""

    kind: str
    model: ModalModel
    resonance: int

    @property
    def swept(self) -> bool:
        """Whether it goes through the resonance, up and down."""
        return self.kind != "random"

    def file(self, intensity: float, schedule: FrequencySchedule) -> Plain:
        """Return it in the form of `docs/loads.md`; a random force lasts as long as a ``schedule``."""
        sizes = {"force": "amplitude_n", "unbalance": "unbalance_kg_m", "base": "acceleration_m_s2"}
        if self.swept:
            own = {
                "times_s": schedule.times.tolist(),
                "omegas_rad_s": schedule.omegas.tolist(),
                "reference_rad_s": schedule.reference,
            }
            return {"load": {"kind": self.kind, sizes[self.kind]: intensity, "schedule": own}}
        low, high = (share * schedule.reference / (2 * np.pi) for share in BAND)
        density = intensity**2 / (high - low)
        spectrum = [[low, density], [high, density]]
        return {
            "load": {
                "kind": "random",
                "spectrum": spectrum,
                "duration_s": float(schedule.times[-1]),
                "seed": 0,
            }
        }

    def act(self, intensity: float, schedule: FrequencySchedule) -> Excitation:
        """Return the drive of a run."""
        return (
            Drive(intensity, schedule)
            if self.kind == "force"
            else to_loads(self.file(intensity, schedule), schedule.reference)
        )

    @property
    def measure(self) -> Measure | None:
        """What a curve shows: of a random force the RMS after the start, else the response level (None)."""
        return None if self.swept else _rms

    @property
    def record(self) -> Record:
        """What is recorded of the run that is shown."""
        return FULL if self.swept else FINE

    @property
    def worth(self) -> float:
        """The harmonic force in N that moves the resonance's mode as one unit of a swept load does; infinite where a force cannot."""
        k = self.resonance - 1
        omega = self.model.resonance_omega(self.resonance)
        if self.kind == "base":
            assert self.model.base_participation is not None
            return (
                float(
                    np.abs(self.model.base_participation[k] / self.model.one_phase_force_shape[k])
                )
                if self.model.one_phase_force_shape[k]
                else float("inf")
            )
        return omega**2 if self.kind == "unbalance" else 1.0

    def rule_gap(self, mass: float, intensity: float) -> float:
        """Return the gap in m from which a search would begin for an absorber of a ``mass`` in kg.

        It is the design rule's for the force that a swept load is worth; of a random force `START` times the free motion's RMS, near enough: the
        resonance's mode alone counts, and its damping is 1e-4 at least.
        """
        if self.swept:
            return design_gap(self.model, mass, intensity * self.worth, self.resonance)
        k = self.resonance - 1
        omega = self.model.resonance_omega(self.resonance)
        damping = max(float(self.model.damping_ratio[k]), LEAST_DAMPING)
        shapes = self.model.one_phase_force_shape[k] * self.model.tip_shape[k]
        return float(START * intensity * np.abs(shapes) / omega**2 * np.sqrt(np.pi / (4 * damping)))

    def driven(self, omega: NDArray[np.float64]) -> tuple[ModalModel, NDArray[np.float64] | float]:
        """Return a model whose force is this load, and by how much a unit of it drives it at frequencies in rad/s; random: in N/sqrt(Hz)."""
        if self.kind == "base":
            assert self.model.base_participation is not None
            return replace(self.model, force_shape=-self.model.base_participation), 1.0
        width = (BAND[1] - BAND[0]) * self.model.resonance_omega(self.resonance) / (2 * np.pi)
        return self.model, {"force": 1.0, "unbalance": omega**2, "random": 1 / np.sqrt(width)}[
            self.kind
        ]


def _rms(lane: Lane, stop: Stop) -> tuple[float, ...]:
    response = simulate(lane.scene, lane.drive, initial=lane.start, record=FINE, stop=stop)
    return read(response), np.nan, np.nan, np.nan, float(response.impact_count), np.nan


CONCEPTS = {
    "impact": "impact absorber",
    "friction": "friction damper",
    "tuned": "tuned absorber",
    "two": "two impact absorbers",
    "none": "no absorber",
}
DIRECTIONS = {"both": "larger of up and down", "up": "up", "down": "down"}
# each costs time in proportion, and a page is no place for long runs
MOST_MEMBERS = 64
MOST_MODES = 40
MOST_RESONANCE = 6
PAPER_FORCE = 3.5  # N


@dataclass(frozen=True)
class Control:
    """One number: its value in SI units lies from ``low`` to ``high``; the page shows it times ``per`` in ``unit``.

    ``log``: its slider is logarithmic; ``zero``: with 0 at the left end. ``concepts`` and ``loads``: those that it is for, empty for all.
    """

    name: str
    label: str
    low: float
    high: float
    value: float
    unit: str = ""
    per: float = 1.0
    log: bool = False
    zero: bool = False
    whole: bool = False
    concepts: tuple[str, ...] = ()
    loads: tuple[str, ...] = ()


@dataclass(frozen=True)
class ControlValues:
    """What a page asks for, checked; SI units. ``instant``: time into the sweep in s around which it is looked at, None for the level's own."""

    concept: str
    load: str
    direction: str
    numbers: Mapping[str, float]
    instant: float | None

    def __getitem__(self, name: str) -> float:
        return self.numbers[name]

    @property
    def intensity(self) -> float:
        """How large the load is, in its unit."""
        return self.numbers[self.load]

    @property
    def resonance(self) -> int:
        """Resonance, counted from 1."""
        return int(self.numbers["resonance"])

    @property
    def members(self) -> int:
        """Number of runs of each point."""
        return int(self.numbers["members"])


class Refused(ParameterError):  # noqa: N818 - an answer
    """Values that are not allowed: ``errors`` says why, by control ("" for several at once)."""

    def __init__(self, errors: dict[str, str]) -> None:
        super().__init__("; ".join(errors.values()))
        self.errors = errors


def _own_values(structure: Structure) -> tuple[Beam | None, float]:
    """Return the beam, None for other structures, and the force in N at which the page begins."""
    beam = structure if isinstance(structure, Beam) else None
    if beam == Beam():
        return beam, PAPER_FORCE
    model = modal_model(structure)
    try:
        return beam, float(
            f"{design_force(model, DEFAULT_MASS_RATIO * model.beam_mass, RigidWalls.gap):.3g}"
        )
    except ParameterError:  # the absorber's own place is a node
        return beam, 1.0


def _intensities(model: ModalModel, force: float) -> list[tuple[str, str, float, str, float]]:
    """Return name, label, usual value, unit and factor of each load's intensity, all worth about the ``force`` in N at the first resonance."""
    labels = [
        ("force", "Force", force, "N", 1.0),
        ("unbalance", "Unbalance", _two(force / model.resonance_omega(1) ** 2), "g mm", 1e6),
    ]
    if (
        model.base_participation is not None
        and np.isfinite(worth := Loading("base", model, 1).worth)
        and worth > 0
    ):
        labels.append(("base", "Base acceleration", _two(force / worth), "m/s²", 1.0))
    return [*labels, ("random", "Random force", force, "N RMS", 1.0)]


def _two(value: float) -> float:
    return float(f"{value:.2g}")


_KNOWN: dict[
    int, tuple[Structure, tuple[Control, ...]]
] = {}  # by identity, and with the structure, which keeps it: a beam has no hash


def controls(structure: Structure) -> tuple[Control, ...]:
    """Return the controls of a structure, in the order of the page."""
    if id(structure) not in _KNOWN:
        _KNOWN[id(structure)] = structure, _controls(structure)
    return _KNOWN[id(structure)][1]


def _controls(structure: Structure) -> tuple[Control, ...]:
    beam, force = _own_values(structure)
    modes = (beam or modal_model(structure)).modes
    tuned = TunedAbsorber()
    walls = RigidWalls()
    cavity = ("impact", "two")
    table = [
        *(
            Control(name, label, size / 100, size * 30, size, unit, per, log=True, loads=(name,))
            for name, label, size, unit, per in _intensities(modal_model(structure), force)
        ),
        Control("resonance", "Resonance", 1, min(MOST_RESONANCE, modes), 1, whole=True),
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
        ),
        Control("restitution", "Restitution", 0.0, 1.0, 0.7, concepts=cavity),
        Control(
            "friction", "Friction limit", 1e-4, 20.0, 0.0, "N", log=True, zero=True, concepts=cavity
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
            concepts=tuple(CONCEPTS)[:-1],
        ),
    ]
    alone = tuple(name for name in CONCEPTS if name != "two")
    if beam is not None:
        place = beam.absorber_position
        table.append(
            Control("place", "Place", 0.05, 1.0, place, "of the length", concepts=alone[:-1])
        )
        table.append(
            Control(
                "first_place",
                "Place of the first",
                0.05,
                1.0,
                1.0,
                "of the length",
                concepts=("two",),
            )
        )
        table.append(
            Control(
                "second_place",
                "Place of the second",
                0.05,
                1.0,
                0.6,
                "of the length",
                concepts=("two",),
            )
        )
        if isinstance(beam.damping_ratio, int | float):
            table.append(
                Control(
                    "damping",
                    "Damping ratio",
                    1e-4,
                    0.1,
                    float(beam.damping_ratio),
                    "%",
                    100,
                    log=True,
                )
            )
        table.append(Control("modes", "Modes", 1, MOST_MODES, modes, whole=True))
    else:
        places = len(modal_model(structure).places)
        table.append(
            Control("place", "Place, its number", 1, places, 1, whole=True, concepts=alone[:-1])
        )
        table.append(
            Control(
                "first_place", "Place of the first", 1, places, 1, whole=True, concepts=("two",)
            )
        )
        table.append(
            Control(
                "second_place",
                "Place of the second",
                1,
                places,
                min(2, places),
                whole=True,
                concepts=("two",),
            )
        )
    table.append(Control("members", "Members", 1, MOST_MEMBERS, 4, whole=True))
    return tuple(control for control in table if control.low < control.high)


def loads_on(structure: Structure) -> dict[str, str]:
    """Return the loads that a structure can have, by name: a base only where it says how a base moves it."""
    names = {load for control in controls(structure) for load in control.loads}
    return {name: words for name, words in LOADS.items() if name in names}


def controls_to_dict(structure: Structure, name: str) -> Plain:
    """Return the controls' description for the page."""
    return {
        "structure": name,
        "beam_mass_kg": modal_model(structure).beam_mass,
        "concepts": CONCEPTS,
        "loads": loads_on(structure),
        "directions": DIRECTIONS,
        "controls": [asdict(control) for control in controls(structure)],
    }


def parse_controls(plain: object, structure: Structure) -> ControlValues:
    """Return the settings that a page sent, with defaults for missing ones; raises Refused with all errors."""
    errors: dict[str, str] = {}
    table = {control.name: control for control in controls(structure)}
    entries = dict(plain) if isinstance(plain, Mapping) else {}
    strange = [
        str(name)[:40]
        for name in entries
        if name not in table and name not in ("concept", "load", "direction", "instant")
    ]
    if strange or entries is plain or not isinstance(plain, Mapping):
        errors[""] = f"values = {', '.join(strange)} is not allowed: a table of the page's controls"
    numbers = {}
    for name, control in table.items():
        try:
            numbers[name] = _number(control, entries.get(name, control.value))
        except ParameterError as error:
            errors[name] = str(error)
    words = {}
    for name, known in (
        ("concept", CONCEPTS),
        ("load", loads_on(structure)),
        ("direction", DIRECTIONS),
    ):
        try:
            words[name] = one_of(name, entries.get(name, next(iter(known))), known)
        except ParameterError as error:
            errors[name] = str(error)[:200]
    instant = entries.get("instant")
    if instant is not None and not 0 <= number(instant) <= 1e12:
        errors["instant"] = "instant is not allowed: a time in s, 0 or above"
    if "modes" in numbers and "resonance" in numbers and numbers["resonance"] > numbers["modes"]:
        errors["resonance"] = (
            f"resonance = {numbers['resonance']:g} is not allowed: a mode of the model, 1 to {numbers['modes']:g}"
        )
    if words.get("load") == "base" and words.get("concept") == "two":
        errors["load"] = (
            f"load = base is not allowed: {', '.join(LOADS)} with one absorber, without base with two"
        )
    if errors:
        raise Refused(errors)
    return ControlValues(
        words["concept"],
        words["load"],
        words["direction"],
        numbers,
        None if instant is None else number(instant),
    )


def _number(control: Control, value: object) -> float:
    if control.whole:
        return count(
            control.name,
            int(value) if isinstance(value, float) and value.is_integer() else value,
            int(control.low),
            int(control.high),
        )
    low = 0.0 if control.zero else control.low
    high = control.high
    slack = 1e-9 * high
    as_text = value if isinstance(value, int | float) else f"{value!r:.40}"
    allowed = f"{low * control.per:g} to {high * control.per:g} {control.unit}".rstrip()
    parsed = number(value)
    require(low - slack <= parsed <= high + slack, control.label, as_text, allowed)
    return min(max(parsed, low), high)


def structure_of(values: ControlValues, structure: Structure) -> Structure:
    """Return the structure with the page's modes and damping, if it is a beam."""
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
        places = (values["first_place"], values["second_place"])
        return impact_absorbers(gaps, places, values["restitution"], values["friction"], mass)
    return None


def places_of(values: ControlValues) -> tuple[float, ...]:
    """Return the absorbers' places."""
    names = ("first_place", "second_place") if values.concept == "two" else ("place",)
    return tuple(values.numbers.get(name, 1.0) for name in names)


def scene_of(values: ControlValues, structure: Structure) -> Scene:
    """Return the scene; raises ParameterError where the values do not go together."""
    return scene_on(structure_of(values, structure), absorber_of(values), *places_of(values))


def sweep_range_of(values: ControlValues, structure: Structure) -> tuple[float, float]:
    """Return the ends of the sweeps over the resonance, those of all commands for absorbers of this mass at these places."""
    own = structure_of(values, structure)
    models = [scene_on(own, None, place).model for place in places_of(values)]
    return find_common_range(models, values["mass_ratio"], values.resonance)


def scene_file(values: ControlValues, structure: Structure) -> Plain:
    """Return the scene in the form of `docs/scenes.md`."""
    return from_scene(scene_of(values, structure))


def load_file(values: ControlValues, structure: Structure) -> Plain | None:
    """Return a load other than the force of a sweep in the form of `docs/loads.md`, as it acts in the sweep that is shown."""
    if values.load == "force":
        return None
    scene = scene_of(values, structure)
    limits = sweep_range_of(values, structure)
    up, down = CurveCase(scene, np.ones(1), values.resonance, limits).schedules()
    return Loading(values.load, scene.model, values.resonance).file(
        values.intensity, down if values.direction == "down" else up
    )
