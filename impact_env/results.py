"""The results of a run: `Response` and its parts, and what a run records (`Record`)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import (
    count_from,
    describe_error,
    finite,
    flag,
    labelled,
    require,
)
from impact_env.drive import Drive, FrequencySchedule
from impact_env.fields import check_fields
from impact_env.loads import (
    Loads,
    Random,
    Samples,
    ShakenBase,
    Shock,
    Strike,
    Tone,
    Tones,
    Unbalance,
)
from impact_env.methods import Method
from impact_env.modes import ModalModel
from impact_env.parameters import (
    Absorber,
    Beam,
    FrictionLaw,
    Section,
    WallLaw,
)
from impact_env.result_files import SavedResult, TableResult
from impact_env.scene import InitialState, Scene

if TYPE_CHECKING:
    from impact_env.plots import Axes

Array = NDArray[np.float64]
MOST_BINS = 1_000_000
PLOT_BINS = 600  # columns of an envelope, about those of a figure
MOST_SAMPLES_PER_PERIOD = 100_000  # a pseudo period: the level keeps those of twenty
DEFAULT_SAMPLES = 32  # per pseudo period: the harmonics of the tip that count are resolved


@dataclass(frozen=True)
class Window:
    """A part of a run.

    Parameters
    ----------
    start, end : float
        First and last time in s; samples at both are included.

    Raises
    ------
    ParameterError
        A time is not finite, or the end is not after the start.

    Examples
    --------
    >>> from impact_env import Record, Window
    >>> Record(series=Window(0.5, 1.0)).series.end
    1.0
    """

    start: float
    end: float

    def __post_init__(self) -> None:
        check_fields(
            self,
            start=labelled("start of the window", finite),
            end=labelled("end of the window", finite),
        )
        require(
            self.start < self.end,
            "end of the window",
            self.end,
            f"above its start, {self.start:g} s",
        )


# how to record the parts of a response that a run leaves out unless it is asked for them
RECORDING = {
    "level": "Record(level=True)",
    "impacts": "Record(events=True)",
    "phases": "Record(events=True)",
    "history": "Record(series=True)",
    "energy": "Record(energy=True)",
    "check": "Record(check=True), by the exact method in a scene with contact",
    "envelope": "Record(envelope=100)",
    "reversals": "Record(reversals=True)",
}
Part = TypeVar("Part")


def require_recorded(name: str, part: Part | None) -> Part:
    """Return a part of a response, by its name in `Response`.

    Raises ParameterError if the run did not record it.
    """
    if part is None:
        allowed = f"recorded: simulate(..., record={RECORDING[name]})"
        raise describe_error(name, part, allowed)
    return part


@dataclass(frozen=True)
class Record:
    """What a run records.

    Parameters
    ----------
    level : bool, optional
        Response level (`Response.level`).
    events : bool, optional
        Impacts and contact phases (`Response.impacts`, `Response.phases`).
    series : bool or Window, optional
        State at the samples of the whole run, or of a part of it (`Response.history`).
    energy : bool, optional
        Work and losses (`Response.energy`).
    samples_per_period : int, optional
        Samples in a pseudo period, for level, series and envelope.
    check : bool, optional
        Whether the exact method's event search missed an event, by dense sampling
        (`Response.check`). For tests: the run takes much longer.
    envelope : int, optional
        Number B of equal parts of the run with their least and largest displacement
        (`Response.envelope`). None: no envelope.
    reversals : bool, optional
        Times without relative velocity (`Response.reversals`), for rigid contact and the exact
        method.

    Raises
    ------
    ParameterError
        A value is out of range.

    Examples
    --------
    >>> from impact_env import Record
    >>> Record(events=True).level
    True
    """

    level: bool = True
    events: bool = False
    series: bool | Window = False
    energy: bool = False
    samples_per_period: int = DEFAULT_SAMPLES
    check: bool = False
    envelope: int | None = None
    reversals: bool = False

    def __post_init__(self) -> None:
        check_fields(self, samples_per_period=count_from(4, MOST_SAMPLES_PER_PERIOD))
        if self.envelope is not None:
            check_fields(self, envelope=count_from(1, MOST_BINS))
        check_fields(
            self,
            level=flag,
            events=flag,
            series=lambda name, value: value if isinstance(value, Window) else flag(name, value),
            energy=flag,
            check=flag,
            reversals=flag,
        )


@dataclass(frozen=True)
class ResponseLevel:
    """Response level of a run.

    The place is that of the absorber on the beam (`Beam.absorber_position`), or the place of the
    response (`Beam.response_position`).

    Attributes
    ----------
    value : float
        RMS of the displacement in the window around its maximum, in m.
    time, frequency_ratio : float
        Time in s and frequency over the reference's at the maximum.
    max_tip : float
        Largest absolute displacement in m.
    """

    value: float
    time: float
    frequency_ratio: float
    max_tip: float


@dataclass(frozen=True, eq=False)
class EnergyAccount:
    """Work of the force, losses and stored energy in J over a run (paper, Eqs. Einst and edmi).

    Attributes
    ----------
    work : float
        Work of the force.
    modal_loss : array, (N_m,)
        Loss by the damping of each mode.
    friction_loss, impact_loss : float
        Losses by friction and by impacts.
    absorber_damping : float
        Loss in the damper of a tuned absorber or of compliant walls.
    stored_at_start, stored_at_end : float
        Energy of the state at both ends of the run.
    """

    work: float
    modal_loss: Array
    friction_loss: float
    impact_loss: float
    absorber_damping: float
    stored_at_start: float
    stored_at_end: float

    @property
    def balance_error(self) -> float:
        """Work less losses less increase of the stored energy, in J."""
        losses = (
            float(np.sum(self.modal_loss))
            + self.friction_loss
            + self.impact_loss
            + self.absorber_damping
        )
        return self.work - losses - (self.stored_at_end - self.stored_at_start)

    @property
    def relative_error(self) -> float:
        """Balance error relative to the largest term of the balance."""
        scale = max(
            abs(self.work),
            float(np.sum(self.modal_loss)),
            abs(self.stored_at_start),
            abs(self.stored_at_end),
        )
        return abs(self.balance_error) / scale if scale > 0 else abs(self.balance_error)


# of the time: what the rounding of two events' times may put between impacts at one instant
INSTANT_TOL = 1e-13


@dataclass(frozen=True, eq=False)
class Impacts(TableResult):
    """Impacts of a run, in the order of time.

    Impacts of several absorbers at one instant have no unique outcome in rigid-body mechanics: they
    are computed and listed one after the other, in the order of the absorbers (`simultaneous`).

    Attributes
    ----------
    time : array, (K,)
        Times in s.
    relative_velocity : array, (K,)
        Velocity absorber - tip before the impact in m/s.
    impulse : array, (K,)
        Impulse on the absorber in N s.
    energy_lost : array, (K,)
        Energy lost in J.
    absorber : array of int, (K,)
        Number of the absorber, counted from 0.
    """

    time: Array
    relative_velocity: Array
    impulse: Array
    energy_lost: Array
    absorber: NDArray[np.int64]

    @property
    def simultaneous(self) -> NDArray[np.bool_]:
        """Whether each impact (K,) is simultaneous with one of another absorber next to it.

        Impacts are simultaneous if their times differ by at most `INSTANT_TOL`.
        """
        close = np.diff(self.time) <= INSTANT_TOL * self.time[1:]
        close &= np.diff(self.absorber) != 0
        return np.append(False, close) | np.append(close, False)

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Return the impacts as columns, (K,) each."""
        return {
            "time_s": self.time,
            "relative_velocity_m_s": self.relative_velocity,
            "impulse_n_s": self.impulse,
            "energy_lost_j": self.energy_lost,
            "absorber": self.absorber,
        }


