"""Pictures as a film to look at: H.264 in MP4, written by ffmpeg."""

import errno
from collections.abc import Generator
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from imaging.arrays import Bytes
from imaging.errors import InputError
from imaging.files import store

_QUALITY = "18"
"""x264's constant rate factor, at which hardly anybody sees a difference."""
_AS_REC709 = (
    "-vf", "scale=out_color_matrix=bt709:out_range=tv", "-colorspace", "bt709", "-color_primaries", "bt709",
    "-color_trc", "iec61966-2-1", "-crf", _QUALITY, "-f", "mp4", "-movflags", "+faststart",
)  # fmt: skip


class Video(AbstractContextManager["Video"]):
    """A film that is at `path` when the block ends without an error, and not before.

    rate: frames a second. InputError if imageio-ffmpeg, an extra, is missing.
    """

    def __init__(self, path: Path, rate: float) -> None:
        self.path, self.rate = path, rate
        self._stack = ExitStack()
        self._part: Path | None = None
        self._sink: Generator[None, Any, None] | None = None
        self._size: tuple[int, int] | None = None
        try:
            import imageio_ffmpeg
        except ImportError as error:
            raise InputError(
                f"{path} is written by imageio-ffmpeg, which is not installed: pip install -e '.[video]', "
                "or leave --video out."
            ) from error
        self._write_frames = imageio_ffmpeg.write_frames

    def add(self, picture: Bytes) -> None:
        """Add the next picture, uint8 [H, W, 3] of sRGB, or straight RGBA, which is shown over black."""
        if picture.shape[2] == 4:
            picture = np.round(picture[..., :3] * (picture[..., 3:] / 255.0)).astype(np.uint8)
        height, width = picture.shape[:2]
        if height % 2 or width % 2:  # which H.264 needs to be even
            picture = np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
        self._size = self._size or (width, height)
        if self._sink is None:
            self._part = self._stack.enter_context(store.replacing(self.path))
            even = (picture.shape[1], picture.shape[0])
            self._sink = self._write_frames(
                str(self._part), even, fps=self.rate, codec="libx264", macro_block_size=1,
                quality=None, output_params=list(_AS_REC709), ffmpeg_log_level="error",
            )  # fmt: skip
            self._sink.send(None)
        if (width, height) != self._size:
            raise InputError(
                f"{self.path} would have pictures of {width}x{height} and of {self._size[0]}x{self._size[1]} "
                "pixels: render views of one size, or leave --video out."
            )
        try:
            self._sink.send(np.ascontiguousarray(picture))
        except OSError as error:
            said = str(error).strip().splitlines()
            raise OSError(errno.EIO, said[-1] if said else "ffmpeg ended") from error

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        if self._sink is not None:
            self._sink.close()
        return self._stack.__exit__(kind, error, trace)
