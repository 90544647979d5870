"""Samples that the tests of the file formats share."""

import os
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imaging.files.tiff import dng, dng_tags
from imaging.files.tiff.directory import Entry
from imaging.files.tiff.dng import write_dng
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import FrameMetadata, RawMosaic

MakeRaw = Callable[..., RawMosaic]
Write = Callable[..., Path]


@pytest.fixture
def metadata() -> FrameMetadata:
    """Metadata with every field set."""
    return FrameMetadata(
        make="Maker",
        model="Model 1",
        serial="S-1",
        exposure=Exposure(time=1 / 8000, f_number=2.8, iso=200),
        captured_at=datetime(2024, 5, 6, 7, 8, 9, 123456),
        focal_length_mm=35.0,
        focal_length_35mm=50.0,
        orientation=6,
    )


@pytest.fixture
def make_raw(metadata: FrameMetadata) -> MakeRaw:
    """A mosaic of noise with everything set; shape, seed and any field as asked."""

    def make(height: int = 40, width: int = 64, *, seed: int = 1, **fields: Any) -> RawMosaic:
        white = fields.get("white", 4000)
        pixels = np.random.default_rng(seed).integers(0, white + 1, (height, width), dtype=np.uint16)
        defaults: dict[str, Any] = {
            "pixels": pixels,
            "cfa": Cfa.GBRG,
            "black": ((255.5, 256.0), (257.0, 258.25)),
            "white": white,
            "neutral": (0.5, 1.0, 0.75),
            "camera_from_xyz": ((0.9, -0.3, -0.1), (-0.4, 1.2, 0.2), (0.0, 0.2, 0.6)),
            "noise_profile": (1.25e-4, 3e-7),
            "metadata": metadata,
        }
        return RawMosaic(**{**defaults, **fields})

    return make


@pytest.fixture
def write(tmp_path: Path, make_raw: MakeRaw, monkeypatch: pytest.MonkeyPatch) -> Write:
    """A DNG of `raw` with other or further tags than rig would write; None leaves a tag out."""
    plain = dng._colour

    def written(raw: RawMosaic | None = None, compression: str = "none", **tags: Entry | None) -> Path:
        named = {getattr(dng_tags, name): entry for name, entry in tags.items()}

        def changed(mosaic: RawMosaic) -> dict[int, Entry]:
            entries = {**dng._geometry(mosaic), **plain(mosaic), **named}
            return {tag: entry for tag, entry in entries.items() if entry is not None}

        monkeypatch.setattr(dng, "_colour", changed)
        path = tmp_path / "a.dng"
        write_dng(path, raw or make_raw(), compression=compression)
        return path

    return written


@pytest.fixture
def rig_data() -> Path:
    """The folder of real photographs; skips where there is none."""
    folder = os.environ.get("RIG_DATA")
    if not folder:
        pytest.skip("RIG_DATA is not set: no real photographs")
    return Path(folder)
