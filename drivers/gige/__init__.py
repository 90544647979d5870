"""GigE Vision: machine vision cameras on Ethernet."""

from drivers.gige.camera import GigeCamera, find_cameras
from drivers.gige.network import Network

__all__ = ["GigeCamera", "Network", "find_cameras"]
