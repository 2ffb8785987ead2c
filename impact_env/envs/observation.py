"""Names, meanings and units of the features that agents observe.

A task's observation is a row of such features; its columns are named by them.
"""

from dataclasses import dataclass

FEATURE_LIMIT = 100.0  # of a scaled feature; what lies outside is cut off
FEW_IMPACTS = 4.0  # the same of feature 5 in newer tasks, so that chatter stays of order one


@dataclass(frozen=True)
class Feature:
    """One number of an observation.

    Attributes
    ----------
    name : str
        Name of the feature.
    measured : bool
        Whether a sensor measures it, with noise and delay. Other features are known to the
        machine's control.
    what : str
        Description for the tables of the environments (`shells.list_features`), with names of
        arguments in braces.
    unit : str
        Unit and scale for these tables.
    """

    name: str
    measured: bool
    what: str
    unit: str = "1"


LENGTH_UNIT = "m / half-clearance"
OF_SCENE = "m / half-clearance of the scene"
PER_VELOCITY = "m/s / (half-clearance times the resonance's circular frequency)"
TIP_IN_PHASE = Feature(
    "tip amplitude in phase with the force",
    True,
    "amplitude of the tip in phase with the force, over the last interval",
    LENGTH_UNIT,
)
TIP_QUADRATURE = Feature(
    "tip amplitude a quarter behind the force",
    True,
    "amplitude of the tip a quarter of a period behind the force",
    LENGTH_UNIT,
)
DISTANCE = Feature(
    "absorber's place in the cavity",
    True,
    "place of the absorber relative to the tip at the end of the interval",
    LENGTH_UNIT,
)
VELOCITY = Feature(
    "absorber's velocity in the cavity",
    True,
    "velocity of the absorber relative to the tip",
    PER_VELOCITY,
)
IMPACTS = Feature(
    "impacts per pseudo period", True, "impacts in the last interval", "per pseudo period / 2{few}"
)
SHARE = Feature(
    "absorber's share of the energy",
    True,
    "share of the absorber's kinetic energy in the energy of beam and absorber",
)
FREQUENCY = Feature(
    "frequency", False, "frequency ratio to the resonance, minus {origin}", "1 / {scale}"
)
TIME_LEFT = Feature("time left", False, "remaining share of the time budget")
LEVEL_FEATURE = Feature("level", True, "response level so far", "m / {level}")
RMS = Feature(
    "RMS of the last interval", True, "RMS of the tip over the last interval", LENGTH_UNIT
)
DISTANCE_TO_END = Feature(
    "way left", False, "far frequency minus present frequency", "ratio / {scale}"
)
GAP_IN_USE = Feature("half-clearance in use", False, "half-clearance in use", OF_SCENE)
FRICTION_IN_USE = Feature(
    "friction limit in use",
    False,
    "friction limit in use",
    "place in the range, from -1 to 1",
)
STATE = (
    TIP_IN_PHASE,
    TIP_QUADRATURE,
    DISTANCE,
    VELOCITY,
    IMPACTS,
    SHARE,
    FREQUENCY,
    TIME_LEFT,
    LEVEL_FEATURE,
)
SWEEP_RATE = Feature(
    "rate of the frequency", False, "rate of the frequency", "% per 100 pseudo periods / 4"
)
UNIT_VELOCITY = "m/s / unit of velocity"
STATE_IN_PERIOD = (
    Feature("tip displacement", True, "displacement of the tip", LENGTH_UNIT),
    Feature("tip velocity", True, "velocity of the tip", UNIT_VELOCITY),
    Feature(DISTANCE.name, True, "place of the absorber relative to the tip", LENGTH_UNIT),
    Feature(VELOCITY.name, True, "velocity of the absorber relative to the tip", UNIT_VELOCITY),
    IMPACTS,
    Feature("cosine of the force's phase", False, "cosine of the force's phase"),
    Feature("sine of the force's phase", False, "sine of the force's phase"),
    FREQUENCY,
    TIME_LEFT,
    Feature("RMS of the last period", True, "RMS of the tip over the last period", LENGTH_UNIT),
)
UNIT_ACCELERATION = (
    "m/s^2 / (half-clearance times the square of the resonance's circular frequency)"
)
ACCELERATIONS = (
    Feature("acceleration of the tip", True, "mean acceleration of the tip", UNIT_ACCELERATION),
    Feature(
        "acceleration of the absorber", True, "mean acceleration of the absorber", UNIT_ACCELERATION
    ),
)
KNOWN_TO_CONTROL = STATE_IN_PERIOD[5:9]  # phase of the force, frequency and time
STRUCTURE_NUMBERS = (
    Feature(
        "damping ratio of the first mode", False, "damping ratio of the first mode", "1 / 0.01"
    ),
    Feature("second frequency over the first", False, "second frequency over the first", "1 / 5"),
    Feature(
        "absorber's mass over the first mode's",
        False,
        "absorber's mass times the square of the first mode's shape at it",
        "1 / 0.08",
    ),
)