@dataclass(frozen=True, eq=False)
class ContactPhases(TableResult):
    """Joined phases of a run.

    Attributes
    ----------
    start, end : array, (K,)
        Times in s.
    kind : array of int, (K,)
        0: the absorber sticks inside the cavity, 1: wall contact at the lower wall, 2: at the
        upper.
    absorber : array of int, (K,)
        Number of the absorber, counted from 0.
    """

    start: Array
    end: Array
    kind: NDArray[np.int64]
    absorber: NDArray[np.int64]

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Return the phases as columns, (K,) each."""
        return {
            "start_s": self.start,
            "end_s": self.end,
            "kind": self.kind,
            "absorber": self.absorber,
        }


@dataclass(frozen=True, eq=False)
class Reversals:
    """Times at which the relative velocity of a moving absorber is zero.

    Friction then reverses its direction, or the absorber sticks.

    Attributes
    ----------
    time : array, (K,)
        Times in s.
    absorber : array of int, (K,)
        Number of the absorber, counted from 0.
    """

    time: Array
    absorber: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class History(TableResult):
    """State of a run at its S samples.

    Attributes
    ----------
    time : array, (S,)
        Times in s.
    modal_displacement, modal_velocity : array, (S, N_m)
        Modal displacements in sqrt(kg) m and velocities in sqrt(kg) m/s.
    absorber_displacement, absorber_velocity : array, (S,) or (S, n)
        Displacements in m and velocities in m/s of one absorber, or of n absorbers.
    tip_shape : array, (N_m,)
        Mode shapes at the tip in 1/sqrt(kg).
    """

    time: Array
    modal_displacement: Array
    modal_velocity: Array
    absorber_displacement: Array
    absorber_velocity: Array
    tip_shape: Array

    @property
    def tip_displacement(self) -> Array:
        """Tip displacement in m, (S,)."""
        return np.asarray(self.modal_displacement @ self.tip_shape)

    @property
    def tip_velocity(self) -> Array:
        """Tip velocity in m/s, (S,)."""
        return np.asarray(self.modal_velocity @ self.tip_shape)

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Return time, motion of the tip and motion of each absorber as columns, (S,) each."""
        columns: dict[str, NDArray[Any]] = {
            "time_s": self.time,
            "tip_displacement_m": self.tip_displacement,
            "tip_velocity_m_s": self.tip_velocity,
        }
        displacement = self.absorber_displacement.reshape(len(self.time), -1)
        velocity = self.absorber_velocity.reshape(len(self.time), -1)
        for k in range(displacement.shape[1]):
            name = "absorber" if displacement.shape[1] == 1 else f"absorber_{k + 1}"
            columns[f"{name}_displacement_m"] = displacement[:, k]
            columns[f"{name}_velocity_m_s"] = velocity[:, k]
        return columns


