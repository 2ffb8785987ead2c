"""Reports have the same numbers as text, JSON, CSV, Markdown and HTML.

The page opens in a browser, draws its curves and requests nothing.
"""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from design_studies import search_swept
from drawing import bands, line
from matplotlib.figure import Figure
from PIL import Image

from impact_env import Beam, modal_model
from impact_env.curve import performance_curve
from impact_env.ensemble import Threads
from impact_env.periodic.balance_branches import BalanceRow
from impact_env.scene import Scene
from optimisation.files import write_files
from optimisation.report.balance_report import setting_table
from optimisation.report.gap_report import device_groups, printed_table
from optimisation.report.report import (
    Chart,
    Column,
    Curve,
    Report,
    Row,
    Table,
    choose_colours,
    draw_charts,
    list_files,
    list_named_files,
    render_card_json,
    render_card_text,
    render_html,
    render_markdown,
    render_text,
    show_span,
)
from optimisation.report.tuning_report import Tuning, TuningTable, amplitude_chart, card_groups
from optimisation.service import service_loads
from optimisation.tuned import den_hartog, highest_amplitude

CARD = Report(
    title="A <title> & more",
    verdict="It is <best>.",
    groups=(
        (
            "Device",
            (
                Row("mass", 0.0123456, "kg"),
                Row("words", "as they </script> are"),
                Row("not there", float("nan"), "m"),
            ),
        ),
    ),
    charts=(
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
    warnings=("take care",),
)


def test_text_json_and_html_say_the_same(tmp_path: Path) -> None:
    files = write_files(list_files(CARD, tmp_path))
    assert [file.name for file in files] == ["card.html", "card.json"]
    plain = json.loads(files[1].read_text())
    assert plain == render_card_json(CARD)
    assert plain["verdict"] == "It is <best>."
    assert "<p class='verdict'>It is &lt;best&gt;.</p>" in files[0].read_text()
    assert plain["groups"]["Device"] == [
        {"label": "mass", "value": 0.0123456, "unit": "kg"},
        {"label": "words", "value": "as they </script> are", "unit": ""},
        {"label": "not there", "value": None, "unit": "m"},
    ]
    for word in ("0.01235 kg", "not known", "take care"):
        assert word in render_card_text(CARD)
        assert word in files[0].read_text()
    assert render_html(CARD).count("</script>") == 3  # words do not end a script


TABLE = Table(
    (
        Column("name"),
        Column("gap_m", "gap, mm", scale=1e3),
        Column("low_m", "range, mm", show_span("low_m", "high_m", 1e3)),
        Column("high_m"),
        Column("share", "share, %", "{:.1f}", 100, "none"),
        Column(heading="name", show=lambda row: row["name"].upper()),
    ),
    [("a", 1.25e-3, 1e-3, 2e-3, 0.5), ("b", 2e-3, float("nan"), 3e-3, None)],
)


def test_a_table_says_the_same_in_every_form(tmp_path: Path) -> None:
    assert TABLE.records() == [
        {"name": "a", "gap_m": 1.25e-3, "low_m": 1e-3, "high_m": 2e-3, "share": 0.5},
        {"name": "b", "gap_m": 2e-3, "low_m": None, "high_m": 3e-3, "share": None},
    ]
    report = Report(
        title="Two devices",
        text=[["two of them:"], [TABLE]],
        tables={"devices.csv": TABLE},
        numbers={"devices": TABLE.records()},
        groups=CARD.groups,
        warnings=("take care",),
    )
    files = {file.name: file for file in write_files(list_files(report, tmp_path))}
    assert set(files) == {"devices.csv", "summary.json", "card.html", "card.json"}
    assert files["devices.csv"].read_text().splitlines() == [
        "name,gap_m,low_m,high_m,share",
        "a,0.00125,0.001,0.002,0.5",
        "b,0.002,,0.003,",
    ]
    assert json.loads(files["summary.json"].read_text()) == report.numbers
    text = render_text(report)
    assert text.splitlines() == [
        "two of them:",
        "",
        "| gap, mm | range, mm | share, % | name |",
        "| ------- | --------: | -------: | ---: |",
        "| 1.25    |    1 to 2 |     50.0 |    A |",
        "| 2       |         - |     none |    B |",
    ]
    whole = render_markdown(report)
    assert whole.startswith("# Two devices\n\ntwo of them:\n\n| gap, mm")
    for words in ("## Device", "| mass      |            0.01235 kg |", "- take care"):
        assert words in whole


def test_options_name_the_files_of_a_report(tmp_path: Path) -> None:
    first = Table.of_values(("a", "b"), [(1, 0.1), (2, None), (3, np.nan)])
    report = Report(
        title="Lists",
        numbers=[{"a": 1}, {"a": 2}],
        tables={"first.csv": first, "second.csv": Table.of_values(("c",), [])},
        figures={"first.png": lambda: Figure(figsize=(3, 2)), "second.png": Figure},
        resolution=50,
    )
    files = [tmp_path / name for name in ("n.json", "t.csv", "f.png")]
    assert write_files(list_named_files(report, *files)) == files
    assert json.loads(files[0].read_text()) == [{"a": 1}, {"a": 2}]
    assert files[1].read_text() == "a,b\n1,0.1\n2,\n3,\n"
    assert Image.open(files[2]).size == (150, 100)
    # what no option names is not written, nor what the report does not have
    assert write_files(list_named_files(report, None, plot=files[2])) == files[2:]
    assert write_files(list_named_files(Report(title="Nothing"), *files)) == files[:1]


def test_a_heading_may_be_empty_and_a_column_without_one_is_not_printed() -> None:
    columns = (Column("name", "name", "{}"), Column("hidden"), Column("closed", "", "{}"))
    table = Table(columns, [("first", 0.5, "open")])
    assert table.to_text().splitlines() == [
        "| name  |      |",
        "| ----- | ---: |",
        "| first | open |",
    ]
    assert table.records() == [{"name": "first", "hidden": 0.5, "closed": "open"}]


def test_settings_of_harmonic_balance_are_printed_in_whole_numbers() -> None:
    rows = [
        BalanceRow(20, 50.0, 0.0400106, True, 0.91079490, 0.95469864, -0.00523031, 131, 2.3896),
        BalanceRow(10, 12.5, reason="no solution"),
    ]
    head, _, *lines = setting_table(rows).to_text().splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in (head, *lines)]
    assert cells[0][:3] == ["harmonics", "weight", "error, %"]
    assert cells[1] == ["20", "50", "4.00", "0.910795", "0.954699", "-0.52", "2.39", "closed"]
    assert cells[2] == ["10", "12.5", "", "", "", "", "", "no solution"]


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
        address = write_files(list_files(CARD, tmp_path))[0].as_uri()
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
        row.label: row.value for _, rows in device_groups(advice, loads)[0] for row in rows
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
    cells = [
        line.strip("|").split("|") for line in printed_table(advice).to_text().splitlines()[2:]
    ]
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
    table = TuningTable(model, 0.02, 1, 0.5, 1.6, tunings)
    chart = amplitude_chart(table)
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
        for row in dict(card_groups(table, {}))[
            "What the tuning of the smallest peak bears under 1 N"
        ]
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


