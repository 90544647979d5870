"""Every format at its limits: what is lost is told, and what cannot be is refused in a sentence."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from imaging.colour.spaces import srgb_decode
from imaging.errors import InputError, ReconstructionError
from imaging.files.exr.reading import read_exr
from imaging.progress import unreported
from imaging.session.calibration import Response
from imaging.session.records import Band
from recon.exports.export import FORMATS, export
from recon.exports.formats import sog
from recon.exports.loss import drawn, loss_of, stops_between
from recon.exports.programs import PROGRAMS
from recon.exports.request import ProgramName
from recon.exports.splats import display_splats, exposure_factor, far_light_of, linear_splats, sound
from recon.exports.stored import is_stored
from recon.rendering.cameras.placement import placement_of
from recon.result.model import CHECKPOINT, DisplayValues
from recon.result.scene import Scene, open_scene
from recon.scene.appearance import PlainHarmonics
from recon.scene.checkpoint import read_checkpoint, write_checkpoint
from recon.scene.environment import Environment
from recon.scene.gaussians import GEOMETRY, Gaussians, Renderer
from recon.scene.harmonics import C0
from recon.scene.ply import write_ply
from recon.scene.ply_file import read_ply
from recon.splat import Limits
from tests.recon.exports.made_scene import write_made

SPLATS = {"usd": "a.usdc", "sog": "a.sog", "glb": "a.glb", "spz": "a.spz", "ply": "a.ply", "html": "a.html"}
BANDS = (
    Band(name="650nm", wavelength_nm=650, bandwidth_nm=40),
    Band(name="800nm", wavelength_nm=800, bandwidth_nm=40),
)


def changed(scene: Scene, **rows: tuple[int, float]) -> Scene:
    """The scene with one value of one Gaussian put in each of some parameters."""
    parameters = {name: value.clone() for name, value in scene.gaussians.parameters.items()}
    for name, (row, value) in rows.items():
        parameters[name][row] = value
    return replace(scene, gaussians=Gaussians(parameters))


@pytest.mark.parametrize("name", SPLATS)
def test_gaussians_that_cannot_be_drawn_are_left_out_and_counted(
    name: str, scene: Scene, tmp_path: Path
) -> None:
    bad = changed(
        scene,
        means=(3, np.nan),
        log_scales=(4, np.inf),
        quats=(5, 0.0),
        opacity_logits=(6, -np.inf),
        ln_luminance=(7, np.nan),
    )
    exported = export(bad, tmp_path / SPLATS[name])
    assert exported.gaussians == 395
    assert "5 of 400 Gaussians, which no renderer draws" in exported.notes
    assert exported.loss is not None
    assert np.isfinite([value for value in exported.loss.data().values() if value is not None]).all()


@pytest.mark.parametrize("name", SPLATS)
def test_a_lamp_of_2_to_the_40_stays_finite(name: str, scene: Scene, tmp_path: Path) -> None:
    exported = export(changed(scene, ln_luminance=(0, 40 * np.log(2))), tmp_path / SPLATS[name])
    assert exported.loss is not None
    assert np.isfinite([value for value in exported.loss.data().values() if value is not None]).all()
    if name == "ply":
        assert np.isfinite(read_ply(tmp_path / "a.ply").harmonics).all()


@pytest.mark.parametrize("name", [*SPLATS, "points", "mesh"])
def test_an_empty_scene_is_refused(name: str, scene: Scene, tmp_path: Path) -> None:
    none = {key: value[:0] for key, value in scene.gaussians.parameters.items()}
    with pytest.raises(
        ReconstructionError, match="no Gaussian that can be drawn, so there is nothing to export"
    ):
        export(replace(scene, gaussians=Gaussians(none)), tmp_path / SPLATS.get(name, "a.ply"), name)
    assert not list(tmp_path.iterdir())


def test_opaque_stays_opaque(scene: Scene) -> None:
    """Hide what is behind a wall, however bright: single precision has to yield 1."""
    splats = linear_splats(changed(scene, opacity_logits=(0, 60.0)), 1.0, with_dome=False)
    assert float(splats.gaussians().opacities()[0]) == 1.0
    assert splats.opacities.astype(np.float32)[0] == 1.0


def test_bands_are_exported_in_false_colours(tmp_path: Path) -> None:
    scene = open_scene(write_made(tmp_path / "bands", bands=BANDS))
    exported = export(scene, tmp_path / "a.ply", linear=True)
    assert exported.loss is not None
    assert exported.loss.pixel_p99 < 1e-3
    file = read_ply(tmp_path / "a.ply")
    assert any("false colours of the bands 650nm, 800nm" in line for line in file.comments)
    colours = 0.5 + 0.28209479177387814 * file.harmonics[:, 0]
    assert np.allclose(colours, colours[:, :1], rtol=1e-4, atol=1e-6)  # two bands make no colour: grey


def test_the_figure_of_the_loss_is_that_of_the_file(scene: Scene) -> None:
    """A file whose light is all half a stop off has lost half a stop."""
    splats = linear_splats(scene, 1.0, with_dome=False)
    held = replace(splats, factor=2.0**0.5)
    loss = loss_of(scene, splats, held, lambda *_: None)
    assert loss.gaussian_median == pytest.approx(0.5)
    assert loss.pixel_median == pytest.approx(0.5, abs=0.01)
    assert "0.5 stops in the median" in str(loss)
    assert stops_between([0.0, 1.0, 4.0], [0.5, 2.0, 1.0], 0.5).tolist() == [0.0, 1.0, 2.0]


def test_what_sog_loses_is_told(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fine = export(scene, tmp_path / "a.sog", linear=True).loss
    monkeypatch.setattr(
        sog, "codebook", lambda values: np.linspace(values.min(), values.max(), 16).repeat(16)
    )
    coarse = export(scene, tmp_path / "a.sog", linear=True).loss
    assert fine is not None
    assert coarse is not None
    assert 0.001 < fine.gaussian_median < 0.5 * coarse.gaussian_median


def test_display_values_are_written_as_the_light_they_decode_to(scene: Scene, tmp_path: Path) -> None:
    export(scene, tmp_path / "shown.ply")
    shown = open_scene(tmp_path / "shown.ply")
    values = display_splats(shown, None, unreported).colours
    for factor in (1.0, 4.0):
        splats = linear_splats(shown, factor, with_dome=True)
        assert splats.linear
        assert np.allclose(splats.colours, factor * srgb_decode(values.clip(0, 1)), atol=1e-9)
    for name in ("a.usdc", "a.sog", "a.html"):
        exported = export(shown, tmp_path / name, linear=True)
        assert (exported.linear, exported.exposure_factor, exported.gaussians) == (True, 1.0, 400)
        assert exported.loss is not None
        assert exported.loss.pixel_p99 > 0.001  # light is blended where the scene blends display values
        assert any("blends display values" in note for note in exported.notes)
    with pytest.raises(ReconstructionError, match="leave --exposure out"):
        export(shown, tmp_path / "a.glb", exposure=1.0)
    assert export(shown, tmp_path / "a.glb").gaussians == 400


CODES = np.linspace(0, 1, 65)[1:]
SRGB = Response(kind="srgb", evidence="")
CUBE = Response(kind="curve", codes=tuple(CODES), log_exposure=(tuple(np.log(CODES**3)),) * 3, evidence="")
RESPONSES = {
    "srgb": (SRGB, False, 0.5, srgb_decode(0.5), 2.4 / 1.055 * (0.555 / 1.055) ** 1.4),
    "srgb, clipped": (SRGB, False, 1.5, 1.0, 2.4 / 1.055),
    "linear": (Response(kind="linear", evidence=""), False, 0.5, 0.5, 1.0),
    "curve": (CUBE, False, 0.5, 0.125, 0.75),
    "developed, within": (SRGB, True, 0.5, srgb_decode(0.5), 2.4 / 1.055 * (0.555 / 1.055) ** 1.4),
    "developed, above": (SRGB, True, 2.0, 2**2.2, 2.2 * 2**1.2),
}
"""Response, whether developed, a code, its light, and the slope of the light there."""


@pytest.mark.parametrize("name", RESPONSES)
def test_display_values_are_decoded_by_the_response_of_their_scene(name: str, scene: Scene) -> None:
    """As `Scene.render` does: by its own curve, and above white where photographs were developed."""
    response, developed, code, light, rise = RESPONSES[name]
    display = DisplayValues(response=response, k=0.25, developed=developed)
    parameters = {key: scene.gaussians.parameters[key] for key in GEOMETRY}
    parameters["opacity_logits"] = torch.full((400,), 9.0)
    parameters["log_scales"] = torch.full((400, 3), float(np.log(0.3)))
    parameters["sh_dc"] = torch.full((400, 1, 3), (code - 0.5) / C0)
    parameters["sh_rest"] = torch.zeros(400, 8, 3)
    renderer = Renderer(PlainHarmonics(), Limits.gsplat())
    record = scene.record.model_copy(update={"display": display})
    shown = replace(scene, record=record, gaussians=Gaussians(parameters), renderer=renderer)
    parameters["sh_rest"] = torch.full((400, 8, 3), 0.1)
    bent = replace(shown, gaussians=Gaussians(parameters), record=record.model_copy(update={"degree": 2}))
    far = Environment(torch.full((3, 2, 4), float(np.log(code))), np.eye(3))
    sky = replace(shown, renderer=replace(renderer, environment=far))

    splats = linear_splats(shown, 2.0, with_dome=False)
    assert np.allclose(splats.colours, 2 * light, rtol=1e-4)
    brightest = max(shown.render(view).max() for view in shown.views)
    assert np.isclose(brightest * exposure_factor(shown, 2.0), 2 * light, rtol=2e-3)
    rests = (linear_splats(bent, 2.0, with_dome=False), display_splats(bent, None, unreported))
    assert np.allclose(rests[0].harmonics[:, 1:], 2 * rise * rests[1].harmonics[:, 1:], rtol=1e-3)
    assert np.allclose(far_light_of(sky).ln_light.exp().numpy(), light, rtol=1e-4)

    loss = loss_of(shown, splats, splats, unreported)
    assert loss.pixel_median < 0.01
    plain = replace(splats, harmonics=(2 * srgb_decode(min(code, 1)) - 0.5) / C0 * np.ones((400, 1, 3)))
    off = abs(np.log2(light / srgb_decode(min(code, 1))))
    assert loss_of(shown, splats, plain, unreported).pixel_median == pytest.approx(off, abs=0.02)
    clipped = loss_of(shown, None, display_splats(shown, None, unreported), unreported).clipped
    assert (clipped > 0.05) == (name == "developed, above")


def test_light_from_far_away_of_display_values_is_written_as_it_decodes(
    made_sky: Path, tmp_path: Path
) -> None:
    sky, shown_path = open_scene(made_sky), tmp_path / "shown.ply"
    export(replace(sky, renderer=replace(sky.renderer, environment=None)), shown_path)
    shown = open_scene(shown_path)
    shown = replace(shown, renderer=replace(shown.renderer, environment=sky.renderer.environment))
    far = far_light_of(shown)
    assert far is not None
    values = sky.renderer.environment.ln_light.double().exp().clamp(0, 1).numpy()
    assert np.allclose(far.ln_light.exp().numpy(), srgb_decode(values), rtol=1e-6)
    display, light = display_splats(shown, None, unreported), linear_splats(shown, 2.0, with_dome=True)
    assert display.dome == light.dome > 0
    assert len(linear_splats(shown, 2.0, with_dome=False)) == len(light) - light.dome
    assert np.allclose(
        light.colours[-light.dome :], 2 * srgb_decode(display.colours[-light.dome :].clip(0, 1))
    )
    # A camera that looks away from the Gaussians sees in the file what the scene shows.
    camera = shown.views[0].splat_camera
    camera = replace(camera, cam_from_world=np.diag([-1.0, 1.0, -1.0, 1.0]) @ camera.cam_from_world)
    pictures = drawn(shown, linear_splats(shown, 1.0, with_dome=False), camera), shown.render(camera)
    assert np.median(np.abs(np.log2((pictures[0] + 1e-6) / (pictures[1] + 1e-6)))) < 0.01
    exported = export(shown, tmp_path / "a.usdc", linear=True)
    picture = read_exr(tmp_path / "a.environment.exr").rgb()
    assert np.allclose(picture, np.moveaxis(srgb_decode(values), 0, 2) * exported.exposure_factor, rtol=1e-4)


def test_options_that_a_format_cannot_have_are_refused(scene: Scene, made: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="usd is scene-linear: leave --display out"):
        export(scene, tmp_path / "a.usdc", linear=False)
    with pytest.raises(InputError, match="does not name a format by its suffix"):
        export(scene, tmp_path / "a.obj")
    with pytest.raises(InputError, match="is in the folder of the scene"):
        export(scene, made / "a.ply")
    assert not (made / "a.ply").exists()


def test_the_file_that_is_exported_is_not_written_over(scene: Scene, tmp_path: Path) -> None:
    export(scene, tmp_path / "mine.ply")
    before = (tmp_path / "mine.ply").read_bytes()
    (tmp_path / "link.ply").symlink_to(tmp_path / "mine.ply")
    for name in ("mine.ply", "link.ply"):
        with pytest.raises(InputError, match=f"{name} is the file that is exported: name another --out"):
            export(tmp_path / "mine.ply", tmp_path / name, linear=True)
    assert (tmp_path / "mine.ply").read_bytes() == before


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_picks_format_and_light(name: ProgramName, scene: Scene, tmp_path: Path) -> None:
    program = PROGRAMS[name]
    with pytest.raises(InputError, match=f"{name} opens "):
        export(scene, tmp_path / "a.obj", program=name)
    with pytest.raises(InputError, match=f"{name} opens "):
        export(scene, tmp_path / SPLATS[program.format], program=name, linear=True)
    if name in ("supersplat", "arnold", "spark"):
        exported = export(scene, tmp_path / SPLATS[program.format], program=name)
        assert (exported.format, exported.linear) == (program.format, bool(program.linear))
        assert exported.opening is not None
        assert ("pictures of" in exported.opening) == (name != "arnold")


def test_sound_scenes_are_left_as_they_are(scene: Scene) -> None:
    same, dropped = sound(scene)
    assert same is scene
    assert dropped == 0
    assert set(FORMATS) >= set(SPLATS)


def test_an_offset_is_left_out_of_every_file(made: Path, tmp_path: Path) -> None:
    """Coordinates of a survey do not fit float32; those of the files are less a round number."""
    scene = open_scene(made)
    far = scene.record.model_copy(update={"offset": (450000.0, 5410000.0, 0.0)})
    world = far.world.model_copy(update={"origin": (450003.0, 5409998.0, 1.5)})
    scene = replace(scene, record=far.model_copy(update={"world": world}))
    export(scene, tmp_path / "a.ply", linear=True)
    means = read_ply(tmp_path / "a.ply").means
    scene_means = scene.gaussians.parameters["means"].double().numpy()
    assert np.abs(means - (scene_means * world.unit + [3.0, -2.0, 1.5])).max() < 1e-5
    assert torch.is_tensor(scene.gaussians.parameters["means"])


@pytest.mark.parametrize("first", ["a.ply", "a.usda"])
def test_an_offset_goes_on_with_a_file_that_is_exported_again(first: str, made: Path, tmp_path: Path) -> None:
    """The world of an opened file is its own; what it says to add for the calibration is said again."""
    scene = open_scene(made)
    offset = (450000.0, 5410000.0, 0.25)
    origin = tuple(np.add(scene.record.world.origin, offset).tolist())
    world = scene.record.world.model_copy(update={"origin": origin})
    far = replace(scene, record=scene.record.model_copy(update={"offset": offset, "world": world}))
    export(far, tmp_path / first, linear=True)
    opened = open_scene(tmp_path / first)
    assert opened.record.offset == (0.0, 0.0, 0.0)
    for name in ("b.ply", "b.usda", "b.glb"):
        export(opened, tmp_path / name, linear=True)
        assert placement_of(tmp_path / name).offset == offset
    export(scene, tmp_path / "near.ply", linear=True)
    near, again = (read_ply(tmp_path / name).means for name in ("near.ply", "b.ply"))
    np.testing.assert_allclose(again, near, atol=1e-4)
    export(opened, tmp_path / "cameras", "cameras")
    assert placement_of(tmp_path / "cameras" / "sparse_pc.ply").offset == offset
    transforms = json.loads((tmp_path / "cameras" / "transforms.json").read_text())
    assert tuple(transforms["coordinates"]["world_offset"]) == offset


def test_splats_of_the_folder_are_those_of_the_scene_that_it_holds(made: Path, tmp_path: Path) -> None:
    """What is cut, moved or brighter is fitted anew; what no renderer draws may be left out."""
    folder = shutil.copytree(made, tmp_path / "made")
    scene = open_scene(folder)
    linear = linear_splats(scene, 1.0, with_dome=False)
    marked = linear.harmonics * 0 + 0.25
    write_ply(folder / "splats.ply", linear.gaussians(), marked, ["display values"], scene.record.world)

    def taken(shown: Scene) -> bool:
        splats = display_splats(shown, None, unreported)
        assert len(splats) == len(shown.gaussians)
        return bool((splats.harmonics == 0.25).all())

    assert taken(scene)
    chosen = torch.arange(len(scene.gaussians)) < 100
    sampling = scene.renderer.sampling
    assert sampling is not None
    fewer = replace(sampling, least=sampling.least[chosen], most=sampling.most[chosen])
    renderer = replace(scene.renderer, sampling=fewer)
    assert not taken(replace(scene, gaussians=Gaussians(scene.gaussians.rows(chosen)), renderer=renderer))
    assert not taken(changed(scene, ln_luminance=(3, 0.5)))
    brighter = scene.record.model_copy(update={"exposure": 2 * scene.record.exposure})
    assert not taken(replace(scene, record=brighter))
    checkpoint = read_checkpoint(folder / CHECKPOINT)
    checkpoint.tensors["gaussians.opacity_logits"][6] = -np.inf
    write_checkpoint(folder / CHECKPOINT, checkpoint)
    sounder, dropped = sound(open_scene(folder))
    assert dropped == 1
    assert is_stored(sounder)