@dataclass(frozen=True, eq=False)
class Envelope(TableResult):
    """Least and largest displacement in B parts of a run, at the place of the response level.

    Attributes
    ----------
    edges : array, (B + 1,)
        Times in s between the parts.
    low, high : array, (B,)
        Least and largest displacement in m, NaN in a part without a sample.
    """

    edges: Array
    low: Array
    high: Array

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Return start, end, least and largest displacement of each part as columns, (B,) each."""
        return {
            "start_s": self.edges[:-1],
            "end_s": self.edges[1:],
            "least_displacement_m": self.low,
            "largest_displacement_m": self.high,
        }


@dataclass(frozen=True, eq=False)
class SearchCheck:
    """Check of the exact method's event searches by dense sampling of the guard signals.

    Attributes
    ----------
    searches, misses : int
        Number of checked searches, and of missed events.
    worst : float
        Largest violation: relative to the clearance (kind 0, a wall or spring is passed), to the
        terms of the relative velocity (kind 1, sliding in the wrong direction), or to those of the
        joint force (kind 2, out of its bounds).
    times, kinds, sizes : array, (K,)
        Times in s, kinds and violations of the first misses.
    """

    searches: int
    misses: int
    worst: float
    times: Array
    kinds: NDArray[np.int64]
    sizes: Array


def html_table(title: str, rows: Iterable[tuple[str, str]]) -> str:
    """Return a heading and two columns of text as HTML."""
    cells = "".join(
        (
            f'<tr><td style="text-align:left">{escape(name)}</td><td '
            f'style="text-align:left">{escape(text)}</td></tr>'
        )
        for name, text in rows
    )
    return f"<b>{escape(title)}</b><table>{cells}</table>"


class RecordedParts:
    """The parts of a response without None; each attribute has the name of a part of `Response`.

    Raises ParameterError for a part that the run has not recorded; the message names the `Record`
    needed.
    """

    def __init__(self, response: Response) -> None:
        self._response = response

    @property
    def level(self) -> ResponseLevel:
        """Response level."""
        return require_recorded("level", self._response.level)

    @property
    def impacts(self) -> Impacts:
        """Impacts."""
        return require_recorded("impacts", self._response.impacts)

    @property
    def phases(self) -> ContactPhases:
        """Joined phases of the absorbers."""
        return require_recorded("phases", self._response.phases)

    @property
    def history(self) -> History:
        """State at the samples."""
        return require_recorded("history", self._response.history)

    @property
    def energy(self) -> EnergyAccount:
        """Energy balance."""
        return require_recorded("energy", self._response.energy)

    @property
    def check(self) -> SearchCheck:
        """Check of the exact method's event search."""
        return require_recorded("check", self._response.check)

    @property
    def envelope(self) -> Envelope:
        """Least and largest displacements."""
        return require_recorded("envelope", self._response.envelope)

    @property
    def reversals(self) -> Reversals:
        """Times without relative velocity."""
        return require_recorded("reversals", self._response.reversals)


