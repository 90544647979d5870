"""Fisheyes before a board: taken where they are, and not where radial terms do."""

from dataclasses import replace

import numpy as np
import pytest

from calib.adjustment.bundle_adjustment import opencv_parameters, set_model
from calib.adjustment.fisheye import may_be_fisheye, nearest_terms
from calib.boards import ladder, rig, uncertainty
from calib.boards.corners import Corners
from calib.boards.first_guess import first_guess
from calib.boards.measure import DISAGREE, solve_group
from calib.poses.rigs.known_rig import camera_of
from imaging.optics.lens import Lens
from imaging.progress import unreported
from imaging.session.view_id import ViewId
from tests.calib.boards.conftest import HEIGHT, WIDTH, Stage, stage_of


def two(corners_of: dict[ViewId, Corners]) -> dict[ViewId, Corners]:
    return {view: corners for view, corners in corners_of.items() if view.camera in ("cam0", "cam1")}


def test_a_fisheye_is_taken_and_known_to_a_fraction_of_a_pixel() -> None:
    """120 degrees across the diagonal; corners good to 0.06 px, one in a hundred wrong."""
    stage = stage_of(3, lens="fisheye")
    detected = two(stage.detected(16, wrong=0.01))
    group = solve_group(stage.board, detected, dict.fromkeys(("cam0", "cam1"), (WIDTH, HEIGHT)), unreported)
    assert group.solved is not None
    assert group.doubt is not None
    assert group.rungs[-1].name == "lens_fisheye"
    assert group.rungs[-1].taken
    assert group.solved.rms < 0.1
    assert len(group.solved.misses) > 0.97 * sum(len(corners.ids) for corners in detected.values())
    for mount in stage.rig.mounts[:2]:
        lens, true = group.solved.lenses[mount.name], mount.optics.lens
        doubt = group.doubt.lenses[mount.name]
        assert set(doubt) == {"fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"}
        assert lens.p1 == lens.p2 == 0.0
        assert abs(lens.fx - true.fx) < 5 * doubt["fx"] < 2.0
        away = uncertainty.projection_map(true, [lens])
        assert away[1:-1, 1:-1].max() < 0.5
        assert away.max() < 5 * group.doubt.map[mount.name].max()
        assert group.doubt.halves[mount.name] < 1.5 * DISAGREE  # eight frames a half reach few corners


def test_a_wide_lens_with_radial_terms_stays_what_it_is(stage: Stage) -> None:
    """Nearly as wide as a fisheye, so that the rung is tried, and refused."""
    focal = 0.5 * WIDTH
    mounts = tuple(
        replace(mount, optics=replace(mount.optics, lens=mount.optics.lens.model_copy(
            update={"fx": focal, "fy": focal})))
        for mount in stage.rig.mounts
    )  # fmt: skip
    wide = stage_of(3)
    wide.rig.mounts = mounts
    detected = two(wide.detected(12))
    start = first_guess(wide.board, detected, dict.fromkeys(("cam0", "cam1"), (WIDTH, HEIGHT)))
    inliers, solved = rig.drop_outliers(wide.board, detected, start, ladder.RICHEST)
    free, rungs = ladder.climb(wide.board, inliers, solved, unreported)
    assert (rungs[-1].name, rungs[-1].taken) == ("lens_fisheye", False)
    assert free.model in ("SIMPLE_RADIAL", "RADIAL", "OPENCV")
    usual = stage.rig.mounts[0].optics.lens
    assert may_be_fisheye(mounts[0].optics.lens)
    assert not may_be_fisheye(usual)


@pytest.mark.parametrize(("k1", "k2"), [(0.0, 0.0), (-0.28, 0.087), (-0.21, 0.0), (-0.5, 0.0)])
def test_the_nearest_fisheye_bends_as_the_radial_terms_did(k1: float, k2: float) -> None:
    """To a hundredth of the focal length up to 40 degrees, or up to nine tenths of the fold."""
    lens = Lens(model="OPENCV", width=640, height=480, fx=380, fy=380, cx=320, cy=240, k1=k1, k2=k2, p1=1e-3)
    camera = camera_of(lens)
    set_model(camera, "OPENCV_FISHEYE")
    assert camera.model_name == "OPENCV_FISHEYE"
    assert opencv_parameters(camera)[:4] == [380, 380, 320, 240]
    terms = opencv_parameters(camera)[4:]
    assert terms == list(nearest_terms(k1, k2, float(np.hypot(320, 240)) / 380))
    tangent = np.tan(np.radians(np.linspace(0.0, 40.0, 30)))
    bent = tangent * (1 + k1 * tangent**2 + k2 * tangent**4)
    rises = np.cumprod(np.diff(bent, prepend=-1.0) > 0).astype(bool)
    below = rises & (tangent < 0.9 * tangent[rises].max())
    radii = np.array([camera.img_from_cam([x, 0.0, 1.0])[0] for x in tangent[below]])
    np.testing.assert_allclose((radii - 320) / 380, bent[below], atol=0.01)
