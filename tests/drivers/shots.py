"""A shot of any camera, as a recorder takes it."""

from collections.abc import Sequence

from drivers.camera import Camera, CameraFile
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic


def shot(camera: Camera, exposure: Exposure) -> RawMosaic | CameraFile:
    camera.set_exposure(exposure)
    camera.arm()
    camera.trigger()
    return camera.collect()


def raw_shot(camera: Camera, exposure: Exposure) -> RawMosaic:
    frame = shot(camera, exposure)
    assert isinstance(frame, RawMosaic)
    return frame


def together(cameras: Sequence[Camera], exposure: Exposure) -> list[RawMosaic | CameraFile]:
    """A shot of each: all are armed before the first is triggered."""
    for camera in cameras:
        camera.set_exposure(exposure)
        camera.arm()
    for camera in cameras:
        camera.trigger()
    return [camera.collect() for camera in cameras]
