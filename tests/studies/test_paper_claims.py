"""Claims of the paper that are cheap to compute, against closed forms of beam, impact and absorber that share no code with the package."""

from copy import deepcopy
from typing import Any

import cantilever
import numpy as np
import pytest
import scipy.optimize
import scipy.signal
from numpy.typing import NDArray

from impact_env.parameters import Beam, impact_absorber
from impact_env.scene import beam_scene
from studies.paper import basics, modulation
from studies.paper.basics import compute_beam_numbers, compute_linear_numbers, compute_tuned_numbers
from studies.paper.claim import Claim, ClaimVerdict

Real = NDArray[np.float64]
# the paper's Table 1, typed again
LENGTH = 0.5
STIFFNESS = 362.88
DENSITY = 1.1275
DAMPING = 0.01
MODES = 10
MASS = DENSITY * LENGTH
ABSORBER = 0.02 * MASS
ROOTS = cantilever.roots(MODES)
OMEGA = ROOTS**2 * np.sqrt(STIFFNESS / DENSITY) / LENGTH**2
TIP, FORCE = (cantilever.shapes(MODES, at) / np.sqrt(MASS) for at in (1.0, 0.4))


@pytest.fixture(scope="module")
def values() -> dict[str, Any]:
    """The numbers of the part, those that need many runs made up as they are when all holds."""
    row = {"force": 1.5, "limits": [0.9, 1.06], "up": 0.955, "down": 1.045}
    same = [0.6, 0.59, 0.61]
    return {
        "beam": compute_beam_numbers(),
        "tuned": compute_tuned_numbers(),
        "linear": compute_linear_numbers(),
        "entry": [row],
        "window": [{"modes": 3, "force": 1.5, "relative": [0.5, 0.49], "shrinks": 0.98}],
        "step": [{"case": "one", "force": 1.5, "exact": same, "moreau": same}],
        "scaling": {"level_by_2": 0.0, "times_by_3": 1e-12, "impacts": 12},
        "damper": {
            "jumps": [
                {
                    "method": "exact",
                    "periods_per_percent": 725.0,
                    "runs": 4000,
                    "with": 1810,
                    "without": 1800,
                }
            ],
            "levels": [{"force_n": 1.5, "with": 6e-4, "without": 6e-4, "low": 0.99, "high": 1.02}],
        },
    }


def verdicts(claims: list[Claim]) -> dict[str, ClaimVerdict]:
    return {claim.name.removeprefix("basics_"): claim.verdict for claim in claims}


def amplitude(at: Real, stiffness: float, damping: float) -> Real:
    """Tip amplitude per newton with a spring and a damper between tip and absorber: modes and absorber as one dense system, by frequency."""
    stretch = np.append(-TIP, 1.0)
    mass = np.diag(np.append(np.ones(MODES), ABSORBER))
    rates, squares = (np.diag(np.append(row, 0.0)) for row in (2 * DAMPING * OMEGA, OMEGA**2))
    rates = rates + damping * np.outer(stretch, stretch)
    squares = squares + stiffness * np.outer(stretch, stretch)
    dynamic = squares[None] - at[:, None, None] ** 2 * mass + 1j * at[:, None, None] * rates
    solution = np.linalg.solve(
        dynamic, np.broadcast_to(np.append(FORCE, 0.0)[:, None], (len(at), MODES + 1, 1))
    )
    return np.asarray(np.abs(solution[:, :MODES, 0] @ TIP))


def test_the_beams_numbers_are_those_of_closed_forms(values: dict[str, Any]) -> None:
    beam = values["beam"]
    assert beam["omega_1"] == pytest.approx(OMEGA[0], rel=1e-6)
    assert beam["ratios"] == pytest.approx(
        list(OMEGA / OMEGA[0]), rel=1e-3
    )  # the elements show from the eighth mode on
    assert (round(OMEGA[1] / OMEGA[0], 1), round(OMEGA[2] / OMEGA[0], 1)) == (6.3, 17.5)
    # a mass stuck at the end: 1 + cos x cosh x = m_a/m x (sin x cosh x - cos x sinh x)
    loaded = scipy.optimize.brentq(
        lambda x: np.cos(x) + 1 / np.cosh(x) - 0.02 * x * (np.sin(x) - np.cos(x) * np.tanh(x)),
        1.5,
        1.88,
        xtol=1e-14,
    )
    assert beam["stuck_ratio"] == pytest.approx((loaded / ROOTS[0]) ** 2, rel=1e-5)
    for name in ("stiffness", "stiffness_of_modes"):
        assert beam[name] == pytest.approx(3 * STIFFNESS / LENGTH**3, rel=1e-9)
    left = np.exp(
        -2 * DAMPING * OMEGA * np.pi / OMEGA[0]
    )  # of what an impact leaves in a mode, half a period later
    assert beam["left_after_half_period"] == pytest.approx(list(left), rel=0.02)
    assert left[4] > 0.01 > left[5]


