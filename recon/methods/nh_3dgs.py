"""NH-3DGS (Zhang et al., arXiv 2511.12895): one luminance a Gaussian, linear light, unmerged shots."""

from dataclasses import replace

from recon.data.dataset import Dataset
from recon.data.light import Light
from recon.methods.method import Method
from recon.observe.mixed import linear_or_mixed
from recon.scene.appearance import LuminanceChromaticity

NAME = "nh-3dgs"
APPEARANCE = LuminanceChromaticity()


def compose(dataset: Dataset, light: Light) -> Method:
    """Compose the method for RAW brackets, camera RGB and linear EXR; photographs among them are treated as
    in HDR-GS.
    """
    return Method(
        name=NAME,
        appearance=replace(APPEARANCE, floor=light.reference or 2.0**-20),
        observation=linear_or_mixed(dataset, light),
    )
