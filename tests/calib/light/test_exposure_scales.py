"""Exposure scales of RAW where labels lack, of made mosaics whose exposures are known."""

from pathlib import Path

import numpy as np
import pytest

from calib.data.views import scene_views
from calib.light.exposure_scales import estimate
from imaging.optics.exposure import Exposure
from imaging.progress import unreported
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic
from imaging.session.session import Session
from tests.calib.conftest import make_session

from .curves.test_response import smooth


@pytest.mark.parametrize("missing", [0, 1])  # a first step without a label, beside 1 s, whose ln is 0
def test_one_missing_label_leaves_a_step_that_a_single_view_has_alone_its_brightness(
    tmp_path: Path, missing: int
) -> None:
    light = smooth(np.random.default_rng(0), 0.02, 0.9)[..., 1]

    def shot(time: float, label: float | None) -> tuple[RawMosaic, Exposure | None]:
        pixels = np.rint(64 + 4031 * light * time).astype(np.uint16)
        return RawMosaic(pixels, Cfa.RGGB, ((64,),), 4095), None if label is None else Exposure(time=label)

    bracket = [shot(0.25, 0.25), shot(1.0, 1.0)]
    labels = [None if step == missing else label for step, label in enumerate((0.25, 1.0))]
    views = [bracket, bracket, [shot(0.25, labels[0]), shot(1.0, labels[1])], [shot(0.5, 0.5)]]
    session = Session.open(make_session(tmp_path / "s", views))
    scale = estimate(session, scene_views(session), unreported).scale
    true = {f"raw/{frame:04d}/cam_{step}.dng": 4.0 ** (step - 1) for frame in range(3) for step in range(2)}
    true["raw/0003/cam_0.dng"] = 0.5
    assert scale.keys() == true.keys()
    ratios = {file: scale[file] / scale["raw/0000/cam_0.dng"] for file in scale}
    assert ratios == pytest.approx({file: 4 * time for file, time in true.items()}, rel=0.01)
