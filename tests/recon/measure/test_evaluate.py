"""The whole stage on a toy session, and its metrics on models whose quality is known."""

import itertools
import json
import shutil

import numpy as np
import pytest
import torch

from imaging import metrics
from imaging.colour.spaces import space_from_rec709
from imaging.compute import threads
from imaging.errors import InputError, ReconstructionError, RigError
from imaging.files.exr.reading import read_exr
from imaging.session.calibration import read_calibration
from recon.decide.cost.budget import Budget
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.measure.truth import true_radiance
from recon.measure.view_figures import measured
from recon.reconstruct import reconstruct
from recon.rendering.render import render
from recon.result.model import read_model
from recon.result.opened import Opened, open_model
from tests.recon.ply_files import read_ply


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setitem(QUALITIES, "draft", Quality(60, 800, 64))


@pytest.fixture(scope="module")
def trained(toy, tmp_path_factory):
    """A session with a finished reconstruction; not to be changed."""
    session = shutil.copytree(toy, tmp_path_factory.mktemp("trained") / "session")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(QUALITIES, "draft", Quality(60, 800, 64))
        return reconstruct(session, TrainingRequest(quality="draft"))


def copied(trained, tmp_path):
    session = shutil.copytree(trained.parent.parent, tmp_path / "session")
    return session / "reconstructions" / trained.name


def test_everything_is_there_and_says_what_it_is(trained):
    assert trained.name == "nh-3dgs-draft"
    record = read_model(trained)
    assert record.settings.method == "nh-3dgs"
    assert record.settings.iterations == 60
    assert len(record.training_views) == 5
    assert record.held_out == ("0001/cam0",)
    assert {"linear light", "vignetting", "distortion"} <= {rung.name for rung in record.rungs}
    assert record.gaussians == 800
    assert len(read_ply(trained / "splats.ply")["x"]) == 800
    lines = [json.loads(line) for line in (trained / "train.jsonl").read_text().splitlines()]
    assert [line["iteration"] for line in lines] == [10, 20, 30, 40, 50, 60]
    assert all(5 < line["held_out_db"] < 60 and line["seconds"] > 0 for line in lines)
    assert record.held_out_db == pytest.approx(lines[-1]["held_out_db"], abs=1e-4)
    assert record.schedule == ((0, 0), (60, 60))
    assert (record.iterations, record.ending) == (60, "schedule")
    assert not list(trained.glob(".*"))


def test_a_finished_training_is_not_done_again(trained):
    before = (trained / "checkpoint.safetensors").read_bytes()
    stamp = (trained / "model.json").stat().st_mtime_ns
    assert reconstruct(trained.parent.parent, TrainingRequest(quality="draft")) == trained
    assert (trained / "model.json").stat().st_mtime_ns == stamp
    assert (trained / "checkpoint.safetensors").read_bytes() == before


def test_a_stopped_training_ends_like_one_that_was_not(trained, session_copy):
    """Interrupted by the user half-way; the same command goes on."""

    def impatient(message, done, total):
        if "loss" in message:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reconstruct(session_copy, TrainingRequest(quality="draft"), on_progress=impatient)
    folder = session_copy / "reconstructions" / "nh-3dgs-draft"
    assert not (folder / "model.json").exists()
    reconstruct(session_copy, TrainingRequest(quality="draft"))
    one, two = (
        {name: values.tobytes() for name, values in read_ply(path / "splats.ply").items()}
        for path in (trained, folder)
    )
    assert one == two


