"""What files of splats say beside their Gaussians: filters, axes, motion and the light that colours are."""

import gzip
import math
import struct
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdVol

from imaging.colour.spaces import PRIMARIES, rec709_from_rgb
from imaging.errors import InputError
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from recon.exports.target_coordinates import pinhole
from recon.result.model import SceneView
from recon.result.scene import Scene, open_scene
from recon.scene import spz
from recon.scene.harmonics import C0
from recon.scene.ply import properties

DEVIATION, OPACITY, RADIUS = 0.004, 0.7, 3.0
"""Of one Gaussian at the origin, and the distance of the camera that looks at it."""
FOCAL = 300.0
LENS = Lens(model="PINHOLE", width=33, height=25, fx=FOCAL, fy=FOCAL, cx=16.5, cy=12.5)
"""The origin is seen in the middle of a pixel."""


def row(**others: float) -> dict[str, float]:
    """A white Gaussian at the origin, by property."""
    values = dict.fromkeys(properties(0), 0.0)
    values |= {f"scale_{axis}": math.log(DEVIATION) for axis in range(3)}
    values |= {f"f_dc_{channel}": 0.5 / 0.28209479177387814 for channel in range(3)}
    return values | {"opacity": math.log(OPACITY / (1 - OPACITY)), "rot_0": 1.0} | others


def ply(path: Path, values: dict[str, float], behind: str = "", rest: bytes = b"", comment: str = "") -> Path:
    names = "".join(f"property float {name}\n" for name in values)
    head = f"ply\nformat binary_little_endian 1.0\n{comment}element vertex 1\n{names}{behind}end_header\n"
    path.write_bytes(head.encode() + np.array(list(values.values()), "<f4").tobytes() + rest)
    return path


def middle(scene: Scene) -> float:
    """Value of the pixel in which the Gaussian is seen, over black."""
    pose = Pose(quaternion=(1.0, 0.0, 0.0, 0.0), translation=(0.0, 0.0, RADIUS))
    view = SceneView(camera="c", frame=0, use="training", lens=LENS, cam_from_world=pose, shots=())
    drawn = scene.drawn(scene.record.world.camera(view.splat_camera)).numpy()
    assert np.unravel_index(drawn[..., 0].argmax(), drawn.shape[:2]) == (12, 16)
    return float(drawn[12, 16, 1])


def variance(deviation: float) -> float:
    """Variance in the picture, px^2."""
    return (deviation * FOCAL / RADIUS) ** 2


def test_without_filters_it_is_drawn_as_3dgs_draws(tmp_path: Path) -> None:
    assert middle(open_scene(ply(tmp_path / "a.ply", row()))) == pytest.approx(OPACITY, rel=1e-3)


@pytest.mark.parametrize("width", [0.0, 0.002, 0.01])
def test_the_filters_of_mip_splatting(width: float, tmp_path: Path) -> None:
    """Its equations 9 and 10: wider, at the same mass in space; in the picture a blur at the same mass."""
    scene = open_scene(ply(tmp_path / "a.ply", row(filter_3D=width)))
    wide = math.hypot(DEVIATION, width)
    peak = OPACITY * (DEVIATION / wide) ** 3
    assert middle(scene) == pytest.approx(peak * variance(wide) / (variance(wide) + 0.1), rel=1e-3)


def test_filters_of_any_size_leave_numbers(tmp_path: Path) -> None:
    for width, opacity in ((1e30, 0.0), (0.0, 80.0), (1e-30, -80.0)):
        scene = open_scene(ply(tmp_path / "a.ply", row(filter_3D=width, opacity=opacity)))
        assert np.isfinite(scene.render(pinhole(scene.views[0].splat_camera))).all()
    with pytest.raises(InputError, match="no Gaussian that can be drawn"):
        open_scene(ply(tmp_path / "a.ply", row(filter_3D=math.nan)))


def packed(path: Path, flags: int, records: bytes = b"") -> Path:
    """SPZ of the Gaussian, moved by (1, 2, 3) and turned by 90 degrees about x, with one coefficient each."""
    rest = np.arange(1, 16) / 32
    harmonics = np.concatenate([[[1.0, 1.0, 1.0]], np.repeat(rest[:, None], 3, 1)])[None]
    data = bytearray(gzip.decompress(spz.pack(
        np.array([[1.0, 2.0, 3.0]]), np.full((1, 3), math.log(DEVIATION)),
        np.array([[math.sqrt(0.5), math.sqrt(0.5), 0, 0]]), np.array([OPACITY]), harmonics,
    )))  # fmt: skip
    data[14] = flags
    path.write_bytes(gzip.compress(bytes(data) + records))
    return path


