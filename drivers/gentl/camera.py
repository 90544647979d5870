"""A machine vision camera through a GenTL producer."""

from collections.abc import Iterator

from drivers.clock import Clock
from drivers.genicam.camera import GenicamCamera
from drivers.gentl.producer import Producer, installed, producer
from drivers.gentl.session import open_session
from imaging.errors import CameraError


class GentlCamera(GenicamCamera):
    """The camera with that serial number, as its producer lists it."""

    def __init__(self, serial: str, library: Producer, clock: Clock) -> None:
        super().__init__(serial, lambda patience: open_session(library, serial, clock, patience), clock)
        self.producer = library

    @property
    def where(self) -> str:
        """The producer, and the device in it while that is opened."""
        return super().where or f"GenTL {self.producer.library.where}"

    def verified(self) -> str:
        """Producers in software: no hardware yet."""
        return "the producer Viky of the package genicam, and one of rig's own tests"


def find_cameras(clock: Clock) -> Iterator["GentlCamera | CameraError"]:
    """The cameras of all producers that are installed, none opened; for a producer that fails, why."""
    for path in installed():
        try:
            library = producer(path)
            for entry in library.cameras():
                yield GentlCamera(entry.serial, library, clock)
        except CameraError as error:
            yield error
