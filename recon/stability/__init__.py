"""Stress tests of reconstruction, against float64 and against the truth."""

from recon.stability.methods import methods
from recon.stability.splatting import splatting

__all__ = ["methods", "splatting"]
