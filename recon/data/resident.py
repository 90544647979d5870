"""The bytes that a view takes, decoded, and whether those of a data set are held in memory."""

from collections.abc import Mapping, Sequence

from imaging.compute import memory
from recon.data.dataset import View
from recon.data.shot import bytes_of

FLOAT = 4
MOST_HELD = 0.25
"""Share of the free memory that decoded shots may take and be held there. Arrays made from them (targets,
light, renders of an evaluation) take as much again and more.
"""


def pixels_of(view: View) -> int:
    """Pixels of a view."""
    return view.lens.width * view.lens.height


def decoded_bytes(view: View) -> int:
    """Bytes of the shots of a view in memory."""
    alphas = FLOAT * pixels_of(view) * sum(shot.planes.transparent for shot in view.shots)
    return alphas + sum(
        bytes_of(plane)
        for shot in view.shots
        for plane in (shot.pixels, shot.saturated, shot.dark, shot.valid)
    )


def too_large(firsts: Sequence[View], counts: Mapping[str, tuple[int, int]]) -> bool:
    """Return whether the shots of a data set are left on the disk.

    firsts: a view of each camera; counts: of its views, and of those to train on.
    """
    size = sum(counts[view.camera][0] * decoded_bytes(view) for view in firsts)
    return size > MOST_HELD * memory.available()
