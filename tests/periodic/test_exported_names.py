"""Names of `impact_env.periodic`: all are there, and those before work for one release."""

import pytest

from impact_env import periodic

FORMER_NAMES = {
    "confirmed": "confirm_orbit",
    "shot_orbit": "shoot_orbit",
    "stays": "residence_times",
    "unpacked": "unpack_orbits",
}


@pytest.mark.parametrize("name", periodic.__all__)
def test_exported_names_exist(name: str) -> None:
    assert getattr(periodic, name) is not None


@pytest.mark.parametrize(("former", "name"), FORMER_NAMES.items())
def test_former_names_are_those_of_now(former: str, name: str) -> None:
    assert getattr(periodic, former) is getattr(periodic, name)
    assert former not in periodic.__all__
