"""The peers that are measured against the package, against the reference with many digits."""

import numpy as np
import pytest
from core import drive_of, scene_of, still
from every_scene import SCENES

from impact_env import ElasticCoulombFriction, InitialState, SlidingAbsorber, impact_absorbers

pytest.importorskip("mpmath")
from impact_env.scene import beam_scene
from reference import digits
from reference.contact import Automaton
from studies.accuracy.event_driven import Integrator, Mechanics, PeerFailedError, PeerRun, follow, scipy_integrator

REST = InitialState()


def distance(name: str, found: PeerRun) -> float:
    """Return a peer's largest error of the end state, relative to its largest entry; its impacts must be those of the reference."""
    scene, drive = scene_of(SCENES[name], modes=2), drive_of(12.0, 0.97, 1.0, periods=3.3)
    true = digits.follow(scene, drive)
    assert len(found.impact_time) == len(true.impact_time) or name == "chatter"
    return float(np.max(np.abs(found.end_state - true.end_state)) / np.max(np.abs(true.end_state)))


@pytest.mark.parametrize("name", ["friction", "impacts", "springs", "tuned"])
def test_scipy_follows_the_reference(name: str) -> None:
    scene, drive = scene_of(SCENES[name], modes=2), drive_of(12.0, 0.97, 1.0, periods=3.3)
    found = follow(scene, drive, REST, scipy_integrator(1e-10), energy=True)
    assert found.balance is not None
    assert found.balance < 1e-8
    assert distance(name, found) < 1e-5


@pytest.mark.parametrize("name", ["friction", "impacts", "impacts and friction", "springs", "tuned"])
def test_heyoka_follows_the_reference(name: str) -> None:
    heyoka_peer = pytest.importorskip("studies.accuracy.heyoka_peer", exc_type=ImportError)
    scene, drive = scene_of(SCENES[name], modes=2), drive_of(12.0, 0.97, 1.0, periods=3.3)
    found = follow(scene, drive, REST, heyoka_peer.HeyokaRegimes(1e-15), energy=True)
    assert found.balance is not None
    assert found.balance < 1e-11
    assert distance(name, found) < 1e-8


def test_a_peer_that_misses_a_wall_is_refused() -> None:
    def blind(mechanics: Mechanics, automaton: Automaton) -> Integrator:
        step = scipy_integrator(1e-6)(mechanics, automaton)

        def integrate(_: object, start: float, stop: float, state: np.ndarray) -> tuple[float, np.ndarray, int]:
            return step(automaton.regime("linear"), start, stop, state)

        return integrate

    with pytest.raises(PeerFailedError, match="passed a guard"):
        follow(scene_of(SCENES["impacts"], modes=1), still(0.1), InitialState(absorber_velocity=0.05), blind)


def test_peers_refuse_what_they_do_not_cover() -> None:
    with pytest.raises(ValueError, match="elastic friction"):
        follow(scene_of(SlidingAbsorber(friction=ElasticCoulombFriction(0.1, 1e4))), drive_of(1.0, 1.0), REST, scipy_integrator(1e-6))
    with pytest.raises(ValueError, match="several absorbers"):
        follow(beam_scene(None, impact_absorbers((1e-3, 1e-3), (1.0, 0.5))), drive_of(1.0, 1.0), REST, scipy_integrator(1e-6))
    with pytest.raises(ValueError, match="bent"):
        follow(scene_of(), drive_of(1.0, 0.9, 1.0, 0.9), REST, scipy_integrator(1e-6))
