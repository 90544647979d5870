"""The simulated rigs by name, each a list of cameras on one arm before a scene."""

import threading
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np

from drivers.camera import Camera
from drivers.sim.camera.camera import MAKE, Body, SimulatedCamera
from drivers.sim.camera.filters import behind
from drivers.sim.mounting import (
    LAMP_SPREAD,
    TURN_SPREAD,
    Mount,
    before_turntable,
    head_from_world,
    lamp_factor,
    mounts,
    over_dome,
    rig_from_world,
    table_turn,
)
from drivers.sim.rig_settings import RIGS, RigSettings, built_sensor, nominal_sensor
from drivers.sim.scene.board import SimulatedBoard, board_from_rig
from drivers.sim.scene.court import court_scene
from drivers.sim.scene.dome import brightness, dome_scene, lamp_places
from drivers.sim.scene.gallery import gallery_scene
from drivers.sim.scene.scene import Scene
from drivers.sim.scene.subjects import LIGHT, grey
from drivers.sim.scene.tabletop import demo_scene
from drivers.sim.scene.turntable import turntable_scene
from imaging.arrays import Array, Array32
from imaging.choices import Subject
from imaging.errors import InputError
from imaging.optics.exposure import Exposure
from imaging.optics.lens import rays
from imaging.session.lamps import LampsRecord
from imaging.session.records import CameraRecord
from imaging.session.turntable import TurntableRecord

# Lamp and shadows of the scene both fit: exposures 4 EV apart for a RAW sensor, 7/3 EV for 8-bit codes.
RAW_BRACKET = tuple(Exposure(time=time, f_number=4.0, iso=100.0) for time in (1 / 1000, 1 / 60, 1 / 4))
LDR_BRACKET = tuple(
    Exposure(time=time, f_number=4.0, iso=100.0) for time in (1 / 1000, 1 / 200, 1 / 40, 1 / 8, 0.6)
)
# From the brightest lamp of the court down to the back of its shed.
NODAL_BRACKET = tuple(
    Exposure(time=time, f_number=4.0, iso=100.0) for time in (1 / 8000, 1 / 500, 1 / 30, 1 / 2, 4.0)
)

EVEN = 700.0
"""Radiance of the soft light: what is white fits into 1/60 s at f/4 and ISO 100."""


def names() -> tuple[str, ...]:
    """The rigs that `simulate` knows."""
    return tuple(RIGS)


def simulate(
    name: str, seed: int = 0, *, clock: Callable[[], float] | None = None, **overrides: Any
) -> "SimulatedRig":
    """Simulate a rig. InputError for an unknown name or setting, with a list of those that there are.

    seed: of lenses, colours, sensors, noise and the arm's small errors; the scene is always the same.
    overrides: any field of `RigSettings` but `kind`.
    """
    if name not in RIGS:
        raise InputError(f"there is no simulated rig {name!r}: choose one of {', '.join(RIGS)}.")
    settings = RIGS[name]
    names = {setting.name for setting in fields(RigSettings)} - {"kind"}
    if unknown := sorted(set(overrides) - names):
        raise InputError(
            f"the simulated rig {name} has no setting {unknown[0]!r}: "
            f"choose among {', '.join(sorted(names))}."
        )
    return SimulatedRig(name, seed, replace(settings, **overrides), clock)


