"""The explorer's page in a real browser, with the network off: what is drawn, what a slider does, what is refused, what is saved."""

import csv
import http.server
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from places import ROOT

pytest.importorskip("starlette")
playwright = pytest.importorskip("playwright.sync_api", reason="no Playwright here: the explorer's page is not looked at")

from impact_env import performance_curve
from impact_env.plain import to_scene

BROWSER = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium here: the explorer's page is not looked at")
FAST = "#modes=3&friction=0.1&members=2"
WAIT = 120_000  # ms, for kernels that are compiled on the way
WATCH = """
window.order = {};
new MutationObserver(() => {
  for (const [name, value] of Object.entries(document.documentElement.dataset)) {
    const all = name.startsWith("shown") ? (window.order[name] ??= []) : [Number(value)];
    if (all.at(-1) !== Number(value)) all.push(Number(value));
  }
}).observe(document, { attributes: true, subtree: true });
"""


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    code = "from optimisation.cli.start import main; main()"
    words = [sys.executable, "-c", code, "explore", "--port", "0", "--no-browser"]
    with subprocess.Popen(words, env=os.environ | {"PYTHONPATH": str(ROOT)}, stdout=subprocess.PIPE, text=True) as process:
        yield process.stdout.readline().split()[0]
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as player:
        found = player.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield found
        found.close()


def opened(browser: Any, address: str, *, width: int = 1280, height: int = 800, colours: str = "light") -> tuple[Any, list[str]]:
    """Return a page that reaches nothing but the server, and a list that what goes wrong there is added to."""
    wrong: list[str] = []
    page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=colours)
    page.add_init_script(WATCH)
    page.route("**/*", lambda route: route.continue_() if route.request.url.startswith(address) else wrong.append(route.request.url) or route.abort())
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda told: wrong.append(told.text) if told.type == "error" else None)
    page.goto(address + FAST)
    return page, wrong


def finished(page: Any, number: int | None = None) -> int:
    """Wait until a setting's numbers and its curve of all members are drawn, by default the newest's, and return its number."""
    page.wait_for_selector("html[data-asked]", state="attached", timeout=WAIT)
    end = time.monotonic() + WAIT / 1000
    while True:
        asked = int(page.evaluate("document.documentElement.dataset.asked")) if number is None else number
        if page.locator(f'html[data-showncard="{asked}"][data-whole="{asked}"]').count():
            break
        assert time.monotonic() < end, page.evaluate("[document.querySelector('#status').textContent, {...document.documentElement.dataset}]")
        page.wait_for_timeout(100)
    return asked


def saved(page: Any, label: str, kind: str) -> Path:
    with page.expect_download() as download:
        page.get_by_label(label).select_option(kind)
    return Path(download.value.path())


@pytest.mark.same_bits
def test_numbers_are_those_of_the_library_and_files_are_whole(browser: Any, address: str) -> None:
    page, wrong = opened(browser, address)
    finished(page)
    rows = list(csv.reader(saved(page, "Save the curve as", "CSV").read_text().splitlines()))
    drawn = {float(force): float(level) for name, force, level in rows[1:] if name == "impact absorber"}
    page.get_by_text("Save", exact=True).first.click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Scene file").click()
    scene = to_scene(json.loads(Path(download.value.path()).read_text()))
    forces = sorted(drawn)
    wanted = performance_curve(scene, forces, members=2)
    assert [drawn[force] for force in forces] == pytest.approx((1e3 * wanted.median).tolist(), rel=1e-15)
    assert len(drawn) == 24
    assert saved(page, "Save the sweep as", "PNG").read_bytes().startswith(b"\x89PNG")
    assert saved(page, "Save the sweep as", "SVG").read_text().startswith("<svg ")
    with page.expect_download() as download:
        page.get_by_role("button", name="Card as HTML").click()
    assert f"{1e3 * performance_curve(scene, [3.5], members=2).median[0]:.4g} mm" in Path(download.value.path()).read_text()
    assert wrong == []
    page.close()


def test_a_slider_moves_the_curve_and_nothing_old_covers_it(browser: Any, address: str) -> None:
    page, wrong = opened(browser, address)
    finished(page)
    before = saved(page, "Save the curve as", "CSV").read_text()
    slider = page.get_by_label("Gap to either wall, mm")
    slider.focus()
    for _ in range(30):
        page.keyboard.press("ArrowRight")
        time.sleep(0.02)
    finished(page)
    assert saved(page, "Save the curve as", "CSV").read_text() != before
    order = page.evaluate("window.order")
    assert all(numbers == sorted(numbers) for numbers in order.values())
    assert order["showncurve"][-1] == int(page.evaluate("document.documentElement.dataset.asked"))
    assert "gap=" in page.url
    page.reload()
    finished(page)
    assert float(page.locator("#n-gap").input_value()) > 1
    assert wrong == []
    page.close()


