"""GigE Vision: machine vision cameras on Ethernet."""

from drivers.gige.camera import GigeCamera, find_cameras
from drivers.gige.network import Network
from drivers.gige.session import ActionTeam

__all__ = ["ActionTeam", "GigeCamera", "Network", "find_cameras"]
