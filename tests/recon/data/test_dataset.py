"""A session as training sees it."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from imaging.errors import InputError, ReconstructionError
from imaging.files import store
from imaging.files.exr.writing import write_exr
from imaging.files.photo import encode_png
from imaging.files.tiff.dng import write_dng
from imaging.optics.lens import Lens
from imaging.sensor.cfa import Cfa, mosaic
from imaging.sensor.mosaic import RawMosaic
from imaging.session.calibration import Response
from imaging.session.session import Session
from imaging.session.view_id import ViewId
from recon.data.holdout import held_out
from recon.data.load import lens_of_pixels, load
from recon.data.pixels import ShotSource, read_shot
from recon.data.tone import encode
from recon.train.live_curve import chosen_views

LINEAR = Response(kind="linear", evidence="test")
SRGB = Response(kind="srgb", evidence="test")


def test_one_view_in_eight_is_held_out_spread_over_frames_and_cameras():
    names = [ViewId(frame, f"cam{camera}") for frame in range(6) for camera in range(4)]
    out = held_out(names)
    assert len(out) == 3
    assert len({view.camera for view in out}) == 3
    frames = sorted(view.frame for view in out)
    assert all(frame in run for frame, run in zip(frames, ((0, 1), (2, 3), (4, 5)), strict=True))
    assert held_out(names[::-1]) == out


@pytest.mark.parametrize("cameras", [1, 2, 3, 4, 7, 16])
@pytest.mark.parametrize("frames", [1, 2, 5, 9])
def test_held_out_split_of_any_rig(cameras, frames):
    names = [ViewId(frame, f"c{camera:02d}") for frame in range(frames) for camera in range(cameras)]
    out = held_out(names)
    if len(names) < 4:
        assert out == set()
        return
    assert len(out) == -(-len(names) // 8)
    assert out < set(names)
    taken = [sum(view.camera == f"c{c:02d}" for view in out) for c in range(cameras)]
    assert max(taken) <= -(-len(out) // min(cameras, 8)) + 1


@pytest.mark.parametrize(
    ("count", "validation"), [(0, 0), (1, 1), (2, 1), (3, 1), (4, 2), (7, 3), (8, 4), (30, 4)]
)
def test_views_that_end_a_training_are_none_of_those_that_are_reported(toy_dataset, count, validation):
    """Unless there is only one: then that is looked at, and reported as such."""
    held = tuple(replace(toy_dataset.held_out[0], frame=frame) for frame in range(count))
    whole = replace(toy_dataset, held_out=held)
    assert (whole.validation, whole.test, whole.reported) == ((), held, held)
    parted = whole.with_validation()
    assert len(parted.validation) == validation
    assert set(parted.validation) | set(parted.test) == set(held)
    assert not set(parted.validation) & set(parted.test)
    assert parted.reported == (parted.test if count != 1 else held)
    frames = [view.frame for view in parted.validation]
    assert all(after - before >= count // validation for before, after in pairwise(frames))


@pytest.mark.parametrize(
    ("hidden", "validation"), [((0, 1), [3]), ((3,), [1]), ((0, 1, 2), [0, 1, 2, 3]), ((0, 1, 2, 3), [])]
)
def test_views_that_masks_hide_do_not_end_a_training(toy_dataset, hidden, validation):
    """A single other one is looked at, and reported as such."""
    held = tuple(replace(toy_dataset.held_out[0], frame=frame) for frame in range(4))
    held = tuple(masked(view) if view.frame in hidden else view for view in held)
    assert [view.frame for view in held if view.hidden] == list(hidden)
    parted = replace(toy_dataset, held_out=held).with_validation()
    assert [view.frame for view in parted.validation] == validation
    assert [view.frame for view in chosen_views(parted.validation)] == [
        frame for frame in validation if frame not in hidden
    ]
    assert len(hidden) == 4 or not all(view.hidden for view in parted.reported)


def masked(view):
    shots = (shot.showing(valid=np.zeros(shot.shape, bool)) for shot in view.shots)
    return replace(view, shots=tuple(shots))


def test_views_of_a_camera_share_one_plane_of_falloff(toy_dataset):
    planes = {}
    for view in toy_dataset.views:
        assert planes.setdefault(view.camera, view.sensor.falloff) is view.sensor.falloff


def test_toy_views_carry_what_the_truth_says(toy, toy_dataset):
    truth = store.read_json(toy / "truth" / "truth.json")
    assert toy_dataset.kind == "raw"
    assert len(toy_dataset.train) == 5
    assert len(toy_dataset.held_out) == 1
    assert len(toy_dataset.views) == 6
    for view in toy_dataset.views:
        camera = truth["cameras"][view.camera]
        assert [round(np.log2(shot.k / view.shots[0].k)) for shot in view.shots] == [0, 4, 8]
        assert str(view.sensor.cfa) == camera["cfa"]
        np.testing.assert_allclose(view.sensor.camera_from_rec709, camera["camera_from_rec709"])
        a, b, c = camera["vignetting"]
        corner = view.sensor.falloff[0, 0] / camera["gain"]
        r = np.hypot(31.5, 23.5) / np.hypot(32, 24)
        assert corner == pytest.approx(1 + a * r**2 + b * r**4 + c * r**6, rel=1e-5)


def write_mosaic(path, signal, cfa=Cfa.GRBG):
    raw = RawMosaic(
        pixels=np.round(64 + signal * (4095 - 64)).astype(np.uint16),
        cfa=cfa,
        black=((64.0,),),
        white=4095,
    )
    write_dng(path, raw)


def test_a_much_wider_mosaic_becomes_small_camera_rgb_of_the_same_light(tmp_path):
    y, x = np.mgrid[0:48, 0:64]
    rgb = np.stack([0.1 + x / 200, 0.2 + y / 200, 0.5 - x / 300], -1)
    write_mosaic(tmp_path / "a.dng", mosaic(rgb, Cfa.GRBG))
    shot, cfa = read_shot(ShotSource(tmp_path / "a.dng", "a", "raw", LINEAR, 16), 0.5)
    assert cfa is None
    assert shot.pixels.shape == (12, 16, 3)
    small = rgb.reshape(12, 4, 16, 4, 3).mean((1, 3))
    np.testing.assert_allclose(shot.pixels[1:-1, 1:-1], small[1:-1, 1:-1], atol=4e-3)


def test_a_slightly_wider_mosaic_stays_one_and_an_odd_one_loses_its_edge(tmp_path):
    write_mosaic(tmp_path / "a.dng", np.full((47, 61), 0.4))
    shot, cfa = read_shot(ShotSource(tmp_path / "a.dng", "a", "raw", LINEAR, 40), 0.5)
    assert cfa == Cfa.GRBG
    assert shot.pixels.shape == (46, 60)


@pytest.mark.parametrize(
    ("kind", "width", "height", "most"),
    [
        ("ldr", 65, 49, 64),  # a pixel wider than what is asked for
        ("ldr", 129, 96, 64),
        ("hdr", 65, 49, 64),
        ("raw", 131, 99, 64),  # odd, and small enough to be averaged
        ("raw", 131, 99, 128),  # odd, and a mosaic still
        ("raw", 130, 98, None),
    ],
)
def test_what_is_scaled_stays_where_its_lens_says(tmp_path, kind, width, height, most):
    at = width - 20  # the first of seven lit columns, far from the centre
    light = np.zeros((height, width, 3), np.float32)
    light[:, at : at + 7] = 0.5
    path = tmp_path / {"ldr": "a.png", "hdr": "a.exr", "raw": "a.dng"}[kind]
    if kind == "ldr":
        store.write_bytes(path, encode_png(np.round(light * 255).astype(np.uint8)))
    elif kind == "hdr":
        write_exr(path, light)
    else:
        write_mosaic(path, light[..., 0])
    shot, _ = read_shot(ShotSource(path, "a", kind, LINEAR, most), 1.0)
    lens = Lens(model="PINHOLE", width=width, height=height, fx=90, fy=90, cx=width / 2, cy=height / 2)
    size = shot.pixels.shape[1], shot.pixels.shape[0]
    scaled = lens_of_pixels(lens, kind, *size)
    assert (scaled.width, scaled.height) == size
    row = shot.pixels.reshape(*shot.pixels.shape[:2], -1).mean((0, 2))
    centre = (row * (np.arange(size[0]) + 0.5)).sum() / row.sum()
    expected = (at + 3.5 - lens.cx) / lens.fx * scaled.fx + scaled.cx
    assert centre == pytest.approx(expected, abs=0.05)


def test_a_mask_is_scaled_as_the_odd_mosaic_that_it_covers(tmp_path):
    write_mosaic(tmp_path / "a.dng", np.full((99, 131), 0.5))
    mask = np.full((99, 131), 255, np.uint8)
    mask[:, 64:66] = 0  # 32 of 65 pixels of the even width halved
    store.write_bytes(tmp_path / "m.png", encode_png(mask))
    shot, _ = read_shot(ShotSource(tmp_path / "a.dng", "a", "raw", LINEAR, 65, mask=tmp_path / "m.png"), 1.0)
    assert np.flatnonzero(~shot.valid.all((0, 2))).tolist() == [32]


def test_photographs_are_averaged_in_linear_light(tmp_path):
    codes = np.zeros((8, 16, 3), np.uint8)
    codes[:, ::2] = 250
    store.write_bytes(tmp_path / "a.png", encode_png(codes))
    shot, _ = read_shot(ShotSource(tmp_path / "a.png", "a", "ldr", SRGB, 8), 1.0)
    light = ((250 / 255 + 0.055) / 1.055) ** 2.4 / 2
    np.testing.assert_allclose(shot.pixels, encode(np.full((4, 8, 3), light), SRGB), atol=1e-5)
    assert not shot.saturated.any()


def test_photographs_mark_what_only_bounds_the_light(tmp_path):
    codes = np.full((4, 4, 3), 128, np.uint8)
    codes[0], codes[1] = 255, 1
    store.write_bytes(tmp_path / "a.png", encode_png(codes))
    shot, _ = read_shot(ShotSource(tmp_path / "a.png", "a", "ldr", SRGB), 1.0)
    assert shot.saturated[0].all()
    assert shot.dark[1].all()
    assert not shot.saturated[1:].any()
    assert not shot.dark[2:].any()


def test_nan_in_an_exr_is_masked(tmp_path):
    light = np.ones((4, 8, 3), np.float32)
    light[1, 2] = np.nan
    light[3, 7] = np.inf
    write_exr(tmp_path / "a.exr", light)
    for width in (None, 4):
        shot, _ = read_shot(ShotSource(tmp_path / "a.exr", "a", "hdr", LINEAR, width), 1.0)
        assert np.isfinite(shot.pixels).all()
        np.testing.assert_allclose(shot.pixels[shot.valid], 1.0, rtol=1e-6)
    full, _ = read_shot(ShotSource(tmp_path / "a.exr", "a", "hdr", LINEAR), 1.0)
    assert int((~full.valid).sum()) == 6


def test_a_session_without_calibration_is_refused(session_copy):
    (session_copy / "calibration" / "calibration.json").unlink()
    with pytest.raises(InputError, match=r"is not calibrated: run `rig calibrate"):
        load(session_copy)


def test_a_calibration_without_views_is_refused(session_copy):
    path = session_copy / "calibration" / "calibration.json"
    record = json.loads(path.read_text())
    record["views"] = []
    path.write_text(json.dumps(record))
    with pytest.raises(ReconstructionError, match="no view with a pose"):
        load(session_copy)


def test_a_missing_image_is_named(session_copy):
    victim = sorted((session_copy / "raw").rglob("*.dng"))[3]
    victim.unlink()
    with pytest.raises(InputError, match=victim.name):
        load(session_copy)


def write_split(folder, train, test):
    record = {"schema_version": 1, "reason": "test", "train": train, "test": test}
    store.write_json(folder / "split.json", record)


def test_a_split_decides_what_is_held_out_and_what_nobody_looks_at(session_copy):
    files = {
        shot.file: (shot.frame, shot.camera, shot.step) for shot in Session.open(session_copy).shots("scene")
    }
    before = load(session_copy)
    test = [file for file, (frame, _, _) in files.items() if frame == 1]
    train = [file for file, (frame, _, step) in files.items() if frame == 0 and step != 1]
    write_split(session_copy, [*train, "raw/gone.dng"], test)
    dataset = load(session_copy)
    assert {view.frame for view in dataset.train} == {0}
    assert {view.frame for view in dataset.held_out} == {1}
    assert sorted(shot.file for view in dataset.train for shot in view.shots) == sorted(train)
    assert sorted(shot.file for view in dataset.held_out for shot in view.shots) == sorted(test)
    assert dataset.calibration_sha256 != before.calibration_sha256
    middle = next(shot.k for shot in dataset.held_out[0].shots if files[shot.file][2] == 1)
    assert not dataset.trained_at(middle)
    assert dataset.trained_at(dataset.held_out[0].shots[0].k)


def test_a_split_that_contradicts_itself_or_leaves_nothing_is_refused(session_copy):
    files = [shot.file for shot in Session.open(session_copy).shots("scene")]
    write_split(session_copy, files[:1], files[1:])
    with pytest.raises(InputError, match=r"split\.json trains and tests on view \d{4}/\S+:"):
        load(session_copy)
    write_split(session_copy, ["raw/gone.dng"], files)
    with pytest.raises(ReconstructionError, match=r"leaves no view with a pose to train on"):
        load(session_copy)
    store.write_json(session_copy / "split.json", {"schema_version": 1, "train": []})
    with pytest.raises(InputError, match=r"split\.json: reason"):
        load(session_copy)


def test_alpha_is_averaged_over_areas_and_what_else_is_read_has_none(tmp_path):
    alpha = np.zeros((12, 16), np.uint8)
    alpha[:, 4:] = 255
    photo = np.dstack([np.full((12, 16, 3), 128, np.uint8), alpha])
    (tmp_path / "a.png").write_bytes(encode_png(photo))
    whole, _ = read_shot(ShotSource(tmp_path / "a.png", "a", "ldr", SRGB, 16), 1.0)
    np.testing.assert_array_equal(whole.alpha, alpha / 255)
    small, _ = read_shot(ShotSource(tmp_path / "a.png", "a", "ldr", SRGB, 6), 1.0)
    assert small.alpha.shape == small.pixels.shape[:2]
    assert small.alpha.mean() == pytest.approx(0.75, abs=1e-6)
    assert 0 < small.alpha[0, 1] < 1
    (tmp_path / "b.png").write_bytes(encode_png(photo[..., :3]))
    assert read_shot(ShotSource(tmp_path / "b.png", "b", "ldr", SRGB, 6), 1.0)[0].alpha is None


def test_of_many_points_those_remain_that_most_views_saw(toy_dataset):
    xyz, tracks = toy_dataset.tracks()
    times = np.bincount(np.concatenate(list(tracks.values())), minlength=len(xyz))
    few, few_tracks = toy_dataset.tracks(100)
    places = [int(np.flatnonzero((xyz == point).all(1))[0]) for point in few]
    assert len(few) == 100
    assert times[places].min() >= np.delete(times, places).max()
    for name, points in tracks.items():
        assert {places[row] for row in few_tracks[name]} == set(points.tolist()) & set(places)
    assert all(map(np.array_equal, toy_dataset.tracks(10**6)[1].values(), tracks.values()))
