"""Still cameras over PTP: DSLR and mirrorless bodies on USB."""

from drivers.ptp.camera import PtpCamera, find_cameras

__all__ = ["PtpCamera", "find_cameras"]
