"""The first moments of a page, before there is a scene."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from imaging.errors import InputError
from imaging.files import store
from imaging.session.paths import find_reconstruction
from rig.view.pages.opening import show_scenes
from rig.view.serving.server import Viewer

WATCH = """
window.foreign = new Set();
const look = () => {
  for (const one of document.querySelectorAll("label, button, p, div")) {
    const words = one.childElementCount ? "" : one.textContent.trim();
    if (/^(Dev Settings|Scene tree|Orbit Origin Tool|Save Canvas)$/.test(words)
        && one.checkVisibility({ visibilityProperty: true }) && one.getBoundingClientRect().height > 0)
      foreign.add(words);
  }
  const bare = document.body && getComputedStyle(document.body).backgroundColor;
  if (bare === "rgb(255, 255, 255)") foreign.add(bare);
  requestAnimationFrame(look);
};
requestAnimationFrame(look);
"""


def test_while_it_opens_a_page_has_our_own_names_alone(browser) -> None:
    with Viewer("my scene", 0) as viewer:
        tab = browser.new_page(viewport={"width": 900, "height": 500})
        tab.add_init_script(WATCH)
        tab.goto(viewer.url)
        tab.get_by_text("Opening the scene", exact=True).wait_for()
        tab.get_by_text("my scene", exact=True).wait_for()
        tab.wait_for_timeout(700)
        assert tab.get_by_text("my scene", exact=True).is_visible()
        assert tab.evaluate("[...foreign]") == []
        tab.close()


def calibrated_again(
    scene: Path, place: Path, moved: float, system: dict[str, object] | None = None, **record: object
) -> Path:
    """A scene of the same photographs on a calibration whose cameras are elsewhere.

    system: of its coordinates.
    """
    shutil.copytree(scene, place, ignore=shutil.ignore_patterns("renders", "references"))
    calibration = store.read_json(place / "calibration.json")
    for view in calibration["views"]:
        view["cam_from_world"]["translation"][2] += moved
    if system is not None:
        errors = {"rms": 0.0, "scale_error": None, "rotation_error": 0.0, "position_error": 0.0, "used": 20}
        calibration["coordinates"] = {"system": "local", **errors, **system}
    store.write_json(place / "calibration.json", calibration)
    store.write_json(place / "model.json", store.read_json(place / "model.json") | record)
    return place


def test_scenes_whose_coordinates_differ_are_not_compared(scene_template: Path, tmp_path: Path) -> None:
    first, shown, said = find_reconstruction(scene_template), [], []
    viewer = SimpleNamespace(first=None, show=lambda *its: shown.append(its))
    second = calibrated_again(first, tmp_path / "moved", 0.5, calibration_sha256="1" * 64)
    with pytest.raises(InputError, match=f"^{first} and {second} come from different calibrations"):
        show_scenes(viewer, [first, second], said.append)
    assert not shown
    for name, moved, record in (
        ("in place", 0.0, {"calibration_sha256": "1" * 64}),  # as after a reading of luminance
        ("of another program", 0.5, {"calibration_sha256": ""}),
    ):
        show_scenes(viewer, [first, calibrated_again(first, tmp_path / name, moved, **record)], said.append)
    assert len(shown) == 2
    assert not said


LOCAL = {"source": "survey", "points": ({"name": "P1", "position": (1.0, 2.0, 3.0)},)}
SURVEYED = {"source": "survey", "system": "EPSG:25832", "offset": (5e5, 6e6, 0.0)}


@pytest.mark.parametrize(
    ("systems", "common"),
    [
        ((None, None), False),
        ((SURVEYED, None), False),
        ((SURVEYED, SURVEYED), True),
        ((SURVEYED, SURVEYED | {"offset": (4e5, 6e6, 0.0)}), False),
        ((None, {"source": "session", "onto": "/home/me/first"}), True),
        (({"source": "session", "onto": "/home/me/second"}, None), True),
        ((None, {"source": "session", "onto": "/home/me/third"}), False),
        (({"source": "session", "onto": "/a"}, {"source": "session", "onto": "/b"}), False),
        (({"source": "session", "onto": "/a"}, {"source": "session", "onto": "/a"}), True),
        ((LOCAL, LOCAL), True),
        ((LOCAL, LOCAL | {"points": ({"name": "P1", "position": (1.0, 2.0, 4.0)},)}), False),
    ],
)
def test_that_two_sessions_share_no_coordinates_is_said(
    scene_template: Path, tmp_path: Path, systems, common: bool
) -> None:
    shown, said = [], []
    folders = [
        calibrated_again(
            find_reconstruction(scene_template), tmp_path / name, 0.5, system,
            session=name, calibration_sha256=name,
        )
        for name, system in zip(("first", "second"), systems, strict=True)
    ]  # fmt: skip
    viewer = SimpleNamespace(first=None, show=lambda *its: shown.append(its))
    show_scenes(viewer, folders, said.append)
    assert len(shown) == 1
    assert len(said) == (0 if common else 1)
    assert common or "of two sessions without common coordinates" in said[0]


def test_scenes_of_two_sessions_without_calibrations_are_shown(scene_template: Path, tmp_path: Path) -> None:
    shown, said = [], []
    folders = [
        calibrated_again(
            find_reconstruction(scene_template), tmp_path / name, 0.5, session=name, calibration_sha256=name
        )
        for name in ("first", "second")
    ]
    for folder in folders:
        (folder / "calibration.json").unlink()
    viewer = SimpleNamespace(first=None, show=lambda *its: shown.append(its))
    show_scenes(viewer, folders, said.append)
    assert (len(shown), len(said)) == (1, 1)


def test_sessions_that_were_placed_onto_one_another_share_coordinates(
    scene_template: Path, tmp_path: Path
) -> None:
    """B was placed onto A, and C onto B; then they move, A and B together."""

    def made(name: str, onto: str | None) -> Path:
        session = tmp_path / "there" / name
        system = None if onto is None else {"source": "session", "onto": str(tmp_path / "there" / onto)}
        scene = calibrated_again(
            find_reconstruction(scene_template), session / "reconstructions/s", 0.5, system,
            session=name, calibration_sha256=name,
        )  # fmt: skip
        (session / "calibration").mkdir()
        shutil.copy(scene / "calibration.json", session / "calibration")
        shutil.copy(scene_template / "session.json", session)
        return scene

    a, b, c, other = made("A", None), made("B", "A"), made("C", "B"), made("other", None)
    pairs, said = [(a, b), (b, c), (c, a), (c, other)], []
    viewer = SimpleNamespace(first=None, show=lambda *its: None)
    for pair in pairs:
        show_scenes(viewer, pair, said.append)
    (tmp_path / "there").rename(tmp_path / "moved")
    for pair in pairs:
        show_scenes(viewer, [Path(str(one).replace("there", "moved")) for one in pair], said.append)
    without = [line.partition(" are of two sessions without common coordinates")[0] for line in said]
    moved = str(tmp_path / "moved")
    assert without == [
        f"{c} and {other}", f"{moved}/C/reconstructions/s and {moved}/A/reconstructions/s",
        f"{moved}/C/reconstructions/s and {moved}/other/reconstructions/s",
    ]  # fmt: skip
