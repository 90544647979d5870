"""Still cameras over PTP: DSLR and mirrorless bodies on USB, on Wi-Fi and on Ethernet."""

from drivers.ptp.camera import PtpCamera, cameras_at, find_cameras

__all__ = ["PtpCamera", "cameras_at", "find_cameras"]
