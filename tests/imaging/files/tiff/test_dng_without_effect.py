"""Tags of a DNG that change nothing in what its samples are: rendering, crops, other pictures."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile

from imaging.files.raw import read_raw
from imaging.files.tiff.directory import ASCII, BYTE, LONG, RATIONAL, SHORT, SRATIONAL, UNDEFINED, Entry
from imaging.sensor.mosaic import RawMosaic
from tests.imaging.files.tiff.test_dng_unread import BAYER, COMMON, LIGHT, TRUE, put

MakeRaw = Callable[..., RawMosaic]
Write = Callable[..., Path]

RENDERING = {
    "BaselineExposure": (50730, Entry(SRATIONAL, [2])),
    "BaselineExposureOffset": (51109, Entry(SRATIONAL, [1])),
    "DefaultBlackRender": (51110, Entry(LONG, [1])),
    "ShadowScale": (50739, Entry(RATIONAL, [1])),
    "ProfileToneCurve": (50940, Entry(RATIONAL, [0, 0, 1, 1])),
    "ProfileGainTableMap": (52525, Entry(UNDEFINED, bytes(64))),
    "ProfileGainTableMap2": (52544, Entry(UNDEFINED, bytes(64))),
    "ProfileHueSatMapDims": (50937, Entry(LONG, [1, 2, 1])),
    "ProfileHueSatMapData1": (50938, Entry(RATIONAL, [30, 2, 2, 60, 2, 2])),
    "ProfileLookTableData": (50982, Entry(RATIONAL, [30, 2, 2])),
    "RGBTables": (52543, Entry(UNDEFINED, bytes(32))),
    "ForwardMatrix1": (50964, Entry(SRATIONAL, [2, 0, 0, 0, 2, 0, 0, 0, 2])),
    "ReductionMatrix1": (50725, Entry(SRATIONAL, [2, 0, 0, 0, 2, 0, 0, 0, 2])),
}
CROPS = {
    "DefaultScale": (50718, Entry(RATIONAL, [1, 2])),
    "DefaultCropOrigin": (50719, Entry(LONG, [4, 6])),
    "DefaultUserCrop": (51125, Entry(RATIONAL, [0, 0, 0.5, 0.5])),
    "OriginalDefaultFinalSize": (51089, Entry(LONG, [8, 8])),
}
SENSOR = {
    "MaskedAreas": (50830, Entry(LONG, [0, 0, 8, 8])),
    "BayerGreenSplit": (50733, Entry(LONG, [400])),
    "AntiAliasStrength": (50738, Entry(RATIONAL, [0])),
    "BestQualityScale": (50780, Entry(RATIONAL, [2])),
    "NoiseReductionApplied": (50935, Entry(RATIONAL, [0.5])),
    "LensInfo": (50736, Entry(RATIONAL, [24, 70, 2, 4])),
}
SAME = {
    "SubTileBlockSize": (50974, Entry(SHORT, [1, 1])),
    "RowInterleaveFactor": (50975, Entry(SHORT, [1])),
    "ColorimetricReference": (50879, Entry(SHORT, [0])),
    "SampleFormat": (339, Entry(SHORT, [1])),
    "LinearResponseLimit": (50734, Entry(RATIONAL, [1])),
}
OTHERS = {
    "SemanticName": (52526, Entry(ASCII, "sky")),
    "DNGPrivateData": (50740, Entry(BYTE, [1, 2, 3, 4])),
    "PreviewColorSpace": (50970, Entry(LONG, [3])),
    "ImageSequenceInfo": (52548, Entry(UNDEFINED, bytes(24))),
    "TimeCodes": (51043, Entry(BYTE, [0] * 8)),
}
WITHOUT_EFFECT = RENDERING | CROPS | SENSOR | SAME | OTHERS


@pytest.mark.parametrize("name", WITHOUT_EFFECT)
def test_of_a_mosaic_nothing_changes(
    write: Write, make_raw: MakeRaw, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    tag, entry = WITHOUT_EFFECT[name]
    monkeypatch.setattr("imaging.files.tiff.dng_tags.BASELINE_SHARPNESS", tag)
    raw = make_raw()
    mosaic = read_raw(write(raw, BASELINE_SHARPNESS=entry))
    plain = replace(raw, pixels=mosaic.pixels, metadata=mosaic.metadata)
    assert np.array_equal(mosaic.pixels, raw.pixels)
    assert replace(mosaic, camera_from_xyz=None, noise_profile=None) == replace(
        plain, camera_from_xyz=None, noise_profile=None
    )
    assert np.allclose(mosaic.camera_from_xyz, raw.camera_from_xyz)


@pytest.mark.parametrize("name", WITHOUT_EFFECT)
def test_of_demosaicked_light_nothing_changes(tmp_path: Path, name: str) -> None:
    tag, entry = WITHOUT_EFFECT[name]
    if name == "SampleFormat":  # which tifffile writes itself
        return
    count, _ = entry.encoded()
    values = entry.values
    if entry.kind in (RATIONAL, SRATIONAL):
        values = [part for value in entry.values for part in float(value).as_integer_ratio()]
    form = bytes(values) if entry.kind in (BYTE, UNDEFINED) else values
    more = (tag, entry.kind, count, form if isinstance(form, str | bytes) else tuple(form), True)
    assert np.array_equal(read_raw(put(tmp_path / "a.dng", LIGHT, [more], 34892)).pixels, LIGHT)


def test_masked_photosites_tell_black_only_where_no_tag_does(
    write: Write, make_raw: MakeRaw, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("imaging.files.tiff.dng_tags.BASELINE_SHARPNESS", 50830)
    raw = make_raw()
    raw.pixels[:16, :16] = 100
    areas = Entry(LONG, [0, 0, 16, 16])
    black = Entry(SHORT, [64, 65, 66, 67])
    assert read_raw(write(raw, BASELINE_SHARPNESS=areas, BLACK=black)).black == ((64.0, 65.0), (66.0, 67.0))
    measured = read_raw(write(raw, BASELINE_SHARPNESS=areas, BLACK=None, BLACK_REPEAT=None))
    assert measured.black == ((100.0, 100.0), (100.0, 100.0))
    assert read_raw(write(raw, BLACK=None, BLACK_REPEAT=None)).black == ((0.0, 0.0), (0.0, 0.0))


@pytest.mark.parametrize(
    ("photometric", "kind"),
    [
        (51177, 8),  # depth map
        (52527, 65540),  # semantic mask
        (4, 4),  # TransparencyMask
        (1, 1),  # preview
        (1, 65537),  # alternative preview
        (32803, 16),  # enhanced
        (34892, 16),
        (34892, 1),
    ],
)
@pytest.mark.parametrize("mosaic", [False, True])
def test_a_larger_picture_of_another_kind_is_not_taken(
    tmp_path: Path, photometric: int, kind: int, mosaic: bool
) -> None:
    large = TRUE if mosaic else LIGHT
    other = np.full((160, 200) if photometric != 34892 else (160, 200, 3), 9, np.uint8)
    tags = BAYER if photometric == 32803 else []
    with tifffile.TiffWriter(tmp_path / "a.dng") as file:
        options = {"photometric": 32803 if mosaic else 34892, "extratags": COMMON + (BAYER if mosaic else [])}
        file.write(large, subfiletype=0, subifds=1, metadata=None, **options)
        file.write(other, subfiletype=1, photometric=photometric, metadata=None, extratags=tags)
    data = (tmp_path / "a.dng").read_bytes()
    entry = bytes.fromhex(
        "fe0004000100000001000000"
    )  # NewSubfileType 1, for tifffile writes no masks of bytes
    assert data.count(entry) == 1
    (tmp_path / "a.dng").write_bytes(data.replace(entry, entry[:8] + kind.to_bytes(4, "little")))
    assert np.array_equal(read_raw(tmp_path / "a.dng").pixels, large)
