"""`rig merge`: right light on disk in one unit, resumed where it was, and refusals that name the fix."""

import json
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from calib.luminance.area import LUMINANCE
from capture.imports.photos import import_photos
from imaging.colour.spaces import srgb_encode
from imaging.files import store
from imaging.files.exr.reading import read_exr
from imaging.files.photo import encode_png
from imaging.files.tiff.dng import encode_dng
from imaging.merge.picture import CLIPPED, DARK, GHOST, HIDDEN
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import FrameMetadata, RawMosaic
from imaging.session.records import CameraRecord, SessionRecord, ShotRecord
from imaging.session.session import Session

Run = Callable[..., tuple[int, str, str]]


def test_every_bracket_becomes_an_exr_and_all_share_one_unit(rig: Run, toy: Path, tmp_path: Path) -> None:
    code, out, _ = rig("merge", str(toy), str(tmp_path / "M"), "--json")
    data = json.loads(out)
    assert code == 0
    assert data["exposures"] == "calibration"
    assert len(data["files"]) == 6
    scales = []
    for entry in data["files"]:
        image = read_exr(Path(entry["file"]))
        assert set(image.channels) == {"R", "G", "B", "sigma.R", "sigma.G", "sigma.B", "mask"}
        assert "per second of exposure scale" in str(image.attributes["rig:units"])
        assert image.attributes["rig:colour"] == "Rec.709"
        truth = read_exr(toy / "truth" / f"{entry['frame']:04d}" / f"{entry['camera']}.exr").rgb()
        # In blocks: demosaicking blurs what is as fine as the mosaic of so small a picture.
        merged, real = _blocks(image.rgb()), _blocks(truth)
        lit = (real > 0.1 * np.median(real)) & (merged > 0)  # a lamp of one pixel lacks its other colours
        assert lit.mean() > 0.8
        logs = np.log2(merged[lit] / real[lit])
        scales.append(np.median(logs))
        assert np.median(np.abs(logs - scales[-1])) < 0.1
        sigma = image.channels["sigma.G"]
        assert np.isfinite(sigma).all()
        assert (sigma > 0).all()
        assert entry["ghost"] < 0.01
    assert np.ptp(scales) < 0.1


def _blocks(image: np.ndarray) -> np.ndarray:
    """Means of 8x8 pixels of a picture of 48x64."""
    return image.reshape(6, 8, 8, 8, 3).mean((1, 3))


def test_finished_files_are_kept_and_changed_ones_made_again(rig: Run, toy: Path, tmp_path: Path) -> None:
    chosen = ("merge", str(toy), str(tmp_path / "M"), "--frame", "1", "--exposure", "0", "--json")
    first = json.loads(rig(*chosen)[1])["files"]
    file = Path(first[0]["file"])
    times = [Path(entry["file"]).stat().st_mtime_ns for entry in first]
    file.write_bytes(b"torn")
    second = json.loads(rig(*chosen)[1])["files"]
    assert [entry["reused"] for entry in first] == [False, False]
    assert [entry["reused"] for entry in second] == [False, True]
    assert Path(first[1]["file"]).stat().st_mtime_ns == times[1]
    assert [e | {"reused": None} for e in first] == [e | {"reused": None} for e in second]
    assert not list((tmp_path / "M").rglob("cam0.exr.part"))
    record = toy / "calibration" / "calibration.json"
    known = json.loads(record.read_text())
    known["cameras"][1]["gain"] *= 1.01
    record.write_text(json.dumps(known))
    third = json.loads(rig(*chosen)[1])["files"]
    assert [entry["reused"] for entry in third] == [True, False]
    # The camera stands in the file, too.
    known["cameras"][0]["lens"]["fx"] *= 1.25
    known["cameras"][0]["lens"]["fy"] *= 1.25
    record.write_text(json.dumps(known))
    before = read_exr(file).attributes["pinholeFocalLength"]
    fourth = json.loads(rig(*chosen)[1])["files"]
    assert [entry["reused"] for entry in fourth] == [False, True]
    assert read_exr(file).attributes["pinholeFocalLength"] == pytest.approx(1.25 * before)


