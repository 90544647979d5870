"""The log of a training, and its pictures, as TensorBoard reads them."""

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from imaging.errors import InputError
from imaging.files import store
from recon.result.model import LOG
from recon.result.scene import open_scene

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

MOST_PICTURES = 4


class TensorBoardLog:
    """Writes events into a folder, as they come; nothing before the first.

    InputError where TensorBoard is not installed, StorageError where the folder cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        if find_spec("tensorboard") is None:
            raise InputError("--tensorboard needs TensorBoard: pip install -e '.[tensorboard]'.")
        store.require_writable(folder)
        self.folder = folder
        self._writer: SummaryWriter | None = None

    def line(self, line: Mapping[str, float]) -> None:
        """Add a line of train.jsonl: each of its numbers is a curve over the iterations."""
        for name, value in line.items():
            if name != "iteration":
                self._events().add_scalar(f"training/{name}", value, int(line["iteration"]))
        self._events().flush()

    def finished(self, folder: Path, *, logged: bool) -> None:
        """Add pictures of a scene's held-out views at its own exposure, of its first ones if it has none.

        logged: whether the lines of its log were added already; otherwise they are now.
        """
        if not logged:
            for line in store.read_lines(folder / LOG):
                self.line(line)
        scene = open_scene(folder)
        names = scene.record.held_out or scene.record.training_views
        for name in names[:MOST_PICTURES]:
            pixels = np.asarray(scene.at(0, name).convert("RGB"))
            self._events().add_image(name, pixels, scene.record.iterations, dataformats="HWC")

    def close(self) -> None:
        """Write what is left."""
        if self._writer is not None:
            self._writer.close()

    def _events(self) -> "SummaryWriter":
        if self._writer is None:
            from torch.utils.tensorboard import SummaryWriter

            # A training that is continued reports all its lines again: those of before are dropped.
            self._writer = SummaryWriter(str(self.folder), purge_step=0)
        return self._writer
