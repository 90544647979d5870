"""How right this stage is at the ends of what it is asked, against float64 and against the truth."""

from recon.stability.methods import methods
from recon.stability.splatting import splatting

__all__ = ["methods", "splatting"]