def test_light_is_stored_as_asked_and_a_file_of_another_storage_is_made_again(
    rig: Run, toy: Path, tmp_path: Path
) -> None:
    chosen = ("merge", str(toy), str(tmp_path / "M"), "--frame", "1", "--camera", "cam0", "--json")
    exact = read_exr(Path(json.loads(rig(*chosen)[1])["files"][0]["file"])).channels
    (half,) = json.loads(rig(*chosen, "--exr", "half")[1])["files"]
    assert not half["reused"]
    stored = read_exr(Path(half["file"])).channels
    assert np.array_equal(stored["R"], exact["R"].astype(np.float16).astype(np.float32))
    assert not np.array_equal(stored["R"], exact["R"])
    assert np.array_equal(stored["sigma.R"], exact["sigma.R"])
    assert json.loads(rig(*chosen, "--exr", "half")[1])["files"][0]["reused"]


def bracket(
    folder: Path, codes: list[np.ndarray], times: list[float | None], masks: list[np.ndarray] | None = None
) -> Path:
    """A session of one view: photographs, what they say of their exposure, and what counts of them."""
    camera = CameraRecord(name="cam0", serial="1", kind="ldr")
    record = SessionRecord(name="made", created=datetime.now(UTC), origin="test", cameras=(camera,))
    session = Session.create(folder / "S", record)
    for step, (code, time) in enumerate(zip(codes, times, strict=True)):
        file = f"raw/0000/cam0_{step}.png"
        store.write_bytes(session.folder / file, encode_png(code))
        mask = None if masks is None else f"masks/{step}.png"
        if masks is not None:
            store.write_bytes(session.folder / f"masks/{step}.png", encode_png(255 * np.uint8(masks[step])))
        session.append_shot(
            ShotRecord(
                kind="scene", plan="test", camera="cam0", frame=0, step=step, file=file,
                sha256=store.sha256(session.folder / file), width=code.shape[1], height=code.shape[0],
                reported=None if time is None else Exposure(time=time), mask=mask,
            )
        )  # fmt: skip
    return session.folder


def flat(value: int) -> np.ndarray:
    return np.full((40, 60, 3), value, np.uint8)


@pytest.mark.parametrize(
    ("codes", "fix", "bit"),
    [([255, 255], "saturated all over: take shorter ones", CLIPPED), ([0, 0], "take longer ones", DARK)],
    ids=["saturated", "black"],
)
def test_a_bracket_that_shows_nothing_says_what_to_shoot(
    codes: list[int], fix: str, bit: int, rig: Run, tmp_path: Path
) -> None:
    session = bracket(tmp_path, [flat(code) for code in codes], [1.0, 0.25])
    code, _, error = rig("merge", str(session), str(tmp_path / "M"))
    assert code == 3
    assert fix in error
    (file,) = (tmp_path / "M").rglob("*.exr")
    mask = read_exr(file).channels["mask"].astype(int)
    assert (mask & bit == bit).all()


def test_labels_or_a_curve_that_are_wrong_by_two_are_told(rig: Run, tmp_path: Path) -> None:
    light = np.geomspace(0.01, 0.9, 40 * 60).reshape(40, 60, 1).repeat(3, 2)

    def develop(k: float) -> np.ndarray:
        return np.rint(255 * srgb_encode(np.clip(light * k, 0, 1))).astype(np.uint8)

    session = bracket(tmp_path, [develop(1.0), develop(0.25)], [1.0, 0.125])
    code, out, _ = rig("merge", str(session), str(tmp_path / "M"))
    assert code == 0
    assert "labels (there is no calibration)" in out
    assert "do not fit the assumed sRGB curve (by up to 100 %): run `rig calibrate` first" in out
    assert "labels by" not in out


def test_wrong_labels_of_linear_exposures_are_told(rig: Run, tmp_path: Path) -> None:
    light = np.geomspace(0.01, 0.9, 40 * 60).reshape(40, 60)
    (tmp_path / "photos").mkdir()
    for step, (k, time) in enumerate([(1.0, 1.0), (0.25, 0.125), (0.0625, 0.03125)]):
        pixels = np.rint(64 + 4031 * light * k).astype(np.uint16)
        metadata = FrameMetadata(exposure=Exposure(time=time))
        mosaic = RawMosaic(pixels, Cfa.RGGB, ((64.0,),), 4095, metadata=metadata)
        (tmp_path / "photos" / f"{step}.dng").write_bytes(encode_dng(mosaic))
    import_photos(tmp_path / "photos", tmp_path / "S")
    code, out, _ = rig("merge", str(tmp_path / "S"), str(tmp_path / "M"))
    assert code == 0
    assert "its exposures are off their labels by 100 %: run `rig calibrate` first" in out


