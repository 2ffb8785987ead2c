"""Cards: the same numbers as text, JSON and HTML, and a page that opens in a browser, draws its curves and asks for nothing."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from design_studies import search_swept

from impact_env import Beam, modal_model
from impact_env.curve import performance_curve
from impact_env.ensemble import Threads
from impact_env.scene import Scene
from optimisation.report.card import Card, Chart, Curve, Row, content, page, text, write_card
from optimisation.report.cards import tuning_card
from optimisation.report.gap_report import card as gap_card
from optimisation.report.gap_report import text as gap_table
from optimisation.report.tuning_report import Tuning, TuningTable
from optimisation.service import service_loads
from optimisation.tuned import den_hartog, highest_amplitude

CARD = Card(
    "A <title> & more",
    (
        (
            "Device",
            (
                Row("mass", 0.0123456, "kg"),
                Row("words", "as they </script> are"),
                Row("not there", float("nan"), "m"),
            ),
        ),
    ),
    (
        Chart(
            "Curves",
            "x",
            "y",
            (
                Curve(
                    "first", (1.0, 2.0, 4.0), (1.0, None, 3.0), (0.5, None, 2.0), (2.0, None, 4.0)
                ),
            ),
            (("here", 2.0),),
            log_x=True,
        ),
        Chart(
            "Points", "x", "y", (Curve("second", (0.0, 1.0), (5.0, 6.0), points=True),), log_y=True
        ),
    ),
    ("take care",),
)


def test_text_json_and_html_say_the_same(tmp_path: Path) -> None:
    files = write_card(tmp_path, CARD)
    assert [file.name for file in files] == ["card.html", "card.json"]
    plain = json.loads(files[1].read_text())
    assert plain == content(CARD)
    assert plain["groups"]["Device"] == [
        {"label": "mass", "value": 0.0123456, "unit": "kg"},
        {"label": "words", "value": "as they </script> are", "unit": ""},
        {"label": "not there", "value": None, "unit": "m"},
    ]
    for word in ("0.01235 kg", "not known", "take care"):
        assert word in text(CARD)
        assert word in files[0].read_text()
    assert page(CARD).count("</script>") == 3  # words do not end a script


def test_page_draws_in_a_browser_and_asks_for_nothing(tmp_path: Path) -> None:
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="no Playwright here: the card is not looked at"
    )
    browser = next(
        (
            path
            for name in ("chromium", "chromium-browser", "google-chrome")
            if (path := shutil.which(name))
        ),
        None,
    )
    if browser is None:
        pytest.skip("no Chromium here: the card is not looked at")
    requests = []
    wrong = []
    with playwright.sync_playwright() as player:
        page = player.chromium.launch(executable_path=browser, args=["--no-sandbox"]).new_page()
        page.on("request", lambda request: requests.append(request.url))
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on(
            "console",
            lambda message: wrong.append(message.text) if message.type == "error" else None,
        )
        address = write_card(tmp_path, CARD)[0].as_uri()
        page.goto(address)
        page.wait_for_selector(".u-over >> nth=1")
        box = page.locator(".u-over").first.bounding_box()
        page.mouse.move(box["x"] + box["width"] - 2, box["y"] + 20)
        page.wait_for_function("document.querySelector('.legend').innerText.includes('3 (2 to 4)')")
        assert page.locator("canvas").count() == 2
        page.emulate_media(media="print")
        assert [page.locator(name).first.is_visible() for name in (".printed", ".plot")] == [
            True,
            False,
        ]
        assert "here" in page.locator(".printed").first.inner_text()
    assert [url for url in requests if not url.startswith("data:")] == [address]
    assert wrong == []


def test_card_of_a_gap_is_of_the_recommended_device() -> None:
    model = modal_model(Beam(modes=2))
    advice = search_swept(model, 3.5, members=1, rate=40.0)
    best = advice.recommended
    loads = service_loads(advice, best, Threads(1))
    card_rows = {
        row["label"]: row["value"]
        for rows in content(gap_card(advice, loads))["groups"].values()
        for row in rows
    }
    assert card_rows["clearance to either wall"] == 1e3 * best.gap
    assert card_rows["absorber mass"] == pytest.approx(0.02 * model.beam_mass)
    curve = performance_curve(
        Scene(model, best.absorber),
        [3.5],
        members=1,
        limits=advice.check.limits,
        percent_per_100_periods=40.0,
        steady_start=True,
    )
    assert card_rows["at 3.5 N, median of 1 runs"] == pytest.approx(1e3 * curve.median[0])
    cells = [line.strip("|").split("|") for line in gap_table(advice).splitlines()[2:]]
    levels = [(row[2].strip(), row[3].strip()) for row in cells]
    assert levels
    assert not [level for level, band in levels if band == f"{level} to {level}"]  # of one run
    impacts = curve.lanes.impacts[0, 0]
    time = (
        1e4 * (advice.check.limits[1] - advice.check.limits[0]) / 40.0 * 2 * np.pi / model.omega[0]
    )
    assert card_rows["impacts"] == pytest.approx(impacts.max() / time)
    assert 0 < card_rows["RMS impact speed"] < card_rows["largest impact speed"]
    # power is at most what the fastest impact loses, as often as impacts are
    lost = 0.5 * card_rows["absorber mass"] * (1 - 0.7**2) * card_rows["largest impact speed"] ** 2
    assert 0 < card_rows["power lost in impacts"] < 1e3 * lost * card_rows["impacts"]


def test_card_of_tunings_draws_their_peaks() -> None:
    model = modal_model(Beam(modes=2))
    absorber = den_hartog(model, 0.02)
    none, own = (highest_amplitude(model, one, 1, 0.5, 1.6) for one in (None, absorber))
    tunings = (
        Tuning("none", "no absorber", None, *none, 1.0),
        Tuning("minimax", "smallest peak", absorber, *own, 0.3),
    )
    card = tuning_card(TuningTable(model, 0.02, 1, 0.5, 1.6, tunings), {})
    (chart,) = card.charts
    assert max(y for y in chart.curves[0].y if y is not None) == pytest.approx(100.0)
    assert max(y for y in chart.curves[1].y if y is not None) == pytest.approx(
        100 * own[0] / none[0]
    )
    # two masses on a beam of two modes, solved densely at the frequencies drawn
    omega = np.array(chart.curves[0].x) * model.omega[0]
    mass = 0.02 * model.beam_mass
    spring = absorber.stiffness
    damper = absorber.damping
    stretch = np.append(-model.tip_shape, 1.0)
    dynamic = [
        np.diag(
            [*(model.omega**2 - w**2 + 2j * model.damping_ratio * model.omega * w), -mass * w**2]
        )
        + (spring + 1j * w * damper) * np.outer(stretch, stretch)
        for w in omega
    ]
    moved = np.linalg.solve(
        dynamic, np.append(model.force_shape, 0.0).astype(complex)[None, :, None]
    )[..., 0]
    stroke = np.abs(moved @ stretch)
    card_rows = {
        row.label: row.value
        for row in dict(card.groups)["What the tuning of the smallest peak bears under 1 N"]
    }
    assert card_rows["stroke of the absorber, to either side"] == pytest.approx(1e3 * stroke.max())
    assert card_rows["power lost in the damper"] == pytest.approx(
        1e3 * (damper * (omega * stroke) ** 2 / 2).max()
    )
    assert card_rows["largest acceleration of the absorber"] == pytest.approx(
        (omega**2 * np.abs(moved[:, -1])).max()
    )
    assert card_rows["largest acceleration of the structure"] == pytest.approx(
        (omega**2 * np.abs(moved[:, :-1] @ model.tip_shape)).max()
    )
