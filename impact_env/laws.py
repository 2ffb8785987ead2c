"""The table of absorbers and contact laws.

It has one entry for each. Nothing else in the simulator distinguishes between them.

An entry says by which plain names a law is given (options of commands, keys of files, arguments of
environments and design variables are these names, in SI units), what kind of scene it makes, what
it stores, and how people are told of it. A law that is not in the table is an error.
CONTRIBUTING.md says how to add one.
"""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields, replace
from enum import Enum
from typing import Any, get_args

from impact_env.checks import (
    arguments_called,
    describe_in_errors,
    instance,
    one_of,
    require,
    text,
)
from impact_env.parameters import (
    Absorber,
    CompliantWalls,
    CoulombFriction,
    ElasticCoulombFriction,
    NonlinearSink,
    RigidWalls,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    YieldingWalls,
    find_largest_gravity,
    friction_damper,
    friction_law,
)

Values = Mapping[str, Any]


class SceneKind(Enum):
    """A scene's kind, defined by its contact and springs.

    It decides which methods can simulate the scene and what must be compiled for it.
    """

    LINEAR = "one linear regime"
    RIGID = "rigid contact"
    COMPLIANT = "compliant contact"
    SEVERAL = "several absorbers"
    SMOOTH = "a smooth nonlinear spring"


@dataclass(frozen=True)
class Key:
    """A plain name of a value.

    Its fields are the attribute that it stands for, a description, the unit, and a value that is
    omitted when values are listed.
    """

    attribute: str
    what: str
    unit: str = ""
    usual: float | None = None


@dataclass(frozen=True)
class Law:
    """A law of walls or of friction, or an absorber that has none.

    ``keys``: its plain names. ``mark``: the one that only this law of its group has, None for the
    group's usual law. ``stored``: its energy in J at a relative displacement in m. ``words``: its
    values for people.
    """

    of: type
    kind: SceneKind
    keys: Mapping[str, Key]
    words: Callable[[Any], str]
    mark: str | None = None
    stored: Callable[[Any, float], float] = lambda _law, _displacement: 0.0

    def values(self, law: Any) -> dict[str, Any]:
        """Return a law's values by their plain names."""
        listed = {name: getattr(law, key.attribute) for name, key in self.keys.items()}
        return {name: value for name, value in listed.items() if value != self.keys[name].usual}

    def make(self, values: Values) -> Any:
        """Return the law made from some values.

        Values that are left out have the class's defaults. Raises ParameterError for a missing
        value without a default.
        """
        needed = {field.name for field in fields(self.of) if field.default is MISSING}
        for name, key in self.keys.items():
            require(
                name in values or key.attribute not in needed,
                name,
                None,
                "given: it has no default",
            )
        with arguments_called({key.attribute: name for name, key in self.keys.items()}):
            return self.of(
                **{key.attribute: values[name] for name, key in self.keys.items() if name in values}
            )


GAP_KEY = Key("gap", "Clearance to either wall", "m")
RESTITUTION_KEY = Key("restitution", "Coefficient of restitution, 0 to 1")
MASS_KEYS = {"mass_ratio": Key("mass_ratio", "Absorber mass over beam mass")}
GRAVITY_KEY = (
    "gravity_m_s2"  # of one that has a weight along its motion: a key of files, not an option
)
HEAVY = ("impact", "friction", "tuned", "stuck")

