"""NH-3DGS (Zhang et al., arXiv 2511.12895): one luminance a Gaussian, linear light, unmerged shots."""

from dataclasses import replace

from recon.appearance import LuminanceChromaticity
from recon.dataset import Dataset
from recon.method import Method
from recon.mixed import linear_or_mixed
from recon.radiance import Light

NAME = "nh-3dgs"
APPEARANCE = LuminanceChromaticity()


def compose(dataset: Dataset, light: Light) -> Method:
    """For RAW brackets, camera RGB and linear EXR; photographs among them are seen as HDR-GS sees them."""
    return Method(
        name=NAME,
        appearance=replace(APPEARANCE, floor=light.reference or 2.0**-20),
        observation=linear_or_mixed(dataset, light),
    )
