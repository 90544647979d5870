"""Results of rig on photographs of foreign light."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

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


@contextmanager
def all_measured() -> Iterator[None]:
    """The evaluation at the end of `rig reconstruct` takes its time, as `rig evaluate` after it would."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rig.commands.reconstruct.REPORT_SHARE", math.inf)
        yield
