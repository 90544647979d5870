"""A painted wall two units away, of known light, in the layouts of data sets."""

import json
from pathlib import Path

import numpy as np

from imaging.colour.spaces import srgb_encode
from imaging.files.photo import encode_png
from imaging.files.tiff.dng import encode_dng
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa, mosaic
from imaging.sensor.mosaic import FrameMetadata, RawMosaic

WIDTH, HEIGHT, FOCAL, AWAY = 64, 48, 60.0, 2.0
BLACK, WHITE = 528, 4095
NEUTRAL = np.array([0.5, 1.0, 0.7])
CENTRES = [(0.05 * x, 0.08 * y) for y in (-1, 0, 1) for x in (-2, 0, 2)]
FAST, SLOW = 1 / 1000, 1 / 100


def light(centre) -> np.ndarray:
    """Picture of a camera at `centre` before the wall, [H, W, 3], linear, about 0.01 to 0.09."""
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5 - WIDTH / 2, np.arange(HEIGHT) + 0.5 - HEIGHT / 2)
    x, y = centre[0] + AWAY * u / FOCAL, centre[1] + AWAY * v / FOCAL
    waves = [
        np.sin(7 * x + phase) * np.cos(6 * y + 2 * phase) + 0.5 * np.sin(19 * x - 13 * y)
        for phase in (0, 1, 2)
    ]
    return 0.05 + 0.025 * np.stack(waves, axis=-1)


def rows(folder: Path, centres) -> None:
    """`poses_bounds.npy` of cameras that look along z, x right and y down."""
    table = []
    for x, y in centres:
        matrix = np.array([[0, 1, 0, x, HEIGHT], [1, 0, 0, y, WIDTH], [0, 0, -1, 0, FOCAL]], float)
        table.append([*matrix.ravel(), 1.0, 4.0])
    np.save(folder / "poses_bounds.npy", np.array(table))


def put(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def dng(signal: np.ndarray, time: float, scale: int = 1) -> bytes:
    codes = np.rint(scale * (BLACK + (WHITE - BLACK) * signal)).astype(np.uint16)
    metadata = FrameMetadata(
        make="Maker", model="Phone", exposure=Exposure(time=time, f_number=1.8, iso=1000)
    )
    from_xyz = np.diag(NEUTRAL) @ np.linalg.inv(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    )
    raw = RawMosaic(codes, Cfa.RGGB, ((float(scale * BLACK),),), scale * WHITE, neutral=tuple(NEUTRAL),
                    camera_from_xyz=from_xyz, noise_profile=(1e-4, 1e-6), metadata=metadata)  # fmt: skip
    return encode_dng(raw)


def rawnerf_scene(folder: Path) -> Path:
    """A test scene: the first name is that of the test view, which is clean in ten times the exposure."""
    rng = np.random.default_rng(4)
    centres = [CENTRES[4], *CENTRES]
    rows_of = ["00_test", *(f"IMG_{number}" for number in range(len(CENTRES)))]
    for name, centre in zip(rows_of, centres, strict=True):
        put(folder / "images" / f"{name}.png", encode_png(np.zeros((HEIGHT, WIDTH, 3), np.uint8)))
        signal = mosaic(light(centre) * NEUTRAL, Cfa.RGGB)
        noisy = signal + rng.normal(0, 2e-3, signal.shape)
        if name == "00_test":
            files = {"raw/test/a.dng": dng(noisy, FAST), "raw/test/b.dng": dng(10 * signal, SLOW)}
            files["hdrplus_test/merged.dng"] = dng(10 * signal, SLOW, scale=4)
            for path, data in files.items():
                put(folder / path, data)
        else:
            put(folder / "raw" / "train" / f"{name}.dng", dng(noisy, FAST))
    for path in (folder / "raw").rglob("*.dng"):
        time = "1/100" if path.stem == "b" else "1/1000"
        path.with_suffix(".json").write_text(
            json.dumps([{"ShutterSpeed": time, "ISO": 1000, "FNumber": 1.8}])
        )
    rows(folder, centres)
    return folder


def plenoxels_scene(folder: Path) -> Path:
    """Photographs of exposures and white balances that nothing tells."""
    rng = np.random.default_rng(5)
    for number, centre in enumerate(CENTRES):
        gains = 2 ** rng.uniform(-0.3, 0.3, 3) * 4
        codes = np.rint(255 * srgb_encode(light(centre) * gains)).astype(np.uint8)
        put(folder / "images" / f"{number:03d}.png", encode_png(codes))
    rows(folder, CENTRES)
    return folder
