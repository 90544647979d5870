"""Still cameras through libgphoto2, for those that rig's own PTP cannot drive; the package gphoto2 has it."""

from drivers.gphoto2.camera import Gphoto2Camera, cameras_at, find_cameras
from drivers.gphoto2.library import SCHEME, is_installed

__all__ = ["SCHEME", "Gphoto2Camera", "cameras_at", "find_cameras", "is_installed"]