def masked_bracket(folder: Path) -> tuple[Path, np.ndarray]:
    """Three exposures; somebody stands in the left of the first, and on the right all moves: both masked.

    The light [H, W] that was there without anybody; what is at [:, 200:] is hidden in every exposure.
    """
    rng = np.random.default_rng(0)
    light = np.exp(np.kron(rng.uniform(-4, -1, (12, 24)), np.ones((10, 10))))
    codes, masks = [], []
    for step, k in enumerate((1.0, 0.5, 0.25)):
        hidden_light = light.copy()
        counts = np.ones(light.shape, bool)
        if step == 0:
            hidden_light[20:100, 10:80], counts[20:100, 10:80] = 0.15, False
        hidden_light[:, 200:], counts[:, 200:] = rng.uniform(0, 1, (120, 40)), False
        code = np.rint(
            255 * srgb_encode(np.clip(hidden_light * k + 0.002 * rng.standard_normal(light.shape), 0, 1))
        )
        codes.append(code.astype(np.uint8)[..., None].repeat(3, 2))
        masks.append(counts)
    return bracket(folder, codes, [1.0, 0.5, 0.25], masks), light


def test_what_one_exposure_hides_is_taken_from_the_others(rig: Run, tmp_path: Path) -> None:
    session, light = masked_bracket(tmp_path)
    code, out, _ = rig("merge", str(session), str(tmp_path / "M"), "--exposure", "0", "--json")
    assert code == 0
    (entry,) = json.loads(out)["files"]
    assert entry["ghost"] < 0.01
    assert entry["hidden"] == pytest.approx(40 / 240)
    assert entry["warnings"] == []
    image = read_exr(tmp_path / "M" / "0000" / "cam0.exr")
    mask = image.channels["mask"].astype(int)
    np.testing.assert_array_equal(mask & HIDDEN > 0, np.arange(240)[None].repeat(120, 0) >= 200)
    person = np.s_[20:100, 10:80]
    assert np.median(np.abs(image.channels["G"][person] / light[person] - 1)) < 0.05
    # What nobody is to look at keeps its light, some mean of what it was.
    assert np.isfinite(image.channels["G"]).all()
    assert image.channels["G"][:, 200:].std() > 0.05

    lines = (session / "shots.jsonl").read_text().splitlines()
    bare = [json.loads(line) for line in lines]
    for record in bare:
        del record["mask"]
    (session / "shots.jsonl").write_text("".join(json.dumps(record) + "\n" for record in bare))
    blind = json.loads(rig("merge", str(session), str(tmp_path / "M"), "--json")[1])["files"][0]
    assert not blind["reused"]
    assert blind["ghost"] > 0.1
    assert blind["hidden"] == 0.0
    flags = read_exr(tmp_path / "M" / "0000" / "cam0.exr").channels["mask"].astype(int)
    assert (flags[person] & GHOST > 0).mean() > 0.3


def test_another_mask_makes_another_file(rig: Run, tmp_path: Path) -> None:
    session, _ = masked_bracket(tmp_path)
    asked = ("merge", str(session), str(tmp_path / "M"), "--json")
    first, again = (json.loads(rig(*asked)[1])["files"][0] for _ in range(2))
    assert again == first | {"reused": True}
    for step in range(3):
        store.write_bytes(session / f"masks/{step}.png", encode_png(np.zeros((120, 240), np.uint8)))
    other = json.loads(rig(*asked)[1])["files"][0]
    assert (other["reused"], other["hidden"]) == (False, 1.0)
    (session / "masks/1.png").unlink()
    code, _, error = rig(*asked)
    assert code == 2
    assert "masks/1.png" in error


def test_exposures_without_a_label_are_refused(rig: Run, tmp_path: Path) -> None:
    session = bracket(tmp_path, [flat(100), flat(50)], [None, None])
    code, _, error = rig("merge", str(session), str(tmp_path / "M"))
    assert code == 2
    assert "has no exposure" in error
    assert not (tmp_path / "M").exists()


def test_a_view_that_is_not_there_is_refused(rig: Run, toy: Path, tmp_path: Path) -> None:
    code, _, error = rig("merge", str(toy), str(tmp_path / "M"), "--camera", "cam9", "--frame", "2")
    assert code == 2
    assert "no shot of the scene of camera cam9 at frame 2" in error


