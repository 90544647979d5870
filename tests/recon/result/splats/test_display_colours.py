"""Drawing of splats.ply by viewers, against a display of the light."""

import shutil

import numpy as np
import pytest
import torch

from imaging.colour.spaces import srgb_decode, srgb_encode
from imaging.progress import unreported
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.result.display import displayed
from recon.result.model import read_model
from recon.result.scene import open_scene
from recon.result.splats import display_colours as module
from recon.result.splats.display_colours import LitScene, display_colours
from recon.result.splats.viewers import MOST_CODE, playcanvas, viewers_of
from recon.scene.appearance import LuminanceChromaticity, PlainHarmonics
from recon.scene.gaussians import GEOMETRY, Gaussians, Renderer, limits_for
from recon.scene.harmonics import C0
from recon.scene.ply import write_ply
from recon.splat import Limits, SplatCamera
from tests.recon import foreign_3dgs
from tests.recon.ply_files import read_ply


def camera(turn: float) -> SplatCamera:
    cos, sin = np.cos(turn), np.sin(turn)
    motion = np.eye(4)
    motion[:3, :3], motion[2, 3] = [[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]], 4.0
    return SplatCamera(motion, 60, 60, 32, 24, 64, 48)


CAMERAS = [camera(turn) for turn in np.linspace(-0.5, 0.5, 7)]


@pytest.fixture(scope="module")
def lamps() -> tuple[Gaussians, Renderer]:
    """Surfaces and lamps over sixteen stops, most of them seen through others."""
    rng, appearance = np.random.default_rng(5), LuminanceChromaticity()
    light = torch.from_numpy(2.0 ** rng.uniform(-10, 6, (300, 1)) * rng.uniform(0.3, 1, (300, 3))).float()
    colours = appearance.start(light)
    colours["chroma_rest"] = torch.from_numpy(rng.normal(0, 0.3, (300, 8, 3))).float()
    places = {
        "means": torch.from_numpy(rng.normal(0, 0.8, (300, 3))).float(),
        "log_scales": torch.from_numpy(rng.normal(-2, 0.5, (300, 3))).float(),
        "quats": torch.from_numpy(rng.normal(size=(300, 4))).float(),
        "opacity_logits": torch.from_numpy(rng.normal(0, 2, 300)).float(),
    }
    return Gaussians({**places, **colours}), Renderer(appearance, limits_for(2.0**-10))


def fitted(lamps, steps=100, exposure=0.5):
    gaussians, renderer = lamps
    return display_colours(
        LitScene(gaussians, renderer, 2, exposure),
        gaussians,
        steps,
        fitted=[CAMERAS[i] for i in (0, 1, 2, 4, 5, 6)],
        judged=[CAMERAS[3]],
        progress=unreported,
    )


def test_other_programs_draw_the_display_of_the_light_as_near_as_is_stated(lamps, tmp_path):
    gaussians, renderer = lamps
    colours = fitted(lamps)
    path = tmp_path / "splats.ply"
    write_ply(path, gaussians, colours.harmonics, ["a note"])
    table = foreign_3dgs.read(path)
    drawn = [
        foreign_3dgs.draw(table, CAMERAS[3], blur=0.075),  # PlayCanvas
        foreign_3dgs.draw(table, CAMERAS[3], blur=0.3, made_up=True),  # Spark
    ]
    with torch.no_grad():
        light = renderer(gaussians, CAMERAS[3], degree=2).image.numpy()
    errors = np.clip(drawn, 0, 1) - displayed(light, 0.5) / 255
    assert -10 * np.log10(np.mean(errors**2)) == pytest.approx(colours.db, abs=0.1)
    assert np.abs(colours.harmonics[:, 0]).max() <= 0.5 / foreign_3dgs.C0 + 1e-6  # as Spark has them


def test_codes_above_white_are_the_light_that_a_tone_map_is_given(lamps):
    gaussians, renderer = lamps
    fit = {"fitted": CAMERAS, "judged": (), "progress": unreported}
    with torch.no_grad():
        light = renderer(gaussians, CAMERAS[3], degree=2).image.numpy() * 0.5
    bright = (light > 1.5) & (light < 20)
    assert bright.mean() > 0.02
    off = {}
    for end in (1.0, MOST_CODE):
        colours = display_colours(LitScene(gaussians, renderer, 2, 0.5, end), gaussians, 100, **fit)
        model = Gaussians({name: gaussians.parameters[name] for name in GEOMETRY})
        model.parameters |= {
            "sh_dc": torch.from_numpy(colours.harmonics[:, :1]).float(),
            "sh_rest": torch.from_numpy(colours.harmonics[:, 1:]).float(),
        }
        with torch.no_grad():
            codes = playcanvas()(model, CAMERAS[3], degree=2).image.numpy()
        off[end] = np.median(np.abs(np.log2(srgb_decode(codes, end=MOST_CODE)[bright] / light[bright])))
    assert off[MOST_CODE] < 0.5
    assert off[1.0] > 1.4 * off[MOST_CODE]


def test_the_fit_is_worth_it_and_the_same_every_time(lamps):
    unfitted, colours = fitted(lamps, steps=0), fitted(lamps)
    assert colours.db > unfitted.db + 8
    np.testing.assert_array_equal(colours.harmonics, fitted(lamps).harmonics)


