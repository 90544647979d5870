"""Settings that a camera kept from one photograph to the next, by their files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from calib.data.views import View
from imaging.files.photo import read_metadata
from imaging.sensor.mosaic import FrameMetadata
from imaging.session.session import Session
from imaging.session.view_id import ViewId

SAME = 0.02
"""Relative; gains of a maker's white balance that differ by less are one white balance, a little adjusted."""


@dataclass(frozen=True)
class Stated:
    """Cameras whose files say that all photographs had the same, and what they say; by camera name."""

    exposure: Mapping[str, str] = field(default_factory=dict)
    white_balance: Mapping[str, str] = field(default_factory=dict)

    def of_all(self, part: Literal["exposure", "white_balance"], views: Sequence[ViewId]) -> str:
        """Return what the files of all these views say; empty where those of a camera say nothing."""
        known = self.exposure if part == "exposure" else self.white_balance
        cameras = dict.fromkeys(view.camera for view in views)
        return (
            "; ".join(dict.fromkeys(known[name] for name in cameras))
            if cameras.keys() <= known.keys()
            else ""
        )


NOTHING = Stated()


def stated_by(session: Session, views: Sequence[View]) -> Stated:
    """Return what the files of all views of cameras that develop their photographs say."""
    exposure, white_balance = {}, {}
    by_camera: dict[str, list[View]] = {}
    for view in views:
        if view.camera.kind == "ldr":
            by_camera.setdefault(view.camera.name, []).append(view)
    for name, views_of in by_camera.items():
        if said := _exposure(views_of):
            exposure[name] = said
        files = [read_metadata(session.file(shot)) for view in views_of for shot in view.shots]
        if said := _white_balance(files):
            white_balance[name] = said
    return Stated(exposure, white_balance)


def _exposure(views: Sequence[View]) -> str:
    """The exposures that every view was taken with; empty where they differ or are not known."""
    taken = {tuple(shot.exposure for shot in view.shots) for view in views}
    first = next(iter(taken))
    if len(views) < 2 or len(taken) > 1 or any(one is None for one in first):
        return ""
    return f"the files state that every view was taken at {', '.join(map(str, first))}"


def _white_balance(files: Sequence[FrameMetadata]) -> str:
    """Return how the files say that the white balance was not chosen anew; empty where they do not."""
    if all(one.manual_white_balance for one in files):
        return "the files state that the white balance was set by hand"
    gains = [one.balance for one in files if one.balance is not None]
    if len(gains) < len(files):
        return ""
    if any(max(channel) > (1 + SAME) * min(channel) for channel in zip(*gains, strict=True)):
        return ""
    red, blue = gains[0]
    return f"the files state that red was raised {red:.3g} times and blue {blue:.3g} times in all"
