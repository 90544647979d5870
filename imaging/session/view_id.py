"""Identity of a view: one camera at one frame, with one name and one order everywhere."""

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BeforeValidator, PlainSerializer


@dataclass(frozen=True, order=True)
class ViewId:
    """A camera at a frame, in order of frames and then of cameras; as text `0003/camera`.

    So are the folders of a session named whose files are of views: raw/, truth/.
    """

    frame: int
    camera: str

    def __str__(self) -> str:
        return f"{self.frame:04d}/{self.camera}"

    @classmethod
    def parse(cls, text: str) -> "ViewId":
        """The inverse of `str`; ValueError for another text."""
        frame, separator, camera = text.partition("/")
        if not (frame.isdecimal() and separator and camera):
            raise ValueError("a view is called FRAME/CAMERA, as 0003/left")
        return cls(int(frame), camera)

    @property
    def image_name(self) -> str:
        """Name of the view's image in a COLMAP model, and of its file below the folder of previews.

        COLMAP distinguishes the cameras of a rig by the folders of their images.
        """
        return f"{self.camera}/{self.frame:04d}.png"

    @classmethod
    def of_image(cls, name: str) -> "ViewId":
        """The inverse of `image_name`; ValueError for an image of another name."""
        camera, separator, file = name.rpartition("/")
        frame = file.removesuffix(".png")
        if not (camera and separator and file.endswith(".png") and frame.isdecimal()):
            raise ValueError(f"{name!r} is not CAMERA/FRAME.png")
        return cls(int(frame), camera)


def _parsed(value: Any) -> Any:
    return ViewId.parse(value) if isinstance(value, str) else value


ViewText = Annotated[ViewId, BeforeValidator(_parsed), PlainSerializer(str)]
"""A view as a field of a record: text on disk."""