def test_metrics_have_their_names_and_no_nan(trained, tmp_path):
    folder = copied(trained, tmp_path)
    result = evaluate(folder)
    text = (folder / "metrics.json").read_text()
    assert json.loads(text, parse_constant=pytest.fail) == result.known()
    expected = {
        "hdr_psnr_mu", "hdr_psnr_mu_aligned", "hdr_psnr_mu_dark", "stops_median", "stops_dark",
        "stops_middle", "stops_bright", "stops_brightest", "stops_against", "pu21_psnr", "raw_psnr",
        "relative_error_by_decade", "pose_rotation_deg", "pose_rotation_deg_max", "pose_translation_relative",
        "pose_translation_relative_max", "exposure_ratio_error", "gain_error", "gaussians", "size_bytes",
        "train_seconds", "iterations", "render_fps", "views", "held_out",
    }  # fmt: skip
    assert expected <= set(result.known())
    assert result.gaussians == 800
    assert result.size_bytes == (folder / "splats.ply").stat().st_size
    (row,) = result.views
    assert row.view == result.held_out[0]
    assert row.hdr_psnr_mu_aligned == pytest.approx(result.hdr_psnr_mu_aligned)
    view = open_model(folder).view(row.view)
    image = read_exr(folder / "renders" / f"{view.frame:04d}_{view.camera}.exr").rgb()
    truth = true_radiance(folder.parent.parent, view)
    assert metrics.hdr_psnr_mu(image, truth) == pytest.approx(result.hdr_psnr_mu, abs=1e-3)
    header = read_exr(folder / "renders" / f"{view.frame:04d}_{view.camera}.exr").attributes
    assert header["colorInteropID"] == "lin_rec709_scene"


def test_a_perfect_model_reaches_the_caps(trained, tmp_path, monkeypatch):
    folder = copied(trained, tmp_path)

    def perfect(self, camera):
        view = next(view for view in self.dataset.views if view.lens is camera)
        light = true_radiance(self.dataset.session, view)
        return torch.from_numpy(light) / self.record.normaliser

    monkeypatch.setattr(Opened, "render", perfect)
    result = evaluate(folder)
    assert result.hdr_psnr_mu > 110
    assert result.hdr_psnr_mu_aligned > 110
    assert result.pu21_psnr > 100
    assert result.stops_median < 1e-5
    assert all(entry.p95 < 1e-5 for entry in result.relative_error_by_decade)
    # What is left is the noise of the held-out shots themselves.
    assert 30 < result.raw_psnr < 60


def test_without_a_truth_light_is_held_against_the_photographs(trained, tmp_path, monkeypatch):
    """Draw shining surfaces two stops too dark: the brightest bands show it, the others do not."""
    folder = copied(trained, tmp_path)
    session = folder.parent.parent
    truths = {view.name: true_radiance(session, view) for view in open_model(folder).dataset.views}

    def darkened(self, camera):
        view = next(view for view in self.dataset.views if view.lens is camera)
        light = truths[view.name]
        light = np.where(light > np.percentile(light, 95), light / 4, light)
        return torch.from_numpy(light) / self.record.normaliser

    monkeypatch.setattr(Opened, "render", darkened)
    assert evaluate(folder).stops_against == "truth"
    shutil.rmtree(session / "truth")
    result = evaluate(folder)
    assert (result.stops_against, result.hdr_psnr_mu_aligned) == ("photographs", None)
    assert (result.stops_bright, result.stops_brightest) == pytest.approx((2.0, 2.0), abs=0.15)
    assert result.stops_middle < 0.1
    assert result.stops_bound < 0.5


def test_figures_are_the_same_to_the_bit_on_any_number_of_threads(trained, tmp_path):
    """Use the processor, on which an evaluation renders, wherever the scene was trained."""
    folder, results = copied(trained, tmp_path), []
    threads_before = threads.thread_count()
    try:
        for count in (1, 2, 3):
            threads.set_threads(count)
            opened = open_model(folder)
            assert {value.device.type for value in opened.training.gaussians.parameters.values()} == {"cpu"}
            _, _, rows, pooled = measured(opened)
            results.append((rows, pooled))
    finally:
        threads.set_threads(threads_before)
    assert results[0] == results[1] == results[2]


def test_a_model_twice_too_bright_is_right_after_alignment(trained, tmp_path, monkeypatch):
    folder = copied(trained, tmp_path)

    def bright(self, camera):
        view = next(view for view in self.dataset.views if view.lens is camera)
        return 2 * torch.from_numpy(true_radiance(self.dataset.session, view)) / self.record.normaliser

    monkeypatch.setattr(Opened, "render", bright)
    result = evaluate(folder)
    assert result.alignment_scale == pytest.approx(0.5, rel=1e-5)
    assert result.hdr_psnr_mu < 35
    assert result.hdr_psnr_mu_aligned > 110


