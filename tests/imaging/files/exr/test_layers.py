"""Files of layers, parts, views and passes: the picture is found among them, or one sentence says why not."""

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from capture.pictures.read import read_picture
from imaging.errors import InputError
from imaging.files.depth import read_depth
from imaging.files.exr.reading import read_exr, read_exr_header
from imaging.files.exr.writing import write_exr
from imaging.files.radiance_hdr import read_light, read_with_alpha
from imaging.session.calibration import Response
from recon.data.pixels import ShotSource, read_shot

SHAPE = (32, 48)
LIGHT = np.random.default_rng(1).random((*SHAPE, 3), dtype=np.float32) + 0.1
OTHER = np.full(SHAPE, 7, np.float32)
LINEAR = Response(kind="linear", evidence="test")
HEADER = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}


def rgb(layer: str = "", light: np.ndarray = LIGHT) -> dict[str, np.ndarray]:
    return {f"{layer}{colour}": np.ascontiguousarray(light[..., i]) for i, colour in enumerate("RGB")}


def put(path: Path, channels: dict[str, np.ndarray], **header: object) -> Path:
    OpenEXR.File(HEADER | header, channels).write(str(path))
    return path


def put_parts(path: Path, *parts: tuple[str, dict[str, np.ndarray], dict[str, object]]) -> Path:
    OpenEXR.File([OpenEXR.Part(HEADER | header, planes, name) for name, planes, header in parts]).write(
        str(path)
    )
    return path


@pytest.mark.parametrize(
    "channels",
    [
        rgb("ViewLayer.Combined.") | {"ViewLayer.Depth.Z": OTHER, "ViewLayer.Combined.A": OTHER / 7},
        rgb("ViewLayer.Combined.") | rgb("ViewLayer.DiffCol.", LIGHT / 2) | rgb("ViewLayer.Env.", LIGHT / 3),
        rgb("beauty.") | rgb("albedo.", LIGHT / 2),
        rgb() | rgb("right.", LIGHT / 2) | {"N.X": OTHER, "N.Y": OTHER, "N.Z": OTHER},
        rgb("only."),
        rgb() | {"X": OTHER, "Y": OTHER, "Z": OTHER},
    ],
    ids=["blender", "passes", "beauty", "views", "one", "beside positions"],
)
def test_the_picture_is_found(tmp_path: Path, channels: dict[str, np.ndarray]) -> None:
    assert np.array_equal(read_light(put(tmp_path / "a.exr", channels)), LIGHT)