def test_den_hartogs_rule_and_the_papers_values(values: dict[str, Any]) -> None:
    def rule(mu: float) -> tuple[float, float]:
        own = OMEGA[0] / (1 + mu)
        return ABSORBER * own**2, 2 * ABSORBER * own * float(np.sqrt(3 * mu / (8 * (1 + mu))))

    tunings = values["tuned"]["tunings"]
    effective = ABSORBER * TIP[0] ** 2
    assert effective == pytest.approx(0.08, rel=1e-6)
    for name, (stiffness, damping) in {
        "Den Hartog": rule(effective),
        "modal mass of one": (rule(ABSORBER)[0], 2 * rule(ABSORBER)[1]),
    }.items():
        assert (tunings[name]["stiffness"], tunings[name]["damping"]) == pytest.approx(
            (stiffness, damping), rel=1e-5
        )
    misread = tunings["modal mass of one"]
    assert (misread["stiffness"], misread["damping"]) == pytest.approx((701.8, 0.728), rel=1e-3)


def test_peaks_with_each_tuned_absorber(values: dict[str, Any]) -> None:
    def peak(
        start: float, stop: float, stiffness: float = 0.0, damping: float = 0.0, mode: int = 0
    ) -> float:
        return float(
            amplitude(OMEGA[mode] * np.linspace(start, stop, 6001), stiffness, damping).max()
        )

    tunings = values["tuned"]["tunings"]
    heights = {}
    for name, tuning in tunings.items():
        own = (tuning["stiffness"], tuning["damping"])
        heights[name] = peak(0.5, 1.6, *own) / peak(0.5, 1.6)
        assert tuning["relative"] == pytest.approx(heights[name], rel=1e-3)
        assert tuning["within_limits"] == pytest.approx(
            peak(0.9, 1.06, *own) / peak(0.5, 1.6), rel=1e-3
        )
    assert heights["smallest peak"] <= heights["Den Hartog"] < 0.7 * heights["paper"]
    stiffness, damping = (tunings["smallest peak"][name] for name in ("stiffness", "damping"))
    others = [
        peak(0.7, 1.3, x * stiffness, y * damping)
        for x, y in ((1.01, 1), (0.99, 1), (1, 1.03), (1, 0.97))
    ]
    assert min(others) > peak(0.7, 1.3, stiffness, damping)
    second = peak(0.9, 1.06, 701.8, 0.728, mode=1) / peak(
        0.9, 1.06, mode=1
    )  # the paper's absorber at the second resonance
    assert values["tuned"]["second_relative"] == pytest.approx(second, rel=2e-3)
    for mode in (0, 1):  # the force at which the free tip fills the gap
        assert values["linear"]["gap_force_n"][str(mode + 1)] == pytest.approx(
            1e-3 / peak(0.9, 1.06, mode=mode), rel=2e-3
        )


def test_a_sweep_shows_nearly_the_stationary_level(values: dict[str, Any]) -> None:
    """Each mode's convolution with a chirp by the trapezoidal rule, and the RMS in a window, in plain numpy."""
    period = 2 * np.pi / OMEGA[0]
    each = 200
    levels = []
    for start, stop in ((0.9, 1.06), (1.06, 0.9)):
        duration = abs(stop - start) * 1e4 * period
        time = np.arange(int(duration / period) * each) * period / each
        force = np.cos(OMEGA[0] * (start * time + (stop - start) * time**2 / (2 * duration)))
        tip = np.zeros_like(time)
        for k in range(2):
            pole = OMEGA[k] * (-DAMPING + 1j * np.sqrt(1 - DAMPING**2))
            step = period / each
            factor = np.exp(pole * step)
            pushed = scipy.signal.lfilter(
                [step / 2, step / 2 * factor], [1, -factor], force.astype(complex)
            )
            tip += TIP[k] * FORCE[k] * pushed.imag / (OMEGA[k] * np.sqrt(1 - DAMPING**2))
        peak = int(np.argmax(np.abs(tip)))
        levels.append(np.sqrt(np.mean(tip[peak - 10 * each : peak + 10 * each] ** 2)))
    stationary = amplitude(OMEGA[0] * np.linspace(0.9, 1.06, 4001), 0.0, 0.0).max() / np.sqrt(2)
    assert values["linear"]["sweep_ratio"]["1"] == pytest.approx(max(levels) / stationary, rel=2e-3)