def test_spz_that_was_trained_with_antialiasing(tmp_path: Path) -> None:
    plain, other = (open_scene(packed(tmp_path / f"{flags}.spz", flags)) for flags in (0, spz.ANTIALIASED))
    values = []
    for scene in (plain, other):
        pose = Pose(quaternion=(1.0, 0.0, 0.0, 0.0), translation=(-1.0, -2.0, RADIUS - 3.0))
        view = SceneView(camera="c", frame=0, use="training", lens=LENS, cam_from_world=pose, shots=())
        values.append(scene.drawn(scene.record.world.camera(view.splat_camera)).numpy()[12, 16, 0])
    # Scales are stored to a sixteenth of their logarithm.
    stored = variance(math.exp(round(16 * (math.log(DEVIATION) + 10)) / 16 - 10))
    assert values[1] / values[0] == pytest.approx(stored / (stored + 0.3), rel=1e-3)


def record(axes: int) -> bytes:
    """Records of an unknown maker and of Adobe, the coordinate system."""
    return struct.pack("<IIB", 0x12340001, 1, 7) + struct.pack("<III", 0xADBE0003, 4, axes)


@pytest.mark.parametrize(("axes", "signs"), [
    (0, (1, -1, -1)), (4, (1, -1, -1)), (6, (1, 1, 1)), (8, (1, -1, 1)), (7, (-1, -1, 1)), (1, (-1, 1, -1)),
])  # fmt: skip
def test_spz_in_other_axes_than_those_of_opengl(axes: int, signs: tuple[int, ...], tmp_path: Path) -> None:
    """Letters of the number: left or right, down or up, back or front; PLY has right, down, front."""
    usual = spz.read_spz(packed(tmp_path / "usual.spz", 0))
    read_back = spz.read_spz(packed(tmp_path / "other.spz", spz.EXTENDED, record(axes)))
    # What is stored is the same, in other axes; `usual` is in PLY's by the signs of OpenGL.
    stored = usual.means * [1, -1, -1]
    np.testing.assert_allclose(read_back.means, stored * signs)
    x, y, z = (sign * usual_sign for sign, usual_sign in zip(signs, (1, -1, -1), strict=True))
    np.testing.assert_allclose(read_back.quats, usual.quats * [1, y * z, x * z, x * y], atol=1e-12)
    assert read_back.harmonics[0, 3, 0] == x * usual.harmonics[0, 3, 0]  # of degree 1, along x
    assert read_back.harmonics[0, 10, 0] == x * y * z * usual.harmonics[0, 10, 0]  # xyz
    assert read_back.harmonics[0, 12, 0] == z * usual.harmonics[0, 12, 0]


def test_spz_whose_axes_are_in_another_order_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="its axes, number 12 of Adobe's extension, are not read"):
        spz.read_spz(packed(tmp_path / "a.spz", spz.EXTENDED, record(12)))


@pytest.mark.parametrize(("number", "linear"), [(0, False), (1, True)])
def test_the_colour_space_of_sharp(number: int, linear: bool, tmp_path: Path) -> None:
    behind = (
        "element extrinsic 16\nproperty float extrinsic\nelement image_size 2\nproperty uint image_size\n"
        "element color_space 1\nproperty uchar color_space\nelement version 3\nproperty uchar version\n"
    )
    rest = bytes(16 * 4 + 2 * 4) + bytes([number, 1, 5, 0])
    scene = open_scene(ply(tmp_path / "a.ply", row(), behind, rest))
    assert (scene.record.display is None) is linear
    lists = "element face 1\nproperty list uchar int vertex_indices\n" + behind
    assert open_scene(ply(tmp_path / "b.ply", row(), lists, bytes(13) + rest)).record.display is not None
    assert open_scene(ply(tmp_path / "c.ply", row(), behind, rest[:70])).record.display is not None


def test_the_vertical_axis_of_nerfstudio(tmp_path: Path) -> None:
    scene = open_scene(ply(tmp_path / "a.ply", row(), comment="comment Vertical Axis: z\n"))
    np.testing.assert_allclose(scene.up, [0, 0, 1], atol=1e-6)


