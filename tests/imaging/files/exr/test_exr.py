"""EXR files hold what was put in, and damaged ones are refused without noise."""

from pathlib import Path

import numpy as np
import OpenEXR
import PyOpenColorIO as ocio
import pytest
from hypothesis import given, settings

from imaging.choices import ExrStorage
from imaging.colour.spaces import space_from_rec709
from imaging.errors import InputError, StorageError
from imaging.files.exr.image import ExrImage
from imaging.files.exr.reading import read_exr, read_exr_header
from imaging.files.exr.writing import write_exr
from imaging.files.photo import read_metadata
from imaging.optics.exposure import Exposure
from tests.imaging.files.damage import damaged

RGB = np.random.default_rng(1).random((9, 14, 3), dtype=np.float32)


@pytest.mark.parametrize(
    "view",
    [
        RGB,
        RGB[::-1],
        RGB[:, ::-2],
        RGB.transpose(1, 0, 2),
        np.asfortranarray(RGB),
        RGB.astype(np.float64),
        np.round(RGB * 100).astype(np.int32),
    ],
    ids=["plain", "reversed", "strided", "transposed", "fortran", "double", "int"],
)
def test_any_array_comes_back_as_it_looks(tmp_path: Path, view: np.ndarray) -> None:
    write_exr(tmp_path / "a.exr", view)
    rgb = read_exr(tmp_path / "a.exr").rgb()
    assert rgb.dtype == np.float32
    assert np.array_equal(rgb, view.astype(np.float32))


