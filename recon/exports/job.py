"""Input of a format's writer, and its report."""

from dataclasses import dataclass
from pathlib import Path

from imaging.progress import Progress
from recon.albedo.estimate import Albedo
from recon.exports.splats import Splats, display_splats, exposure_factor, linear_splats
from recon.exports.target_coordinates import Place, bent_px
from recon.result.scene import Scene


@dataclass(frozen=True, eq=False)
class Job:
    """Export job. scene: sound; linear: whether light stays linear; stops: None: the scene's middle; end:
    largest code of light that does not. albedo: to be written too, of all Gaussians of the scene, or None.
    """

    scene: Scene
    out: Path
    linear: bool
    stops: float | None
    place: Place
    progress: Progress
    end: float = 1.0
    albedo: Albedo | None = None

    @property
    def factor(self) -> float:
        """Factor on radiance, for linear light; display values have the exposure of their photographs."""
        usual = self.scene.exposure if self.scene.record.display is None else 1.0
        return usual if self.stops is None else 2.0**self.stops

    @property
    def exposure_factor(self) -> float:
        """Factor on the light of `Scene.render` that gives values of the file, where these are linear."""
        return exposure_factor(self.scene, self.factor)

    def splats(self, *, with_dome: bool = True) -> Splats:
        """The Gaussians as they are to be written, before the format's numbers hold them."""
        if self.linear:
            return linear_splats(self.scene, self.factor, with_dome=with_dome)
        return display_splats(self.scene, self.stops, self.progress, self.end)


@dataclass(frozen=True, eq=False)
class Written:
    """Report of a writer.

    held: the Gaussians as the file has them; truth: the same as they were; both None where it has none.
    notes: what else the file does not hold, or holds in another way; a sentence's part each.
    """

    files: list[Path]
    held: Splats | None = None
    truth: Splats | None = None
    notes: tuple[str, ...] = ()


def blend_note(scene: Scene) -> tuple[str, ...]:
    """Note that a file of light blends otherwise than the scene, where it does."""
    if scene.record.display is None:
        return ()
    return ("that the scene blends display values, as its photographs have them: light is blended",)


def lens_note(scene: Scene) -> tuple[str, ...]:
    """Note that lenses are bent and the file's cameras are not, where it applies."""
    bent = max((bent_px(view) for view in scene.views), default=0.0)
    if bent < 0.05:
        return ()
    return (f"the distortion of the lenses, up to {bent:.2g} px at the border of the pictures",)
