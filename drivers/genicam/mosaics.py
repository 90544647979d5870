"""Frames of a machine vision camera as the rest of rig knows them."""

from drivers.errors import CameraProtocol
from drivers.genicam import settings
from drivers.genicam.chunks import CHUNKS, split_chunks
from drivers.genicam.pixels import format_of, unpack
from drivers.genicam.session import Frame, Session
from imaging.cfa import Tile
from imaging.exposure import Exposure
from imaging.mosaic import FrameMetadata, RawMosaic


class Mosaics:
    """Of one session with the camera of that serial number; levels are read once for each pixel format."""

    def __init__(self, session: Session, serial: str) -> None:
        self._session, self._serial = session, serial
        self._levels: dict[int, tuple[Tile, int]] = {}
        """Black and white of each pixel format."""

    def of(self, frame: Frame, exposure: Exposure) -> RawMosaic:
        """The mosaic of a frame; exposure: what was set, its time replaced by that of the frame's chunk.

        CameraProtocol if a part of the frame is missing.
        """
        leader, nodes = frame.leader, self._session.nodes
        if frame.problem is not None:
            raise CameraProtocol(
                f"frame {leader.block} of {self._session.where} is incomplete ({frame.problem}): "
                "shoot it again."
            )
        pixels = format_of(leader.pixel_format)
        image = frame.payload
        chunks: dict[int, bytes] = {}
        if leader.payload_type & CHUNKS:
            image, chunks = split_chunks(image, self._session.chunk_order)
        nodes.attach_chunks(chunks)
        if chunks and nodes.available("ChunkExposureTime"):
            exposure = exposure.with_time(float(nodes.number("ChunkExposureTime")) / 1e6)
        if pixels.code not in self._levels:
            white = settings.white_level(nodes, pixels)
            self._levels[pixels.code] = settings.black_levels(nodes, pixels), white
        black, white = self._levels[pixels.code]
        return RawMosaic(
            pixels=unpack(image, pixels, leader.width, leader.height, leader.padding),
            cfa=pixels.cfa,
            black=black,
            white=white,
            metadata=FrameMetadata(
                make=self._session.make,
                model=self._session.model,
                serial=self._serial,
                exposure=exposure,
            ),
        )