@pytest.mark.parametrize(
    ("name", "says"),
    [("trbf_center", "that move"), ("motion_0", "that move"), ("t", "that move"), ("scale_t", "that move")]
    + [(name, "that are not valid Gaussians") for name in ("shape", "beta", "nu_degree")],
)
def test_splats_that_move_or_are_no_gaussians_are_refused(name: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rf"{says} \({name}\)"):
        open_scene(ply(tmp_path / "a.ply", row(**{name: 0.5})))


def test_properties_that_change_nothing(tmp_path: Path) -> None:
    others = dict.fromkeys(("nx", "ny", "nz", "red", "semantic_0", "roughness"), 0.3)
    plain = middle(open_scene(ply(tmp_path / "a.ply", row())))
    assert middle(open_scene(ply(tmp_path / "b.ply", row(**others)))) == plain


FIELD = {"Scales": Gf.Vec3f(0.1), "Orientations": Gf.Quatf(1), "Opacities": 0.99}
LIGHT = np.array([[0.8, 0.2, 0.1], [0.05, -0.1, 0.2], [0.0, 0.1, 0.0], [-0.2, 0.0, 0.1]])
"""A colour, and harmonics of degree 1 beside it."""


def field(
    path: Path, without: str = "", count: int = 2, time: float | None = None, space: str | None = None
) -> Path:
    """A field of the same Gaussians in a row: without an attribute, or with all of them at a time."""
    stage = Usd.Stage.CreateNew(str(path))
    splats = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/splats")
    at = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    dc = (LIGHT[0] - 0.5) / C0
    coefficients = [Gf.Vec3f(*one) for one in (dc.tolist(), *LIGHT[1:].tolist())]
    values = {name: [value] * count for name, value in FIELD.items()}
    values |= {
        "Positions": [Gf.Vec3f(number, 0, 0) for number in range(count)],
        "RadianceSphericalHarmonicsCoefficients": coefficients * count,
    }
    for name, rows in values.items():
        if name != without:
            getattr(splats, f"Create{name}Attr")().Set(rows, at)
    splats.CreateRadianceSphericalHarmonicsDegreeAttr(1)
    if space is not None:
        splats.GetRadianceSphericalHarmonicsCoefficientsAttr().SetColorSpace(space)
    stage.Save()
    return path


def test_a_usd_that_is_animated_is_read_at_its_first_moment(tmp_path: Path) -> None:
    still, moving = (
        open_scene(field(tmp_path / f"{name}.usda", time=time))
        for name, time in (("still", None), ("moving", 7.0))
    )
    for name, value in still.gaussians.parameters.items():
        np.testing.assert_array_equal(moving.gaussians.parameters[name].numpy(), value.numpy())


@pytest.mark.parametrize(
    "without", ["Scales", "Orientations", "Opacities", "RadianceSphericalHarmonicsCoefficients"]
)
def test_a_usd_that_lacks_an_attribute_is_refused(without: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="different lengths"):
        open_scene(field(tmp_path / "a.usda", without))


def test_a_usd_without_gaussians_is_refused(tmp_path: Path) -> None:
    for path in (field(tmp_path / "none.usda", count=0), field(tmp_path / "lacks.usda", "Positions")):
        with pytest.raises(InputError, match="holds no Gaussian"):
            open_scene(path)


@pytest.mark.parametrize(
    ("space", "name"),
    [
        ("lin_rec709_scene", "rec709"),
        ("lin_rec2020_scene", "rec2020"),
        ("lin_ap1_scene", "ap1"),
        ("lin_ap0_scene", "ap0"),
    ],
)
def test_light_of_a_usd_in_other_primaries_becomes_that_of_rec709(
    space: str, name: str, tmp_path: Path
) -> None:
    scene = open_scene(field(tmp_path / "a.usda", space=space))
    assert scene.record.display is None
    expected = LIGHT @ rec709_from_rgb(PRIMARIES[name]).T
    parameters = scene.gaussians.parameters
    np.testing.assert_allclose(0.5 + C0 * parameters["sh_dc"][0, 0].numpy(), expected[0], atol=1e-6)
    np.testing.assert_allclose(parameters["sh_rest"][1, :3].numpy(), expected[1:], atol=1e-6)


def test_light_of_a_usd_in_an_unknown_space_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="lin_mine, which rig does not know"):
        open_scene(field(tmp_path / "a.usda", space="lin_mine"))
