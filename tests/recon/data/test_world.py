"""A scene is the same whatever the origin and the unit of the user's world."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from imaging.files.colmap import pycolmap, read_points
from recon.data.geometry import project
from recon.data.load import load
from recon.data.world import WorldTransform
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.decide.steps.corrections import pose_error_px
from recon.reconstruct import reconstruct
from recon.result.opened import open_model
from recon.splat import SplatCamera
from tests.recon.ply_files import read_ply
from tests.recon.worlds import ECEF, UTM, put

WORLDS = {
    "utm": (1.0, UTM),
    "ecef": (1.0, ECEF),
    "thousandths": (1e-3, (0.0, 0.0, 0.0)),
    "thousands": (1e3, (0.0, 0.0, 0.0)),
    "ten-thousandths": (1e-4, (0.0, 0.0, 0.0)),
}


def trained(session):
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(QUALITIES, "draft", Quality(60, 600, 64))
        # Growth is by rank: where rounding makes two Gaussians change places, all new ones are others.
        return reconstruct(
            session, TrainingRequest(quality="draft", overrides=Overrides(refine="none", growth=0))
        )


@pytest.fixture(scope="module")
def usual(toy, tmp_path_factory):
    """The toy session in its own world, and its scene; not to be changed."""
    return trained(shutil.copytree(toy, tmp_path_factory.mktemp("usual") / "session"))


@pytest.fixture(scope="module", params=["utm", "thousandths"])
def elsewhere(request, toy, tmp_path_factory):
    """The same session in another world, its scene, and the world's unit and origin."""
    session = shutil.copytree(toy, tmp_path_factory.mktemp(request.param) / "session")
    put(session, *WORLDS[request.param])
    return trained(session), *WORLDS[request.param]


@pytest.mark.parametrize(("scale", "shift"), WORLDS.values(), ids=WORLDS)
def test_the_views_of_a_scene_and_its_points_are_those_of_any_other_world(
    toy_dataset, session_copy, scale, shift
):
    put(session_copy, scale, shift)
    one, two = toy_dataset, load(session_copy)
    assert two.world.unit == pytest.approx(scale * one.world.unit, rel=1e-6)
    np.testing.assert_allclose(
        two.world.origin, scale * np.array(one.world.origin) + shift, rtol=1e-12, atol=1e-6 * scale
    )
    assert two.extent == pytest.approx(one.extent, rel=1e-6)
    for view, other in zip(one.views, two.views, strict=True):
        np.testing.assert_allclose(view.lens.cam_from_world, other.lens.cam_from_world, atol=1e-7)
    np.testing.assert_allclose(one.points().xyz, two.points().xyz, atol=1e-6)
    assert 0.3 < np.median(project(two.train[0].lens, two.points().xyz)[1]) < 3
    assert pose_error_px(one) == pose_error_px(two) or pose_error_px(one) == pytest.approx(pose_error_px(two))


def test_a_scene_of_any_world_is_trained_alike(usual, elsewhere):
    """Short trainings that start from rounding errors stay within what rounding errors grow to."""
    one, two = open_model(usual), open_model(elsewhere[0])
    assert one.record.held_out_db == pytest.approx(two.record.held_out_db, abs=0.05)
    for view, other in zip(one.dataset.views, two.dataset.views, strict=True):
        images = one.render(view.lens), two.render(other.lens)
        error = float((images[0] - images[1]).square().mean().sqrt() / images[0].square().mean().sqrt())
        assert error < 0.02