def test_renders_of_named_views_at_several_exposures(trained, tmp_path):
    files = render(
        trained, tmp_path / "out", views=["0000/cam0", "0002/cam1"], stops=(-3, 0, 3), exposure=0.0
    )
    assert [file.name for file in files if file.suffix == ".exr"] == ["0000_cam0.exr", "0002_cam1.exr"]
    assert {file.name for file in files if "0000" in file.name and file.suffix == ".png"} == {
        "0000_cam0_-3ev.png", "0000_cam0_+0ev.png", "0000_cam0_+3ev.png"
    }  # fmt: skip
    assert all(file.is_file() for file in files)
    image = read_exr(tmp_path / "out" / "0000_cam0.exr").rgb()
    truth = read_exr(trained.parent.parent / "truth" / "0000" / "cam0.exr").rgb()
    assert metrics.stops_median(image, truth) < 0.7


def test_a_budget_makes_the_schedule_as_short_as_it_must_be(session_copy, monkeypatch):
    monkeypatch.setitem(QUALITIES, "draft", Quality(1_000_000, 800, 64))
    ticks = itertools.count(step=0.005)  # a look at the clock takes that long
    folder = reconstruct(
        session_copy, TrainingRequest(quality="draft", budget=Budget(4.0, "s")), clock=lambda: next(ticks)
    )
    record = read_model(folder)
    assert record.settings.budget == 4.0
    assert 50 <= record.settings.iterations < 1_000_000
    assert open_model(folder).training.iteration == record.iterations == record.schedule[-1][0]


def test_a_budget_with_room_to_spare_changes_nothing(session_copy):
    folder = reconstruct(session_copy, TrainingRequest(quality="draft", budget=Budget(600.0, "s")))
    assert read_model(folder).settings.iterations == 60


def test_photographs_choose_hdr_gs_and_linear_ones_do_not(toy_ldr, tmp_path):
    session = shutil.copytree(toy_ldr, tmp_path / "session")
    folder = reconstruct(session, TrainingRequest(quality="draft"))
    assert folder.name == "hdr-gs-draft"
    result = evaluate(folder)
    assert {"ldr_psnr_oe", "ssim", "response_rmse", "hdr_psnr_mu_aligned"} <= set(result.known())
    assert result.response_rmse < 0.1
    with pytest.raises(ReconstructionError, match="developed photographs"):
        reconstruct(session, TrainingRequest(quality="draft", method="nh-3dgs"))


def only_first_step(session):
    lines = (session / "shots.jsonl").read_text().splitlines()
    (session / "shots.jsonl").write_text("".join(x + "\n" for x in lines if json.loads(x)["step"] == 2))


def test_photographs_of_one_exposure_are_plain_3dgs_in_display_values(toy_ldr, tmp_path):
    session = shutil.copytree(toy_ldr, tmp_path / "session")
    only_first_step(session)
    folder = reconstruct(session, TrainingRequest(quality="draft"))
    assert folder.name == "vanilla-draft"
    result = evaluate(folder)
    assert result.ldr_psnr_oe > 15
    assert result.response_rmse is not None


def keep_views(session, count):
    path = session / "calibration" / "calibration.json"
    record = json.loads(path.read_text())
    record["views"] = record["views"][:count]
    path.write_text(json.dumps(record))


@pytest.mark.parametrize("count", [1, 3])
def test_too_few_views_hold_nothing_out_and_say_so(session_copy, count):
    keep_views(session_copy, count)
    folder = reconstruct(session_copy, TrainingRequest(quality="draft"))
    result = evaluate(folder)
    assert result.held_out == ()
    assert "too few" in result.held_out_note
    assert result.hdr_psnr_mu_aligned is None
    assert all(file.stat().st_size for file in render(folder, session_copy / "out"))


