"""Cheap claims about the paper's frequency responses, its jump, its strongly modulated response and its compliant contact; and what measures them."""

from pathlib import Path

import numpy as np
import pytest

from impact_env import Beam, Exact, Moreau, beam_scene, impact_absorber
from impact_env.drive import Drive, constant_frequency, linear_sweep
from impact_env.ensemble import Lane, draw_members
from impact_env.periodic.residence import Approach, hold
from optimisation.files import read_json
from studies.paper import basics, conv, high_low, jump, smr
from studies.paper.claim import Claim, Verdict, from_plain
from studies.paper.frame import Settings
from studies.paper.study import FIGURES

DOCS = Path(__file__).resolve().parents[2] / "docs"
QUICK = Settings(Path("nowhere"), quick=True, threads=1)


def named(claims: list[Claim], name: str) -> Claim:
    return next(claim for claim in claims if claim.name == name)


def test_the_sliding_absorber_drifts_at_the_papers_step_only() -> None:
    """By the exact method whole periods of friction leave the absorber's place; a scheme that is late at each reversal moves it to a wall."""
    scene, (start, stop, _) = jump.scene(), jump.DRIFT
    drives = draw_members(3, 0, "phase").drives(1.5, linear_sweep(scene.model.resonance_omega(1), start, stop, 0.2))
    drifts = {method: [jump.Drifted(method)(Lane(scene, drive))[0] for drive in drives] for method in (Exact(), Moreau())}
    assert max(drifts[Exact()]) < 0.02e-3
    assert min(drifts[Moreau()]) > 0.04e-3


def test_one_mode_without_losses_at_its_contact_is_strongly_modulated() -> None:
    (*_, values) = smr.FIGURE.measure(QUICK, smr.Sizes(3, 300, (2, 100)), {})
    claims = smr.FIGURE.claims(values)
    for name in ("two impacts in the burst", "fewer impacts between", "lag near zero", "ninety per cent", "effective at resonance"):
        assert named(claims, name).verdict in (Verdict.HOLDS, Verdict.SPREAD), named(claims, name)
    assert all(0.5 < depth < 1 for depth in values["exact"]["depth"])
    record = values["exact"]["record"]
    assert np.max(np.abs(np.array(record["absorber_m"]) - record["tip_m"])) <= values["linear"]["gap_m"] * (1 + 1e-4)


@pytest.mark.nightly
def test_friction_springs_and_walls_approach_the_rigid_laws() -> None:
    for kind in (conv.WALLS, conv.FRICTION):
        found = conv._over_stiffness(QUICK, conv.sizes(3, 4, 3), kind, Exact())
        ratio = np.median(found["level_m"], axis=1) / np.median(found["rigid_m"])
        assert abs(ratio[-1] - 1) < 0.05
        assert abs(ratio[0] - 1) > 0.1


def test_on_the_high_branch_the_absorber_visits_two_walls_a_period_and_is_struck_more_often() -> None:
    scene = high_low.scene()
    lane = Lane(scene, hold(Approach(scene.model.resonance_omega(1), 1.0), 3.0, 0.955, 400.0))
    impacts, visits = high_low.Rhythm(Exact())(lane)
    assert visits == pytest.approx(2.0, abs=0.1)
    assert 3 < impacts < 6


@pytest.mark.parametrize("damper", [0.0, 0.1])
def test_a_damper_to_ground_is_that_of_an_own_integration(damper: float) -> None:
    """Small steps with elastic impacts, from rest over the first of them: at 0.1 N s/m two thirds of a free absorber's velocity would go."""
    scene, periods, each = beam_scene(Beam(modes=2), impact_absorber()), 5, 4000
    model, mass = scene.model, float(scene.absorber_mass or 0)
    omega, tip = model.resonance_omega(1), model.tip_shape
    found = basics.squares(scene, [Drive(4.0, constant_frequency(omega, 1.0, periods))], damper, Exact(), 1, 16)[:, 0]
    dt, q, v, a, u, impacts = 2 * np.pi / omega / each, np.zeros(2), np.zeros(2), 0.0, 0.0, 0
    tips = np.zeros(periods * each + 1)
    for k in range(periods * each):
        push = model.force_shape * 4.0 * np.cos(omega * (k + 0.5) * dt)
        q, a = q + 0.5 * dt * v, a + 0.5 * dt * u
        v, u = v + dt * (push - model.omega**2 * q - 2 * model.damping_ratio * model.omega * v), u * (1 - dt * damper / mass)
        closing, place = float(u - tip @ v), float(a - tip @ q)
        if abs(place) >= 1e-3 and place * closing > 0:
            impulse, impacts = 2 * closing / (1 / mass + tip @ tip), impacts + 1
            v, u = v + tip * impulse, u - impulse / mass
        q, a = q + 0.5 * dt * v, a + 0.5 * dt * u
        tips[k + 1] = tip @ q
    square = tips[: -1 : each // basics.SAMPLES].reshape(periods * 16, -1) ** 2
    assert impacts >= 3
    assert found == pytest.approx(square.mean(axis=1), abs=0.01 * square.max())


@pytest.mark.skipif(not (DOCS / "paper" / "claims.json.gz").exists(), reason="the page has not been measured yet")
def test_published_claims_are_on_the_page() -> None:
    content = read_json(DOCS / "paper" / "claims.json.gz")
    claims, page = [from_plain(plain) for plain in content["claims"]], (DOCS / "paper.md").read_text()
    assert not content["missing"]
    assert len(claims) >= 30
    assert len({claim.name for claim in claims}) == len(claims)
    for claim in claims:
        assert claim.statement.replace("|", "\\|") in page
        assert claim.figure in {figure.label for figure in FIGURES}
