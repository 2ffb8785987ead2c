"""A structure without finite elements, golden cases of loads, and loads over time.

The functions of time share nothing with the pieces of the kernels.
"""

from pathlib import Path

import numpy as np
from core import EVERYTHING
from numpy.typing import NDArray

from impact_env.drive import FrequencySchedule
from impact_env.laws import SceneKind
from impact_env.modes import ModalModel
from impact_env.results import Record
from impact_env.scene import Scene

Array = NDArray[np.float64]
# a uniform clamped-free beam in closed form: three modes, with the force at 0.4 of the length; tips
# alternate in sign
OMEGA = (252.3097218652803, 1581.1980362916618, 4427.40028691217)
FORCE_SHAPE = (0.6123449944147568, 1.8205634693679993, 1.4009099753247334)
TIP_SHAPE = (2.663708632848108, -2.6637086328480986, 2.663708632847805)
MASS = 0.56375
BETA = (1.8751040687119611, 4.694091132974174, 7.854757438237613)  # cosh cos = -1
# sqrt(kg): the integral of the shape over the mass
PARTICIPATION = tuple(
    2 * (np.sinh(b) - np.sin(b)) / (np.cosh(b) + np.cos(b)) / b * np.sqrt(MASS) for b in BETA
)
# impact times in s and relative velocities before them in m/s, by Duhamel's integral and root
# finding
TONES = (
    (0.04019227245696305, 0.528865743),
    (0.04149855306285344, -2.223935818),
    (0.0425315593100972, 2.870677179),
    (0.04459768234981616, -1.627346331),
    (0.04527233520049146, -0.953873455),
    (0.046778006443749215, 2.080058252),
    (0.04952736298729936, -2.776191844),
    (0.05040791402038946, 2.855403076),
    (0.05309388033185561, -1.781872723),
    (0.05525809092086492, 2.096258068),
)
GRAVITY = (
    (0.014806878132807498, -0.117827102),
    (0.020917768977148074, -0.077151321),
    (0.023741027561886712, -0.031302553),
    (0.024409728088152734, -0.011251100),
    (0.02585734076653175, -0.022952492),
    (0.046275100381747, -0.165733877),
    (0.050223405103677725, -0.031601777),
    (0.05121004421367017, -0.039067692),
    (0.0773283485349521, -0.251791359),
    (0.08774835287587945, 0.227846135),
)


def record_of(scene: Scene) -> Record:
    """Return the record of runs under loads.

    There is one set of observers for scenes with contact and one for those without, since each set
    is a further kernel.
    """
    return Record(series=True, energy=True) if scene.kind is SceneKind.LINEAR else EVERYTHING


def file_of_one_mode(damping_ratio: float) -> str:
    """Return the file of a structure with that cantilever's first frequency and mass."""
    shapes = "force_shape_per_sqrt_kg = [0.6]\ntip_shape_per_sqrt_kg = [2.6]"
    return (
        f"[model]\nomega_rad_s = [{OMEGA[0]}]\ndamping_ratio = "
        f"[{damping_ratio}]\n{shapes}\nbeam_mass_kg = {MASS}\n"
    )


def cantilever() -> ModalModel:
    """Return the closed-form cantilever."""
    rows = (np.array(row) for row in (OMEGA, np.full(3, 0.01), FORCE_SHAPE, TIP_SHAPE))
    return ModalModel(*rows, MASS, base_participation=np.array(PARTICIPATION))


def chain(folder: Path, held: bool = True, **more: Array) -> tuple[Array, Array]:
    """Three masses on springs, as matrices in a file."""
    mass = np.diag([1.0, 0.5, 1.5])
    stiffness = 1e4 * np.array(
        [[2.0 if held else 1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]
    )
    np.savez(folder / "m.npz", M=mass, K=stiffness, **more)
    return mass, stiffness


def chirp(schedule: FrequencySchedule, times: Array) -> tuple[Array, Array, Array]:
    """Return frequency (rad/s), its rate (rad/s^2) and phase (rad) of a schedule.

    The schedule has one linear piece. ``times`` are in s.
    """
    rate = (schedule.omegas[1] - schedule.omegas[0]) / schedule.times[1]
    return (
        schedule.omegas[0] + rate * times,
        np.full_like(times, rate),
        (schedule.omegas[0] + 0.5 * rate * times) * times,
    )


KINDS = (
    "force",
    "unbalance",
    "base",
    "tones",
    "orders",
    "samples",
    "random",
    "random base",
    "shock",
    "shock of the base",
    "strike",
)


def tables_of(omega: float, folder: Path) -> dict[str, str]:
    """Return a load of each kind as TOML, and write the record that one of them names.

    Loads last eight periods of a structure with the first frequency ``omega`` (rad/s).

    The base goes up to seven times that frequency.
    """
    period = 2 * np.pi / omega
    hertz = omega / (2 * np.pi)
    length = 8 * period
    times = np.linspace(0, 8 * period, 321)
    (folder / "record.csv").write_text(
        "time_s,value\n" + "".join(f"{t:.9f},{np.sin(omega * t):.9f}\n" for t in times)
    )
    up = (
        "schedule = "
        f"{{ times_s = [0, {length}], omegas_rad_s = [{0.5 * omega}, {7 * omega}], reference_rad_s = {omega} }}"
    )
    swept = (
        "schedule = "
        f"{{ times_s = [0, {length}], omegas_rad_s = [{0.95 * omega}, {1.05 * omega}], reference_rad_s = {omega} }}"
    )
    spectrum = f"spectrum = [[{0.5 * hertz}, 4.0], [{1.5 * hertz}, 4.0]]\nduration_s = {length}"
    tables = {
        "force": f"kind = 'force'\namplitude_n = 3.0\n{swept}",
        "unbalance": f"kind = 'unbalance'\nunbalance_kg_m = {3 / omega**2}\n{swept}",
        "base": f"kind = 'base'\nacceleration_m_s2 = 8.0\n{up}",
        "tones": f"kind = 'tones'\ntones = [{{ amplitude_n = 2.0, frequency_hz = {hertz} }}, "
        f"{{ amplitude_n = 2.0, frequency_hz = {3 * hertz} }}]\n"
        f"duration_s = {length}",
        "orders": (
            f"kind = 'tones'\norders = [{{ amplitude_n = 2.0, order = 1 }}, "
            f"{{ amplitude_n = 5.0, order = 3 }}]\n{swept}"
        ),
        "samples": "kind = 'samples'\nfile = 'record.csv'\nquantity = 'base_acceleration'\nscale = 9.81",
        "random": f"kind = 'random'\nseed = 1\n{spectrum}",
        "random base": f"kind = 'base'\n{spectrum}",
        "shock": (
            "kind = 'shock'\npulse = 'half-sine'\npeak_n = 60.0\npulse_s = "
            f"{0.4 * period}\nduration_s = {length}"
        ),
        "shock of the base": "kind = 'base'\npulse = 'trapezoid'\npeak_m_s2 = 60.0\npulse_s = "
        f"{0.4 * period}\nrise_s = {0.1 * period}\n"
        f"duration_s = {length}",
        "strike": f"kind = 'shock'\nvelocity_m_s = 0.5\nplace = 'absorber'\nduration_s = {length}",
    }
    return {kind: f"[load]\n{text}\n" for kind, text in tables.items()}
