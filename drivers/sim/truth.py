"""Ground truth of a simulated session in `truth/`, which only an evaluation may read.

truth.json names lenses, poses, colours, vignetting, noise, the response and the exposures really applied;
<frame>/<camera>.exr is the true radiance, linear Rec.709 float32, on the camera's own distorted pixel grid,
averaged over each pixel, without vignetting and noise; of frames of the scene only. Of a filter wheel it has
a channel a band. truth.json lists the frames of darks, flats and the board, their brightness and the board's
poses.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drivers.sim.camera import response, shutter
from drivers.sim.camera.camera import Body, applied_exposure
from drivers.sim.camera.filters import weights
from drivers.sim.camera.sensor import SimulatedSensor
from drivers.sim.rigs import SimulatedRig
from drivers.sim.scene.subjects import LIGHT
from imaging.arrays import Array, Array32
from imaging.files import store
from imaging.files.exr.writing import write_exr
from imaging.optics.exposure import Exposure
from imaging.optics.pose import Pose
from imaging.progress import Progress, unreported
from imaging.session.bands import channels, in_order
from imaging.session.records import Band, ShotRecord
from imaging.session.session import Session
from imaging.session.view_id import ViewId


def pose_of(motion: Array) -> Pose:
    """A rigid motion [4, 4] as a Pose, w >= 0."""
    m = motion[:3, :3]
    # Shepperd's method: divide by the largest component, which is at least 1/2.
    trace = float(np.trace(m))
    squares = np.array((trace, m[0, 0], m[1, 1], m[2, 2])) * 2.0 - trace + 1.0
    squares[0] = 1.0 + trace
    largest = int(np.argmax(squares))
    w, x, y, z = {
        0: (squares[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]),
        1: (m[2, 1] - m[1, 2], squares[1], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]),
        2: (m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], squares[2], m[1, 2] + m[2, 1]),
        3: (m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], squares[3]),
    }[largest]
    quaternion = np.array((w, x, y, z), np.float64)
    quaternion /= np.linalg.norm(quaternion) * (1.0 if quaternion[0] >= 0 else -1.0)
    q, t = quaternion.tolist(), motion[:3, 3].tolist()
    return Pose(quaternion=(q[0], q[1], q[2], q[3]), translation=(t[0], t[1], t[2]))


def write_truth(rig: SimulatedRig, session: Path, progress: Progress = unreported) -> None:
    """Write `truth/` for the frames that the session has shots of, or for all if it has none yet.

    Radiance that an earlier run of the session has written stays: the seed makes it the same.
    """
    shots = Session.open(session).shots() if (session / "session.json").exists() else []
    frames = sorted({shot.frame for shot in shots if shot.kind == "scene"})
    if not shots:
        frames = list(range(rig.frames))
    names = [mount.name for mount in rig.mounts]
    folder, total = session / "truth", len(frames) * len(names)
    done = 0
    for frame in frames:
        for index, name in enumerate(names):
            progress("writing the true radiance", done, total)
            path = folder / f"{ViewId(frame, name)}.exr"
            if not path.exists():
                _write_light(path, rig.radiance(index, frame), in_order(rig.settings.wheel))
            done += 1
    bodies = dict(zip(names, rig.bodies, strict=True))
    applied = [
        {"file": shot.file, "camera": shot.camera, "frame": shot.frame, "step": shot.step}
        | _applied(bodies[shot.camera], shot.frame, shot.exposure)
        for shot in shots
        if shot.camera in bodies and shot.exposure is not None
    ]
    if not shots:
        applied = [
            {"camera": name, "frame": frame, "step": step} | _applied(body, frame, exposure)
            for frame in frames
            for name, body in bodies.items()
            for step, exposure in enumerate(rig.bracket)
        ]
    store.write_json(
        folder / "truth.json",
        {
            "schema_version": 1,
            "rig": rig.name,
            "seed": rig.seed,
            "effects": rig.settings.effects,
            "cameras": {name: _camera(rig, index) for index, name in enumerate(names)},
            "frames": [
                {
                    "frame": frame,
                    "cam_from_world": {
                        name: pose_of(rig.cam_from_world(index, frame)).model_dump(mode="json")
                        for index, name in enumerate(names)
                    },
                }
                for frame in frames
            ],
            "response": _response(rig.settings.curve) if rig.settings.kind == "ldr" else None,
            "exposures": applied,
            **_subjects(rig, names, shots),
        },
    )
    progress("writing the true radiance", total, total)


def _write_light(path: Path, light: Array32, bands: Sequence[Band]) -> None:
    if not bands:
        write_exr(path, light)
        return
    by_band = light @ np.stack([weights(band) for band in bands]).T
    planes = {name: by_band[..., number] for number, name in enumerate(channels(bands))}
    write_exr(path, planes, primaries=None)


def _subjects(rig: SimulatedRig, names: list[str], shots: list[ShotRecord]) -> dict[str, Any]:
    """Return the subjects of the frames that do not show the scene; empty without such frames."""
    frames = {
        kind: sorted({shot.frame for shot in shots if shot.kind == kind})
        for kind in ("dark", "flat", "board")
    }
    facts: dict[str, Any] = {}
    if frames["dark"]:
        facts["dark"] = {"frames": frames["dark"]}
    if frames["flat"]:
        facts["flat"] = {"frames": frames["flat"], "radiance": LIGHT * rig.settings.light}
    if frames["board"]:
        facts["board"] = rig.board.description() | {
            "frames": [
                {
                    "frame": frame,
                    "board_from_world": pose_of(rig.board_from_world(frame)).model_dump(mode="json"),
                    "cam_from_world": {
                        name: pose_of(rig.cam_from_world(index, frame, "board")).model_dump(mode="json")
                        for index, name in enumerate(names)
                    },
                }
                for frame in frames["board"]
            ]
        }
    return facts


def _camera(rig: SimulatedRig, index: int) -> dict[str, Any]:
    mount, body = rig.mounts[index], rig.bodies[index]
    optics, sensor = body.optics, body.sensor
    return {
        "serial": body.serial,
        "lens": optics.lens.model_dump(mode="json"),
        "cam_from_rig": pose_of(mount.cam_from_rig).model_dump(mode="json"),
        "camera_from_rec709": optics.camera_from_rec709.tolist(),
        "vignetting": list(optics.vignetting),
        "gain": optics.gain,
        "glare": optics.glare,
        "noise": {"gain": sensor.gain, "read_noise": sensor.read_noise, "prnu": sensor.prnu},
        "black": [list(row) for row in sensor.black],
        "white": sensor.white,
        "full_well": sensor.full_well,
        "cfa": str(body.cfa),
        **(_photosites(body) if body.kind == "raw" else {}),
    }


def _photosites(body: Body) -> dict[str, Any]:
    """Return the sensor properties that only darks and flats measure; defects by column and row."""
    model, lens = body.sensor, body.optics.lens
    sensor = SimulatedSensor(model, lens.width, lens.height, body.seed, body.serial, 0)
    return {
        "ceiling": model.white if model.ceiling is None else model.ceiling,
        "nonlinearity": model.nonlinearity,
        "dsnu": model.dsnu,
        "dark_current": model.dark_current,
        "row_noise": model.row_noise,
        "defects": [
            {"x": int(x), "y": int(y), "kind": kind}
            for kind, which in (("hot", sensor.hot), ("dead", sensor.dead))
            for y, x in zip(*np.nonzero(which), strict=True)
        ],
    }


def _applied(body: Body, frame: int, label: Exposure) -> dict[str, Any]:
    label = shutter.snap(label)
    exact, flicker = applied_exposure(body, frame, label)
    return {
        "reported": label.model_dump(mode="json"),
        "applied": exact.model_dump(mode="json"),
        "light": flicker,
    }


def _response(name: response.Curve) -> dict[str, Any]:
    """The tone curve, the same for all channels and cameras: ln(E k) at codes 1/255..254/255."""
    codes = np.arange(1, 255) / 255.0
    curve = np.log(response.exposure_of(codes, name)).tolist()
    return {"codes": codes.tolist(), "log_exposure": [curve, curve, curve]}
