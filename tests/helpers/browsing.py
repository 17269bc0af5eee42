"""Headless Chromium for tests that look at pages as a person does."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

_FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run "
    "--disable-background-networking --disable-component-update --disable-sync"
)


@contextmanager
def opened(address: str, **context) -> Iterator:
    """A page at an address; skips without Chromium or Playwright. Fails on errors of its scripts.

    context : of the browser, such as color_scheme or viewport.
    """
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        pytest.skip("Chromium is not installed")
    with playwright.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=found, args=_FLAGS.split())
        page = browser.new_page(**context)
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(address)
        try:
            yield page
        finally:
            browser.close()
        assert errors == []
