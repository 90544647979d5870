"""Pictures as films to look at, in MP4, written by ffmpeg: H.264 of sRGB, HDR10 and HLG."""

import errno
import tempfile
from collections.abc import Generator, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import numpy as np

from imaging.arrays import AnyArray, Array32, Bytes
from imaging.errors import InputError
from imaging.files import store
from imaging.files.hdr_display import BRIGHTEST, hlg_encode, on_screen, pq_encode

_QUALITY = "18"
"""x264's constant rate factor, at which hardly anybody sees a difference."""
_HDR_QUALITY = "6"
"""x265's, at which luminance of the demo is within 0.05 stops in most pixels."""
_MP4 = "-f", "mp4", "-movflags", "+faststart"
_AS_REC709 = (
    "-vf", "scale=out_color_matrix=bt709:out_range=tv", "-colorspace", "bt709", "-color_primaries", "bt709",
    "-color_trc", "iec61966-2-1", "-crf", _QUALITY, *_MP4,
)  # fmt: skip
_AS_REC2020 = (
    "-vf", "zscale=matrixin=gbr:rangein=full:matrix=bt2020nc:range=limited", "-colorspace", "bt2020nc",
    "-color_primaries", "bt2020", "-crf", _HDR_QUALITY, "-tag:v", "hvc1", *_MP4,
)  # fmt: skip
_REC2020 = "log-level=error:repeat-headers=1:colorprim=bt2020:colormatrix=bt2020nc:range=limited:transfer={}"
_PQ, _HLG = "smpte2084", "arib-std-b67"
_HDR10 = (
    ":hdr10=1:master-display=G(15000,30000)B(7500,3000)R(32000,16500)WP(15635,16450)L({},1):max-cll={},{}"
)
"""Mastering display: primaries and white of Rec.709, in 0.00002 of CIE xy, and the most luminance in 0.0001
cd/m2; then the brightest light, and the mean of the brightest frame, cd/m2."""


class _Film:
    """A film that is at `path` when the block ends without an error, and not before."""

    def __init__(self, path: Path, rate: float) -> None:
        """rate: frames a second. InputError if imageio-ffmpeg, an extra, is missing."""
        self.path, self.rate = path, rate
        self._stack = ExitStack()
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

    def _even(self, picture: AnyArray) -> AnyArray:
        """A picture whose sides are even, as the codecs need; InputError for another size than before."""
        height, width = picture.shape[:2]
        self._size = self._size or (width, height)
        if (width, height) != self._size:
            raise InputError(
                f"{self.path} would have pictures of {width}x{height} and of {self._size[0]}x{self._size[1]} "
                "pixels: render views of one size, or leave --video out."
            )
        return np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")

    def _begin(self, width: int, height: int, codec: str, taken: str, made: str, said: Sequence[str]) -> None:
        """Start ffmpeg; taken, made: how it names the pixels that it is sent, and that it writes."""
        part = self._stack.enter_context(store.replacing(self.path))
        self._sink = self._write_frames(
            str(part), (width, height), taken, made, fps=self.rate, codec=codec, macro_block_size=1,
            quality=None, output_params=list(said), ffmpeg_log_level="error",
        )  # fmt: skip
        self._sink.send(None)

    def _begin_hevc(self, width: int, height: int, curve: str, said: str = "") -> None:
        """Start HEVC of codes of 16 bits of Rec.2020; said: more settings of x265."""
        settings = ("-color_trc", curve, "-x265-params", _REC2020.format(curve) + said)
        self._begin(width, height, "libx265", "rgb48le", "yuv420p10le", (*_AS_REC2020, *settings))

    def _send(self, picture: AnyArray) -> None:
        assert self._sink is not None
        try:
            self._sink.send(np.ascontiguousarray(picture))
        except OSError as error:
            said = str(error).strip().splitlines()
            raise OSError(errno.EIO, said[-1] if said else "ffmpeg ended") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        if self._sink is not None:
            self._sink.close()
        return self._stack.__exit__(kind, error, trace)


class Video(_Film):
    """A film of pictures as they are."""

    def add(self, picture: Bytes) -> None:
        """Add the next picture, uint8 [H, W, 3] of sRGB, or straight RGBA, which is shown over black."""
        if picture.shape[2] == 4:
            picture = np.round(picture[..., :3] * (picture[..., 3:] / 255.0)).astype(np.uint8)
        even = self._even(picture)
        if self._sink is None:
            self._begin(even.shape[1], even.shape[0], "libx264", "rgb24", "yuv420p", _AS_REC709)
        self._send(even)


class HlgVideo(_Film):
    """A film of light as HLG: HEVC of 10 bits, Rec.2020, which needs no word on its brightest light."""

    def add(self, light: Array32) -> None:
        """Add the next picture, linear Rec.709 [H, W, 3] over black, 1 as white."""
        codes = self._even(np.round(65535 * hlg_encode(on_screen(light))).astype("<u2"))
        if self._sink is None:
            self._begin_hevc(codes.shape[1], codes.shape[0], _HLG)
        self._send(codes)


class HdrVideo(_Film):
    """A film of light as HDR10: HEVC of 10 bits, PQ, Rec.2020, with the luminance of its brightest light.

    This stands before the first frame, so the codes of all frames are kept in a file without a name until
    the last one is known: six bytes of a pixel.
    """

    def __init__(self, path: Path, rate: float) -> None:
        super().__init__(path, rate)
        self._codes: IO[bytes] = tempfile.TemporaryFile(dir=path.parent)  # noqa: SIM115
        self._stack.enter_context(self._codes)
        self._brightest = self._mean = 0.0

    def add(self, light: Array32) -> None:
        """Add the next picture, linear Rec.709 [H, W, 3] over black, 1 as white."""
        luminance = self._even(on_screen(light))
        levels = luminance.max(axis=2)  # as CTA-861.3 defines both
        self._brightest = max(self._brightest, float(levels.max()))
        self._mean = max(self._mean, float(levels.mean()))
        self._codes.write(np.round(65535 * pq_encode(luminance)).astype("<u2").tobytes())

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        if error is None and self._size is not None:
            try:
                self._encode(*(side + side % 2 for side in self._size))
            except BaseException as failed:
                super().__exit__(type(failed), failed, failed.__traceback__)
                raise
        return super().__exit__(kind, error, trace)

    def _encode(self, width: int, height: int) -> None:
        display = _HDR10.format(round(BRIGHTEST / 1e-4), round(self._brightest), round(self._mean))
        self._begin_hevc(width, height, _PQ, display)
        self._codes.seek(0)
        while frame := self._codes.read(6 * width * height):
            self._send(np.frombuffer(frame, np.uint8))
