"""Cards: the same numbers as text, JSON and HTML, and a page that opens in a browser, draws its curves and asks for nothing."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from impact_env import Beam, modal_model
from impact_env.curve import performance_curve
from impact_env.scene import Scene
from optimisation.gap_advice import advise
from optimisation.gap_card import bearing
from optimisation.report.card import Card, Chart, Curve, Row, content, numbers, page, text, write_card
from optimisation.report.gap_table import card as gap_card

CARD = Card(
    "A <title> & more",
    (("Device", (Row("mass", 0.0123456, "kg"), Row("words", "as they </script> are"), Row("not there", float("nan"), "m"))),),
    (
        Chart(
            "Curves", "x", "y", (Curve("first", (1.0, 2.0, 4.0), (1.0, None, 3.0), (0.5, None, 2.0), (2.0, None, 4.0)),), (("here", 2.0),), log_x=True
        ),
        Chart("Points", "x", "y", (Curve("second", (0.0, 1.0), (5.0, 6.0), points=True),), log_y=True),
    ),
    ("take care",),
)


def test_text_json_and_html_say_the_same(tmp_path: Path) -> None:
    files = write_card(tmp_path, CARD)
    assert [file.name for file in files] == ["card.html", "card.json"]
    found = json.loads(files[1].read_text())
    assert found == content(CARD)
    assert found["groups"]["Device"] == [
        {"label": "mass", "value": 0.0123456, "unit": "kg"},
        {"label": "words", "value": "as they </script> are", "unit": ""},
        {"label": "not there", "value": None, "unit": "m"},
    ]
    for word in ("0.01235 kg", "not known", "take care"):
        assert word in text(CARD)
        assert word in files[0].read_text()
    assert page(CARD).count("</script>") == 2  # words do not end a script
    assert numbers([1.0, float("inf")]) == (1.0, None)


def test_page_draws_in_a_browser_and_asks_for_nothing(tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium here")
    (html, _), log = write_card(tmp_path, CARD), tmp_path / "net.json"
    line = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", f"--log-net-log={log}", "--dump-dom"]
    line += [f"--user-data-dir={tmp_path / 'profile'}", html.as_uri()]
    found = subprocess.run(line, capture_output=True, text=True, timeout=120, check=True).stdout
    assert found.count("<svg") == 2
    assert found.count("<polyline") == 1
    assert found.count("<polygon") == 1
    assert "first" in found.split('id="charts"')[1]
    asked = {url for url in log.read_text().split('"') if url.startswith(("http://", "https://")) and html.name in url}
    assert not asked
    assert "http" not in html.read_text().replace("http-equiv", "").replace("http://www.w3.org/2000/svg", "")


def test_card_of_a_gap_is_of_the_recommended_device() -> None:
    model = modal_model(Beam(modes=2))
    found = advise(model, 3.5, members=1, percent_per_100_periods=40.0)
    best = found.recommended
    seen = bearing(found, best, 1)
    told = {row["label"]: row["value"] for rows in content(gap_card(found, seen))["groups"].values() for row in rows}
    assert told["clearance to either wall"] == 1e3 * best.gap
    assert told["absorber mass"] == pytest.approx(0.02 * model.beam_mass)
    curve = performance_curve(Scene(model, best.absorber), [3.5], members=1, limits=found.check.limits, percent_per_100_periods=40.0)
    assert told["at 3.5 N, median of 1 runs"] == pytest.approx(1e3 * curve.median[0])
    impacts = curve.lanes.impacts[0, 0]
    time = 1e4 * (found.check.limits[1] - found.check.limits[0]) / 40.0 * 2 * np.pi / model.omega[0]
    assert told["impacts"] == pytest.approx(impacts.max() / time)
    assert 0 < told["RMS impact speed"] < told["largest impact speed"]
    # power is at most what the fastest impact loses, as often as impacts are
    lost = 0.5 * told["absorber mass"] * (1 - 0.7**2) * told["largest impact speed"] ** 2
    assert 0 < told["power lost in impacts"] < 1e3 * lost * told["impacts"]
    low, high = seen.helps
    assert low <= 3.5 <= high
    assert found.at_force(best, 1.0) == pytest.approx(best.level)
