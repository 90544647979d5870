"""Settings of the simulated rigs, by name, and the sensors that they have."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from drivers.sim.camera.camera import HEADROOM
from drivers.sim.camera.response import Curve
from drivers.sim.camera.sensor import SensorModel
from drivers.sim.mounting import LensKind, Mount
from imaging.sensor.cfa import Cfa, as_tile
from imaging.session.records import Band


@dataclass(frozen=True)
class RigSettings:
    """Settings of a rig that can be overridden.

    scene: the laid table, the gallery, the court, in which one camera turns on a nodal head instead of
    going along an arc, a turntable before cameras that stand still, or a light dome; positions: frames;
    bit_depth: of the RAW files; samples: rays along a pixel's side; light: factor on all light of the scene,
    0 for dark frames; effects: jitter, flicker and row noise; lens: of all cameras; sensor: fields of
    SensorModel in which the sensors differ from their files, such as prnu.
    even: soft light alone, which fits into one exposure, instead of lamps; gloss: of all surfaces; None keeps
    theirs. distortion, vignetting, gains: factors on how far lenses and sensitivities are from ideal ones, 0
    for just that. curve: of a camera that develops its photographs. cfa: of all sensors, begun at a place of
    its own by each; None: a Bayer one. glare: share of the light that lenses scatter.
    """

    kind: Literal["raw", "ldr"]
    cameras: int
    positions: int
    width: int
    height: int
    scene: Literal["table", "gallery", "court", "turntable", "dome"] = "table"
    bit_depth: int = 12
    samples: int = 4
    light: float = 1.0
    effects: bool = False
    lens: LensKind = "normal"
    even: bool = False
    gloss: float | None = None
    distortion: float = 1.0
    vignetting: float = 1.0
    gains: float = 1.0
    curve: Curve = "film"
    cfa: Cfa | None = None
    glare: float = 0.0
    sensor: Mapping[str, Any] = field(default_factory=dict)
    wheel: tuple[Band, ...] = ()


_WHEEL = tuple(Band(name=f"{wave}nm", wavelength_nm=wave, bandwidth_nm=40) for wave in (450, 550, 650))
RIGS = {
    "demo": RigSettings("raw", cameras=4, positions=6, width=320, height=240),
    "demo-ldr": RigSettings("ldr", cameras=4, positions=6, width=320, height=240),
    "gallery": RigSettings("raw", cameras=4, positions=6, width=320, height=240, scene="gallery"),
    "gallery-ldr": RigSettings("ldr", cameras=4, positions=6, width=320, height=240, scene="gallery"),
    "demo-fisheye": RigSettings("raw", cameras=4, positions=6, width=320, height=240, lens="fisheye"),
    "nodal": RigSettings(
        "raw", cameras=1, positions=12, width=320, height=240, scene="court", lens="fisheye"
    ),
    "turntable": RigSettings("raw", cameras=1, positions=24, width=400, height=300, scene="turntable"),
    "dome": RigSettings(
        "raw", cameras=1, positions=25, width=240, height=180, scene="dome", samples=3, vignetting=0
    ),
    "toy": RigSettings("raw", cameras=2, positions=3, width=64, height=48),
    "toy-ldr": RigSettings("ldr", cameras=2, positions=3, width=64, height=48),
    "toy-fisheye": RigSettings("raw", cameras=2, positions=3, width=64, height=48, lens="fisheye"),
    "toy-x-trans": RigSettings("raw", cameras=2, positions=3, width=64, height=48, cfa=Cfa.X_TRANS),
    "toy-quad-bayer": RigSettings("raw", cameras=2, positions=3, width=64, height=48, cfa=Cfa.QUAD_BAYER),
    "toy-rgbw": RigSettings("raw", cameras=2, positions=3, width=64, height=48, cfa=Cfa.KODAK_RGBW),
    "toy-mono": RigSettings("raw", cameras=2, positions=3, width=64, height=48, cfa=Cfa.MONO),
    "toy-wheel": RigSettings("raw", cameras=2, positions=3, width=64, height=48, wheel=_WHEEL),
}


def nominal_sensor(settings: RigSettings) -> SensorModel:
    """A small industrial sensor: a well of 10,300 electrons, just above white at ISO 100; 3 of read noise.

    A camera that develops its photographs bins four photosites to a pixel.
    """
    bits, bins = (settings.bit_depth, 1.0) if settings.kind == "raw" else (14, HEADROOM)
    black = 2.0 ** (bits - 4)
    span = 2.0**bits - 1.0 - black
    return SensorModel(
        gain=span / (bins * 9600.0),
        read_noise=3.0,
        full_well=bins * 10_300.0,
        black=((black, black), (black, black)),
        bit_depth=bits,
        prnu=0.005,
        dsnu=0.4,
        dark_current=0.5,
        hot_share=5e-5,
    )


def built_sensor(nominal: SensorModel, mount: Mount, effects: bool) -> SensorModel:
    """One sensor of that make: gain, read noise and black differ a little from the data sheet."""
    black = nominal.black[0][0]
    return replace(
        nominal,
        gain=nominal.gain * mount.unit_gain,
        read_noise=nominal.read_noise * mount.unit_noise,
        full_well=nominal.full_well / mount.unit_gain,
        black=as_tile(black + np.array(mount.black)),
        row_noise=0.5 if effects else 0.0,
    )