def test_all_views_are_trained_on_where_that_is_asked_for(session_copy):
    asked = TrainingRequest(quality="draft", all_views=True)
    folder = reconstruct(session_copy, asked)
    assert folder.name == "nh-3dgs-draft-all"
    views = read_calibration(session_copy).views
    assert read_model(folder).training_views == tuple(str(view.id) for view in views)
    result = evaluate(folder)
    assert (result.held_out, result.hdr_psnr_mu_aligned) == ((), None)
    words = f"All {len(views)} views were trained on, as asked for: none is left to measure with."
    assert result.held_out_note == words
    assert reconstruct(session_copy, asked) == folder  # finished: nothing is trained again
    with pytest.raises(InputError, match="judged by held-out views, and --all-views leaves none"):
        TrainingRequest(budget=Budget.parse("35dB"), all_views=True)


def request(budget=None, **options):
    return TrainingRequest(quality="draft", budget=Budget.of(budget), **options)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method": "hdr-gs"}, "no tone curve"),
        ({"budget": -1.0}, "too short for training"),
        ({"budget": float("nan")}, "too short for training"),
        ({"seed": -1}, "out of range"),
        *(({"name": name}, "is not that of a folder") for name in ("../elsewhere", "a/b", "a\\b", ".a", "")),
    ],
)
def test_bad_usage_is_one_sentence(toy, options, words):
    with pytest.raises(RigError, match=words):
        reconstruct(toy, request(**options))
    assert not (toy / "reconstructions").exists()


def test_what_is_no_reconstruction_is_refused(toy, trained, tmp_path):
    with pytest.raises(InputError, match="no finished reconstruction"):
        evaluate(toy)
    with pytest.raises(InputError):
        reconstruct(tmp_path)
    with pytest.raises(ReconstructionError, match="no view"):
        render(trained, tmp_path / "out", views=["0009/cam7"])


@pytest.mark.parametrize("views", [6, 16])
def test_figures_of_a_training_that_views_may_end_are_of_others(toy, toy_long, tmp_path, monkeypatch, views):
    """Six views have one to hold out, which is looked at; sixteen another, by which nothing is ended."""
    monkeypatch.setitem(QUALITIES, "draft", Quality(20, 400, 64))
    session = shutil.copytree(toy if views == 6 else toy_long.session, tmp_path / "session")
    folder = reconstruct(session, TrainingRequest(quality="draft", early_stop=True))
    record, result = read_model(folder), evaluate(folder)
    assert set(record.validation) <= set(record.held_out)
    assert result.validation == record.validation
    assert len(record.validation) == 1
    assert set(result.held_out) == set(record.held_out) - set(record.validation)
    (row,) = result.views
    last = json.loads((folder / "train.jsonl").read_text().splitlines()[-1])["held_out_db"]
    if views == 6:
        assert (result.measured_on, row.view) == ("validation", record.validation[0])
        assert "looked at" in result.held_out_note
        assert row.raw_psnr == pytest.approx(last, abs=1e-3)
        return
    assert (result.measured_on, row.view) == ("test", result.held_out[0])
    assert result.held_out_note is None
    assert row.raw_psnr != pytest.approx(last, abs=1e-3)


def test_renders_in_another_space_are_the_same_light(trained, tmp_path):
    plain, wide = tmp_path / "plain", tmp_path / "wide"
    render(trained, plain, views=["0000/cam0"])
    render(trained, wide, views=["0000/cam0"], space="aces2065-1")
    image = read_exr(wide / "0000_cam0.exr")
    assert image.attributes["colorInteropID"] == "lin_ap0_scene"
    stored = np.stack([image.channels[letter] for letter in "RGB"], axis=-1)
    truth = read_exr(plain / "0000_cam0.exr").rgb()
    assert np.abs(stored - truth @ space_from_rec709("aces2065-1").T).max() < 1e-5 * truth.max()
    assert np.abs(stored - truth).max() > 0.01 * truth.max()
    assert np.abs(image.rgb() - truth).max() < 1e-5 * truth.max()
    assert (wide / "0000_cam0.png").read_bytes() == (plain / "0000_cam0.png").read_bytes()