@pytest.mark.parametrize(
    ("channels", "says"),
    [
        (rgb("one.") | rgb("two."), "the layers one, two, and none or several"),
        (rgb("A.Combined.") | rgb("B.Combined."), "the layers A.Combined, B.Combined"),
        ({"X": OTHER, "Y": OTHER, "Z": OTHER}, "CIE XYZ, positions or motion"),
        ({"X": OTHER, "Y": OTHER}, "CIE XYZ, positions or motion"),
        ({"Y": OTHER, "RY": OTHER, "BY": OTHER}, "luminance and chroma"),
        (rgb() | {"AR": OTHER, "AG": OTHER, "AB": OTHER}, "an alpha for each colour"),
        ({"N.X": OTHER, "N.Y": OTHER, "N.Z": OTHER}, "neither R, G, B nor Y"),
        ({"R": OTHER, "G": OTHER}, "neither R, G, B nor Y"),
    ],
)
def test_what_may_be_no_light_is_refused(tmp_path: Path, channels: dict[str, np.ndarray], says: str) -> None:
    path = put(tmp_path / "a.exr", channels)
    with pytest.raises(InputError, match=says) as error:
        read_light(path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


def test_the_part_that_is_light_tells_its_own_colour(tmp_path: Path) -> None:
    data = ("normal", rgb("", LIGHT * 9), {"colorInteropID": "data", "rig:k": 5.0})
    light = ("picture", rgb(), {"colorInteropID": "lin_ap1_scene"})
    path = put_parts(tmp_path / "a.exr", data, light)
    write_exr(tmp_path / "b.exr", LIGHT, primaries="ap1")
    assert np.array_equal(read_light(path), read_light(tmp_path / "b.exr"))
    assert read_exr_header(path).attributes == {"colorInteropID": "lin_ap1_scene"}
    named = put_parts(tmp_path / "c.exr", ("albedo", rgb("", LIGHT / 2), {}), ("Beauty", rgb(), {}))
    assert np.array_equal(read_light(named), LIGHT)


def test_alpha_is_that_of_the_light_which_is_multiplied_by_it(tmp_path: Path) -> None:
    alpha = np.ones(SHAPE, np.float32)
    alpha[:8], alpha[8:12] = 0, 0.25
    for layer in ("", "ViewLayer.Combined."):
        path = put(tmp_path / "a.exr", rgb(layer, LIGHT * alpha[..., None]) | {f"{layer}A": alpha})
        picture = read_with_alpha(path)
        assert np.array_equal(picture.pixels, LIGHT * alpha[..., None])
        assert picture.alpha is not None
        assert np.array_equal(picture.alpha, alpha)
        assert read_picture(path).transparent == 12 / 32
        shot, _ = read_shot(ShotSource(path, "a", "hdr", LINEAR), 1.0)
        assert np.array_equal(shot.alpha, alpha)
        small, _ = read_shot(ShotSource(path, "a", "hdr", LINEAR, SHAPE[1] // 2), 1.0)
        assert small.alpha == pytest.approx(alpha[::2, ::2])
    odd = alpha.copy()
    odd[0, :3] = np.nan, -1, 5
    picture = read_with_alpha(put(tmp_path / "a.exr", rgb() | {"A": odd}))
    assert picture.alpha is not None
    assert picture.alpha[0, :3].tolist() == [1, 0, 1]


def test_what_is_opaque_has_no_alpha(tmp_path: Path) -> None:
    assert read_with_alpha(put(tmp_path / "a.exr", rgb() | {"A": OTHER / 7})).alpha is None
    assert read_with_alpha(put(tmp_path / "a.exr", rgb())).alpha is None
    # an alpha in a part of data is none of the light
    write_exr(tmp_path / "b.exr", LIGHT, data={"alpha": {"A": OTHER / 14}})
    assert read_with_alpha(tmp_path / "b.exr").alpha is None
    assert np.all(read_exr(tmp_path / "b.exr").channels["A"] == 0.5)


def test_pixels_that_are_not_square_are_told(tmp_path: Path) -> None:
    assert read_picture(put(tmp_path / "a.exr", rgb(), pixelAspectRatio=2.0)).doubt.startswith(
        "pixelAspectRatio 2 is not used"
    )
    assert read_picture(put(tmp_path / "a.exr", rgb())).doubt == ""


def test_the_order_of_lines_changes_nothing(tmp_path: Path) -> None:
    path = put(tmp_path / "a.exr", rgb(), lineOrder=OpenEXR.LineOrder.DECREASING_Y)
    assert np.array_equal(read_light(path), LIGHT)


@pytest.mark.parametrize(
    ("channels", "depth"),
    [
        ({"Z": OTHER, "Y": OTHER / 2}, 7),
        (rgb("ViewLayer.Combined.") | {"ViewLayer.Depth.Z": OTHER}, 7),
        ({"Scene.Depth.V": OTHER}, 7),
        ({"X": OTHER, "Y": OTHER, "Z": OTHER}, None),
        ({"a.Depth.Z": OTHER, "b.Depth.Z": OTHER}, None),
    ],
)
def test_depth_is_found_among_layers_and_is_no_position(
    tmp_path: Path, channels: dict[str, np.ndarray], depth: float | None
) -> None:
    path = put(tmp_path / "a.exr", channels)
    if depth is None:
        with pytest.raises(InputError, match="none is depth: name it Z"):
            read_depth(path)
    else:
        assert np.all(read_depth(path)[0] == depth)


@pytest.mark.parametrize(
    "header",
    [
        {"whiteLuminance": 400.0},
        {"adoptedNeutral": (0.3127, 0.329)},
        {"envmap": OpenEXR.Envmap.ENVMAP_LATLONG},
        {"screenWindowWidth": 2.5, "screenWindowCenter": (0.5, 0.5)},
        {"compression": OpenEXR.PIZ_COMPRESSION},
        {"compression": OpenEXR.NO_COMPRESSION},
        {"compression": OpenEXR.RLE_COMPRESSION},
        {"xDensity": 72.0, "owner": "nobody", "comments": "gamma 2.2", "utcOffset": 3600.0},
        {"longitude": 1.0, "latitude": 2.0, "altitude": 3.0, "focus": 4.0},
        {"wrapmodes": "periodic"},
    ],
    ids=lambda header: next(iter(header)),
)
def test_what_is_about_displays_and_places_changes_nothing(tmp_path: Path, header: dict[str, object]) -> None:
    path = put(tmp_path / "a.exr", rgb(), **header)
    assert np.array_equal(read_light(path), LIGHT)
    assert read_picture(path).doubt == ""
