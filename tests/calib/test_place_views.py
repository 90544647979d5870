"""A stopped calibration goes on only where all that its features follow from is as it was."""

import os
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest

from calib import place_views
from calib.data import learned
from calib.place_views import cache_key
from calib.poses.resolution import Contradicted
from imaging.errors import CalibrationError
from imaging.progress import unreported
from imaging.session.calibration import Response
from imaging.session.records import Rung
from imaging.session.view_id import ViewId


class Shot(SimpleNamespace):
    """A shot's record, as far as the question reads it."""

    def model_dump(self, mode: str) -> dict[str, str]:
        return {"file": self.file, "sha256": self.sha256}


def evidence(
    folder: Path, *, sha256: str = "aa", scale: float = 0.5, kind: str = "srgb", sensors: object = None
):
    shot = Shot(file="raw/0000/cam_0.png", sha256=sha256, mask="mask.png")
    return SimpleNamespace(
        session=SimpleNamespace(folder=folder, mask=lambda shot: folder / shot.mask),
        views=[SimpleNamespace(shots=(shot,))],
        light=SimpleNamespace(scale={shot.file: scale}, responses={"cam": Response(kind=kind, evidence="")}),
        sensors=sensors,
    )


@pytest.mark.parametrize(
    "changed", [{"sha256": "bb"}, {"scale": 0.25}, {"kind": "linear"}, {"sensors": {"cam": 1}}]
)
def test_another_shot_exposure_response_or_sensor_is_anothercache_key(tmp_path, changed):
    assert cache_key(evidence(tmp_path)) == cache_key(evidence(tmp_path))
    assert cache_key(evidence(tmp_path, **changed)) != cache_key(evidence(tmp_path))


def test_a_mask_that_is_written_again_is_another_question_and_one_that_is_gone_no_failure(tmp_path):
    gone = cache_key(evidence(tmp_path))
    (tmp_path / "mask.png").write_bytes(b"one")
    before = cache_key(evidence(tmp_path))
    (tmp_path / "mask.png").write_bytes(b"two")
    os.utime(tmp_path / "mask.png", ns=(0, 0))
    assert gone != before
    assert cache_key(evidence(tmp_path)) != before


@dataclass(frozen=True)
class Model:
    """Fields of a model that are read."""

    poses: dict
    rungs: tuple = ()
    hanging: frozenset = frozenset()


def given(kind, count=500, size=(1600, 1000)):
    """Summaries of ten views of a size with so many features of a kind."""
    features = SimpleNamespace(points=range(count))
    one = SimpleNamespace(blank=None, kind=kind, features=features, width=size[0], height=size[1])
    return dict.fromkeys(range(10), one)


@pytest.mark.parametrize("kind", ["sift", "learned"])
@pytest.mark.parametrize("name", ["pose_contradictions", "pose_unconfirmed"])
def test_learned_features_place_nothing_where_things_look_alike(monkeypatch, kind, name):
    """A contradiction of SIFT's, or a doubt of any kind about what learned features place."""

    def solved(evidence, summaries, *rest):
        doubted = (Rung(name=name, taken=True, reason="."),) if summaries[0].kind == kind else ()
        return Model(dict.fromkeys(range(9 if summaries[0].kind == "learned" else 2)), doubted)

    monkeypatch.setattr(learned, "available", lambda: True)
    monkeypatch.setattr(place_views, "_solved", solved)
    monkeypatch.setattr(place_views.view_images, "summaries", lambda *asked: given(asked[-1]))
    model, _ = place_views._by_features(None, given("sift"), None, False, unreported)
    # A few views that nothing confirms are what learned features are for.
    assert len(model.poses) == (9 if (kind, name) == ("sift", "pose_unconfirmed") else 2)


def test_views_that_contradict_each_other_are_refused_as_before(monkeypatch):
    def refused(*_):
        raise Contradicted("alike.")

    monkeypatch.setattr(learned, "available", lambda: True)
    monkeypatch.setattr(place_views, "_solved", refused)
    with pytest.raises(Contradicted):
        place_views._by_features(None, given("sift"), None, False, unreported)


@pytest.mark.parametrize(
    ("by_sift", "by_learned", "there", "expected"),
    [
        (2, 9, True, 9),
        (2, 9, False, 2),
        (8, 9, True, 8),  # enough: nothing else is tried
        (5, 4, True, 5),
        (5, None, True, 5),
        (None, 9, True, 9),
        (None, None, True, None),
        (None, 9, False, None),
    ],
)
def test_learned_features_are_the_last_rung(monkeypatch, by_sift, by_learned, there, expected):
    """Place ten images; None: none can be placed."""

    def solved(evidence, summaries, *rest):
        placed = by_learned if summaries[0].kind == "learned" else by_sift
        if placed is None:
            raise CalibrationError(f"{summaries[0].kind} places none.")
        return Model(dict.fromkeys(range(placed)))

    monkeypatch.setattr(learned, "available", lambda: there)
    monkeypatch.setattr(place_views, "_solved", solved)
    monkeypatch.setattr(place_views.view_images, "summaries", lambda *asked: given(asked[-1]))
    asked = None, given("sift"), None, False, unreported
    if expected is None:
        with pytest.raises(CalibrationError, match="sift places none"):
            place_views._by_features(*asked)
        return
    model, summaries = place_views._by_features(*asked)
    assert len(model.poses) == expected
    said = [rung.reason for rung in model.rungs if rung.name == place_views.FURTHER["learned"]]
    assert bool(said) == (summaries[0].kind == "learned") == (expected == by_learned)
    if said and by_sift:
        assert f"{by_sift} of 10 images are placed without, {expected} with learned" in said[0]


