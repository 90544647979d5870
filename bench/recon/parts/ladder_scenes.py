"""Scenes for bench/recon/parts/ladder.py: simulated sessions of which the model required is known.

Each kind of scene has one thing that has to be modelled, or none; everything else is switched off in the
simulator, so that whatever else a ladder takes is taken for nothing.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from bench.support.oracle import calibrate_from_truth
from calib.calibrate import calibrate
from capture.bracket.goals import BracketGoals
from capture.simulated import capture_simulated
from drivers.sim.rigs import simulate
from drivers.sim.truth import pose_of
from imaging.files import store
from imaging.optics.pose import Pose
from imaging.session.calibration import CalibrationRecord, read_calibration

POINTS = 1200
"""Scene points of a calibration that is taken from the truth: about as many as pictures of this size give."""
SNR = 14.0
"""dB that a planned bracket has to reach in the dark: soft light spans 5 stops, and one exposure of these
sensors reaches 8 at that; lamps and shadows span 17."""
TURN, SHIFT = 0.5, 0.008
"""Errors of made wrong poses: degrees about each axis, nearly a pixel, and m along each."""
STOPS = 0.2
"""Errors of made wrong exposure scales, stops."""

PLAIN: dict[str, Any] = {
    "width": 96, "height": 72, "samples": 3,
    "even": True, "gloss": 0.0, "distortion": 0.0, "vignetting": 0.0, "gains": 0.0,
}  # fmt: skip
"""Settings of a plain scene: soft light before ideal cameras, as small as calibration by itself still can."""

OFF = dict.fromkeys(
    (
        "exposures", "response_curve", "sensor_linearity", "vignetting", "camera_gain",
        "direction-dependent colour", "lens_principal_point", "lens_radial_1", "lens_radial_2",
        "lens_tangential", "lens_fisheye", "refine poses", "refine exposures", "refine vignetting",
    ),
    False,
)  # fmt: skip
"""Needs of a plain scene among all that is judged: none."""

Altered = Callable[[CalibrationRecord, np.random.Generator], CalibrationRecord]


def turned(record: CalibrationRecord, rng: np.random.Generator) -> CalibrationRecord:
    """Every view turned and shifted at random, without a word of how sure its pose is."""
    views = []
    for view in record.views:
        half = np.radians(TURN * rng.standard_normal(3)) / 2
        turn = np.array([1.0, *half])
        w, x, y, z = (turn / np.linalg.norm(turn)).tolist()
        small = Pose(quaternion=(w, x, y, z), translation=tuple(SHIFT * rng.standard_normal(3)))
        moved = small.matrix() @ view.cam_from_world.matrix()
        views.append(view.model_copy(update={"cam_from_world": pose_of(moved)}))
    return record.model_copy(update={"views": tuple(views)})


def mislabelled(record: CalibrationRecord, rng: np.random.Generator) -> CalibrationRecord:
    """The scale of every shot off at random."""
    scale = {
        file: k * float(2 ** (STOPS * rng.standard_normal())) for file, k in record.exposure_scale.items()
    }
    return record.model_copy(update={"exposure_scale": scale})


def unshaded(record: CalibrationRecord, rng: np.random.Generator) -> CalibrationRecord:
    """Remove the falloff."""
    cameras = [camera.model_copy(update={"vignetting": (0.0, 0.0, 0.0)}) for camera in record.cameras]
    return record.model_copy(update={"cameras": tuple(cameras)})


@dataclass(frozen=True)
class Kind:
    """Kind of scene: the settings of the simulator, and the rungs that have to be taken, or must not be.

    required: in place of `OFF`; None: either will do. stops: of the bracket about the rig's middle
    exposure, or `auto`: planned; None: the rig's own. altered: the calibration is not measured but the
    truth's, made wrong so. little: whether its scenes need little. trainings: of each scene, with seeds of
    their own, for the mean of their dB: where there are lamps, seeds alone change the pictures by 0.3 dB.
    """

    name: str
    rig: str = "demo"
    settings: Mapping[str, Any] = field(default_factory=dict)
    stops: tuple[float, ...] | str | None = None
    required: Mapping[str, bool | None] = field(default_factory=dict)
    altered: Altered | None = None
    little: bool = False
    seeds: int = 5
    trainings: int = 1

    @property
    def needs(self) -> dict[str, bool]:
        """Expected state of every rung that is judged."""
        known = {**OFF, **self.required}
        return {name: need for name, need in known.items() if need is not None}


LAMPS = {"even": False}
MANY = {"exposures": True}
KINDS = (
    Kind("one photograph a view", "demo-ldr", stops=(0.0,), required={"tone curve": False}, little=True),
    Kind(
        "HDR", settings=LAMPS, stops="auto", required={**MANY, "one-sided saturation": True}, trainings=3
    ),
    Kind("linear", required=MANY, stops=(-2.0, 0.0, 2.0), little=True),
    Kind("film curve", "demo-ldr", required={**MANY, "response_curve": True, "tone curve": True}),
    Kind(
        "vignetted", settings={"vignetting": 1.0}, stops=(0.0,),
        # The falloffs differ by some percent, which a sensitivity for each camera describes nearly as well.
        required={"vignetting": True, "camera_gain": None},
    ),
    Kind(
        "view-dependent", settings={**LAMPS, "gloss": 0.12},
        required={**MANY, "direction-dependent colour": True}, trainings=3,
    ),
    Kind("wrong poses", stops=(0.0,), altered=turned, required={"refine poses": True}),
    Kind("one exposure enough", stops="auto", required={"one-sided saturation": False}, little=True),
    Kind("sRGB curve", "demo-ldr", {"curve": "srgb"}, required={**MANY, "tone curve": True}, seeds=3),
    Kind(
        "gamma curve", "demo-ldr", {"curve": "gamma"}, seeds=3,
        required={**MANY, "tone curve": True, "response_curve": True, "response_blend": False},
    ),
    Kind("unequal cameras", settings={"gains": 3.0}, stops=(0.0,), required={"camera_gain": True}, seeds=3),
    Kind("distorted", settings={"distortion": 1.0}, stops=(0.0,), required={"lens_radial_1": True}, seeds=3),
    Kind(
        "fisheye", settings={"lens": "fisheye"}, stops=(0.0,), seeds=3,
        # What leads to a fisheye, or comes behind it, is no fault.
        required={
            "lens_fisheye": True, "lens_radial_1": None, "lens_radial_2": None, "lens_tangential": None,
        },
    ),
    Kind("wrong exposures", stops=(0.0,), altered=mislabelled, required={"refine exposures": True}, seeds=3),
    Kind(
        "falloff unknown", settings={"vignetting": 1.0}, stops=(0.0,), altered=unshaded,
        required={"refine vignetting": True}, seeds=3,
    ),
)  # fmt: skip
"""The first eight are those of the requirement."""


@dataclass(frozen=True)
class Scene:
    """A kind and a seed; odd seeds show the gallery, even ones the table."""

    kind: Kind
    seed: int

    @property
    def name(self) -> str:
        """Name in words; it names its row and, with dashes, its folder."""
        return f"{self.kind.name} {self.seed}"


def scenes() -> list[Scene]:
    """All of them, so ordered that a bench that is stopped has seen every kind."""
    most = max(kind.seeds for kind in KINDS)
    return [Scene(kind, seed) for seed in range(most) for kind in KINDS if seed < kind.seeds]


def session(scene: Scene, work: Path) -> Path:
    """Session, shot and calibrated now if it does not exist."""
    kind, seed = scene.kind, scene.seed
    folder = work / scene.name.replace(" ", "-")
    settings = {**PLAIN, "scene": "gallery" if seed % 2 else "table", **kind.settings}
    with mock.patch("capture.simulated.simulate", partial(simulate, **settings)):
        if not (folder / "truth" / "truth.json").exists():
            bracket = BracketGoals(snr=SNR) if isinstance(kind.stops, str) else kind.stops
            capture_simulated(kind.rig, folder, seed=seed, bracket=bracket)
    if (folder / "calibration" / "calibration.json").exists():
        return folder
    if kind.altered is None:
        calibrate(folder)
        return folder
    with mock.patch("bench.support.oracle.simulate", partial(simulate, **settings)):
        calibrate_from_truth(folder, points=POINTS, seed=seed)
    record = kind.altered(read_calibration(folder), np.random.Generator(np.random.PCG64([seed, 0x0FF])))
    store.write_json(folder / "calibration" / "calibration.json", record.model_dump(mode="json"))
    return folder
