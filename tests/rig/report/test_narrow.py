"""Report pages in a narrow window: what a camera is called takes no room from the values."""

from pathlib import Path

import pytest

from imaging.files import store
from rig.report.pages.calibration import calibration_report

LONG = "kodak-z612-zoom-digital-camera-" + 60 * "x"
"""A camera's name, of which a part has no place to break at."""
ROWS = """() => [...document.querySelectorAll('th[scope=row]')].map(label => {
    const value = label.parentElement.lastElementChild, table = label.closest('table');
    return {label: label.innerText, width: value.clientWidth / table.parentElement.clientWidth,
            over: table.scrollWidth - table.parentElement.clientWidth,
            height: label.parentElement.clientHeight};
})"""


def imported(session: Path) -> None:
    """Let a session be as one of photographs is that came from a camera with a long name."""
    for name in ("session.json", "plans.jsonl", "shots.jsonl", "calibration/calibration.json"):
        path = session / name
        text = path.read_text().replace('"cam0"', f'"{LONG}"')
        path.write_text(text.replace('"plan": "scene"', f'"plan": "import-{LONG}-1"'))
    record = store.read_json(session / "session.json")
    store.write_json(session / "session.json", record | {"origin": "import", "seed": None})


@pytest.mark.parametrize("width", [360, 420, 700, 1200])
def test_long_names_leave_room_for_the_values(toy: Path, browser, width: int) -> None:
    imported(toy)
    path = calibration_report(toy)
    tab = browser.new_page(viewport={"width": width, "height": 800})
    try:
        tab.goto(path.as_uri())
        rows = tab.evaluate(ROWS)
        assert any(f"import-{LONG}-1" in row["label"].replace("\n", "") for row in rows)
        for row in rows:
            assert row["width"] > 0.4, row
            assert row["over"] <= 1, row
            assert row["height"] < 200, row
        assert tab.evaluate("document.getElementById('provenance').offsetHeight") < 1500
        assert tab.evaluate("document.documentElement.scrollWidth") <= width
    finally:
        tab.close()
