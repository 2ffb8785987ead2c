"""The table of absorbers and contact laws.

Every absorber and every law of walls or friction has an entry. The names of its options, its kind
of scene, its stored energy and its description come from that entry alone.

The fields of a law's class declare the names by which it is given: options of commands, keys of
files, arguments of environments and design variables, in SI units (`impact_env.fields`). For a law
that is not in the table `find_law` raises ParameterError. CONTRIBUTING.md says how to add a law.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field, dataclass, replace
from enum import Enum
from typing import Any, NamedTuple, get_args

from impact_env.checks import (
    DESCRIPTIONS,
    arguments_called,
    instance,
    one_of,
    require,
    text,
)
from impact_env.fields import list_options
from impact_env.parameters import (
    Absorber,
    CompliantWalls,
    CoulombFriction,
    ElasticCoulombFriction,
    FrictionLaw,
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
    """A scene's kind, which follows from its contact and springs.

    The kind determines which methods can simulate the scene and which kernels are compiled for it.
    """

    LINEAR = "one linear regime"
    RIGID = "rigid contact"
    COMPLIANT = "compliant contact"
    SEVERAL = "several absorbers"
    SMOOTH = "a smooth nonlinear spring"


class Link(NamedTuple):
    """Spring and damper between the structure and a linear absorber.

    Attributes
    ----------
    stiffness : float
        Stiffness of the spring in N/m.
    damping : float
        Coefficient of the damper in N s/m.
    """

    stiffness: float
    damping: float


@dataclass(frozen=True)
class Law:
    """A law of walls or of friction, or an absorber that has neither.

    Parameters
    ----------
    of : type
        Class of the law, whose fields declare its options (`impact_env.fields.parameter`).
    kind : SceneKind
        Kind of a scene with this law.
    words : callable
        Function of a law that returns its values as text, such as "gap 1 mm, restitution 0.8".
    mark : str, optional
        Name of the option that selects this law among the laws of walls, or of friction. None: the
        law is used where no such option is given.
    stored : callable, optional
        Function of a law and a relative displacement in m that returns the stored energy in J,
        without that of a link. Default: 0.
    link : callable, optional
        `Link` of a linear absorber with its mass in kg. All methods and frequency responses use it.
        None only for `StuckAbsorber`, which does not move on the structure, and for other kinds of
        scenes.

    Raises
    ------
    ParameterError
        A linear absorber has no link, or another kind of scene has one.
    """

    of: type
    kind: SceneKind
    words: Callable[[Any], str]
    mark: str | None = None
    stored: Callable[[Any, float], float] = lambda _law, _displacement: 0.0
    link: Callable[[Any, float], Link] | None = None

    def __post_init__(self) -> None:
        linked = self.kind is SceneKind.LINEAR and self.of is not StuckAbsorber
        require(
            (self.link is not None) == linked,
            "link",
            self.link,
            f"{'given' if linked else 'left out'} for {self.of.__name__}",
        )

    @property
    def options(self) -> dict[str, Field[Any]]:
        """Dataclass fields of the law by the names of their options."""
        return list_options(self.of)

    def values(self, law: Any) -> dict[str, Any]:
        """Return a law's values by the names of their options.

        Fields declared with ``omit_default`` are left out where they have their default.
        """
        return {
            name: getattr(law, field.name)
            for name, field in self.options.items()
            if not field.metadata["omit_default"] or getattr(law, field.name) != field.default
        }

    def make(self, values: Values) -> Any:
        """Return a law with values by the names of their options; other names are ignored.

        Missing values have the class's defaults. Raises ParameterError for a missing value without
        a default, and for a value that is not allowed.
        """
        arguments = {}
        for name, field in self.options.items():
            if name in values:
                arguments[field.name] = values[name]
            else:
                require(field.default is not MISSING, name, None, "given: it has no default")
        with arguments_called({field.name: name for name, field in self.options.items()}):
            return self.of(**arguments)


MASS_OPTION = list_options(SlidingAbsorber)  # mass_ratio
# gravity along the absorber's motion: a key of files, not an option of commands
GRAVITY_KEY = "gravity_m_s2"

WALL_LAWS = (
    Law(
        RigidWalls,
        SceneKind.RIGID,
        lambda w: f"gap {1e3 * w.gap:g} mm, restitution {w.restitution:g}",
    ),
    Law(
        YieldingWalls,
        SceneKind.RIGID,
        lambda w: (
            f"gap {1e3 * w.gap:g} mm, restitution {w.restitution:g} that falls above "
            f"{w.yield_velocity:g} m/s"
        ),
        mark="yield_velocity",
    ),
    Law(
        CompliantWalls,
        SceneKind.COMPLIANT,
        lambda w: (
            f"gap {1e3 * w.gap:g} mm, contact stiffness {w.stiffness:g} N/m"
            + (f", restitution {w.restitution:g}" if w.restitution < 1 else "")
        ),
        mark="contact_stiffness",
        stored=lambda w, y: 0.5 * w.stiffness * max(abs(y) - w.gap, 0.0) ** 2,
    ),
)
FRICTION_LAWS = (
    Law(
        CoulombFriction,
        SceneKind.RIGID,
        lambda f: (
            f"friction limit {f.limit:g} N"
            + (f", static {f.static_ratio:g} times that" if f.static_ratio > 1 else "")
        ),
    ),
    Law(
        ElasticCoulombFriction,
        SceneKind.COMPLIANT,
        lambda f: f"friction limit {f.limit:g} N, friction stiffness {f.stiffness:g} N/m",
        mark="friction_stiffness",
    ),
)
FRICTION_NAMES = {field.name: name for law in FRICTION_LAWS for name, field in law.options.items()}
STUCK_LAW = Law(StuckAbsorber, SceneKind.LINEAR, lambda _: "")
TUNED_LAW = Law(
    TunedAbsorber,
    SceneKind.LINEAR,
    lambda a: f"stiffness {a.stiffness:g} N/m, damping {a.damping:g} N s/m",
    link=lambda a, _mass: Link(a.stiffness, a.damping),
)
SINK_LAW = Law(
    NonlinearSink,
    SceneKind.SMOOTH,
    lambda a: f"cubic stiffness {a.cubic_stiffness:g} N/m^3, damping {a.damping:g} N s/m",
    stored=lambda a, y: 0.25 * a.cubic_stiffness * y**4,
)
WHOLE_ABSORBERS = {
    "tuned": TUNED_LAW,
    "stuck": STUCK_LAW,
    "sink": SINK_LAW,
}  # absorbers that are one law
# concepts of an absorber that may have a weight along its motion
HEAVY = (
    "impact",
    "friction",
    *(name for name, law in WHOLE_ABSORBERS.items() if hasattr(law.of, "gravity")),
)
ABSORBER_NAMES = {
    "impact": "impact absorber",
    "friction": "friction damper",
    "tuned": "tuned absorber",
    "stuck": "stuck absorber",
    "sink": "nonlinear sink",
}


def _list_options(laws: Iterable[Law]) -> dict[str, Field[Any]]:
    """Return the options of several laws by name."""
    return {name: field for law in laws for name, field in law.options.items()}


# the concepts of one absorber, each with its options by name
CONCEPTS: dict[str, dict[str, Field[Any]]] = {
    "impact": {**MASS_OPTION, **_list_options(WALL_LAWS), **_list_options(FRICTION_LAWS)},
    "friction": {**MASS_OPTION, **_list_options(FRICTION_LAWS)},
    **{name: law.options for name, law in WHOLE_ABSORBERS.items()},
    "none": {},
}
_ENTRIES = {law.of: law for law in (*WALL_LAWS, *FRICTION_LAWS, *WHOLE_ABSORBERS.values())}


def find_law(law: object) -> Law:
    """Return the entry of a law; raises ParameterError if the law is not in the table."""
    if type(law) not in _ENTRIES:
        require(False, "law", law, f"one of {', '.join(known.__name__ for known in _ENTRIES)}")
    return _ENTRIES[type(law)]


def list_laws(absorber: Absorber | None) -> tuple[object, ...]:
    """Return the laws of an absorber, as keys of `find_law`.

    A sliding absorber has its walls and its friction, as far as they are not None. Any other
    absorber is its own law. The result is empty for several absorbers, and without an absorber.
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
    """Return the kind of a scene with this absorber; `SceneKind.LINEAR` for None."""
    if isinstance(absorber, SeveralAbsorbers):
        return SceneKind.SEVERAL
    return next((find_law(law).kind for law in list_laws(absorber)), SceneKind.LINEAR)