WALL_LAWS = (
    Law(
        RigidWalls,
        SceneKind.RIGID,
        {"gap": GAP_KEY, "restitution": RESTITUTION_KEY},
        lambda w: f"gap {1e3 * w.gap:g} mm, restitution {w.restitution:g}",
    ),
    Law(
        YieldingWalls,
        SceneKind.RIGID,
        {
            "yield_velocity": Key(
                "yield_velocity",
                "Impact velocity from which restitution falls, where contact yields",
                "m/s",
            ),
            "gap": GAP_KEY,
            "restitution": RESTITUTION_KEY,
        },
        lambda w: (
            f"gap {1e3 * w.gap:g} mm, restitution {w.restitution:g} that falls above "
            f"{w.yield_velocity:g} m/s"
        ),
        mark="yield_velocity",
    ),
    Law(
        CompliantWalls,
        SceneKind.COMPLIANT,
        {
            "contact_stiffness": Key("stiffness", "Stiffness of walls that are springs", "N/m"),
            "gap": GAP_KEY,
            "restitution": replace(RESTITUTION_KEY, usual=1.0),
        },
        lambda w: (
            f"gap {1e3 * w.gap:g} mm, contact stiffness {w.stiffness:g} N/m"
            + (f", restitution {w.restitution:g}" if w.restitution < 1 else "")
        ),
        mark="contact_stiffness",
        stored=lambda w, y: 0.5 * w.stiffness * max(abs(y) - w.gap, 0.0) ** 2,
    ),
)
FRICTION_LIMIT_KEY = Key("limit", "Friction limit, 0 for none", "N")
STATIC_RATIO_KEY = Key(
    "static_ratio", "Static friction over sliding friction, 1 or above", usual=1.0
)
FRICTION_LAWS = (
    Law(
        CoulombFriction,
        SceneKind.RIGID,
        {"friction_limit": FRICTION_LIMIT_KEY, "static_friction_ratio": STATIC_RATIO_KEY},
        lambda f: (
            f"friction limit {f.limit:g} N"
            + (f", static {f.static_ratio:g} times that" if f.static_ratio > 1 else "")
        ),
    ),
    Law(
        ElasticCoulombFriction,
        SceneKind.COMPLIANT,
        {
            "friction_limit": FRICTION_LIMIT_KEY,
            "friction_stiffness": Key(
                "stiffness", "Stiffness of a spring in series with friction", "N/m"
            ),
        },
        lambda f: f"friction limit {f.limit:g} N, friction stiffness {f.stiffness:g} N/m",
        mark="friction_stiffness",
    ),
)
FRICTION_NAMES = {key.attribute: name for law in FRICTION_LAWS for name, key in law.keys.items()}
STUCK_LAW = Law(StuckAbsorber, SceneKind.LINEAR, MASS_KEYS, lambda _: "")
TUNED_LAW = Law(
    TunedAbsorber,
    SceneKind.LINEAR,
    {
        **MASS_KEYS,
        "stiffness": Key("stiffness", "Spring of the absorber", "N/m"),
        "damping": Key("damping", "Damper of the absorber", "N s/m"),
    },
    lambda a: f"stiffness {a.stiffness:g} N/m, damping {a.damping:g} N s/m",
    stored=lambda a, y: 0.5 * a.stiffness * y**2,
)
SINK_LAW = Law(
    NonlinearSink,
    SceneKind.SMOOTH,
    {
        **MASS_KEYS,
        "cubic_stiffness": Key(
            "cubic_stiffness", "Spring of the absorber, whose force grows with the cube", "N/m^3"
        ),
        "damping": Key("damping", "Damper of the absorber", "N s/m"),
    },
    lambda a: f"cubic stiffness {a.cubic_stiffness:g} N/m^3, damping {a.damping:g} N s/m",
    stored=lambda a, y: 0.25 * a.cubic_stiffness * y**4,
)
WHOLE_ABSORBERS = {
    "tuned": TUNED_LAW,
    "stuck": STUCK_LAW,
    "sink": SINK_LAW,
}  # absorbers that are one law
ABSORBER_NAMES = {
    "impact": "impact absorber",
    "friction": "friction damper",
    "tuned": "tuned absorber",
    "stuck": "stuck absorber",
    "sink": "nonlinear sink",
}


def _keys(*laws: Law) -> dict[str, Key]:
    return {name: key for law in laws for name, key in law.keys.items()}


# the concepts of one absorber, and the plain names that each is given by
CONCEPTS: dict[str, dict[str, Key]] = {
    "impact": {**MASS_KEYS, **_keys(*WALL_LAWS), **_keys(*FRICTION_LAWS)},
    "friction": {**MASS_KEYS, **_keys(*FRICTION_LAWS)},
    **{name: dict(law.keys) for name, law in WHOLE_ABSORBERS.items()},
    "none": {},
}
_ENTRIES = {law.of: law for law in (*WALL_LAWS, *FRICTION_LAWS, *WHOLE_ABSORBERS.values())}


def find_law(law: object) -> Law:
    """Return the entry of a law; raises ParameterError for one that is not in the table."""
    if type(law) not in _ENTRIES:
        require(False, "law", law, f"one of {', '.join(known.__name__ for known in _ENTRIES)}")
    return _ENTRIES[type(law)]


def list_laws(absorber: Absorber | None) -> tuple[object, ...]:
    """Return the laws that are present.

    They are walls and friction of a sliding absorber, or otherwise the absorber itself. Several
    absorbers have no laws here.
    """
    if instance("absorber", absorber, Absorber | None) is None or isinstance(
        absorber, SeveralAbsorbers
    ):
        return ()
    return (
        tuple(law for law in (absorber.walls, absorber.friction) if law is not None)
        if isinstance(absorber, SlidingAbsorber)
        else (absorber,)
    )


def kind(absorber: Absorber | None) -> SceneKind:
    """Return the kind of scene of an absorber."""
    if isinstance(absorber, SeveralAbsorbers):
        return SceneKind.SEVERAL
    return next((find_law(law).kind for law in list_laws(absorber)), SceneKind.LINEAR)


def compute_spring_energy(absorber: Absorber | None, displacement: float) -> float:
    """Return the energy in J of an absorber's springs at a relative displacement in m.

    It is 0 for several absorbers, whose contact is rigid.
    """
    return sum(find_law(law).stored(law, displacement) for law in list_laws(absorber))


def concept(absorber: Absorber | None) -> str:
    """Return which of `CONCEPTS` one absorber is."""
    if isinstance(absorber, SlidingAbsorber):
        return "friction" if absorber.walls is None else "impact"
    return (
        "none"
        if absorber is None
        else next(name for name, law in WHOLE_ABSORBERS.items() if law is find_law(absorber))
    )


