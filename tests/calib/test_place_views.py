"""A stopped calibration goes on only where all that its features follow from is as it was."""

import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from calib.place_views import _question
from imaging.session.calibration import Response


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
def test_another_shot_exposure_response_or_sensor_is_another_question(tmp_path, changed):
    assert _question(evidence(tmp_path)) == _question(evidence(tmp_path))
    assert _question(evidence(tmp_path, **changed)) != _question(evidence(tmp_path))


def test_a_mask_that_is_written_again_is_another_question_and_one_that_is_gone_no_failure(tmp_path):
    gone = _question(evidence(tmp_path))
    (tmp_path / "mask.png").write_bytes(b"one")
    before = _question(evidence(tmp_path))
    (tmp_path / "mask.png").write_bytes(b"two")
    os.utime(tmp_path / "mask.png", ns=(0, 0))
    assert gone != before
    assert _question(evidence(tmp_path)) != before
