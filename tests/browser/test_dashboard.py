"""The dashboard in a browser, with rigs that run, slip and die meanwhile."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from pipeline.verdict import Event, Level, Status
from sinks.zenoh import ZenohSettings, ZenohSink
from tests.browser.conftest import visit
from tests.browser.rigs import Stage
from tests.pipeline.dashboard.served import served
from tests.pipeline.fleet.said import status

SLIP = "[{type: slip, camera: right, frames: 1, start_s: 25}]"
OFFSET = "{timestamp: {}, offset: {}}"
CONTRAST = Path(__file__).with_name("contrast.js")
MARKUP = "<img src=x onerror=\"document.body.dataset.run='1'\"><script>document.body.dataset.run='1'</script>"


@pytest.fixture(scope="module")
def stage(tmp_path_factory) -> Iterator[Stage]:
    made = Stage(tmp_path_factory.mktemp("rigs"))
    yield made
    made.end()


@pytest.fixture(scope="module")
def address(stage) -> str:
    return stage.dashboard("--port", "0")[1]


def card(page: Page, name: str):
    return page.locator(".card", has=page.locator(".name", has_text=name))


def word(page: Page):
    return page.locator(".hero .word")


PAINTED = """() => {
    const canvas = document.querySelector("canvas");
    const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    const colours = new Set();
    for (let at = 0; at < pixels.length; at += 4) colours.add(pixels.slice(at, at + 4).join());
    return colours.has("0,134,93,255");  // that of the state "in sync", by day
}"""


@pytest.mark.timeout(240)
def test_a_rig_in_the_field(chromium, stage, address, pictures):
    """Rigs appear, one slips and is called out of sync, one dies and is called gone; nobody reloads anything."""
    with visit(chromium, address) as page:
        expect(page.locator(".empty")).to_contain_text(f"No rig has been heard yet under {stage.prefix}/")
        stage.rig("cart", small=False, faults=SLIP, detectors=OFFSET, zenoh="preview: {every_s: 1}")
        expect(card(page, "cart").locator(".word")).to_have_text("In sync")
        tram = stage.rig("tram")
        stage.rig("gate", faults="[{type: dark, camera: left}]")
        stage.rig("crane", source="cameras: 3")
        stage.rig("lift", source="motion: still", detectors="{offset: {}}")

        card(page, "cart").locator("a").click()
        expect(word(page)).to_have_text("In sync")
        expect(page.locator(".link")).to_have_text("live")
        assert page.get_by_role("status").all_inner_texts() == ["live", "In sync"]
        expect(page.locator(".camera")).to_have_count(2)
        page.wait_for_function(
            "() => [...document.querySelectorAll('img.preview')].every((i) => i.naturalWidth === 320)"
        )
        page.wait_for_function("() => document.title.startsWith('✓ In sync: cart')")
        expect(page.locator("footer")).not_to_have_text(page.locator("footer").inner_text())
        page.wait_for_function(PAINTED)
        expect(page.locator("footer")).to_contain_text("% of verdicts within")
        expect(page.locator(".plot .more")).to_contain_text("over the last minute")

        expect(word(page)).to_have_text("Out of sync", timeout=100_000)
        expect(page.locator(".hero .detail")).to_contain_text("right is")
        expect(page.locator(".event")).to_contain_text("left – right, out of sync: slip")
        expect(page.locator(".plot .offset")).to_contain_text("+100.")
        page.wait_for_function("() => document.title.startsWith('✕ Out of sync: cart')")
        if "SYNCWATCH_IMAGES" in os.environ:
            page.wait_for_timeout(8000)  # so that the picture shows the step
        page.screenshot(path=pictures / "dashboard-rig.png")
    with visit(chromium, f"{address}rig?name=cart", phone=True, scheme="dark") as page:
        expect(word(page)).to_have_text("Out of sync")
        assert page.evaluate("document.documentElement.scrollWidth") == 390
        page.locator(".plot .chart").tap()
        expect(page.locator(".readout")).to_contain_text("ago:")
        page.screenshot(path=pictures / "dashboard-phone.png")

    with visit(chromium, f"{address}rig?name=tram") as page, visit(chromium, address, scheme="dark") as fleet:
        expect(word(page)).to_have_text("In sync")
        tram.kill()
        expect(word(page)).to_have_text("Monitor gone")
        expect(page.locator(".badge")).to_contain_text("last known: in sync")
        page.screenshot(path=pictures / "dashboard-gone.png")
        for name, state in {
            "cart": "Out of sync",
            "tram": "Monitor gone",
            "gate": "Warning",
            "lift": "Cannot tell",
            "crane": "In sync",
        }.items():
            expect(card(fleet, name).locator(".word")).to_have_text(state)
        assert fleet.locator(".card .name").all_inner_texts() == ["cart", "tram", "gate", "lift", "crane"]
        expect(fleet.locator(".counts")).to_contain_text("1 in trouble")
        fleet.set_viewport_size({"width": 1180, "height": 620})
        fleet.screenshot(path=pictures / "dashboard-fleet.png")


def test_a_page_of_hundreds_shows_trouble_large_and_the_rest_in_tiles(chromium, pictures):
    with served(monotonic_ns=lambda: 10**15) as site:  # a clock that stands, so that nothing turns stale
        for number in range(300):
            site.fleet.hear_status(f"hall{number % 3}/rig{number:03d}", status())
        apart = {"state": "async", "cause": "slip", "since_ns": 0, "offset_ms": 33.3, "offset_sigma_ms": 0.2}
        reasons = ["left-right: right is 33.3 ms later than left (slip)"]
        for name in ("hall0/rig105", "hall2/rig107"):
            site.fleet.hear_status(name, status("error", reasons=reasons, pairs={"left-right": apart}))
        site.fleet.hear_status("hall1/rig223", status("warn", reasons=["left sees nothing: its pictures are dark"]))
        address = f"http://127.0.0.1:{site.port}/"
        with visit(chromium, address, scheme="dark") as page:
            expect(page.locator(".card")).to_have_count(300)
            large = page.locator(".card[data-small=false]")
            assert large.locator(".name").all_inner_texts() == ["hall0/rig105", "hall2/rig107", "hall1/rig223"]
            expect(card(page, "hall0/rig000").locator(".word")).to_have_text("In sync")
            assert page.evaluate(CONTRAST.read_text()) == []
            page.screenshot(path=pictures / "dashboard-many.png")
            page.locator(".count[data-tone=good]").click()
            expect(page.locator("#good")).to_be_in_viewport()
            site.fleet.hear_status("hall0/rig000", status("error", reasons=["frozen"]))
            expect(page.locator(".card").first.locator(".name")).to_have_text("hall0/rig000")
        with visit(chromium, f"{address}#warn", phone=True) as page:
            expect(page.locator("#warn")).to_be_focused()
            expect(page.locator("#warn .name")).to_have_text("hall1/rig223")
            assert page.evaluate("document.documentElement.scrollWidth") == 390


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("path", ["", "rig?name=cart", "rig?name=nobody"])
def test_text_can_be_read_against_what_is_behind_it(chromium, address, scheme, path):
    with visit(chromium, address + path, scheme=scheme) as page:
        expect(page.locator(".card, .hero").first).to_be_visible()
        assert page.evaluate(CONTRAST.read_text()) == []


def test_what_comes_over_the_network_is_text_and_never_markup(chromium, stage, address):
    sink = ZenohSink(ZenohSettings(prefix=stage.prefix), rig="<b>odd<b>")
    sink.start()
    try:
        with visit(chromium, address) as page, visit(chromium, f"{address}rig?name=%3Cb%3Eodd%3Cb%3E") as rig:
            sink.take(Status("odd", 1, Level.ERROR, (MARKUP,), {}, {}, MARKUP, 1.0, 0))
            sink.take(Event("odd", "x-1", MARKUP, "onset", None, MARKUP, None, 1, None, {}, MARKUP))
            expect(card(page, "<b>odd<b>").locator(".detail")).to_have_text(MARKUP)
            expect(rig.locator(".hero .detail")).to_have_text(MARKUP)
            expect(rig.locator(".event p").first).to_have_text(MARKUP)
            for shown in (page, rig):
                assert shown.locator("main b b, main script, main img[src=x]").count() == 0
                assert shown.evaluate("document.body.dataset.run ?? null") is None
    finally:
        sink.stop()


def test_a_page_says_that_its_dashboard_is_gone_and_comes_back_by_itself(chromium, stage):
    process, address = stage.dashboard("--port", "0")
    port = address.rpartition(":")[2].strip("/")
    with visit(chromium, address, allowed="net::ERR_") as page:
        expect(page.locator(".link")).to_have_text("live")
        process.terminate()
        process.wait(10)
        alert = page.get_by_role("alert")
        expect(alert).to_have_text("Connection to the dashboard lost, trying again.")
        expect(page.locator(".banner")).to_contain_text("What is below is")
        page.wait_for_function("() => document.title.startsWith('⊘ not live')")
        stage.dashboard("--port", port)
        expect(page.locator(".banner")).to_be_hidden()
        expect(page.locator(".link")).to_have_text("live")


def test_the_token_is_asked_for_and_does_not_stay_in_the_address(chromium, stage):
    address = stage.dashboard("--port", "0", "--token", "open sesame, please")[1]
    with visit(chromium, address, allowed="401 (Unauthorized)") as page:
        page.get_by_label("Token").fill("open sesame, please")
        page.get_by_role("button").click()
        expect(page.locator(".link")).to_have_text("live")
        assert page.url == address