def find_link(absorber: Absorber | None, mass: float) -> Link | None:
    """Return the spring and damper of a linear absorber of ``mass`` kg.

    The result is None for a stuck absorber, and where the scene is not linear.
    """
    if absorber is None or kind(absorber) is not SceneKind.LINEAR:
        return None
    link = find_law(absorber).link
    return None if link is None else link(absorber, mass)


def concept(absorber: Absorber | None) -> str:
    """Return an absorber's key in `CONCEPTS`, "none" for None.

    Raises ParameterError for several absorbers.
    """
    if isinstance(absorber, SlidingAbsorber):
        return "friction" if absorber.walls is None else "impact"
    return (
        "none"
        if absorber is None
        else next(name for name, law in WHOLE_ABSORBERS.items() if law is find_law(absorber))
    )


def values(absorber: Absorber | None) -> dict[str, Any]:
    """Return one absorber's values by the names of their options; `make` is the inverse function.

    The values are the mass ratio, gravity in m/s^2 unless it is 0, and the values of the laws.
    """
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
    """Return an absorber's kind and values as text."""
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
    """Return an absorber or a contact law as text; raises KeyError for any other object."""
    if isinstance(value, Absorber):
        return describe_absorber(value)
    return f"{type(value).__name__} ({_ENTRIES[type(value)].words(value)})"


