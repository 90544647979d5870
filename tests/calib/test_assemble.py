"""What is written of cameras that a board, a scene, or only one of them shows."""

from types import SimpleNamespace

import pytest

from calib import assemble
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.session.calibration import PoseError
from imaging.session.records import CameraRecord

LENS = Lens(model="SIMPLE_RADIAL", width=1200, height=800, fx=1000, fy=1000, cx=600, cy=400)
ERROR = PoseError(rotation=0.02, translation=1e-4)


def at(x: float) -> Pose:
    return Pose(quaternion=(1, 0, 0, 0), translation=(-x, 0, 0))


@pytest.mark.parametrize(
    ("tied", "metric", "sure", "place"),
    [
        ("BC", True, True, -0.5),
        ("BC", True, False, -0.5),
        ("BC", False, True, None),  # a board's metres say nothing in another unit
        ("D", True, True, None),  # a camera that the board did not show
        ("", True, True, 0.0),  # no rig of the model: the board's stays
    ],
)
def test_a_camera_without_views_stands_in_the_rig_of_the_model(tied, metric, sure, place):
    """The board's reference is A, which sees nothing of the scene; the model's is the first that is tied."""
    by_board = {"A": at(0.0), "B": at(0.5), "C": at(1.0)}
    cameras = [CameraRecord(name=name, serial=name, kind="raw", rig="rig") for name in "ABCD"]
    board = SimpleNamespace(
        lenses=dict.fromkeys("ABC", LENS),
        lens_errors={},
        cam_from_rig=by_board,
        rig_errors=dict.fromkeys("ABC", ERROR),
        sure_lenses=frozenset("ABC"),
        sure_rig=sure,
    )
    model = SimpleNamespace(
        lenses=dict.fromkeys("BCD", LENS),
        cam_from_rig={name: at(0.5 * place) for place, name in enumerate(tied)},
        errors=None,
        poses={},
        metric=metric,
        by_motion=frozenset(),
    )
    evidence = SimpleNamespace(
        session=SimpleNamespace(record=SimpleNamespace(cameras=cameras)),
        board=board,
        sensors={},
        light=SimpleNamespace(responses={}),
    )
    camera = assemble._camera(cameras[0], evidence, model, None)
    assert camera.lens == LENS
    assert (camera.cam_from_rig and camera.cam_from_rig.matrix()[0, 3]) == (place and -place)
    assert camera.cam_from_rig_error == (ERROR if place is not None and sure else None)