class SimulatedRig:
    """Cameras rigidly mounted on one arm, moved together from frame to frame."""

    def __init__(
        self, name: str, seed: int, settings: RigSettings, clock: Callable[[], float] | None = None
    ) -> None:
        self.name, self.seed, self.settings = name, seed, settings
        self.frames = settings.positions
        self.bracket = RAW_BRACKET if settings.kind == "raw" else LDR_BRACKET
        if settings.scene == "court":
            self.bracket = NODAL_BRACKET
        self.scene = _scene(settings, seed)
        self.mounts: tuple[Mount, ...] = tuple(
            replace(
                mount,
                optics=replace(
                    mount.optics.nearer(settings.distortion, settings.vignetting, settings.gains),
                    glare=settings.glare,
                ),
            )
            for mount in mounts(
                seed,
                settings.cameras,
                settings.width,
                settings.height,
                settings.kind,
                settings.lens,
                settings.cfa,
            )
        )
        self.board = SimulatedBoard()
        self._subject: Subject = "scene"
        self._frame = 0
        self._shown: dict[int, Subject] = {}
        self._rendered: dict[tuple[Subject, int, int], Array32] = {}
        # Cameras may be emptied in threads of their own; the ray-caster uses all cores by itself.
        self._lock = threading.Lock()
        self._devices = [
            SimulatedCamera(self._body(mount), self._view(index), clock)
            for index, mount in enumerate(self.mounts)
        ]
        if settings.wheel:
            self.turn_to(settings.wheel[0].name)

    def turn_to(self, band: str) -> None:
        """Turn the filter wheels of all cameras to that filter."""
        chosen = next(each for each in self.settings.wheel if each.name == band)
        for device in self._devices:
            device.body = behind(device.body, chosen)

    @property
    def cameras(self) -> list[Camera]:
        """The cameras, in the order of `records`."""
        return list(self._devices)

    @property
    def devices(self) -> tuple[SimulatedCamera, ...]:
        """The same, with what only simulated cameras have."""
        return tuple(self._devices)

    @property
    def bodies(self) -> tuple[Body, ...]:
        """Properties of each camera, in the order of `records`."""
        return tuple(device.body for device in self._devices)

    def records(self) -> tuple[CameraRecord, ...]:
        """The cameras as a session names them."""
        return tuple(
            CameraRecord(
                name=mount.name,
                serial=device.body.serial,
                make=MAKE,
                model=device.identify().model,
                kind=device.body.kind,
                rig="arm",
            )
            for mount, device in zip(self.mounts, self._devices, strict=True)
        )

    def show(self, kind: Subject) -> None:
        """Set the subject from now on: the scene, nothing, a grey surface, or the board.

        dark: the lenses are covered; flat: all that each lens sees has the one radiance
        `drivers.sim.scene.subjects.LIGHT`; board: it is held anew at every frame. The rig rests for these at
        its first place, and frames have any number, which should be that of one subject only.
        """
        self._subject = self._shown[self._frame] = kind

    def move_to(self, frame: int, step: int = 0) -> None:
        """Move the whole rig to a frame; InputError if the scene is shown and it is not on the arc.

        step: distinguishes exposures of equal settings, as the shots of a dark series are.
        """
        if self._subject == "scene" and not 0 <= frame < self.frames:
            raise InputError(
                f"the simulated rig {self.name} has no frame {frame}: choose 0 to {self.frames - 1}."
            )
        if frame < 0:
            raise InputError(f"the simulated rig {self.name} has no frame {frame}: choose 0 or more.")
        self._frame, self._shown[frame] = frame, self._subject
        for device in self._devices:
            device.place(frame, step)

    def cam_from_world(self, camera: int, frame: int, subject: Subject = "scene") -> Array:
        """True pose of a camera at a frame, float64 [4, 4]."""
        place = frame if subject == "scene" else 0
        return np.asarray(self.mounts[camera].cam_from_rig @ self._rig_from_world(place))

    def board_from_world(self, frame: int) -> Array:
        """True pose of the board at a frame, float64 [4, 4]."""
        held = board_from_rig(
            self.board,
            self.seed,
            frame,
            self.mounts[0].optics.lens,
            [mount.cam_from_rig for mount in self.mounts],
        )
        return np.asarray(held @ self._rig_from_world(0))

    def _rig_from_world(self, frame: int) -> Array:
        placed = {"court": head_from_world, "turntable": before_turntable, "dome": over_dome}
        return placed.get(self.settings.scene, rig_from_world)(self.seed, self.frames, frame)

    @property
    def turntable(self) -> TurntableRecord | None:
        """Angles that the turntable states, which it misses a little; None without one."""
        if self.settings.scene != "turntable":
            return None
        stated = {frame: 360.0 * frame / self.frames for frame in range(self.frames)}
        return TurntableRecord(reason="the simulated turntable", degrees=stated, spread=TURN_SPREAD)

    @property
    def lamps(self) -> LampsRecord | None:
        """Lamps of the dome, one for each frame but the last, which has none; None without a dome."""
        if self.settings.scene != "dome":
            return None
        places = dict(enumerate(lamp_places()[: self.frames]))
        lens = self.mounts[0].optics.lens
        left, right = rays(lens, ((0.0, lens.height / 2), (lens.width, lens.height / 2)))
        return LampsRecord(
            reason="the simulated dome",
            places={frame: places.get(frame) for frame in range(self.frames)},
            brightness={frame: brightness(frame) for frame in places},
            across=float(self.cam_from_world(0, 0)[2, 3] * (right[0] / right[2] - left[0] / left[2])),
            spread=LAMP_SPREAD,
        )

    def scene_at(self, frame: int) -> Scene:
        """The scene of a frame, in the axes of the poses: of a turntable the room turns about the things."""
        if self.settings.scene not in ("turntable", "dome"):
            return self.scene
        return _scene(self.settings, self.seed, frame)

    def radiance(self, camera: int, frame: int, subject: Subject = "scene") -> Array32:
        """True radiance averaged over each pixel, float32 [H, W, 3]; rendered once and kept."""
        lens = self.mounts[camera].optics.lens
        if subject in ("dark", "flat"):
            return grey(lens, LIGHT * self.settings.light if subject == "flat" else 0.0)
        with self._lock:
            key = (subject, camera, frame)
            if key not in self._rendered:
                self._rendered[key] = self._render(camera, frame, subject)
            return self._rendered[key]

    def _render(self, camera: int, frame: int, subject: Subject) -> Array32:
        lens, samples = self.mounts[camera].optics.lens, self.settings.samples
        pose = self.cam_from_world(camera, frame, subject)
        if subject == "scene":
            return self.scene_at(frame).render(lens, pose, samples)
        image = self.board.render(lens, pose @ np.linalg.inv(self.board_from_world(frame)), samples)
        light = np.float32(LIGHT * self.settings.light)
        return np.repeat((light * image)[..., None], 3, axis=2)

    def _view(self, index: int) -> Callable[[int], Array32]:
        return lambda frame: self.radiance(index, frame, self._shown.get(frame, "scene"))

    def _body(self, mount: Mount) -> Body:
        settings = self.settings
        nominal = nominal_sensor(settings)
        return Body(
            seed=self.seed,
            serial=mount.serial,
            kind=settings.kind,
            optics=mount.optics,
            sensor=replace(built_sensor(nominal, mount, settings.effects), **settings.sensor),
            nominal=nominal,
            cfa=mount.cfa,
            camera_from_xyz=mount.camera_from_xyz,
            curve=settings.curve,
            effects=settings.effects,
        )


def _scene(settings: RigSettings, seed: int, frame: int = 0) -> Scene:
    """The scene of a rig at a frame."""
    made: dict[str, Callable[[], Scene]] = {
        "table": demo_scene,
        "gallery": gallery_scene,
        "court": court_scene,
        "turntable": lambda: turntable_scene(table_turn(seed, settings.positions, frame)),
        "dome": lambda: dome_scene(frame, lamp_factor(seed, frame)),
    }
    scene = made[settings.scene]()
    if settings.even:
        scene = scene.evenly_lit(EVEN)
    if settings.gloss is not None:
        scene = scene.polished(settings.gloss)
    return scene if settings.light == 1.0 else scene.brightened(settings.light)
