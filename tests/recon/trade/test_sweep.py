"""Sweeps at toy size: points are kept, true, and made again by what is said beside them."""

import importlib
import json
import shutil
from concurrent.futures import Future
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imaging.compute.workers import LocalWorkers, Share, WorkerLost
from imaging.errors import InputError, ReconstructionError
from imaging.files import store
from recon.data.load import load
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.reconstruct import reconstruct
from recon.trade import Choice, Point, Trade, read_trade, trade_sweep
from recon.trade.point import measuring, quality_of
from recon.trade.trade_record import key_of
from tests.recon.methods.conftest import as_exr

TINY = {"draft": Quality(10, 100, 32), "standard": Quality(20, 200, 64), "best": Quality(30, 300, 64)}
module = importlib.import_module("recon.trade.sweep")
"""The package has a function of that name."""
AT_ONCE = 1e-6
"""A budget that is over when the first training is done."""


@pytest.fixture(autouse=True)
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, quality in TINY.items():
        monkeypatch.setitem(QUALITIES, name, quality)


def test_each_call_goes_on_and_every_point_can_be_made_again(session_copy: Path) -> None:
    said: list[str] = []
    first = trade_sweep(session_copy, budget=AT_ONCE, on_message=said.append)
    assert [point.choice.quality for point in first.points] == ["standard"]
    assert first.left_out > 5
    assert len(said) == 1
    second = trade_sweep(session_copy, budget=AT_ONCE)
    assert second.points[:1] == first.points
    assert [point.choice.quality for point in second.points] == ["standard", "draft"]
    assert read_trade(session_copy) == second
    # No scene is left behind: its command makes it again, to the byte, and measures the same.
    assert [path.name for path in (session_copy / "trade").iterdir()] == ["trade.json"]
    point = second.points[0]
    assert point.command == f"rig reconstruct {session_copy} --method nh-3dgs --quality standard --seed 0"
    folder = reconstruct(session_copy, TrainingRequest(method="nh-3dgs", quality="standard", seed=0))
    assert store.sha256(folder / "splats.ply") == point.splats_sha256
    assert point.refine is None
    metrics = evaluate(folder)
    assert metrics.raw_psnr == pytest.approx(point.db)
    assert metrics.hdr_psnr_mu_aligned == pytest.approx(point.truth_db)
    assert metrics.size_bytes == point.size_bytes
    assert point.seconds > 0
    assert point.processor_seconds > 0