def values(absorber: Absorber | None) -> dict[str, Any]:
    """Return one absorber's values by their plain names; `make` gives the same absorber back."""
    mass = {} if absorber is None else {"mass_ratio": absorber.mass_ratio}
    mass |= (
        {GRAVITY_KEY: find_largest_gravity(absorber)} if find_largest_gravity(absorber) != 0 else {}
    )
    return mass | {
        name: value
        for law in list_laws(absorber)
        for name, value in find_law(law).values(law).items()
    }


def describe_modes(modes: int) -> str:
    """Return "1 mode" or "10 modes"."""
    return f"{modes} mode{'s' * (modes != 1)}"


MOST_DESCRIBED = 4  # absorbers that are described one by one


def describe_absorber(absorber: Absorber | None) -> str:
    """Return an absorber's kind and values for people."""
    if isinstance(absorber, SeveralAbsorbers):
        every = absorber.absorbers
        if len(every) > MOST_DESCRIBED:
            same = "each" if len(set(every)) == 1 else "the first"
            return f"{len(every)} absorbers, {same}: {describe_absorber(every[0])}"
        each = zip(every, absorber.positions, strict=True)
        return "; ".join(
            f"at {position:g} of the length {describe_absorber(one)}" for one, position in each
        )
    if absorber is None:
        return "no absorber"
    descriptions = [
        ABSORBER_NAMES[concept(absorber)],
        f"mass ratio {absorber.mass_ratio:g}",
        *(find_law(law).words(law) for law in list_laws(absorber)),
    ]
    if isinstance(absorber, SlidingAbsorber) and absorber.friction is None:
        descriptions.append("no friction")
    if find_largest_gravity(absorber) != 0:
        descriptions.append(f"gravity {find_largest_gravity(absorber):g} m/s^2")
    return ", ".join(word for word in descriptions if word)


def describe(value: Any) -> str:
    """Return an absorber or a contact law of the table for people; KeyError for anything else."""
    if isinstance(value, Absorber):
        return describe_absorber(value)
    return f"{type(value).__name__} ({_ENTRIES[type(value)].words(value)})"


for _kind in (*_ENTRIES, *get_args(Absorber)):
    describe_in_errors(_kind, describe)


def _choose_law(laws: tuple[Law, ...], values: Values) -> Law:
    """Return the law of a group that the given names belong to."""
    law = next((law for law in laws if law.mark in values), laws[0])
    for name in values:
        other = name in _keys(*laws) and name not in law.keys
        require(
            not other,
            name,
            values[name],
            f"left out with {law.mark}: {law.of.__name__} have {', '.join(law.keys)}",
        )
    return law


def _make_friction(
    values: Values, walls: object
) -> CoulombFriction | ElasticCoulombFriction | None:
    """Return friction in addition to walls.

    It is elastic if the walls are springs. Its stiffness is that of the walls unless ``values``
    contains another one.
    """
    limit = values.get("friction_limit")
    stiffness = values.get("friction_stiffness")
    if stiffness is None and isinstance(walls, CompliantWalls):
        stiffness = walls.stiffness
    if "friction_stiffness" in values:
        require(
            limit is not None, "friction_stiffness", stiffness, "left out without a friction_limit"
        )
    ratio = values.get("static_friction_ratio", 1.0)
    require(
        limit is not None or ratio == 1,
        "static_friction_ratio",
        ratio,
        "left out without a friction_limit",
    )
    with arguments_called(FRICTION_NAMES):
        return friction_law(limit, stiffness, ratio)


def make(concept: str, values: Values, name: str = "absorber") -> Absorber | None:
    """Return an absorber made from values by their plain names.

    Values that are left out or None have the defaults of `impact_env.parameters`.

    Raises ParameterError for an unknown concept or name, which it calls ``name``.
    """
    name = text("name", name)
    known = set(CONCEPTS[one_of(name, concept, CONCEPTS)]) | (
        {GRAVITY_KEY} if concept in HEAVY else set()
    )
    strange = sorted(set(instance(f"{name}'s values", values, Mapping)) - known)
    require(
        not strange,
        f"{name}'s values",
        dict(values),
        f"only the keys {', '.join(sorted(known))}" if known else "no keys",
    )
    present = {key: value for key, value in values.items() if value is not None}
    if GRAVITY_KEY in present:
        gravity = present.pop(GRAVITY_KEY)
        with arguments_called({"gravity": GRAVITY_KEY}):
            return replace(make(concept, present, name), gravity=gravity)  # type: ignore[type-var]
    if concept in WHOLE_ABSORBERS:
        return WHOLE_ABSORBERS[concept].make(present)
    mass = {key: present[key] for key in MASS_KEYS if key in present}
    if concept == "friction":
        with arguments_called(FRICTION_NAMES):
            return friction_damper(**present)
    if concept == "none":
        return None
    walls = _choose_law(WALL_LAWS, present).make(present)
    return SlidingAbsorber(**mass, walls=walls, friction=_make_friction(present, walls))