for _kind in (*_ENTRIES, *get_args(Absorber)):
    DESCRIPTIONS[_kind] = describe


def _choose_law(laws: tuple[Law, ...], values: Values) -> Law:
    """Return the law, of several alternatives, that the names of ``values`` select.

    It is the law whose ``mark`` is in ``values``, else the first. Raises ParameterError if
    ``values`` has an option that only another of these laws has.
    """
    law = next((law for law in laws if law.mark in values), laws[0])
    for name in values:
        other = name in _list_options(laws) and name not in law.options
        require(
            not other,
            name,
            values[name],
            f"left out with {law.mark}: {law.of.__name__} have {', '.join(law.options)}",
        )
    return law


def _make_friction(values: Values, walls: object) -> FrictionLaw | None:
    """Return an absorber's friction law, None if ``values`` has no friction limit.

    Friction is elastic if ``values`` has a friction stiffness or ``walls`` are compliant; without a
    friction stiffness the contact stiffness is used. Raises ParameterError for a stiffness or a
    static ratio without a friction limit.
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
    """Return an absorber of a concept (a key of `CONCEPTS`), None for the concept "none".

    ``values`` are in SI units by the names of their options. Values that are missing or None have
    the defaults of `impact_env.parameters`. Raises ParameterError for an unknown concept, for a
    name that the concept does not have, and for a value that is not allowed; the message calls the
    absorber ``name``.
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
    mass = {name: present[name] for name in MASS_OPTION if name in present}
    if concept == "friction":
        with arguments_called(FRICTION_NAMES):
            return friction_damper(**present)
    if concept == "none":
        return None
    walls = _choose_law(WALL_LAWS, present).make(present)
    return SlidingAbsorber(**mass, walls=walls, friction=_make_friction(present, walls))
