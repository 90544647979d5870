"""Cameras of other packages: entry points of the group `hdr_rig.cameras`.

Such an entry point is a function that is given the clock and returns a driver for each camera that is
connected, none of them opened; a driver follows `drivers.camera.Camera`. Its name is the protocol that
`rig cameras` shows. `rig doctor --camera` examines whether a driver does what `rig` needs.
"""

from collections.abc import Iterator
from importlib.metadata import entry_points

from drivers.camera import Camera
from drivers.clock import Clock
from imaging.errors import CameraError

GROUP = "hdr_rig.cameras"


def find_cameras(clock: Clock) -> Iterator[tuple[str, Camera | CameraError]]:
    """The plug-ins' names with each of their cameras, or with the reason why a plug-in has none to offer."""
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        try:
            for camera in point.load()(clock):
                yield point.name, camera
        except Exception as error:  # of a package that is not ours
            package = point.dist.name if point.dist is not None else point.value
            reason = f"{type(error).__name__}: {error}"
            yield (
                point.name,
                CameraError(f"{package} finds no cameras ({reason}): update it, or uninstall it."),
            )
