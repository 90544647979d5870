"""What a method is made of; `recon.methods` has one small module for each."""

from dataclasses import dataclass, field

from recon.observe.linear import Observation
from recon.observe.losses import Photometric
from recon.scene.appearance import Appearance
from recon.scene.gaussians import GeometryRates


@dataclass(frozen=True)
class Schedule:
    """What changes during training, as fractions of it.

    degrees: when each further degree of the harmonics is switched on. opacity_weight: pull of the
    mean opacity towards zero, which clears what nothing needs (luminance times opacity is known,
    each of them alone only through occlusion).
    """

    degrees: tuple[float, ...] = (0.3, 0.6)
    opacity_weight: float = 0.0

    def degree(self, progress: float) -> int:
        """Degree of the harmonics in use."""
        return sum(progress >= at for at in self.degrees)


@dataclass(frozen=True)
class Method:
    """An appearance, an observation model, a loss and a schedule."""

    name: str
    appearance: Appearance
    observation: Observation
    loss: Photometric = field(default_factory=Photometric)
    geometry: GeometryRates = field(default_factory=GeometryRates)
    schedule: Schedule = field(default_factory=Schedule)