def test_light_of_display_values_stays_what_it_is():
    """Opaque surfaces, none behind another, within 0..1: there is nothing to tell blends apart by."""
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(np.linspace(-1.5, 1.5, 4), np.linspace(-1, 1, 3))
    places = {
        "means": torch.from_numpy(np.stack([x, y, 0 * x], -1).reshape(-1, 3)).float(),
        "log_scales": torch.full((12, 3), -3.0),
        "quats": torch.tensor([[1.0, 0, 0, 0]]).repeat(12, 1),
        "opacity_logits": torch.full((12,), 8.0),
    }
    appearance = PlainHarmonics()
    colours = torch.from_numpy(rng.uniform(0.2, 1, (12, 3))).float()
    gaussians = Gaussians({**places, **appearance.start(colours)})
    renderer = Renderer(appearance, Limits.gsplat())
    shown = display_colours(
        LitScene(gaussians, renderer, 0, 1.0),
        gaussians,
        0,
        fitted=CAMERAS[:1],
        judged=(),
        progress=unreported,
    )
    assert shown.harmonics.shape == (12, 1, 3)
    codes = shown.harmonics[:, 0] * 0.28209479177387814 + 0.5
    np.testing.assert_allclose(255 * codes, displayed(colours.numpy(), 1.0), atol=0.6)


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setitem(QUALITIES, "draft", Quality(60, 500, 64))


def drawn(table, view) -> list[np.ndarray]:
    """Draw as each of the viewers does, through the view's own lens."""
    columns = [np.stack([table[f"{name}_{i}"] for i in range(count)], 1) for name, count in
               (("scale", 3), ("rot", 4), ("f_dc", 3))]  # fmt: skip
    rest = np.array([table[name] for name in table if name.startswith("f_rest")])
    others = np.zeros((len(table["x"]), 8, 3), np.float32)
    others[:, : len(rest) // 3] = rest.reshape(3, len(rest) // 3, len(others)).transpose(2, 1, 0)
    values = np.stack([table[axis] for axis in "xyz"], 1), *columns[:2], table["opacity"], columns[2][:, None]
    names = "means", "log_scales", "quats", "opacity_logits", "sh_dc"
    gaussians = Gaussians({name: torch.from_numpy(value) for name, value in zip(names, values, strict=True)})
    gaussians.parameters["sh_rest"] = torch.from_numpy(others)
    degree = {0: 0, 9: 1, 24: 2}[len(rest)]
    viewers = viewers_of(len(gaussians), 1.0)
    return [viewer(gaussians, view.splat_camera, degree=degree).image.numpy() for viewer in viewers]


def test_a_scene_of_light_has_a_file_for_viewers_and_one_of_its_light(session_copy, small):
    folder = reconstruct(session_copy, TrainingRequest(quality="draft", overrides=Overrides(refine="none")))
    scene, record = open_scene(folder), read_model(folder)
    shown, linear = (read_ply(folder / name) for name in ("splats.ply", "radiance.ply"))
    for name in ("x", "y", "z", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_3"):
        np.testing.assert_array_equal(shown[name], linear[name])
    (view,) = (view for view in scene.views if view.use == "test")
    light = scene.render(view.splat_camera)
    wanted = displayed(light, record.exposure) / 255
    codes = np.clip(drawn(shown, view), 0, 1)
    assert 0.3 < np.median(codes) < 0.6  # middle grey is a code of 0.46
    unfitted = dict(shown)
    for channel in (f"f_dc_{number}" for number in range(3)):
        exposed = (0.5 + C0 * linear[channel]) * record.normaliser * record.exposure
        unfitted[channel] = ((srgb_encode(np.clip(exposed, 0, 1)) - 0.5) / C0).astype(np.float32)
    plain, psnr = (
        -10 * np.log10(np.mean((picture - wanted) ** 2))
        for picture in (np.clip(drawn(unfitted, view), 0, 1), codes)
    )
    assert psnr == pytest.approx(record.display_db, abs=0.1)
    assert psnr > plain + 4.4  # a fit of 20 steps: by seed 21.6 to 22.7 dB, and 4.6 to 5.0 above
    radiance = drawn(linear, view)[0] * record.normaliser
    assert np.median(np.abs(radiance - light)) < 0.05 * np.median(light)
    heads = [(folder / f"{name}.ply").read_bytes().partition(b"end_header")[0].decode() for name in
             ("splats", "radiance")]  # fmt: skip
    assert f"radiance x {record.exposure:.6g} " in heads[0]
    assert f"{record.display_db:.1f} dB from that; linear light is in radiance.ply" in heads[0]
    assert f"linear Rec.709 radiance over {record.normaliser:.6g} " in heads[1]


def test_a_scene_of_display_values_has_one_file(toy_ldr, tmp_path, small):
    session = shutil.copytree(toy_ldr, tmp_path / "session")
    folder = reconstruct(
        session, TrainingRequest(quality="draft", method="vanilla", overrides=Overrides(refine="none"))
    )
    record = read_model(folder)
    assert record.display_db is None
    assert not (folder / "radiance.ply").exists()
    scene, table = open_scene(folder), read_ply(folder / "splats.ply")
    np.testing.assert_array_equal(table["f_dc_1"], scene.gaussians.parameters["sh_dc"][:, 0, 1].numpy())


def test_a_short_training_is_not_outlasted_by_the_fit():
    assert module.steps_after(60) == 20
    assert module.steps_after(4000) == module.MOST_STEPS
