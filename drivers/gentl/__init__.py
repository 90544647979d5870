"""GenTL producers: machine vision cameras through the library that their maker's SDK installs."""

from drivers.gentl.camera import GentlCamera, find_cameras
from drivers.gentl.producer import ENVIRONMENT, Producer, installed

__all__ = ["ENVIRONMENT", "GentlCamera", "Producer", "find_cameras", "installed"]
