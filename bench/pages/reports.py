"""Parts of the reports of a session as pictures in docs/images/, as headless Chromium shows them.

    rig demo demo/ && rig check demo/ && python -m bench.pages.reports demo/

Needs Playwright and Chromium (`apt install chromium`).
"""

import argparse
import io
import shutil
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

from imaging.files import store
from imaging.session.paths import find_reconstruction

IMAGES = Path(__file__).parents[2] / "docs" / "images"
WIDTH, SCALE = 1100, 1.5
"""CSS pixels of the window, and pixels of the picture for each."""
COLOURS = 128
"""A page has few: so a picture is a fifth of its size."""
MOST = 300_000
"""Bytes of a picture."""

PARTS = {
    "check-measures": ("check", "body", "text=Skew >> nth=1"),
    "check-sheet": ("check", "h2:has-text('Contact sheet')", "details >> nth=1"),
    "calibration-verdicts": ("calibration", "#calibrated h2", "h3:has-text('Poses')"),
    "calibration-poses": ("calibration", "h3:has-text('Poses')", "text=From above"),
    "calibration-light": ("calibration", "h3:has-text('Light')", "h3:has-text('Response')"),
    "calibration-choices": (
        "calibration",
        "#calibrated h3:has-text('Model choices')",
        "#calibrated tr:has-text('response curve')",
    ),
    "reconstruction-views": ("reconstruction", "body", "#pictures h3 >> nth=1"),
    "reconstruction-quality": ("reconstruction", "#quality h2", "#quality h3 >> nth=0"),
    "reconstruction-curves": ("reconstruction", "#quality h3 >> nth=0", "#quality h3:has-text('Cost')"),
}
"""Name: the page, where the picture begins, and before what it ends."""


def pictures(session: Path) -> None:
    """Write every part of the reports of a session that is checked, calibrated and reconstructed."""
    pages = {
        "check": session / "check" / "report.html",
        "calibration": session / "calibration" / "report.html",
        "reconstruction": find_reconstruction(session) / "report.html",
    }
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": WIDTH, "height": 900}, device_scale_factor=SCALE)
        for name, (page, begin, end) in PARTS.items():
            tab.goto(pages[page].resolve().as_uri())
            tab.evaluate("document.querySelectorAll('img').forEach(image => { image.loading = 'eager' })")
            tab.wait_for_function("[...document.images].every(image => image.complete)")
            picture = _between(tab, begin, end)
            assert len(picture) <= MOST, f"{name} has {len(picture)} bytes"
            store.write_bytes(IMAGES / f"{name}.png", picture)
        browser.close()


def _between(tab: Any, begin: str, end: str) -> bytes:
    """PNG of a page from one element to another."""
    top, bottom = (tab.locator(where).first.bounding_box()["y"] for where in (begin, end))
    top = max(0.0, top - 12)
    clip = {"x": 0, "y": top, "width": WIDTH, "height": bottom - 16 - top}
    image = Image.open(io.BytesIO(tab.screenshot(full_page=True, clip=clip))).convert("RGB")
    out = io.BytesIO()
    image.quantize(COLOURS, method=Image.Quantize.MEDIANCUT).save(out, "PNG", optimize=True)
    return out.getvalue()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("session", type=Path)
    pictures(parser.parse_args().session)
