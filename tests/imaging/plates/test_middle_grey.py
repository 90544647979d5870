"""One exposure of a session: in its calibration, and in whatever is measured of it."""

from pathlib import Path

import numpy as np
import pytest

from imaging.files import store
from imaging.files.exr.reading import read_exr
from imaging.plates.middle_grey import exposure_factor, lasting_factor, measured_factor
from imaging.session.calibration import read_calibration
from imaging.session.session import Session


def test_the_median_of_the_true_light_becomes_middle_grey(toy: Path) -> None:
    factor = measured_factor(Session.open(toy), read_calibration(toy))
    truth = np.concatenate([read_exr(path).rgb() for path in sorted((toy / "truth").rglob("*.exr"))])
    assert abs(np.log2(factor * np.median(truth @ [0.2126, 0.7152, 0.0722]) / 0.18)) < 0.1
    assert np.log2(factor) * 10 == pytest.approx(round(np.log2(factor) * 10), abs=1e-9)


def test_the_record_counts_and_is_kept_while_it_fits(toy: Path) -> None:
    session, record = Session.open(toy), read_calibration(toy)
    factor = measured_factor(session, record)
    assert exposure_factor(session, record.model_copy(update={"exposure_factor": 7.0})) == 7.0
    assert lasting_factor(session, record, None) == factor
    assert lasting_factor(session, record, 1.1 * factor) == 1.1 * factor
    assert lasting_factor(session, record, 2 * factor) == factor


def test_of_single_photographs_it_is_what_they_were_shot_at(toy_ldr: Path) -> None:
    session, record = Session.open(toy_ldr), read_calibration(toy_ldr)
    lines = store.read_lines(toy_ldr / "shots.jsonl")
    single = [line for line in lines if line["step"] == 0]
    store.write_bytes(toy_ldr / "shots.jsonl", b"")
    for line in single:
        store.append_line(toy_ldr / "shots.jsonl", line)
    scales = [record.exposure_scale[line["file"]] for line in single]
    assert measured_factor(session, record) == pytest.approx(np.exp(np.median(np.log(scales))))
