"""Points that views of different exposure share tell the response as brackets do."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from bench.support import hdr_nerf_scene as scenes
from calib.data.views import View, scene_views
from calib.light import radiometry
from calib.light.curves.track_codes import _agreeing, _codes_at, sample_tracks
from capture.imports.photos import import_photos
from imaging.files import store
from imaging.progress import unreported
from imaging.session.records import SplitRecord
from imaging.session.session import SPLIT, Session

ERROR = 0.05
"""Median disagreement of the light that two views see of a point, natural log: patches, gloss, edges."""


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight views in a row and a half, each photographed five times; a split keeps one shot of each."""
    folder = tmp_path_factory.mktemp("tracks")
    scenes.write_scene(folder / "scene", scenes.Size(160, 8, 1), seed=2, samples=2)
    import_photos(folder / "scene", folder / "s")
    opened = Session.open(folder / "s")
    train = [view.shots[1 + index % 3].file for index, view in enumerate(scene_views(opened))]
    # What is in neither is looked at by nobody.
    test = [shot.file for shot in opened.shots() if shot.file not in train and shot.frame % 2]
    record = SplitRecord(reason="one exposure a view", train=tuple(train), test=tuple(test))
    store.write_json(folder / "s" / SPLIT, record.model_dump(mode="json"))
    return folder / "s"


@pytest.fixture(scope="module")
def single(session: Path) -> list[View]:
    """Views with the shot that is for training alone."""
    opened = Session.open(session)
    split = opened.split()
    assert split is not None
    return [
        View(view.camera, view.frame, tuple(shot for shot in view.shots if shot.file in split.train))
        for view in scene_views(opened)
    ]


def labels_of(views: list[View]) -> dict[str, float]:
    return {shot.file: shot.exposure.scale for view in views for shot in view.shots if shot.exposure}


def true_log(codes: np.ndarray) -> np.ndarray:
    """ln of the exposure that a code stands for, by the curve that the scene went through."""
    logs = np.linspace(-14, 9, 8000)
    return np.interp(codes / 255, scenes.curve(logs), logs)


def test_views_agree_on_the_light_of_the_points_that_they_share(session, single):
    tracks = sample_tracks(Session.open(session), single, labels_of(single), unreported)
    assert tracks is not None
    light = true_log(tracks.codes) - tracks.log_k[..., None]
    shared_points = np.isfinite(light[..., 1]).sum(1) >= 2
    assert shared_points.sum() > 150
    shared = light[shared_points, :, 1]
    apart = np.nanmax(shared, 1) - np.nanmin(shared, 1)
    assert np.median(apart) < 2 * ERROR
    exposures = np.where(np.isfinite(tracks.codes[..., 1]), tracks.log_k, np.nan)[shared_points]
    assert (np.nanmax(exposures, 1) - np.nanmin(exposures, 1) > 1).sum() > 100
    assert tracks.group.min() == 0
    assert len(np.unique(tracks.group)) == tracks.group.max() + 1 > 20


def test_exposures_that_hardly_differ_tell_nothing(session, single):
    labels = {file: 1.0 + 0.1 * index for index, file in enumerate(labels_of(single))}
    labels = {file: min(label, 1.3) for file, label in labels.items()}
    assert sample_tracks(Session.open(session), single, labels, unreported) is None
    assert sample_tracks(Session.open(session), single[:1], labels_of(single), unreported) is None


def test_a_response_is_measured_where_no_view_has_a_bracket_and_only_from_what_is_for_training(
    session, monkeypatch
):
    opened = Session.open(session)
    split = opened.split()
    assert split is not None
    read: list[Path] = []
    from calib.light.curves.track_codes import read_photo

    monkeypatch.setattr(
        "calib.light.curves.track_codes.read_photo", lambda path: (read.append(path), read_photo(path))[1]
    )
    light = radiometry.measure_light(opened, scene_views(opened), unreported)
    assert sorted(read) == sorted(session / file for file in split.train)
    (response,) = light.responses.values()
    assert response.residual is not None
    assert light.measured
    codes = 255 * np.array(response.codes)
    usable = (codes >= 20) & (codes <= 235)
    for channel in response.log_exposure:
        error = (np.array(channel) - true_log(codes))[usable]
        assert np.std(error) < 0.08  # sRGB, which is assumed without any samples, is off by 0.7


def test_what_a_mask_hides_is_no_point(session: Path, single: list[View], tmp_path: Path) -> None:
    """A view that is hidden as a whole is as good as none; of half a picture points are left."""
    opened, few = Session.open(session), single[:4]
    first = few[0].shots[0]
    masks = {"all.png": np.zeros((first.height, first.width), np.uint8)}
    masks["half.png"] = masks["all.png"].copy()
    masks["half.png"][:, : first.width // 2] = 255
    for name, image in masks.items():
        store.write_bytes(session / "masks" / name, cv2.imencode(".png", image)[1].tobytes())

    def hidden(view: View, name: str) -> View:
        return View(view.camera, view.frame, (view.shots[0].model_copy(update={"mask": f"masks/{name}"}),))

    labels = labels_of(few)
    whole = sample_tracks(opened, [hidden(few[0], "all.png"), *few[1:]], labels, unreported)
    without = sample_tracks(opened, few[1:], labels, unreported)
    half = sample_tracks(opened, [hidden(view, "half.png") for view in few], labels, unreported)
    assert whole is not None
    assert without is not None
    assert half is not None
    np.testing.assert_array_equal(whole.codes, without.codes)
    assert 0 < len(half.codes) < 0.8 * len(without.codes)


def test_codes_next_to_a_mask_are_none() -> None:
    pixels = np.full((20, 30, 3), 0.5, np.float32)
    counts = np.ones((20, 30), bool)
    counts[:, :10] = False
    codes = _codes_at(pixels, np.array([[5.0, 9.0], [11.5, 9.0], [12.5, 9.0]]), counts)
    assert np.isfinite(codes).all(1).tolist() == [False, False, True]


@pytest.mark.parametrize("refused", [False, True])
def test_matches_of_one_geometry_are_told_even_where_opencv_asserts(
    refused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One camera steps aside before 120 points; 30 matches are of nothing."""
    rng = np.random.default_rng(3)
    points = rng.uniform([-1, -1, 3], [1, 1, 6], (150, 3))
    one = 100 * points[:, :2] / points[:, 2:] + 50
    other = 100 * (points[:, :2] + [0.4, 0.1]) / points[:, 2:] + 50
    other[120:] = rng.uniform(0, 100, (30, 2))
    real = cv2.findFundamentalMat

    def asserting(first: object, second: object, method: int, *rest: object) -> object:
        if refused and method == cv2.USAC_MAGSAC:
            raise cv2.error("Assertion failed")
        return real(first, second, method, *rest)

    monkeypatch.setattr(cv2, "findFundamentalMat", asserting)
    cv2.setRNGSeed(0)
    agreeing = _agreeing(one, other)
    assert agreeing[:120].mean() > 0.95
    assert agreeing[120:].mean() < 0.3