def test_channels_are_named_as_others_expect(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", RGB)
    with OpenEXR.File(str(tmp_path / "a.exr")) as file:
        assert np.array_equal(file.parts[0].channels["RGB"].pixels, RGB)
        assert file.parts[0].header["compression"] == OpenEXR.ZIP_COMPRESSION
        assert file.parts[0].header["colorInteropID"] == "lin_rec709_scene"


@pytest.mark.parametrize(
    ("primaries", "space"),
    [
        ("rec709", "lin_rec709_scene"),
        ("ap1", "lin_ap1_scene"),
        ("ap0", "lin_ap0_scene"),
        ("rec2020", "lin_rec2020_scene"),
        (None, "unknown"),
    ],
)
def test_the_space_is_told_by_its_interop_id_alone(tmp_path: Path, primaries: str | None, space: str) -> None:
    """Compare with OpenColorIO, without the older tags, which might contradict it."""
    write_exr(tmp_path / "a.exr", RGB, primaries=primaries)
    attributes = read_exr_header(tmp_path / "a.exr").attributes
    assert attributes["colorInteropID"] == space
    assert not {"chromaticities", "adoptedNeutral"} & set(attributes)
    if primaries is not None:
        config = ocio.Config.CreateFromBuiltinConfig("studio-config-latest")
        assert config.getColorSpace(space).getInteropID() == space


def test_other_primaries_are_read_as_the_same_light(tmp_path: Path) -> None:
    wide = RGB @ space_from_rec709("acescg").T
    write_exr(tmp_path / "a.exr", wide, primaries="ap1")
    image = read_exr(tmp_path / "a.exr")
    assert np.array_equal(image.channels["R"], wide[..., 0].astype(np.float32))
    assert image.rgb() == pytest.approx(RGB, abs=1e-5)
    assert image.rgb().dtype == np.float32
    assert np.array_equal(ExrImage({"Y": RGB[..., 0]}, image.attributes).rgb()[..., 2], RGB[..., 0])


@pytest.mark.parametrize("stated", [(0.0,) * 8, (0.3, 0.3) * 4, (float("nan"),) * 8, (0.64, 0.33), "Rec.709"])
def test_primaries_that_are_none_are_passed_over(stated: tuple[float, ...] | str) -> None:
    image = ExrImage(dict(zip("RGB", np.moveaxis(RGB, -1, 0), strict=True)), {"chromaticities": stated})
    assert np.array_equal(image.rgb(), RGB)


def test_special_values_survive(tmp_path: Path) -> None:
    special = np.array([[np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-45, 3.4e38, -1.0]], np.float32)
    write_exr(tmp_path / "a.exr", special)
    back = read_exr(tmp_path / "a.exr").channels["Y"]
    assert np.array_equal(back.view(np.uint32), special.view(np.uint32))
    half = np.array([[np.nan, np.inf, -np.inf, 65504.0]], np.float32)
    write_exr(tmp_path / "h.exr", half, storage="half")
    assert np.array_equal(read_exr(tmp_path / "h.exr").channels["Y"], half, equal_nan=True)


def test_half_rounds_to_eleven_bits(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", RGB, storage="half")
    assert np.array_equal(read_exr(tmp_path / "a.exr").rgb(), RGB.astype(np.float16).astype(np.float32))
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        assert file.parts[0].channels["R"].pixels.dtype == np.float16


@pytest.mark.parametrize(
    ("value", "storage"), [(65520.0, "half"), (65520.0, "dwaa"), (1e39, "float"), (-1e39, "float")]
)
def test_what_does_not_fit_is_refused_and_nothing_written(
    tmp_path: Path, value: float, storage: ExrStorage
) -> None:
    pixels = np.zeros((4, 4, 3))
    pixels[1, 2, 0] = value
    with pytest.raises(InputError, match="channel R exceeds"):
        write_exr(tmp_path / "a.exr", pixels, storage=storage)
    assert list(tmp_path.iterdir()) == []


def test_named_channels_and_attributes(tmp_path: Path) -> None:
    channels = {"R": RGB[..., 0], "sigma": RGB[..., 1], "depth.Z": RGB[..., 2]}
    attributes = {"rig:camera": "cäm 0", "rig:empty": "", "rig:k": 0.25, "whiteLuminance": 100.0}
    write_exr(tmp_path / "a.exr", channels, primaries=None, attributes=attributes)
    image = read_exr(tmp_path / "a.exr")
    assert image.channels.keys() == channels.keys()
    assert all(np.array_equal(image.channels[name], channels[name]) for name in channels)
    assert image.attributes == attributes | {"colorInteropID": "data"}
    with pytest.raises(InputError, match="neither R, G, B nor Y"):
        image.rgb()


def test_a_grey_image_has_three_equal_channels(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", RGB[..., 0])
    assert np.array_equal(read_exr(tmp_path / "a.exr").rgb(), RGB[..., :1].repeat(3, axis=2))


@pytest.mark.parametrize(
    "exposure", [Exposure(time=1 / 8000, f_number=2.8, iso=200), Exposure(time=30.0), Exposure(time=1e-5)]
)
def test_the_exposure_survives(tmp_path: Path, exposure: Exposure) -> None:
    write_exr(tmp_path / "a.exr", RGB, exposure=exposure)
    for read_back in (
        read_exr(tmp_path / "a.exr").exposure,
        read_exr_header(tmp_path / "a.exr").exposure,
        read_metadata(tmp_path / "a.exr").exposure,
    ):
        assert read_back is not None
        assert read_back.time == pytest.approx(exposure.time, rel=1e-7)
        assert read_back.scale == pytest.approx(exposure.scale, rel=1e-6)
        assert (read_back.f_number is None, read_back.iso is None) == (
            exposure.f_number is None,
            exposure.iso is None,
        )


def test_no_time_is_no_exposure() -> None:
    assert ExrImage({}, {"isoSpeed": 100.0}).exposure is None
    assert ExrImage({}, {"expTime": 0.0}).exposure is None
    assert ExrImage({}, {"expTime": float("nan")}).exposure is None
    assert ExrImage({}, {"expTime": "1/30"}).exposure is None


@pytest.mark.parametrize(
    "channels",
    [
        {},
        np.zeros((4, 4, 4), np.float32),
        np.zeros((0, 4), np.float32),
        {"R": np.zeros((2, 2)), "G": np.zeros((2, 3))},
    ],
)
def test_other_shapes_are_refused(tmp_path: Path, channels: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"channel"):
        write_exr(tmp_path / "a.exr", channels)
    with pytest.raises(ValueError, match="structure"):
        write_exr(tmp_path / "a.exr", RGB, attributes={"dataWindow": 1.0})
    assert list(tmp_path.iterdir()) == []


def test_windows_of_other_programs(tmp_path: Path) -> None:
    plane = np.arange(12, dtype=np.float32).reshape(3, 4) + 1
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "dataWindow": ((-1, 1), (2, 3)),
        "displayWindow": ((0, 0), (4, 2)),
    }
    OpenEXR.File(header, {"Y": plane}).write(str(tmp_path / "a.exr"))
    expected = np.zeros((3, 5), np.float32)
    expected[1:3, 0:3] = plane[:2, 1:]
    assert np.array_equal(read_exr(tmp_path / "a.exr").channels["Y"], expected)


def test_of_several_parts_the_first_has_the_names(tmp_path: Path) -> None:
    parts = [
        OpenEXR.Part({"type": OpenEXR.scanlineimage}, {"Y": np.full((2, 3), value, np.float32)}, name)
        for name, value in (("one", 1.0), ("two", 2.0))
    ]
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    channels = read_exr(tmp_path / "a.exr").channels
    assert np.all(channels["Y"] == 1.0)
    assert np.all(channels["two.Y"] == 2.0)


def test_data_are_in_parts_of_their_own(tmp_path: Path) -> None:
    depth, normal = RGB[..., 0] + 2, {f"N.{axis}": RGB[..., 1] for axis in "XYZ"}
    write_exr(tmp_path / "a.exr", RGB, attributes={"rig:k": 2.0}, data={"depth": {"Z": depth}, "N": normal})
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        parts = [
            (part.header["name"], part.header["colorInteropID"], set(part.channels)) for part in file.parts
        ]
        assert file.parts[0].header["rig:k"] == 2.0
    assert parts == [
        ("light", "lin_rec709_scene", {"R", "G", "B"}),
        ("depth", "data", {"Z"}),
        ("N", "data", {"N.X", "N.Y", "N.Z"}),
    ]
    image = read_exr(tmp_path / "a.exr")
    assert np.array_equal(image.rgb(), RGB)
    assert np.array_equal(image.channels["Z"], depth)
    assert image.attributes["colorInteropID"] == "lin_rec709_scene"
    with pytest.raises(ValueError, match="one shape"):
        write_exr(tmp_path / "b.exr", RGB, data={"depth": {"Z": depth[:2]}})


def test_deep_files_are_refused(tmp_path: Path) -> None:
    deep = np.empty((2, 3), object)
    for place in np.ndindex(2, 3):
        deep[place] = np.ones(place[1] + 1, np.float32)
    header = {"compression": OpenEXR.ZIPS_COMPRESSION, "type": OpenEXR.deepscanline}
    OpenEXR.File(header, {"Z": deep, "A": deep}).write(str(tmp_path / "a.exr"))
    with pytest.raises(InputError, match="deep or subsampled"):
        read_exr(tmp_path / "a.exr")


def test_a_file_cut_off_anywhere_is_refused_in_silence(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, np.random.default_rng(2).random((40, 30, 3)))
    data = path.read_bytes()
    for end in [*range(0, 700, 7), *range(700, len(data), 997), len(data) - 1]:
        path.write_bytes(data[:end])
        with pytest.raises(InputError) as error:
            read_exr(path)
        assert str(error.value).startswith(str(path))
        assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


def test_other_files_are_refused_in_silence(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "folder.exr").mkdir()
    (tmp_path / "text.exr").write_text("I am a text file")
    (tmp_path / "zeros.exr").write_bytes(bytes(1000))
    (tmp_path / "empty.exr").write_bytes(b"")
    for name in ("folder.exr", "text.exr", "zeros.exr", "empty.exr", "missing.exr"):
        for read in (read_exr, read_exr_header):
            with pytest.raises(InputError, match=r"is not a(n EXR)? file"):
                read(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def test_damaged_bytes_never_raise_anything_else(tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("exr") / "a.exr"
    write_exr(path, RGB, exposure=Exposure(time=0.5))
    data = path.read_bytes()

    @settings(max_examples=200)
    @given(damaged(data, 500))
    def damage(wrong: bytes) -> None:
        path.write_bytes(wrong)
        try:
            image = read_exr(path)
        except InputError:
            return
        assert all(plane.dtype == np.float32 and plane.ndim == 2 for plane in image.channels.values())

    damage()


def test_a_full_disk_is_told_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Full:
        def __init__(self, *_: object) -> None: ...

        def write(self, name: str) -> None:
            Path(name).write_bytes(b"half")
            raise RuntimeError('Failed to write pixel data to image file "x". No space left on device.')

    monkeypatch.setattr(OpenEXR, "File", Full)
    with pytest.raises(StorageError, match=r"could not be written \(no space left on device\)"):
        write_exr(tmp_path / "a.exr", RGB)
    assert list(tmp_path.iterdir()) == []


def test_an_old_file_stays_when_the_new_one_fails(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", RGB)
    with pytest.raises(InputError):
        write_exr(tmp_path / "a.exr", np.full((2, 2), 1e39))
    assert np.array_equal(read_exr(tmp_path / "a.exr").rgb(), RGB)