@dataclass(frozen=True, eq=False)
class Response(SavedResult, TableResult):
    """Result of a run.

    A part that was not recorded is None. `recorded` raises an error with the name of such a part.

    Attributes
    ----------
    scene, drive, method : Scene, Drive or Loads, Exact or Moreau or RungeKutta
        Arguments of the run.
    end_state : array, (2 N_m + 2 n,)
        State at the end, as `InitialState.vector`. `final_state` starts another run from it.
    impact_count : int
        Impacts of all absorbers.
    stuck_time : float
        Time in s in which absorbers stick or are held at a wall, summed over the absorbers.
    steps : int
        Time steps, or segments between the events of the exact method.
    evaluations : int
        Evaluations of the right-hand side, or of the exact method's event search, where a block of
        times counts once. 0 for linear scenes and the Moreau scheme.
    wall_time : float
        Duration of the computation in s.
    level : ResponseLevel or None
        Response level, with `Record` ``level=True``.
    impacts, phases : Impacts, ContactPhases or None
        Impacts and contact phases, with ``events=True``.
    history : History or None
        State at the samples, with ``series``.
    energy : EnergyAccount or None
        Work and losses, with ``energy=True``.
    check : SearchCheck or None
        Check of the event search, with ``check=True``. None also without an event search.
    envelope : Envelope or None
        Least and largest displacements, with ``envelope``.
    reversals : Reversals or None
        Times without relative velocity, with ``reversals=True``.
    """

    scene: Scene
    drive: Any  # Drive, or Loads
    method: Method
    end_state: Array
    impact_count: int
    stuck_time: float
    steps: int
    evaluations: int
    wall_time: float
    level: ResponseLevel | None = None
    impacts: Impacts | None = None
    phases: ContactPhases | None = None
    history: History | None = None
    energy: EnergyAccount | None = None
    check: SearchCheck | None = None
    envelope: Envelope | None = None
    reversals: Reversals | None = None

    @property
    def recorded(self) -> RecordedParts:
        """The recorded parts, whose types exclude None: ``response.recorded.history.time``.

        Raises ParameterError for a part that was not recorded.
        """
        return RecordedParts(self)

    @property
    def final_state(self) -> InitialState:
        """State at the end of the run, from which another run of the scene can continue.

        For example, ``simulate(scene, drive, initial=response.final_state)``.
        """
        return InitialState.from_vector(self.scene, self.end_state)

    def __repr__(self) -> str:
        level = self.level
        words = [
            f"{self.drive.describe(phase=False)} from 0 to {self.drive.schedule.times[-1]:.4g} s"
        ]
        if level is not None:
            words.append(
                f"level {1e3 * level.value:.4g} mm at {level.frequency_ratio:.4f} of the resonance"
            )
        words.append(
            f"{self.impact_count} impact{'s' * (self.impact_count != 1)}{self._simultaneous}"
        )
        return f"Response({self.scene}\n         {', '.join(words)})"

    @property
    def _simultaneous(self) -> str:
        """Return a note on impacts of several absorbers at one instant, if any are recorded."""
        number = 0 if self.impacts is None else int(np.sum(self.impacts.simultaneous))
        return f" ({number} at one instant with another absorber's, in their order)" * (number > 0)

    def _repr_html_(self) -> str:
        """Return the HTML table of a notebook."""
        run = (
            f"{self.drive.describe(phase=False)} from 0 to {self.drive.schedule.times[-1]:.4g} s, "
            f"{self.method}"
        )
        rows = [
            ("scene", str(self.scene)),
            ("run", run),
            ("impacts", f"{self.impact_count}{self._simultaneous}"),
            ("time stuck or held", f"{self.stuck_time:.4g} s"),
        ]
        if self.level is not None:
            rows.append(
                (
                    "response level",
                    (
                        f"{1e3 * self.level.value:.4g} mm at {self.level.frequency_ratio:.4f} of "
                        "the resonance"
                    ),
                )
            )
            rows.append(("largest displacement", f"{1e3 * self.level.max_tip:.4g} mm"))
        if self.energy is not None:
            rows.append(("error of the energies' balance", f"{self.energy.relative_error:.1e}"))
        return html_table("Response", rows)

    def plot(self, axes: Axes | None = None, **options: Any) -> Axes:
        """Draw the displacement's envelope and the level, and return matplotlib's axes.

        The envelope is drawn over the frequency, or over time if the frequency is constant.

        ``options`` go to matplotlib's fill_between. Raises ParameterError unless the run has
        recorded its series or an envelope (`Record`).
        """
        from impact_env.plots import plot_envelope

        time, low, high = self.displacement_columns()
        schedule = self.drive.schedule
        level = self.level
        swept = bool(np.ptp(schedule.omegas) > 0)
        x = schedule.omega_at(time) / schedule.reference if swept else time
        point = None
        if level is not None:
            point = (level.frequency_ratio if swept else level.time, level.value)
        return plot_envelope(x, low, high, point, swept, axes, options)

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Return the state at the samples as columns, as `History.to_columns`.

        Raises ParameterError unless the run recorded its series.
        """
        return self.recorded.history.to_columns()

    def displacement_columns(self) -> tuple[Array, Array, Array]:
        """Return times (B,) in s, and smallest and largest displacement (B,) in m around each time.

        The place is that of the response level. Raises ParameterError if the run has recorded
        neither its series nor an envelope.
        """
        envelope = self.envelope
        if envelope is not None:
            return (envelope.edges[1:] + envelope.edges[:-1]) / 2, envelope.low, envelope.high
        history = self.history
        if history is None:
            allowed = (
                "one that has its motion: simulate(..., record=Record(series=True)), "
                "or Record(envelope=600)"
            )
            raise describe_error("response", self, allowed)
        values = history.modal_displacement @ self.scene.model.level_shape
        bins = min(PLOT_BINS, len(values))
        pieces = np.array_split(np.arange(len(values)), bins) if bins > 0 else []
        return (
            np.array([np.mean(history.time[piece]) for piece in pieces]),
            np.array([np.min(values[piece]) for piece in pieces]),
            np.array([np.max(values[piece]) for piece in pieces]),
        )


# what a result is made of, in files
SavedResult.classes |= {
    part.__name__: part
    for part in (
        *(ContactPhases, EnergyAccount, Envelope, History, Impacts, Record, ResponseLevel),
        *(Reversals, SearchCheck, Window),
        *(Scene, InitialState, ModalModel, Beam, Section),
        *get_args(Absorber),
        *get_args(WallLaw),
        *get_args(FrictionLaw),
        *(Drive, FrequencySchedule, Loads, Random, Samples, ShakenBase, Shock, Strike),
        *(Tone, Tones, Unbalance),
        *get_args(Method),
    )
}
