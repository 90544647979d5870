"""Sessions with darks and flats: what reaches calibration.json, and what is said where they lack."""

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import pytest

from calib.calibrate import calibrate
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.truth import write_truth
from imaging.choices import Subject
from imaging.errors import InputError
from imaging.files import store
from imaging.files.tiff.dng import write_dng
from imaging.merge.linear_frame import read_linear
from imaging.optics.exposure import Exposure
from imaging.session.calibration import CalibrationRecord, read_calibration
from imaging.session.records import SessionRecord, ShotRecord
from imaging.session.session import Session
from tests.drivers.shots import raw_shot

FLATS = (1 / 1000, 1 / 250, 1 / 60, 1 / 30, 1 / 15, 1 / 8, 1 / 4)
CHANGES = {"ceiling": 3600, "hot_share": 1e-3, "hot_current": 300.0, "dead_share": 5e-4, "prnu": 0.008}


def exposures(times: Sequence[float], iso: float = 100.0) -> list[Exposure]:
    return [Exposure(time=time, f_number=4.0, iso=iso) for time in times]


class Shooting:
    """A session that grows."""

    def __init__(self, folder: Path, rig: SimulatedRig) -> None:
        self.rig, self.folder, self.frame = rig, folder, 0
        record = SessionRecord(
            name="s", created=datetime.now(UTC), origin="sim:toy", seed=3, cameras=rig.records()
        )
        self.session = Session.create(folder, record)

    def shoot(self, kind: Subject, wanted: Sequence[Exposure], frames: int) -> None:
        self.rig.show(kind)
        for frame in range(self.frame, self.frame + frames):
            self.rig.move_to(frame)
            for record, camera in zip(self.rig.records(), self.rig.cameras, strict=True):
                for step, exposure in enumerate(wanted):
                    image = raw_shot(camera, exposure)
                    file = f"raw/{frame:04d}/{record.name}_{step}.dng"
                    store.make_folder((self.folder / file).parent)
                    write_dng(self.folder / file, image)
                    height, width = image.pixels.shape
                    self.session.append_shot(
                        ShotRecord(
                            kind=kind, plan=kind, camera=record.name, frame=frame, step=step, file=file,
                            sha256="0" * 64, reported=image.metadata.exposure, width=width, height=height,
                        )
                    )  # fmt: skip
        self.frame += frames


def rig() -> SimulatedRig:
    return simulate("toy", 3, width=160, height=120, cameras=1, samples=1, sensor=CHANGES)


@pytest.fixture(scope="module")
def dark_and_flat(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, CalibrationRecord]:
    folder = tmp_path_factory.mktemp("sensor") / "session"
    shooting = Shooting(folder, rig())
    shooting.shoot("dark", exposures((1 / 1000, 4.0)), 8)
    shooting.shoot("flat", exposures(FLATS), 5)
    write_truth(shooting.rig, folder)
    return folder, calibrate(folder, only="sensor")


def test_a_session_of_darks_and_flats_only(dark_and_flat: tuple[Path, CalibrationRecord]) -> None:
    folder, record = dark_and_flat
    assert read_calibration(folder) == record
    truth = json.loads((folder / "truth" / "truth.json").read_text())["cameras"]["cam0"]
    camera = record.camera("cam0")
    (sensor,) = camera.sensors
    assert sensor.iso == 100.0
    assert camera.noise == sensor.noise()
    assert camera.noise is not None
    assert camera.noise.gain == pytest.approx(truth["noise"]["gain"], rel=0.01)
    assert camera.noise.read_noise == pytest.approx(truth["noise"]["read_noise"], rel=0.02)
    assert camera.noise.prnu == pytest.approx(truth["noise"]["prnu"], rel=0.1)
    assert sensor.levels().white == truth["ceiling"] == 3600
    assert sensor.black is not None
    assert [[level.value for level in row] for row in sensor.black] == [
        pytest.approx(row, abs=0.1) for row in truth["black"]
    ]
    assert {(one.x, one.y) for one in sensor.defects or ()} == {
        (one["x"], one["y"]) for one in truth["defects"]
    }
    assert 1 + sum(camera.vignetting) == pytest.approx(1 + sum(truth["vignetting"]), abs=0.02)
    assert camera.response.kind == "linear"
    taken = {rung.name: rung.taken for rung in record.rungs}
    assert taken["sensor_noise"]
    assert taken["sensor_ceiling"]
    assert taken["sensor_pattern"]
    assert not taken["sensor_linearity"]


def test_shots_are_read_by_what_was_measured(dark_and_flat: tuple[Path, CalibrationRecord]) -> None:
    folder, record = dark_and_flat
    camera = record.camera("cam0")
    bright = folder / "raw" / "0008" / "cam0_6.dng"
    plain = read_linear(bright, "raw", 1.0, camera.response)
    frame = read_linear(bright, "raw", 1.0, camera.response, camera.sensors)
    assert not plain.saturated.any(), "the files say that white is at 4095"
    assert frame.saturated.mean() > 0.9
    assert frame.ceiling == pytest.approx((3600 - 255.5) / (4095 - 255.5), abs=1e-3)
    assert (~frame.valid).sum() == len(camera.sensors[0].defects or ())
    other = camera.sensors[0].model_copy(update={"iso": 400.0})
    unlike = read_linear(bright, "raw", 1.0, camera.response, (other,))
    assert not unlike.saturated.any(), "another ISO's levels never stand in"
    assert unlike.valid.all()


def test_brackets_stand_in_at_an_iso_without_darks_and_that_is_said(tmp_path: Path) -> None:
    shooting = Shooting(tmp_path / "session", rig())
    shooting.shoot("scene", exposures((1 / 1000, 1 / 125, 1 / 15), iso=200.0), 3)
    shooting.shoot("dark", exposures((1 / 1000, 1.0)), 4)
    record = calibrate(tmp_path / "session", only="sensor")
    camera = record.camera("cam0")
    at = {sensor.iso: sensor for sensor in camera.sensors}
    assert set(at) == {100.0, 200.0}
    assert at[100.0].black is not None
    assert at[100.0].black[0][0].source == "darks"
    gain = at[200.0].gain
    assert gain is not None
    assert gain.source == "brackets"
    true = 2 * shooting.rig.bodies[0].sensor.gain
    assert abs(gain.value - true) < 3 * gain.sigma < 0.3 * true
    assert at[200.0].prnu is None
    assert at[200.0].defects is None
    assert camera.noise == at[200.0].noise(), "the scene was shot at ISO 200"
    words = next(rung.reason for rung in record.rungs if rung.name == "sensor_noise")
    assert "cam0 at ISO 200 has no darks and flats" in words
    assert "cam0 at ISO 100 has no flats" in words


def test_repeated_frames_of_unlike_size_are_an_error_in_one_sentence(tmp_path: Path) -> None:
    shooting = Shooting(tmp_path / "session", rig())
    shooting.shoot("dark", exposures((1 / 1000,)), 1)
    shooting.rig = simulate("toy", 3, width=128, height=96, cameras=1, samples=1)
    shooting.shoot("dark", exposures((1 / 1000,)), 1)
    with pytest.raises(InputError, match="dark shots of cam0: repeated frames are of one size"):
        calibrate(tmp_path / "session", only="sensor")
