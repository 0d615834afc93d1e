"""A headless Chromium that complains about everything a user would not see."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from tests.programs import ROOT

ARGUMENTS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
)
DESKTOP = {"width": 1180, "height": 820}
PHONE = {"width": 390, "height": 844}
WAIT_MS = 30_000


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    path = shutil.which("chromium")
    if path is None:
        pytest.fail("no chromium here: run tests/browser/setup.sh as root")
    expect.set_options(timeout=WAIT_MS)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS.split())
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def pictures() -> Path:
    """The folder of screenshots: `make images` renews those of the documentation."""
    folder = ROOT / os.environ.get("SYNCWATCH_IMAGES", "build/images")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextmanager
def visit(
    browser: Browser, address: str, *, scheme: str = "light", phone: bool = False, allowed: str | None = None
) -> Iterator[Page]:
    """A page that must load nothing from anywhere else and complain of nothing, but for what is `allowed`."""
    context: dict[str, Any] = {"viewport": DESKTOP, "color_scheme": scheme}
    if phone:
        context |= {"viewport": PHONE, "is_mobile": True, "has_touch": True, "device_scale_factor": 2}
    made = browser.new_context(**context)
    made.set_default_timeout(WAIT_MS)
    page = made.new_page()
    wrong: list[str] = []
    home = urlsplit(address)

    def look(request: Any) -> None:
        asked = urlsplit(request.url)
        if (asked.scheme, asked.netloc) != (home.scheme, home.netloc) and asked.scheme not in {"data", "blob"}:
            wrong.append(f"asked for {request.url}")

    page.on("request", look)
    page.on("console", lambda said: wrong.append(said.text) if said.type in {"error", "warning"} else None)
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.goto(address)
    try:
        yield page
    finally:
        made.close()
    assert [complaint for complaint in wrong if allowed is None or allowed not in complaint] == []
