"""`truth/` says what the cameras really saw, where they stood, and what they applied."""

import json
from pathlib import Path

import numpy as np
import pytest

from drivers.sim.camera import response
from drivers.sim.camera.lens import unproject
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.truth import pose_of, write_truth
from imaging.files.exr.reading import read_exr
from imaging.optics.exposure import Exposure
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.sensor.mosaic import RawMosaic


def test_poses_survive_as_quaternions() -> None:
    rng = np.random.default_rng(0)
    turns = [np.eye(3), np.diag((1.0, -1, -1)), np.diag((-1.0, 1, -1)), np.diag((-1.0, -1, 1))]
    turns += [np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(200)]
    for turn in turns:
        motion = np.eye(4)
        motion[:3, :3] = turn * np.sign(np.linalg.det(turn))
        motion[:3, 3] = rng.normal(size=3)
        pose = pose_of(motion)
        assert pose.quaternion[0] >= 0
        np.testing.assert_allclose(pose.matrix(), motion, atol=1e-14)


@pytest.fixture(scope="module")
def written(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[SimulatedRig, Path, list[tuple[str, int, int]]]:
    rig = simulate("toy", 4, effects=True)
    folder = tmp_path_factory.mktemp("session")
    steps: list[tuple[str, int, int]] = []
    write_truth(rig, folder, lambda message, done, total: steps.append((message, done, total)))
    return rig, folder / "truth", steps


def test_progress_runs_to_its_end(written: tuple[SimulatedRig, Path, list[tuple[str, int, int]]]) -> None:
    _, _, steps = written
    assert [done for _, done, _ in steps] == list(range(7))
    assert {total for _, _, total in steps} == {6}


def test_the_images_are_the_scene_on_the_cameras_own_grid(
    written: tuple[SimulatedRig, Path, list[tuple[str, int, int]]],
) -> None:
    rig, folder, _ = written
    truth = json.loads((folder / "truth.json").read_text())
    assert truth["schema_version"] == 1
    for entry in truth["frames"]:
        for name, camera in truth["cameras"].items():
            image = read_exr(folder / f"{entry['frame']:04d}" / f"{name}.exr").rgb()
            lens = Lens.model_validate(camera["lens"])
            pose = Pose.model_validate(entry["cam_from_world"][name]).matrix()
            assert image.shape == (lens.height, lens.width, 3)
            for row, column in ((3, 5), (20, 40), (45, 60)):
                offsets = (np.arange(4) + 0.5) / 4
                v, u = np.meshgrid(row + offsets, column + offsets, indexing="ij")
                rays = unproject(lens, np.stack([u, v], axis=-1)) @ pose[:3, :3]
                expected = rig.scene.radiance(np.linalg.inv(pose)[:3, 3], rays).mean(axis=(0, 1))
                # A shadow's edge may fall to either side after the pose's round trip.
                np.testing.assert_allclose(image[row, column], expected, rtol=1e-5)


def test_the_frames_follow_from_the_truth(
    written: tuple[SimulatedRig, Path, list[tuple[str, int, int]]],
) -> None:
    rig, folder, _ = written
    truth = json.loads((folder / "truth.json").read_text())
    assert len(truth["exposures"]) == 3 * 2 * 3
    times, compared = set(), 0
    for shot in truth["exposures"]:
        camera = truth["cameras"][shot["camera"]]
        index = list(truth["cameras"]).index(shot["camera"])
        rig.move_to(shot["frame"])
        device = rig.cameras[index]
        assert device.set_exposure(rig.bracket[shot["step"]]) == Exposure.model_validate(shot["reported"])
        device.arm()
        device.trigger()
        frame = device.collect()
        assert isinstance(frame, RawMosaic)
        image = read_exr(folder / f"{shot['frame']:04d}" / f"{shot['camera']}.exr").rgb().astype(float)
        lens = camera["lens"]
        v, u = np.mgrid[0 : lens["height"], 0 : lens["width"]] + 0.5
        r2 = (u / lens["width"] * 2 - 1) ** 2 * 0.64 + (v / lens["height"] * 2 - 1) ** 2 * 0.36
        a, b, c = camera["vignetting"]
        applied = Exposure.model_validate(shot["applied"])
        times.add(applied.time)
        x = (image @ np.array(camera["camera_from_rec709"]).T)[..., 1] * camera["gain"] * shot["light"]
        x *= (1 + a * r2 + b * r2**2 + c * r2**3) * applied.scale
        green = (frame.cfa.channels(*x.shape) == 1) & (x > 0.03) & (x < 0.9)
        compared += int(green.sum())
        # Shot noise, read noise and PRNU of the sum; white is 9600 electrons.
        total = x[green].sum()
        error = np.sqrt(total / 9600 + green.sum() * (3 / 9600) ** 2 + 0.005**2 * (x[green] ** 2).sum())
        assert abs(frame.signal()[green].sum() - total) < 4.5 * error + 3e-4 * total
    assert compared > 3000
    assert len(times) == 18, "the shutter jitters from shot to shot"


def test_the_response_is_told_and_only_frames_that_were_shot(tmp_path: Path) -> None:
    rig = simulate("toy-ldr", positions=1)
    write_truth(rig, tmp_path)
    truth = json.loads((tmp_path / "truth" / "truth.json").read_text())
    assert [entry["frame"] for entry in truth["frames"]] == [0]
    curve = truth["response"]
    for channel in curve["log_exposure"]:
        np.testing.assert_allclose(response.develop(np.exp(channel)), curve["codes"], rtol=1e-9)
    assert simulate("toy", positions=1).settings.kind == "raw"