def test_a_figure_of_charts_has_their_curves_bands_and_marks() -> None:
    first, second = draw_charts(CARD.charts).axes
    x, y = line(first, "first")
    np.testing.assert_array_equal(x, [1.0, 2.0, 4.0])
    np.testing.assert_array_equal(y, [1.0, np.nan, 3.0])
    band = np.hstack(bands(first))  # in two parts: the middle is not known
    np.testing.assert_array_equal(band[:, [0, -1]], [[1.0, 4.0], [0.5, 2.0], [2.0, 4.0]])
    np.testing.assert_array_equal(line(first, "here: 2")[0], 2.0)
    assert (first.get_xscale(), first.get_yscale()) == ("log", "linear")
    assert (second.get_xscale(), second.get_yscale()) == ("linear", "log")
    (points,) = second.get_lines()
    assert points.get_linewidth() == 0.0
    assert points.get_marker() == "o"
    assert first.get_xlabel() == "x"
    assert first.get_title() == "Curves"


def test_points_are_drawn_by_their_abscissa() -> None:
    curve = Curve("c", (3.0, None, 1.0), (30.0, 20.0, 10.0), (29.0, 19.0, 9.0), (31.0, 21.0, 11.0))
    ordered = curve.in_order()
    assert (ordered.x, ordered.y) == ([1.0, 3.0], [10.0, 30.0])
    assert (ordered.low, ordered.high) == ([9.0, 29.0], [11.0, 31.0])
    assert Curve("d", (2.0, 1.0), (4.0, 5.0)).in_order().low == []


def test_an_absorber_has_one_colour_in_every_chart() -> None:
    def colours(*names: str) -> dict[str, int]:
        curves = tuple(Curve(name, [0.0], [0.0]) for name in names)
        return dict(zip(names, choose_colours(Chart("", "", "", curves)), strict=True))

    all_of_them = colours(
        "no absorber",
        "impact absorber",
        "friction damper",
        "tuned absorber, paper's values",
        "tuned absorber, well tuned",
        "measured",
    )
    assert len(set(all_of_them.values())) == len(all_of_them)
    fewer = colours("tuned absorber, well tuned", "impact absorber", "another")
    assert {name: all_of_them[name] for name in fewer if name != "another"}.items() <= fewer.items()
    assert len(set(fewer.values())) == 3
    two = colours("impact absorber, 10 g", "impact absorber, 20 g")
    assert two["impact absorber, 10 g"] == all_of_them["impact absorber"]
    assert len(set(two.values())) == 2
    assert len(colours(*map(str, range(20)))) == 20