def test_the_ply_of_any_world_is_in_that_world(usual, elsewhere):
    folder, scale, shift = elsewhere
    one, two = read_ply(usual / "splats.ply"), read_ply(folder / "splats.ply")
    record = open_model(folder).record
    places = np.stack([one[axis] for axis in "xyz"], 1).astype(np.float64)
    positions = np.stack([two[axis] for axis in "xyz"], 1).astype(np.float64) + record.offset
    # Single Gaussians that nothing holds drift apart from one rounding error; most of them do not.
    apart = np.linalg.norm(scale * places + shift - positions, axis=1) / record.world.unit
    assert np.median(apart) < 1e-3
    sizes = np.median(np.exp(two["scale_0"].astype(np.float64) - one["scale_0"]))
    assert sizes == pytest.approx(scale, rel=1e-3)
    header = (folder / "splats.ply").read_bytes().partition(b"end_header")[0].decode()
    comments = [line for line in header.splitlines() if line.startswith("comment offset")]
    if not any(record.offset):
        assert not comments
        return
    assert comments == ["comment offset {!r} {!r} {!r}: add it to x y z".format(*record.offset)]
    assert max(map(abs, two["x"])) < 100 * record.world.unit
    np.testing.assert_allclose(record.offset, shift, atol=100 * record.world.unit)


def test_only_far_worlds_have_an_offset(usual, elsewhere):
    assert not any(open_model(usual).record.offset)
    assert any(open_model(elsewhere[0]).record.offset) == any(elsewhere[2])


def test_a_camera_of_the_world_sees_the_same_in_the_scene():
    rng = np.random.default_rng(0)
    world = WorldTransform(origin=UTM, unit=7.0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = turn, [0.5, -2.0, 9.0] - turn @ UTM
    camera = SplatCamera(motion, 300, 290, 160, 120, 320, 240, k1=-0.1, p1=1e-3)
    places = rng.normal(size=(50, 3)) + UTM
    pixels, depth = project(camera, places)
    projected, away = project(world.camera(camera), world.from_world(places))
    np.testing.assert_allclose(projected, pixels, atol=1e-4)
    np.testing.assert_allclose(away * 7.0, depth, rtol=1e-7)
    np.testing.assert_allclose(world.to_world(world.from_world(places)), places, atol=1e-8)


@pytest.mark.parametrize(
    ("origin", "unit", "offset"),
    [
        ((3.0, -40.0, 2.0), 5.0, (0.0, 0.0, 0.0)),
        (UTM, 5.0, (450000.0, 5410000.0, 300.0)),
        ((450123.4, 5410056.7, 312.0), 0.5, (450120.0, 5410060.0, 310.0)),
        ((450.1234, 5410.0567, 0.312), 5e-4, (450.12, 5410.06, 0.31)),
    ],
)
def test_an_offset_is_a_round_number_of_the_size_of_the_scene(origin, unit, offset):
    assert WorldTransform(origin=origin, unit=unit).offset(focal=300) == pytest.approx(offset, abs=1e-9)


def test_without_points_the_unit_is_the_reach_of_the_cameras_and_never_nothing(session_copy):
    folder = session_copy / "calibration" / "colmap"
    model = pycolmap.Reconstruction(str(folder))
    for key in list(model.points3D):
        model.delete_point3D(key)
    model.write(str(folder))
    assert len(read_points(folder).xyz) == 0
    dataset = load(session_copy)
    assert max(np.linalg.norm(view.centre) for view in dataset.views) == pytest.approx(1.0)
    assert WorldTransform.of({"a": np.eye(4)}, folder).unit == 1.0
    assert dataset.extent > 1


@pytest.mark.parametrize("apart", [0.0, 1e-6])
def test_cameras_at_one_spot_have_the_extent_of_what_they_look_at(toy_dataset, apart):
    first = toy_dataset.train[0]
    assert replace(toy_dataset, train=(first,)).extent == 1.0
    motion = first.lens.cam_from_world.copy()
    motion[0, 3] += apart
    beside = replace(first, lens=replace(first.lens, cam_from_world=motion))
    assert replace(toy_dataset, train=(first, beside)).extent == 1.0
    centres = np.array([view.centre for view in toy_dataset.train])
    reach = np.linalg.norm(centres - centres.mean(axis=0), axis=1).max()
    assert toy_dataset.extent == pytest.approx(1.1 * reach)