def test_a_click_sets_the_force_and_an_instant(browser: Any, address: str) -> None:
    page, wrong = opened(browser, address)
    finished(page)
    box = page.locator("#curve .u-over").bounding_box()
    page.mouse.click(box["x"] + 0.3 * box["width"], box["y"] + 0.5 * box["height"])
    finished(page, 2)
    assert float(page.locator("#n-force").input_value()) < 3.5
    box = page.locator("#sweep .u-over").bounding_box()
    page.mouse.click(box["x"] + 0.7 * box["width"], box["y"] + 0.5 * box["height"])
    finished(page, 3)
    assert "instant=" in page.url
    assert page.locator("#motion .note").inner_text() == "around the chosen instant"
    assert wrong == []
    page.close()


def test_a_bad_value_is_told_beside_its_control(browser: Any, address: str) -> None:
    page, wrong = opened(browser, address)
    finished(page)
    gap = page.locator("#n-gap")
    gap.fill("-1")
    gap.press("Enter")
    page.wait_for_selector("#e-gap:not(:empty)")
    assert "0.02 to 50 mm" in page.locator("#e-gap").inner_text()
    assert gap.get_attribute("aria-invalid") == "true"
    gap.fill("1.2")
    gap.press("Enter")
    finished(page)
    assert page.locator("#e-gap").inner_text() == ""
    assert wrong == []
    page.close()


def test_two_tabs_have_their_own_settings(browser: Any, address: str) -> None:
    pages = [opened(browser, address)[0] for _ in range(2)]
    pages[1].select_option("#concept", "tuned")
    for page, concept in zip(pages, ("impact", "tuned"), strict=True):
        finished(page)
        assert page.locator("#concept").input_value() == concept
        assert f"{concept} absorber" in page.locator("#card .note").inner_text()
    for page in pages:
        page.close()


def test_advice_sets_the_controls(browser: Any, address: str) -> None:
    page, wrong = opened(browser, address)
    finished(page)
    page.locator("#n-force").fill("2")
    page.locator("#n-force").press("Enter")
    finished(page)
    page.get_by_role("button", name="Recommended").click()
    page.wait_for_selector("#why:not(:empty)", timeout=WAIT)
    assert "design rule" in page.locator("#why").inner_text()
    assert float(page.locator("#n-gap").input_value()) != 1
    assert wrong == []
    page.close()


def test_another_sites_page_reaches_nothing(browser: Any, address: str) -> None:
    class Foreign(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("content-type", "text/html")
            self.end_headers()
            self.wfile.write(b"<p>elsewhere</p>")

        def log_message(self, *_: Any) -> None:
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Foreign) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        page = browser.new_page()
        page.goto(f"http://127.0.0.1:{server.server_port}/")
        socket = f"ws://{address.removeprefix('http://')}socket"
        opens = "url => new Promise(done => { const s = new WebSocket(url); s.onopen = () => done('open'); s.onerror = () => done('refused'); })"
        assert page.evaluate(opens, socket) == "refused"
        reads = "url => fetch(url).then(() => 'read', () => 'refused')"
        assert page.evaluate(reads, address + "controls") == "refused"
        page.close()
        server.shutdown()


@pytest.mark.parametrize(("width", "height", "colours"), [(1280, 800, "light"), (1280, 800, "dark"), (1920, 1080, "light"), (1920, 1080, "dark")])
def test_it_fits_and_everything_has_a_name(browser: Any, address: str, width: int, height: int, colours: str) -> None:
    page, wrong = opened(browser, address, width=width, height=height, colours=colours)
    finished(page)
    size = page.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]")
    assert size[0] <= width
    assert size[1] <= height
    nameless = """[...document.querySelectorAll('input, select, button, canvas, progress')].filter(
      (e) => !(e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length)
        && e.closest('.plot') === null).map((e) => e.outerHTML)"""
    assert page.evaluate(nameless) == []
    outside = """[...document.querySelectorAll('.panel')].filter((p) => [...p.querySelectorAll('.uplot, dl, canvas')].some(
      (e) => e.getBoundingClientRect().bottom > p.getBoundingClientRect().bottom + 1)).map((p) => p.id)"""
    assert page.evaluate(outside) == []
    dark = int(re.findall(r"\d+", page.evaluate("getComputedStyle(document.body).backgroundColor"))[0]) < 128
    assert dark == (colours == "dark")
    assert wrong == []
    page.close()
