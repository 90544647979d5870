"""A mono camera with a filter wheel, from its files to a scene of bands, against the simulator's truth."""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from calib.calibrate import calibrate
from capture.imports.photos import import_photos
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.camera.filters import behind
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.truth import write_truth
from imaging.errors import InputError
from imaging.files.exr.reading import read_exr
from imaging.files.tiff.dng import write_dng
from imaging.optics.exposure import Exposure
from imaging.session.calibration import CalibrationRecord
from imaging.session.records import Band
from recon.data.light import radiance_image
from recon.data.load import load
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.measure.evaluation import Evaluation
from recon.measure.truth import calibration_errors, true_radiance
from recon.reconstruct import reconstruct
from recon.rendering.light_files import write_light
from recon.rendering.render import render
from recon.result.scene import Scene, open_scene
from tests.drivers.shots import raw_shot

WHEEL = tuple(
    Band(name=name, wavelength_nm=wave) for name, wave in (("red", 630), ("g", 545), ("b", 465), ("ir", 690))
)
ORDER = ("b", "g", "red", "ir")
SHORT, LONG = Exposure(time=1 / 500, f_number=4.0, iso=100.0), Exposure(time=1 / 30, f_number=4.0, iso=100.0)
DARK = Exposure(time=1 / 4, f_number=4.0, iso=100.0)


class Outcome(NamedTuple):
    session: Path
    calibration: CalibrationRecord
    scene: Scene
    metrics: Evaluation


def photograph(rig: SimulatedRig, photos: Path, brackets: dict[str, tuple[Exposure, ...]]) -> None:
    """Photographs of every camera at every frame through every band: `photos`/BAND/CAMERA/FRAME_STEP.dng."""
    for index, mount in enumerate(rig.mounts):
        for turn, band in enumerate(WHEEL):
            camera = SimulatedCamera(behind(rig.bodies[index], band), partial(rig.radiance, index))
            for frame in range(rig.frames):
                camera.place(frame, turn)
                for step, exposure in enumerate(brackets[band.name]):
                    file = photos / band.name / mount.name / f"{frame:04d}_{step}.dng"
                    write_dng(file, raw_shot(camera, exposure))


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """Eight views through four filters, each band at exposures of its own; from DNG files on."""
    home = tmp_path_factory.mktemp("wheel")
    rig = simulate("toy", cameras=2, positions=4, width=112, height=84, samples=2, wheel=WHEEL)
    brackets = {"red": (SHORT, LONG), "g": (SHORT, LONG), "b": (SHORT, LONG), "ir": (LONG, DARK)}
    photograph(rig, home / "photos", brackets)
    (home / "bands.txt").write_text("\n".join(f"{band.name}, {band.wavelength_nm}" for band in WHEEL))
    session = home / "session"
    import_photos(home / "photos", session, bands=home / "bands.txt", cameras="folder")
    write_truth(rig, session)
    calibration = calibrate(session)
    overrides = Overrides(iterations=150, gaussians=3000, degree=0, refine="none")
    folder = reconstruct(session, TrainingRequest(quality="draft", overrides=overrides))
    return Outcome(session, calibration, open_scene(folder), evaluate(folder))


def test_all_views_are_placed_by_the_pictures_of_all_bands(outcome: Outcome) -> None:
    assert len(outcome.calibration.views) == 8
    errors = calibration_errors(outcome.session, outcome.calibration)
    assert errors["pose_rotation_deg"] < 0.5
    # The labels are 4 % off: of each band the ratio is measured by itself, in small and noisy pictures.
    assert errors["exposure_ratio_error"] < 0.02


def test_what_the_shots_say_is_the_truth_of_their_band(outcome: Outcome) -> None:
    """Before any training: each band in its place and its unit."""
    dataset = load(outcome.session)
    assert tuple(band.name for band in dataset.bands) == ORDER
    ratios = []
    for view in dataset.train:
        light, trusted = radiance_image(view)
        truth = true_radiance(outcome.session, view, dataset.bands)
        ratios.append([np.median(light[trusted, band] / truth[trusted, band]) for band in range(4)])
    ratios = np.median(ratios, axis=0)
    np.testing.assert_allclose(ratios / ratios.mean(), 1.0, atol=0.01)


def test_the_scene_has_the_light_of_every_band(outcome: Outcome) -> None:
    assert outcome.scene.channels == ORDER
    view = outcome.scene.views[0]
    assert outcome.scene.render(view.splat_camera).shape == (84, 112, 4)
    bands = {row.band: row for row in outcome.metrics.bands}
    assert tuple(bands) == ORDER
    for name, row in bands.items():
        assert row.stops_median < 0.2, name
        assert row.raw_psnr > 28, name
    assert outcome.metrics.hdr_psnr_mu_aligned > 28


def test_spectra_are_right(outcome: Outcome) -> None:
    """Infrared over blue differs a hundredfold between red things and blue ones; the scene has it right."""
    bands = outcome.scene.record.bands
    dataset = load(outcome.session)
    for view in dataset.held_out:
        light = outcome.scene.render(outcome.scene.view(view.name).splat_camera)
        truth = true_radiance(outcome.session, view, bands)
        ours, true = (np.log2(np.maximum(side[..., 3], 1e-9) / side[..., 0]) for side in (light, truth))
        assert np.percentile(true, 95) - np.percentile(true, 5) > 1
        assert np.median(np.abs(ours - true)) < 0.2


def test_renders_are_spectral_files_and_pictures_in_colour(outcome: Outcome, tmp_path: Path) -> None:
    name = outcome.scene.views[0].name
    exr, png = render(outcome.scene.folder, tmp_path, views=[name], exposure=0.0)
    image = read_exr(exr)
    assert set(image.channels) == {f"S0.{wave},000000nm" for wave in (465, 545, 630, 690)}
    assert image.attributes["spectralLayoutVersion"] == "1.0"
    assert image.attributes["colorInteropID"] == "data"
    light = outcome.scene.render(outcome.scene.views[0].splat_camera)
    np.testing.assert_array_equal(image.channels["S0.630,000000nm"], light[..., 2])
    assert png.suffix == ".png"
    with pytest.raises(InputError, match="has the light of bands, which has no primaries"):
        render(outcome.scene.folder, tmp_path, views=[name], space="acescg")


def test_a_file_keeps_bands_of_one_wavelength_and_the_one_called_as_alpha_is(tmp_path: Path) -> None:
    bands = (Band(name="par", wavelength_nm=650), Band(name="perp", wavelength_nm=650), Band(name="A"))
    light = np.full((4, 5, 3), (1, 2, 3), np.float32)
    write_light(tmp_path / "a.exr", light, {}, bands, alpha=np.full((4, 5), 0.5, np.float32))
    values = {name: plane[0, 0] for name, plane in read_exr(tmp_path / "a.exr").channels.items()}
    assert values == {"par": 1, "perp": 2, "band:A": 3, "A": 0.5}


def test_viewers_are_told_that_colours_are_false(outcome: Outcome) -> None:
    for name in ("splats.ply", "radiance.ply"):
        head = (outcome.scene.folder / name).read_bytes()[:600].decode("ascii", "replace")
        assert "false colours of the bands b, g, red, ir" in head