@pytest.mark.parametrize(
    ("count", "size", "by_sift", "by_more", "expected"),
    [
        (6000, (1600, 1000), 7, 9, 9),
        (6000, (1600, 1000), 7, 6, 7),
        (6000, (1600, 1000), 8, 9, 8),  # enough: nothing else is tried
        (500, (1600, 1000), 7, 9, 7),
        (6000, (1600, 1000), None, 3, 3),
        (2000, (1600, 1000), 7, 9, 7),
        (2000, (400, 300), 7, 9, 9),  # the search ended before the smallest features
        (2000, (320, 240), 7, 9, 7),
    ],
)
def test_more_features_are_tried_where_pictures_have_more_and_many_views_are_lost(
    monkeypatch, count, size, by_sift, by_more, expected
):
    def solved(evidence, summaries, *rest):
        placed = by_more if summaries[0].kind == "more" else by_sift
        if placed is None:
            raise CalibrationError("none.")
        return Model(dict.fromkeys(range(placed)))

    monkeypatch.setattr(learned, "available", lambda: False)
    monkeypatch.setattr(place_views, "_solved", solved)
    asked = []
    monkeypatch.setattr(
        place_views.view_images,
        "summaries",
        lambda *given_: asked.append(given_[-1]) or given(given_[-1], count, size),
    )
    model, _ = place_views._by_features(None, given("sift", count, size), None, False, unreported)
    assert len(model.poses) == expected
    assert asked == (["more"] if (count == 6000 or size == (400, 300)) and by_sift != 8 else [])
    said = [rung.reason for rung in model.rungs if rung.name == place_views.FURTHER["more"]]
    assert bool(said) == (expected == by_more and asked == ["more"])


@pytest.mark.parametrize(
    ("by_sift", "by_more", "expected"),
    [
        ((8, 1), (8, 0), (8, 0)),
        ((8, 1), (7, 0), (8, 1)),
        ((8, 1), (8, 1), (8, 1)),
        ((7, 0), (8, 1), (8, 1)),
    ],
)
def test_views_that_one_pair_holds_count_for_less(monkeypatch, by_sift, by_more, expected):
    """Of ten images so many are placed, of these so many by one pair."""

    def solved(evidence, summaries, *rest):
        placed, hanging = by_more if summaries[0].kind == "more" else by_sift
        return Model(dict.fromkeys(range(placed)), hanging=frozenset(range(hanging)))

    monkeypatch.setattr(learned, "available", lambda: False)
    monkeypatch.setattr(place_views, "_solved", solved)
    monkeypatch.setattr(place_views.view_images, "summaries", lambda *asked: given(asked[-1], 6000))
    model, _ = place_views._by_features(None, given("sift", 6000), None, False, unreported)
    assert (len(model.poses), len(model.hanging)) == expected
    said = [rung.reason for rung in model.rungs]
    if by_more == (8, 0):
        assert said[0].startswith("8 (1 by one pair only) of 10 images are placed without, 8 with up to")
    assert bool(said) == (expected == by_more != by_sift)


@pytest.mark.parametrize("size", [(1, 1), (15, 900), (40_000, 4)])
def test_photographs_that_are_too_narrow_are_told(tmp_path, size):
    shot = SimpleNamespace(file="raw/0000/cam_0.png", camera="cam", width=size[0], height=size[1])
    evidence = SimpleNamespace(
        session=SimpleNamespace(folder=tmp_path), views=[SimpleNamespace(shots=(shot,))]
    )
    with pytest.raises(CalibrationError, match=rf"cam_0\.png has {size[0]}x{size[1]} pixels, and views need"):
        place_views.require_sizes(evidence)


def test_a_rig_takes_its_scale_from_a_board_or_a_ruler_and_never_from_both(monkeypatch):
    """Rulers measure all cameras of three rigs; a board two of the first, one of the second, none else."""
    rigs = {"a": "one", "b": "one", "c": "one", "d": "two", "e": "two", "f": "three", "g": "three"}
    cameras = [
        SimpleNamespace(name=name, kind="srgb", rig=rig, position=(float(place), 2.0, 0.0))
        for place, (name, rig) in enumerate(rigs.items())
    ]
    lens = SimpleNamespace(resized=lambda *size: None)
    by_board = {"a": (0.0, 0.0, 0.0), "b": (0.9, 0.0, 0.0), "d": (0.0, 0.0, 0.0), "unseen": (1.0, 0.0, 0.0)}
    board = SimpleNamespace(
        lenses={}, sure_lenses=(), sure_rig=False, cam_from_rig=by_board, place=by_board.__getitem__
    )
    session = SimpleNamespace(
        record=SimpleNamespace(cameras=cameras), photograph_names=lambda: {}, turntable=lambda: None
    )
    evidence = SimpleNamespace(
        session=session,
        views=[],
        board=board,
        sensors=dict.fromkeys(rigs, SimpleNamespace(lens=lens, focal=None)),
    )
    view = SimpleNamespace(
        width=640, height=480, features=None, blank=None, png=b"", faint=False, brightness=None
    )
    monkeypatch.setattr(place_views, "stated_places", lambda *_: {})
    monkeypatch.setattr(place_views.sfm, "solve", lambda inputs, guesses: inputs)
    summaries = {ViewId(0, name): view for name in rigs}
    inputs = place_views._solved(evidence, summaries, None, False, unreported)
    ruler = {camera.name: camera.position for camera in cameras}
    assert inputs.known.places == {
        "a": by_board["a"],
        "b": by_board["b"],
        **{name: ruler[name] for name in "defg"},
    }