def test_points_are_measured_at_one_size_whatever_they_were_trained_at(
    session_copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = Choice(axis="resolution", overrides=Overrides(width=32, exposures=1, views=3, refine="poses"))
    monkeypatch.setattr(module, "planned", lambda session, standard: [small])
    (point,) = trade_sweep(session_copy, budget=AT_ONCE).points
    assert point.width == 32
    assert point.refine == "poses"
    name = "by-hand"
    folder = reconstruct(
        session_copy, TrainingRequest(method="nh-3dgs", overrides=small.overrides, name=name)
    )
    assert store.sha256(folder / "splats.ply") == point.splats_sha256
    assert point.command.endswith("--set width=32 --set views=3 --set exposures=1 --set refine=poses")
    # The held-out view keeps its size and its bracket, so that its figure is not the small scene's own.
    assert evaluate(folder).raw_psnr != pytest.approx(point.db, abs=1e-3)


def test_what_is_done_survives_an_interruption(session_copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real, calls = module.train_point, []

    def stopped(*arguments, **options):
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return real(*arguments, **options)

    monkeypatch.setattr(module, "train_point", stopped)
    with pytest.raises(KeyboardInterrupt):
        trade_sweep(session_copy, budget=1e6)
    assert len(read_trade(session_copy).points) == 1


def test_a_training_that_is_not_possible_is_noted(
    session_copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*arguments, **options):
        raise ReconstructionError("nothing to start from: take more views.")

    monkeypatch.setattr(module, "train_point", refused)
    monkeypatch.setattr(module, "planned", lambda session, standard: [Choice(axis="preset", quality="draft")])
    trade = trade_sweep(session_copy, budget=1e6)
    assert trade.points == ()
    assert list(trade.failed.values()) == ["nothing to start from: take more views."]


def test_a_new_calibration_begins_anew(session_copy: Path) -> None:
    before = trade_sweep(session_copy, budget=AT_ONCE)
    path = session_copy / "calibration" / "calibration.json"
    store.write_json(path, store.read_json(path) | {"reprojection_px": 0.5})
    after = trade_sweep(session_copy, budget=AT_ONCE)
    assert [point.choice for point in after.points] == [point.choice for point in before.points]
    assert after.points[0].key != before.points[0].key


def test_other_masks_begin_anew(session_copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = trade_sweep(session_copy, budget=AT_ONCE)

    def as_before(session: Path, choice: Choice, trade: Trade, **options: object) -> Point:
        return before.points[0].model_copy(update={"key": key_of(choice, trade)})

    monkeypatch.setattr(module, "train_point", as_before)
    path = session_copy / "shots.jsonl"
    shots = [json.loads(line) | {"mask_sha256": "0" * 64} for line in path.read_text().splitlines()]
    path.write_text("".join(f"{json.dumps(shot)}\n" for shot in shots))
    (after,) = trade_sweep(session_copy, budget=AT_ONCE).points
    assert after.key != before.points[0].key


def test_a_key_tells_settings_photographs_calibration_and_code(session_copy: Path) -> None:
    trade = trade_sweep(session_copy, budget=AT_ONCE)
    choice = trade.points[0].choice
    changes = [
        trade.model_copy(update={name: value})
        for name, value in (
            ("code", "0"),
            ("calibration_sha256", "0"),
            ("photographs_sha256", "0"),
            ("depths_sha256", "0"),
            ("seed", 1),
            ("method", "vanilla"),
        )
    ]
    keys = [key_of(choice, trade), *(key_of(choice, changed) for changed in changes)]
    keys.append(key_of(choice.model_copy(update={"overrides": Overrides(iterations=9)}), trade))
    assert len(set(keys)) == len(keys)
    assert key_of(choice.model_copy(update={"axis": "other"}), trade) == keys[0]
    without = choice.model_copy(update={"overrides": Overrides(depth=0)})
    assert key_of(without, trade) == key_of(without, trade.model_copy(update={"depths_sha256": "0"}))


def test_another_preset_leaves_the_others_as_they_are(
    session_copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trade = trade_sweep(session_copy, budget=AT_ONCE)
    choices = [Choice(axis="preset", quality=quality) for quality in ("draft", "standard", "best")]
    before = [key_of(choice, trade) for choice in choices]
    monkeypatch.setitem(QUALITIES, "best", Quality(7, 70, 64))
    after = [key_of(choice, trade) for choice in choices]
    assert [one == other for one, other in zip(before, after, strict=True)] == [True, True, False]


def test_without_held_out_views_nothing_can_be_measured(session_copy: Path) -> None:
    path = session_copy / "calibration" / "calibration.json"
    record = store.read_json(path)
    store.write_json(path, record | {"views": record["views"][:3]})
    with pytest.raises(ReconstructionError, match="too few views"):
        trade_sweep(session_copy, budget=1.0)


def test_where_masks_hide_all_held_out_views_nothing_is_trained(
    toy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = load(toy)
    held_out = tuple(
        replace(view, shots=tuple(shot.showing(valid=np.zeros_like(shot.valid)) for shot in view.shots))
        for view in dataset.held_out
    )
    monkeypatch.setattr(module, "measuring", lambda *_: replace(dataset, held_out=held_out))
    monkeypatch.setattr(module, "train_point", pytest.fail)
    with pytest.raises(ReconstructionError, match="masks hide all of it"):
        trade_sweep(toy, budget=1.0)


def test_a_camera_of_exr_beside_others_is_measured(toy: Path, tmp_path: Path) -> None:
    """As linear light, without a truth too; it is the camera of the held-out view."""
    session = as_exr(toy, tmp_path / "mixed", lambda light: light, of=["cam0"])
    shutil.rmtree(session / "truth")
    (point,) = trade_sweep(session, budget=AT_ONCE).points
    (view,) = load(session).held_out
    assert view.sensor.kind == "hdr"
    assert point.views == {view.name: point.db}
    assert 5 < point.db < 60
    assert point.truth_db is None


def test_another_split_is_read_anew(session_copy: Path) -> None:
    before = measuring(session_copy, 64)
    assert measuring(session_copy, 64) is before
    shots = {view.name: [shot.file for shot in view.shots] for view in before.views}
    (old,), new = (view.name for view in before.held_out), before.train[0].name
    split = {"train": [file for name in shots if name != new for file in shots[name]], "test": shots[new]}
    store.write_json(session_copy / "split.json", {"schema_version": 1, "reason": "by hand"} | split)
    assert [view.name for view in measuring(session_copy, 64).held_out] == [new] != [old]


def test_a_session_without_calibration_is_refused(session_copy: Path) -> None:
    store.discard(session_copy / "calibration" / "calibration.json")
    with pytest.raises(InputError, match="not calibrated"):
        trade_sweep(session_copy, budget=1.0)


def test_no_trade_off_is_said(session_copy: Path) -> None:
    with pytest.raises(InputError, match="run `rig trade` first"):
        read_trade(session_copy)


SAID = (
    Choice(axis="preset", overrides=Overrides(iterations=10, gaussians=100, width=32)),
    Choice(axis="Gaussians", overrides=Overrides(iterations=12, gaussians=200, width=32)),
)
"""Quick by what they say, not by tiny presets, of which processes that are started afresh know nothing."""


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    monkeypatch.setattr(module, "planned", lambda session, standard: list(SAID))
    monkeypatch.setattr(module, "neighbours", lambda points, session: [])


@pytest.mark.usefixtures("said")
def test_several_at_once_are_what_they_are_alone(session_copy: Path) -> None:
    several = trade_sweep(session_copy, budget=1e6, workers=2)
    store.discard(session_copy / "trade" / "trade.json")
    alone = trade_sweep(session_copy, budget=1e6)
    assert same(several) == same(alone)
    assert [point.at_once for point in (*several.points, *alone.points)] == [2, 2, 1, 1]


@pytest.mark.usefixtures("said")
def test_a_lost_process_is_noted_and_its_training_made_by_the_next_call(
    session_copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Losing(LocalWorkers):
        def submit(self, task, function, session, choice, *rest):
            assert session == session_copy  # on a cluster the working folder is another one
            ended: Future[Point] = Future()
            if choice == SAID[0]:
                ended.set_exception(WorkerLost("its process was killed 2 times."))
            else:
                ended.set_result(function(Share(serves=True), session, choice, *rest))
            return ended

    monkeypatch.chdir(session_copy.parent)
    with closing(Losing(2)) as workers:
        trade = trade_sweep(session_copy.name, budget=1e6, workers=workers)
    assert [point.choice for point in trade.points] == [SAID[1]]
    assert list(trade.failed.values()) == ["its process was killed 2 times."]
    again = trade_sweep(session_copy, budget=1e6)
    assert [point.choice for point in again.points] == [SAID[1], SAID[0]]
    assert again.failed == {}


@pytest.mark.usefixtures("said")
def test_a_training_that_fits_no_worker_is_noted(session_copy: Path) -> None:
    with closing(LocalWorkers(2)) as workers:
        workers.room = 1
        trade = trade_sweep(session_copy, budget=1e6, workers=workers)
    assert trade.points == ()
    assert len(trade.failed) == 2
    assert "more of memory where 0 MB are free" in next(iter(trade.failed.values()))


def same(trade: Trade) -> dict[str, dict[str, object]]:
    """Values of each point by its key that do not depend on the way it was run."""
    rest = {"seconds", "processor_seconds", "at_once", "device"}
    return {point.key: point.model_dump(exclude=rest) for point in trade.points}


def test_a_view_that_a_mask_hides_has_no_quality() -> None:
    rows = [
        {"view": "0000/cam0", "raw_psnr": 31.0},
        {"view": "0001/cam0"},
        {"view": "0000/b", "hdr_psnr_mu": 5},
    ]
    assert quality_of(rows) == {"0000/cam0": 31.0, "0000/b": 5}
