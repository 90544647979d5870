"""Photosites and exposure tags that are wrong, with and without a calibration that knows."""

import numpy as np
import pytest

from calib.calibrate import calibrate
from imaging.files import store
from recon.data.light import radiance_image
from recon.measure.truth import calibration_errors

from .conftest import in_other_units, mean_stops

EACH = [("toy", "nh-3dgs"), ("toy-ldr", "hdr-gs"), ("toy", "vanilla")]
VICTIM = (1, "cam1", 1)
"""Frame, camera and step of the shot whose tag is wrong."""


@pytest.mark.parametrize(
    ("name", "method", "fault"),
    [("toy", "nh-3dgs", "dead_share"), ("toy", "nh-3dgs", "hot_share"), ("toy", "vanilla", "dead_share")],
)
def test_a_tenth_of_the_photosites_is_bad_and_nobody_knows(studio, train, name, method, fault):
    """No darks and flats: the loss is of absolute differences, which a tenth of outliers cannot lead far."""
    session = studio.session(name, sensor={fault: 0.1})
    outcome = train(session, method)
    assert all(shot.valid.all() for view in outcome.scene.dataset.views for shot in view.shots)
    seeds = 2 if fault == "dead_share" else 1
    assert mean_stops(session, method, seeds) < 1.35 * mean_stops(studio.session(name), method, seeds)


def stops_of_photographs(outcome):
    """Mean of log2 of the light that the photographs of the training views hold."""
    images = [radiance_image(view)[0] for view in outcome.scene.dataset.train]
    return np.mean([np.log2(image[image > 0]).mean() for image in images])


def test_a_camera_with_dead_photosites_develops_photographs_and_nobody_knows(studio, train):
    """Each dead one darkens its neighbours, which no loss can tell; the scene loses less than they did."""
    clean = train(studio.session("toy-ldr"), "hdr-gs")
    faulty = train(studio.session("toy-ldr", sensor={"dead_share": 0.1}), "hdr-gs")
    lost = stops_of_photographs(clean) - stops_of_photographs(faulty)
    assert 0.1 < lost < 0.3
    assert faulty.stops() - clean.stops() < lost


def wrongly_tagged(session, folder, factor):
    """A copy in which one shot says that it was exposed `factor` times as long, and k believes it."""
    in_other_units(session, folder, 1.0)
    lines = store.read_lines(folder / "shots.jsonl")
    store.discard(folder / "shots.jsonl")
    path = folder / "calibration" / "calibration.json"
    record = store.read_json(path)
    for line in lines:
        if (line["frame"], line["camera"], line["step"]) == VICTIM:
            for tag in ("requested", "reported"):
                line[tag]["time"] *= factor
            record["exposure_scale"][line["file"]] *= factor
        store.append_line(folder / "shots.jsonl", line)
    record["shots_sha256"] = store.sha256(folder / "shots.jsonl")
    store.write_json(path, record)
    return folder


@pytest.mark.parametrize(
    ("name", "method", "factor"), [(*one, 2.0) for one in EACH] + [("toy", "nh-3dgs", 0.5)]
)
def test_a_tag_that_is_wrong_by_two_and_believed(studio, train, tmp_path, name, method, factor):
    """One shot in eighteen, or thirty, argues with the others."""
    session = wrongly_tagged(studio.session(name), tmp_path / "tagged", factor)
    assert mean_stops(session, method) < 1.25 * mean_stops(studio.session(name), method)


@pytest.mark.parametrize("factor", [2.0, 0.5])
def test_calibration_finds_the_wrong_tag_of_raw(studio, tmp_path, factor):
    session = wrongly_tagged(studio.session("toy", width=64, height=48), tmp_path / "tagged", factor)
    before = calibration_errors(session, calibrate(session, only="colour"))["exposure_ratio_error_max"]
    after = calibration_errors(session, calibrate(session, only="response"))["exposure_ratio_error_max"]
    assert before > 0.4
    assert after < 0.03
