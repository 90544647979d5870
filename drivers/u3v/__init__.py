"""USB3 Vision: machine vision cameras."""

from drivers.u3v.camera import U3vCamera, find_cameras

__all__ = ["U3vCamera", "find_cameras"]
