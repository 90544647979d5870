"""Pictures side by side: what is written beside each other has the figures that other programs find in it."""

import shutil

import colour
import flip_evaluator
import numpy as np
import pytest

from imaging.files.exr.reading import read_exr
from imaging.files.photo import read_photo
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.measure import flip, vdp
from recon.measure.evaluate import evaluate
from recon.measure.flip import hdr_flip
from recon.reconstruct import reconstruct
from recon.result.model import read_model


@pytest.fixture(scope="module", params=["toy", "toy_ldr"])
def scene(request, tmp_path_factory):
    """A scene and its metrics: one against the true light, one against photographs."""
    session = shutil.copytree(request.getfixturevalue(request.param), tmp_path_factory.mktemp("look") / "S")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(QUALITIES, "draft", Quality(40, 600, 64))
        folder = reconstruct(session, TrainingRequest(quality="draft"))
    return folder, evaluate(folder)


def test_other_programs_find_the_same_figures_in_the_files(scene):
    """FLIP reads the files itself; CIEDE2000 is that of colour-science."""
    folder, result = scene
    pictures = sorted((folder / "references").glob("*.png"))
    assert len(pictures) == (1 if folder.name.startswith("nh-3dgs") else 5)
    flips, differences = [], []
    for reference in pictures:
        ours = folder / "renders" / reference.name
        flips.append(flip_evaluator.evaluate(str(reference), str(ours), "LDR", applyMagma=False)[0])
        one, other = (colour.sRGB_to_XYZ(read_photo(path).pixels) for path in (ours, reference))
        white = colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D65"]
        labs = (colour.XYZ_to_Lab(xyz, white) for xyz in (one, other))
        differences.append(colour.delta_E(*labs, method="CIE 2000"))
    assert result.flip_mean == pytest.approx(np.mean(flips), abs=1e-5)
    assert result.flip_median == pytest.approx(np.median(flips), abs=1e-5)
    # Rounded matrices of the standard: a few hundredths at the most.
    assert result.ciede2000_mean == pytest.approx(np.mean(differences), abs=0.02)
    assert result.ciede2000_median == pytest.approx(np.median(differences), abs=0.02)
    assert 0.01 < result.flip_mean < 0.8


def test_light_is_written_in_one_unit_and_has_the_hdr_flip_of_its_authors(scene):
    folder, result = scene
    (reference,) = (folder / "references").glob("*.exr")
    ours, truth = (read_exr(folder / name / reference.name).rgb() for name in ("renders", "references"))
    assert np.median(np.log(ours / truth)) == pytest.approx(0, abs=0.01)
    errors, mean, _ = flip_evaluator.evaluate(truth, np.maximum(ours, 0), "HDR", applyMagma=False)
    assert result.hdr_flip_mean == pytest.approx(mean, abs=1e-4)
    assert result.hdr_flip_median == pytest.approx(np.median(errors), abs=1e-4)


def test_colorvideovdp_sees_the_light_of_the_files_with_white_at_203_nits(scene, monkeypatch):
    """Neither scene has a scale."""
    folder, _ = scene
    compared = {vdp.SCREEN: [], vdp.LIGHT_SCREEN: []}

    def metric(screen):
        return lambda *sides: compared[screen].append(sides) or 9.0 - (screen == vdp.LIGHT_SCREEN)

    monkeypatch.setattr(vdp, "_metric", metric)
    result = evaluate(folder)
    pictures = sorted((folder / "references").glob("*.png"))
    shown = [read_photo(folder / name / pictures[0].name).pixels for name in ("renders", "references")]
    assert result.vdp_jod == 9.0
    assert len(compared[vdp.SCREEN]) == len(pictures)
    for side, file in zip(compared[vdp.SCREEN][0], shown, strict=True):
        assert np.allclose(side / 255, file, atol=1e-6)
    assert result.hdr_vdp_jod == 8.0
    exposure = read_model(folder).exposure
    (sides,) = compared[vdp.LIGHT_SCREEN]
    (reference,) = (folder / "references").glob("*.exr")
    for side, name in zip(sides, ("renders", "references"), strict=True):
        light = read_exr(folder / name / reference.name).rgb()
        assert np.allclose(side, (203 * exposure * light).clip(0, 1500), rtol=1e-5)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_light_without_contrast_has_no_hdr_flip(value):
    """FLIP itself ends the process there."""
    light = np.full((20, 20, 3), value, np.float32)
    assert hdr_flip(light + np.float32(0.1), light, np.ones((20, 20), bool)) is None


def test_what_is_masked_has_no_part(monkeypatch):
    rng = np.random.default_rng(0)
    truth = np.exp(rng.normal(0, 1.5, (32, 40, 3))).astype(np.float32)
    visible = np.ones((32, 40), bool)
    visible[:, :15] = False
    spoilt = np.where(visible[..., None], truth, 100).astype(np.float32)
    assert hdr_flip(spoilt, truth, visible) == pytest.approx(0, abs=1e-6)
    assert hdr_flip(spoilt, truth, visible).shape == (32 * 25,)


def test_without_flip_the_rest_is_told(scene, monkeypatch):
    folder, before = scene
    monkeypatch.setattr(flip, "find_spec", lambda name: None)
    result = evaluate(folder)
    assert not [key for key in result.known() if "flip" in key]
    assert result.ciede2000_mean == before.ciede2000_mean
