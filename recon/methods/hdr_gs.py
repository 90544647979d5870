"""HDR-GS with a grid tone curve (Wu et al., arXiv 2408.06543): radiance from bracketed photographs."""

from dataclasses import replace

from recon.data.dataset import Dataset
from recon.data.light import Light
from recon.methods.method import Method
from recon.observe.calibrated_curves import tone_curve
from recon.scene.appearance import LuminanceChromaticity

NAME = "hdr-gs"
APPEARANCE = LuminanceChromaticity()


def compose(dataset: Dataset, light: Light) -> Method:
    """Compose the method for photographs with known exposures."""
    return Method(
        name=NAME,
        appearance=replace(APPEARANCE, floor=light.reference or 2.0**-20),
        observation=tone_curve(dataset, light),
    )
