"""Frames of a machine vision camera as the rest of rig knows them."""

from contextlib import suppress

from drivers.errors import CameraProtocol, CameraRefused
from drivers.genicam import settings, units
from drivers.genicam.chunks import CHUNKS, split_chunks
from drivers.genicam.pixels import format_of, unpack
from drivers.genicam.session import Frame, Session
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Tile
from imaging.sensor.mosaic import FrameMetadata, RawMosaic


class Mosaics:
    """Mosaics of one session with the camera of that serial number; levels are read once for each pixel
    format.
    """

    def __init__(self, session: Session, serial: str) -> None:
        self._session, self._serial = session, serial
        self._levels: dict[int, tuple[Tile | None, int]] = {}
        """Black, None if it is not known, and white of each pixel format."""

    def of(self, frame: Frame, exposure: Exposure) -> RawMosaic:
        """The mosaic of a frame; exposure: what was set, its time replaced by that of the frame's chunk.

        CameraProtocol if a part of the frame is missing; ChunksRefused if its chunks are not understood.
        """
        leader, nodes = frame.leader, self._session.nodes
        if frame.problem is not None:
            raise CameraProtocol(
                f"frame {leader.block} of {self._session.where} is incomplete ({frame.problem}): "
                "shoot it again."
            )
        image = frame.payload
        chunks: dict[int, bytes] = {}
        if leader.payload_type & CHUNKS:
            image, chunks = split_chunks(image, self._session.chunk_order)
        nodes.attach_chunks(chunks)
        if chunks and nodes.available("ChunkExposureTime"):
            second = units.per_second(nodes, "ChunkExposureTime")
            exposure = exposure.with_time(float(nodes.number("ChunkExposureTime")) / second)
        pixels = format_of(leader.pixel_format or self._stated("PixelFormat"))
        width, height = leader.width or self._stated("Width"), leader.height or self._stated("Height")
        if pixels.code not in self._levels:
            white = settings.white_level(nodes, pixels)
            self._levels[pixels.code] = settings.black_levels(nodes, pixels, white), white
        black, white = self._levels[pixels.code]
        unknown = () if black is not None else (self._no_black(),)
        return RawMosaic(
            pixels=unpack(image, pixels, width, height, leader.padding),
            cfa=pixels.cfa,
            black=((0.0,),) if black is None else black,
            white=white,
            metadata=FrameMetadata(
                make=self._session.make,
                model=self._session.model,
                serial=self._serial,
                exposure=exposure,
                unknown=unknown,
            ),
        )

    def _stated(self, name: str) -> int:
        """Complete what a leader of version 1 of GigE Vision omits: from a chunk, else from the camera's
        settings.
        """
        nodes = self._session.nodes
        with suppress(CameraRefused):  # the chunk may be described and not sent
            return int(nodes.number(f"Chunk{name}"))
        return int(nodes.number(name))

    def _no_black(self) -> str:
        nodes = self._session.nodes
        unit = nodes.unit("BlackLevel") if nodes.available("BlackLevel") else None
        says = {None: "does not state its black level", "": "states its black level without a unit"}.get(
            unit, f"states a black level that rig cannot read, in {unit!r}"
        )
        return (
            f"camera {self._serial} {says}: its files state 0; measure it from dark frames (rig "
            "capture --darks)"
        )