def test_a_stale_calibration_is_refused(rig: Run, toy: Path, tmp_path: Path) -> None:
    with (toy / "shots.jsonl").open("a") as file:
        file.write((toy / "shots.jsonl").read_text().splitlines()[0] + "\n")
    code, _, error = rig("merge", str(toy), str(tmp_path / "M"))
    assert code == 2
    assert "older than the shots" in error


def test_a_single_exposure_is_its_own_picture(rig: Run, tmp_path: Path) -> None:
    session, light = bracket(tmp_path, [flat(128)], [0.5]), 0.2159 / Exposure(time=0.5).scale
    code, _, _ = rig("merge", str(session), str(tmp_path / "M"), "--exposure", "0")
    assert code == 0
    (file,) = (tmp_path / "M").rglob("*.exr")
    assert np.median(read_exr(file).rgb()) == pytest.approx(light, rel=1e-3)


def test_pictures_open_at_middle_grey_by_one_stated_factor(rig: Run, toy: Path, tmp_path: Path) -> None:
    whole, part, plain = (
        json.loads(rig("merge", str(toy), str(tmp_path / name), *options, "--json")[1])
        for name, *options in (("W",), ("P", "--frame", "2"), ("L", "--frame", "2", "--exposure", "0"))
    )
    factor = whole["exposure_factor"]
    assert part["exposure_factor"] == factor  # of the session, whatever part of it is merged
    assert json.loads((tmp_path / "P" / "merge.json").read_text())["exposure_factor"] == factor
    assert np.log2(factor) != 0
    images = [read_exr(Path(entry["file"])) for entry in whole["files"]]
    assert {image.attributes["rig:exposureFactor"] for image in images} == {float(np.float32(factor))}
    median = np.median(np.concatenate([image.rgb().ravel() for image in images]))
    assert abs(np.log2(median / 0.18)) < 0.75
    for entry in plain["files"]:
        light = read_exr(Path(entry["file"]))
        exposed = read_exr(tmp_path / "W" / f"{entry['frame']:04d}" / f"{entry['camera']}.exr")
        for name in ("R", "G", "B", "sigma.R", "sigma.G", "sigma.B"):
            np.testing.assert_allclose(exposed.channels[name] / factor, light.channels[name], rtol=1e-6)
        assert np.array_equal(exposed.channels["mask"], light.channels["mask"])
        assert "whiteLuminance" not in exposed.attributes


def test_a_scale_of_light_makes_the_values_absolute(rig: Run, toy: Path, tmp_path: Path) -> None:
    truth = read_exr(toy / "truth" / "0000" / "cam1.exr").rgb()[1:13, 48:60] @ np.array(LUMINANCE)
    args = ("calibrate", str(toy), "--only", "luminance", "--luminance")
    code, out, _ = rig(*args, f"0000/cam1:48,1,12,12={100 * truth.mean()},+-3%")
    assert code == 0
    assert "light of 1 is " in out
    assert "luminance" in rig("explain", str(toy))[1]
    page = (toy / "calibration" / "report.html").read_text()
    assert "Scale of light" in page
    code, out, _ = rig("merge", str(toy), str(tmp_path / "M"), "--frame", "0")
    assert code == 0
    assert "a value of 1 is" in out
    image = read_exr(tmp_path / "M" / "0000" / "cam1.exr")
    luminance = image.attributes["whiteLuminance"] * np.median(image.rgb()[1:13, 48:60] @ np.array(LUMINANCE))
    assert luminance == pytest.approx(100 * np.median(truth), rel=0.1)
    assert image.attributes["rig:whiteLuminanceError"] > 0.03 * image.attributes["whiteLuminance"]
    # Nobody has compared the other camera with this one.
    assert "whiteLuminance" not in read_exr(tmp_path / "M" / "0000" / "cam0.exr").attributes


def test_a_session_without_exposures_elsewhere_still_merges_what_has_them(rig: Run, tmp_path: Path) -> None:
    session = bracket(tmp_path, [flat(128)], [0.5])
    opened = Session.open(session)
    (shot,) = opened.shots()
    for step in range(2):
        blank = {"frame": 1, "step": step, "reported": None}
        opened.append_shot(ShotRecord.model_validate(shot.model_dump() | blank))
    code, out, _ = rig("merge", str(session), str(tmp_path / "M"), "--frame", "0", "--json")
    assert code == 0
    assert json.loads(out)["exposure_factor"] == pytest.approx(Exposure(time=0.5).scale)  # as it was shot