def test_claims_on_beam_and_tuned_absorber(values: dict[str, Any]) -> None:
    claims = basics.claims(values)
    refuted = {name for name, verdict in verdicts(claims).items() if verdict is ClaimVerdict.NOT}
    assert refuted == {"ltva", "ltva_second", "second_reason"}
    assert len(verdicts(claims)) == len(claims) == 17
    names = {"omega_2", "mass", "node", "stiffness", "own_period", "span", "scaling", "undamped"}
    assert {claim.name for claim in claims if claim.definitional} == {
        f"basics_{name}" for name in names
    }
    assert all(claim.why for claim in claims if claim.verdict is not ClaimVerdict.HOLDS)


CHANGES: dict[str, tuple[tuple[str, ...], Any]] = {
    "omega_2": (("beam", "ratios"), [1.0, 6.1, 17.5]),
    "stiffness": (("beam", "stiffness_of_modes"), 8700.0),
    "rate": (("linear", "sweep_ratio"), {"1": 0.7, "2": 0.99}),
    "limits": (("entry",), [{"force": 9.0, "limits": [0.9, 1.06], "up": 0.9, "down": 1.05}]),
    "window": (("window",), [{"modes": 3, "force": 1.5, "relative": [0.5, 0.6], "shrinks": 0.98}]),
    "step": (
        ("step",),
        [{"case": "one", "force": 1.5, "exact": [0.6, 0.59, 0.61], "moreau": [0.8, 0.79, 0.81]}],
    ),
    "scaling": (("scaling", "times_by_3"), 1e-3),
    "damper": (
        ("damper", "jumps"),
        [
            {
                "method": "exact",
                "periods_per_percent": 725.0,
                "runs": 4000,
                "with": 2100,
                "without": 1800,
            }
        ],
    ),
    "undamped": (("tuned", "undamped_relative"), 0.1),
}


@pytest.mark.parametrize("name", CHANGES)
def test_another_number_refutes_a_claim(name: str, values: dict[str, Any]) -> None:
    (*path, last), number = CHANGES[name]
    other = deepcopy(values)
    place = other
    for step in path:
        place = place[step]
    place[last] = number
    assert verdicts(basics.claims(values))[name] is ClaimVerdict.HOLDS
    assert verdicts(basics.claims(other))[name] is ClaimVerdict.NOT


@pytest.mark.parametrize("modes", [1, 3, 10])
@pytest.mark.parametrize("restitution", [1.0, 0.6])
def test_modes_take_from_the_first_what_a_lossy_impact_takes(
    modes: int, restitution: float
) -> None:
    """The impulse from Newton's law as a linear system of all velocities after the impact, and that of one mode with the equivalent restitution."""
    tip = TIP[:modes]
    before = np.append(
        np.random.default_rng(3).normal(size=modes), 0.7
    )  # velocities of modes and absorber

    def after(row: Real, velocities: Real, e: float) -> Real:
        mass = np.append(np.ones(len(row)), ABSORBER)
        towards = np.append(-row, 1.0)
        system = np.block([[np.diag(mass), -towards[:, None]], [towards[None], np.zeros((1, 1))]])
        return np.asarray(
            np.linalg.solve(system, np.append(mass * velocities, -e * towards @ velocities))
        )

    impulse = after(tip, before, restitution)[-1]
    closing = np.append(-tip, 1.0) @ before
    alone = np.array([0.0, closing])  # one mode and an absorber that close in as fast
    own = modulation.compute_equivalent_restitution(
        beam_scene(Beam(modes=modes), impact_absorber()), restitution
    )
    assert own == pytest.approx((1 + restitution) * (1 + 0.08) / (1 + 0.08 * modes) - 1, abs=2e-3)
    assert after(tip[:1], alone, own)[-1] == pytest.approx(impulse, rel=1e-3)


def test_the_depth_of_a_modulation_is_that_of_its_envelope() -> None:
    peaks = 1 + 0.4 * np.sin(np.linspace(0, 40 * np.pi, 4000))
    assert modulation.compute_depth(peaks) == pytest.approx(0.4 * np.sin(0.45 * np.pi), rel=1e-2)
    assert modulation.compute_depth(np.ones(10)) == 0
