"""Results of rig on photographs of foreign light."""

from dataclasses import dataclass
from pathlib import Path

from imaging.arrays import Array32

from .folder import Shots
from .lit import LitScene


@dataclass(frozen=True)
class Taken:
    """A scene, its true light, what was photographed of it, and the session; exits: code of each command."""

    scene: LitScene
    light: Array32
    shots: Shots
    session: Path
    exits: dict[str, int]

    @property
    def merged(self) -> Path:
        """Folder of merged brackets, if they were merged."""
        return self.session.with_name("merged")

    @property
    def reconstruction(self) -> Path:
        """The scene that was trained, if it was."""
        return self.session / "reconstructions" / "scene"
