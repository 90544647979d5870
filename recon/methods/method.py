"""Parts of a method; `recon.methods` has one small module for each."""

from dataclasses import dataclass, field

from recon.observe.linear import Observation
from recon.observe.losses.photometric import Photometric
from recon.scene.appearance import Appearance
from recon.scene.gaussians import GeometryRates


@dataclass(frozen=True)
class Method:
    """An appearance, an observation model, a loss, and when harmonics are switched on.

    loss: or any other scalar of predicted and recorded planes, [P, H, W] each. degrees: the share of training
    after which each further degree of the harmonics is in use. opacity_weight: pull of the mean opacity
    towards zero, which clears what nothing needs (luminance times opacity is known, each of them alone only
    through occlusion). depth_weight: of what measured depth differs by, where views have any.
    """

    name: str
    appearance: Appearance
    observation: Observation
    loss: Photometric = field(default_factory=Photometric)
    geometry: GeometryRates = field(default_factory=GeometryRates)
    degrees: tuple[float, ...] = (0.3, 0.6)
    opacity_weight: float = 0.0
    depth_weight: float = 0.0

    def degree(self, progress: float) -> int:
        """Degree of the harmonics in use at a share of the training, 0..1."""
        return sum(progress >= share for share in self.degrees)
