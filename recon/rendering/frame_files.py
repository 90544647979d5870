"""Files of a render: linear EXR, simulated RAW, PNG, pictures for HDR screens; and films of them."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imaging.arrays import Array32, Bytes
from imaging.files import store
from imaging.files.exr.camera import film_attributes
from imaging.files.hdr_display import encode_avif
from imaging.files.photo import encode_png
from imaging.files.tiff.dng import write_dng
from imaging.files.ultra_hdr import encode_ultra_hdr
from recon.rendering.light_files import header_of, seen_by, write_light
from recon.rendering.request import RenderRequest
from recon.rendering.simulated_raw import RawCamera
from recon.rendering.video import HdrVideo, HlgVideo, Video
from recon.result.data_layers import DataLayers
from recon.result.display import displayed, in_colour, picture
from recon.result.scene import Scene
from recon.splat import SplatCamera


@dataclass(frozen=True)
class Frame:
    """One picture to be drawn: the name of its files without suffix, that of its header, and the camera.

    number: of a frame of a film; None of a view.
    """

    stem: str
    name: str
    camera: SplatCamera
    number: int | None = None


class Films:
    """Films of one render: of its PNG files, and with `hdr` two for HDR screens; closed with the stack."""

    def __init__(self, stack: ExitStack, stem: Path, request: RenderRequest) -> None:
        self._film = stack.enter_context(Video(stem.with_name(f"{stem.name}.mp4"), request.rate))
        self._hdr: list[HdrVideo | HlgVideo] = []
        if request.hdr:
            self._hdr = [
                stack.enter_context(HdrVideo(stem.with_name(f"{stem.name}.hdr.mp4"), request.rate)),
                stack.enter_context(HlgVideo(stem.with_name(f"{stem.name}.hlg.mp4"), request.rate)),
            ]

    def add(self, shot: Bytes) -> None:
        """Add a picture as a display shows it."""
        self._film.add(shot)

    def add_bright(self, light: Array32) -> None:
        """Add light for HDR screens, 1 as white."""
        for film in self._hdr:
            film.add(light)

    @property
    def paths(self) -> list[Path]:
        """The files."""
        return [film.path for film in (*self._hdr, self._film)]


class Pictures:
    """Pictures of one render, frame by frame. empty: names of the frames that see nothing of the scene."""

    def __init__(
        self,
        scene: Scene,
        out: Path,
        request: RenderRequest,
        data: DataLayers,
        sensor: RawCamera | None,
        films: Films | None,
    ) -> None:
        self._scene, self._out, self._request = scene, out, request
        self._data, self._sensor, self._films = data, sensor, films
        self._factor = scene.exposure if request.exposure is None else 2.0**request.exposure
        self._shown = request.shown or displayed
        self._files: list[Path] = []
        self._png: list[Path] = []
        self._mosaics: list[Path] = []
        self.empty: list[str] = []

    def draw(self, frame: Frame, seed: int) -> None:
        """Draw a frame and write all its files; seed: of the noise of its RAW files."""
        image, covered = self._scene.covered_layer(frame.camera)
        alpha = covered if self._scene.record.transparent else None
        if not covered.any():
            self.empty.append(frame.name)
        self._write_light(frame, image, alpha)
        if self._sensor is not None:
            self._write_raw(frame, image, self._sensor, seed)
        light = in_colour(image, self._scene.record.bands)
        self._write_shown(frame, light, alpha)
        if self._request.hdr:
            self._write_bright(frame, light)

    def written(self) -> list[Path]:
        """All files, EXR first."""
        films = [] if self._films is None else self._films.paths
        return self._files + self._png + self._mosaics + films

    def _write_light(self, frame: Frame, image: Array32, alpha: Array32 | None) -> None:
        request, record = self._request, self._scene.record
        file = self._out / f"{frame.stem}.exr"
        planes = {layer: self._data.layer(layer, frame.camera) for layer in request.layers}
        header = header_of(record, frame.name, self._factor) | seen_by(frame.camera)
        if frame.number is not None:
            header |= film_attributes(frame.number, request.rate)
        values = image * np.float32(self._factor)
        write_light(file, values, header, record.bands, request.space, alpha, planes, request.exr)
        self._files.append(file)

    def _write_raw(self, frame: Frame, image: Array32, sensor: RawCamera, seed: int) -> None:
        for index, mosaic in enumerate(sensor.bracket(image, seed=seed)):
            file = self._out / f"{frame.stem}_{index}.dng"
            write_dng(file, mosaic)
            self._mosaics.append(file)

    def _write_shown(self, frame: Frame, light: Array32, alpha: Array32 | None) -> None:
        """A PNG for each of the stops, the first also into the film."""
        stops = self._request.stops
        for index, step in enumerate(stops):
            name = f"{frame.stem}.png" if len(stops) == 1 else f"{frame.stem}_{step:+g}ev.png"
            shot = picture(light, alpha, self._factor * 2.0**step, self._shown)
            store.write_bytes(self._out / name, encode_png(shot))
            self._png.append(self._out / name)
            if self._films is not None and index == 0:
                self._films.add(shot)

    def _write_bright(self, frame: Frame, light: Array32) -> None:
        bright = light * np.float32(self._factor * 2.0 ** (*self._request.stops, 0.0)[0])
        self._png += _write_hdr(self._out / frame.stem, bright, self._shown(bright, 1.0))
        if self._films is not None:
            self._films.add_bright(bright)


def _write_hdr(stem: Path, light: Array32, base: Bytes) -> list[Path]:
    """Write light for HDR screens, 1 as white, beside the PNG of that name; base: sRGB, for other screens."""
    files = {".jpg": encode_ultra_hdr(light, base), ".avif": encode_avif(light)}
    for suffix, data in files.items():
        store.write_bytes(stem.with_name(stem.name + suffix), data)
    return [stem.with_name(stem.name + suffix) for suffix in files]
