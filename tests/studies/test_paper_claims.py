"""Claims of the paper that are cheap to compute agree with closed forms.

The closed forms of beam, impact and absorber share no code with the package.
"""

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
from optimisation.files import DOCS
from studies.paper import basics, further, jump, modulation, smr
from studies.paper.basics import compute_beam_numbers, compute_linear_numbers, compute_tuned_numbers
from studies.paper.claim import REASONS, STATED, Claim, ClaimVerdict, judge_cases
from studies.paper.study import FIGURES, make_claims_table, make_paths
from studies.study import Json, read_measurement

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
    same = [0.6, 0.59, 0.61]
    return {
        "beam": compute_beam_numbers(),
        "tuned": compute_tuned_numbers(),
        "linear": compute_linear_numbers(),
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
    """Return the tip amplitude per newton with a spring and a damper to the absorber.

    Modes and absorber are one dense system, which is solved for each frequency.
    """
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
    """A sweep has nearly the stationary level.

    Each mode's convolution with a chirp by the trapezoidal rule, and the RMS in a window, are
    computed in plain numpy.
    """
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
    assert refuted == {"ltva"}
    assert len(verdicts(claims)) == len(claims) == 15
    names = {"omega_2", "mass", "node", "stiffness", "own_period", "span", "scaling", "undamped"}
    assert {claim.name for claim in claims if claim.definitional} == {
        f"basics_{name}" for name in names
    }
    assert all(claim.why for claim in claims if claim.verdict is not ClaimVerdict.HOLDS)


CHANGES: dict[str, tuple[tuple[str, ...], Any]] = {
    "omega_2": (("beam", "ratios"), [1.0, 6.1, 17.5]),
    "stiffness": (("beam", "stiffness_of_modes"), 8700.0),
    "rate": (("linear", "sweep_ratio"), {"1": 0.7, "2": 0.9}),
    "window": (("window",), [{"modes": 3, "force": 1.5, "relative": [0.5, 0.6], "shrinks": 0.98}]),
    "step": (
        ("step",),
        [{"case": "one", "force": 1.5, "exact": [0.6, 0.59, 0.61], "moreau": [0.8, 0.79, 0.81]}],
    ),
    "scaling": (("scaling", "times_by_3"), 1e-3),
    "damper": (
        ("damper",),
        {
            "jumps": [
                {
                    "method": "exact",
                    "periods_per_percent": 725.0,
                    "runs": 4000,
                    "with": 2100,
                    "without": 1800,
                }
            ],
            "levels": [{"force_n": 1.5, "with": 7e-4, "without": 6e-4, "low": 1.1, "high": 1.2}],
        },
    ),
    "undamped": (("tuned", "undamped_relative"), 0.1),
    "ltva_second": (("tuned", "second_relative"), 0.7),
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
    """Other modes take from the first one what an impact with loss takes.

    The impulse follows from Newton's law as a linear system of all velocities after the impact. It
    equals that of one mode with the equivalent restitution.
    """
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


# Statements on published numbers: what they say today, and that another number refutes them.

HOLDS = ClaimVerdict.HOLDS
SPREAD = ClaimVerdict.SPREAD
NOT = ClaimVerdict.NOT


def published(label: str) -> Json:
    """Return a copy of a figure's published values."""
    figure = next(figure for figure in FIGURES if figure.label == label)
    return deepcopy(read_measurement(figure.part(), make_paths(DOCS)).values)


def judge(label: str, name: str, values: Json) -> Claim:
    """Return the claim of a figure by its name."""
    figure = next(figure for figure in FIGURES if figure.label == label)
    return next(claim for claim in figure.claims(values) if claim.name == name)


def set_first_impacts(values: Json, ratio: float) -> None:
    for row in values["limits"]:
        for way in ("up", "down"):
            row[way]["first_impact"] = ratio * row[way]["start"]


def scale_sweep(values: Json, factor: float) -> None:
    orbit = np.array(values["branch"]["orbit_m"])[:, None]
    values["branch"]["sweep_m"] = (factor * orbit * np.ones((1, 4))).tolist()


def set_impacts(values: Json, number: float) -> None:
    values["orbits"]["impacts"] = [number] * 5


def set_multiplier(values: Json, number: float) -> None:
    for row in values["folds"]:
        row["multipliers"] = [[number, 0.0]]


def set_modulated(values: Json, number: int) -> None:
    for row in values["basin"]:
        row["kinds"] = {further.MODULATED: number, further.SLIDING: 100 - number}


def set_least_blow(values: Json, least: float) -> None:
    for row in values["blows"]:
        row["impacting"] = int(row["blow"] >= least)


def set_slip_share(values: Json, share: float) -> None:
    values["sliding"]["share"] = share


def set_spacing(values: Json, factor: float) -> None:
    for one in values["exact"]["spacing_spread"]:
        one["low"] = factor * one["high"]


def set_rms(values: Json, factor: float) -> None:
    values["exact"]["rms_m"] = [factor * x for x in values["exact"]["rms_m"]]


def reverse_shares(values: Json, _: float) -> None:
    rows = values["jumps, exact"]
    keys = ("share", "low", "high")
    for row, other in zip(rows, [dict(row) for row in rows[::-1]], strict=True):
        row.update({key: other[key] for key in keys})


def set_damper(values: Json, factor: float) -> None:
    """Scale the damper's levels at the highest forces: no rise after the minimum."""
    own, none = (values[name] for name in ("damper, muN = 0.5 N", "no absorber"))
    own["level"] = [[factor * x for x in row] for row in none["level"]]


def shift_departure(values: Json, _: float) -> None:
    """Let the curve with impacts leave that of friction alone at the lowest force already."""
    values["muN = 0.1 N, e = 1"]["level"][0] = [
        1.5 * x for x in values["muN = 0.1 N, e = 1"]["level"][0]
    ]


def scale_friction(values: Json, factor: float) -> None:
    own, free = (values[f"muN = {limit}, e = 1"] for limit in ("0.1 N", "0"))
    own["level"] = [[factor * x for x in row] for row in free["level"]]


def scale_second_forces(values: Json, factor: float) -> None:
    for curve in values["around 2"]["curves"].values():
        curve["forces"] = [factor * x for x in curve["forces"]]


def set_absorber(values: Json, factor: float) -> None:
    for resonance in ("resonance 1", "resonance 2"):
        curves = values[resonance]["curves"]
        curves["impact"]["level"] = [[factor * x for x in row] for row in curves["none"]["level"]]


def set_depth(values: Json, factor: float) -> None:
    values["modes"][-1]["depth"] = [factor * x for x in values["modes"][0]["depth"]]


def set_ten_modes(values: Json, factor: float) -> None:
    most = max(values, key=int)
    for resonance in values["10"]:
        values["10"][resonance]["relative"] = [
            factor * x for x in values[most][resonance]["relative"]
        ]


def set_passed(values: Json, share: float) -> None:
    for key, row in values.items():
        if not key.startswith("signal"):
            row["in_stated_range"] = [share] * len(row["in_stated_range"])


def raise_orbits(values: Json, tip: float) -> None:
    values["orbits, 1 mode, e = 0.75"]["branches"][0]["tip"][0] = tip


JUDGED: dict[str, tuple[str, str, ClaimVerdict, Any, tuple[tuple[float, ClaimVerdict], ...]]] = {
    # figure, claim, published verdict, change, and its number with the verdict on it
    "limits": (
        "further",
        "limits",
        SPREAD,
        set_first_impacts,
        ((1.0, NOT), (1.001, NOT), (1.02, HOLDS)),
    ),
    "branch": ("further", "branch", SPREAD, scale_sweep, ((1.04, HOLDS), (0.9, NOT), (1.1, NOT))),
    "orbits": ("further", "orbits", HOLDS, set_impacts, ((2.0, HOLDS), (3.0, NOT))),
    "folds": ("further", "folds", HOLDS, set_multiplier, ((1.0, HOLDS), (-1.0, NOT), (1.1, NOT))),
    "basin": ("further", "basin", HOLDS, set_modulated, ((90, HOLDS), (50, SPREAD), (10, NOT))),
    "perturbation": (
        "further",
        "perturbation",
        SPREAD,
        set_least_blow,
        ((0.5, HOLDS), (0.1, NOT)),
    ),
    "sliding": ("further", "mainly sliding", HOLDS, set_slip_share, ((0.6, HOLDS), (0.1, SPREAD))),
    "regular": ("SMR", "less regular between", SPREAD, set_spacing, ((1.2, HOLDS), (0.8, NOT))),
    "linear": ("SMR", "linear design", HOLDS, set_rms, ((1.0, HOLDS), (0.2, NOT))),
    "faster": ("jump", "faster is worse", HOLDS, reverse_shares, ((0.0, NOT),)),
    "ceased": (
        "oprangeTWO",
        "oprangeTWO_ceased",
        HOLDS,
        raise_orbits,
        ((0.5e-3, HOLDS), (1.5e-3, NOT)),
    ),
    "passed": ("varom", "varom_passed", SPREAD, set_passed, ((0.97, HOLDS), (0.02, NOT))),
    "robust": (
        "dissinf",
        "dissinf_robust",
        HOLDS,
        scale_friction,
        ((1.2, HOLDS), (1.4, ClaimVerdict.STEP), (0.6, ClaimVerdict.STEP)),
    ),
    "departs": ("dissinf", "dissinf_departs", HOLDS, shift_departure, ((0.0, SPREAD),)),
    "similar": ("dissinf", "dissinf_similar", HOLDS, set_damper, ((1.0, SPREAD),)),
    "reason": ("m12", "m12_reason", HOLDS, scale_second_forces, ((1.0, HOLDS), (0.5, NOT))),
    "limited": ("m12", "m12_limited", HOLDS, set_absorber, ((0.5, SPREAD), (0.95, NOT))),
    "insensitive": (
        "modulation",
        "modulation_insensitive",
        NOT,
        set_depth,
        ((0.5, NOT), (1.0, HOLDS)),
    ),
    "ten modes": (
        "modes_needed",
        "modes_needed_first",
        SPREAD,
        set_ten_modes,
        ((1.03, HOLDS), (1.2, NOT)),
    ),
}


@pytest.mark.parametrize("case", JUDGED)
def test_a_statement_on_published_numbers_is_judged_by_them(case: str) -> None:
    label, name, verdict, change, expected = JUDGED[case]
    assert judge(label, name, published(label)).verdict is verdict
    for number, own in expected:
        values = published(label)
        change(values, number)
        assert judge(label, name, values).verdict is own, number


def test_several_cases_hold_or_not_where_each_does() -> None:
    assert judge_cases([HOLDS, HOLDS]) is HOLDS
    assert judge_cases([NOT, NOT]) is NOT
    assert judge_cases([HOLDS, NOT]) is SPREAD
    assert judge_cases([HOLDS, SPREAD]) is SPREAD


def test_each_published_statement_that_does_not_hold_names_its_kind_of_cause() -> None:
    for figure in FIGURES:
        for claim in figure.claims(published(figure.label)):
            if claim.verdict is not HOLDS:
                texts = STATED[figure.label].get(claim.name)
                assert texts is None or texts["reason"] in REASONS, claim.name
                assert claim.reason in REASONS


def test_numbers_of_a_claim_stand_in_its_row_and_decide_it() -> None:
    claims = [claim for figure in FIGURES for claim in figure.claims(published(figure.label))]
    table = make_claims_table(claims)
    rows = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
    counted = 0
    for row in rows:
        if row["least"] == "" and row["most"] == "":
            continue
        counted += 1
        low = float(row["low"])
        high = float(row["high"])
        least = float(row["least"]) if row["least"] != "" else -np.inf
        most = float(row["most"]) if row["most"] != "" else np.inf
        slack = 1e-4 * max(abs(low), abs(high), 1.0)
        inside = least - slack <= low and high <= most + slack
        outside = high < least - slack or low > most + slack
        if not inside:
            assert row["verdict"] != "holds", row["name"]
        if outside:
            assert row["verdict"] in ("does not hold", "holds only at the paper's step")
    assert counted > 110


# New numbers beside closed forms.


def compute_first_impact(force: float, start: float, stop: float) -> float:
    """Return the frequency ratio at which |q_tip| of a sweep from rest first reaches 1 mm.

    It is computed by recursive filters of all modes in plain numpy.
    """
    each = 2000
    step = 2 * np.pi / OMEGA[0] / each
    duration = abs(stop - start) * 1e4 * 2 * np.pi / OMEGA[0]
    time = np.arange(int(duration / step)) * step
    drive = force * np.cos(OMEGA[0] * (start * time + (stop - start) * time**2 / (2 * duration)))
    tip = np.zeros_like(time)
    for k in range(3):  # higher modes move by less than 1e-4 mm
        damped = OMEGA[k] * np.sqrt(1 - DAMPING**2)
        factor = np.exp((-OMEGA[k] * DAMPING + 1j * damped) * step)
        state = scipy.signal.lfilter(
            [step / 2, step / 2 * factor], [1, -factor], drive.astype(complex)
        )
        tip += TIP[k] * FORCE[k] * state.imag / damped
    first = time[int(np.argmax(np.abs(tip) >= 1e-3))]
    return float(start + (stop - start) * first / duration)


def test_first_impacts_of_sweeps_are_those_of_the_linear_motion() -> None:
    rows = {row["force_n"]: row for row in published("further")["limits"]}
    for force in (3.0, 4.0):
        for way, start, stop in (("up", 0.9, 1.06), ("down", 1.06, 0.9)):
            expected = compute_first_impact(force, start, stop)
            assert rows[force][way]["first_impact"] == pytest.approx(expected, abs=3e-4)
    computed = further.measure_first_impacts((3.0,))[0]
    assert computed == rows[3.0]


def test_the_stiffer_mode_without_absorber_has_the_wanted_amplitude() -> None:
    relative = np.array([0.2, 0.5, 0.9])
    stiffness = smr.compute_stiffening(relative)
    amplitude = 1 / np.abs(stiffness - 1 + 2j * DAMPING * np.sqrt(stiffness))
    assert amplitude * 2 * DAMPING == pytest.approx(relative, rel=1e-9)
    assert np.all(stiffness > 1)


def test_the_absorber_slides_once_friction_cannot_accelerate_it() -> None:
    own = published("further")["sliding"]
    assert own["slip_tip_m"] == pytest.approx(0.01 / (ABSORBER * OMEGA[0] ** 2), rel=1e-5)


def test_regular_impacts_have_no_spread_and_random_ones_one() -> None:
    assert smr.compute_relative_spread(np.full(100, 0.5)) == 0
    random = np.random.default_rng(1).exponential(0.5, 20000)
    assert smr.compute_relative_spread(random) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("carried", [False, True])
def test_a_blow_changes_the_velocity_of_the_first_mode(carried: bool) -> None:
    scene = jump.make_scene()
    before, after = (
        further.make_blow(scene, 0.95, 1.0, size, carried).initial for size in (0.0, 2.0)
    )
    assert before is not None
    assert after is not None
    velocity = np.asarray(after.modal_velocity) - np.asarray(before.modal_velocity)
    omega = 0.95 * scene.model.resonance_omega(1)
    # the sliding motion is nearly the linear one: amplitude of a single mode at 0.95 of its
    # resonance
    linear = 1.5 * abs(scene.model.force_shape[0]) / scene.model.omega[0] ** 2
    linear /= abs(1 - 0.95**2 + 2j * DAMPING * 0.95)
    assert velocity[0] == pytest.approx(2 * linear * omega, rel=0.02)
    assert velocity[1] == 0
    push = float(np.asarray(after.absorber_velocity) - np.asarray(before.absorber_velocity))
    expected = scene.model.tip_shape[0] * velocity[0] if carried else 0.0
    assert push == pytest.approx(expected, abs=1e-12)
