"""The forecast of memory: beside what a data set holds, and what it refuses."""

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imaging.errors import InputError
from imaging.files import store
from recon.data.load import load
from recon.data.measured_depth import DepthMapFile
from recon.decide.cost.memory_need import KERNELS, Need, fitting, need
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest

LIMITED = """
import resource, sys
from pathlib import Path
import recon.reconstruct as stage
from imaging.errors import InputError
from imaging.files import store
from recon.decide.request import TrainingRequest
size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (size + (64 << 20),) * 2)
try:
    stage.reconstruct(sys.argv[1], TrainingRequest(quality="draft"))
except InputError as error:
    print(error)
"""


def test_the_views_that_are_to_come_are_counted_before_they_are_read(toy_ldr: Path) -> None:
    examined = []
    dataset = load(toy_ldr, examine=lambda firsts, counts: examined.append((list(firsts), counts)))
    ((_, counts),) = examined
    assert [view.name for view in dataset.views] == sorted(view.name for view in dataset.views)
    assert sum(total for total, _ in counts.values()) == len(dataset.views)
    assert sum(train for _, train in counts.values()) == len(dataset.train)


def test_a_view_of_one_shot_takes_its_planes_and_its_light(toy_ldr: Path) -> None:
    view = load(toy_ldr).train[0]
    view = replace(view, shots=view.shots[:1])
    shot = view.shots[0]
    planes = (shot.pixels, shot.saturated, shot.dark, shot.valid)
    held = sum(plane.nbytes for plane in planes if any(plane.strides))
    few, many = (need([view], {view.camera: (count, count)}, 1, 0).images for count in (1000, 1001))
    # Radiance of three channels, a mask, and twice a plane for the percentile of them all.
    assert many - few == held + 64 * 48 * (12 + 1 + 8)


def test_a_depth_map_takes_a_float_and_a_mask_of_each_view_that_trains(toy_ldr: Path) -> None:
    bare = load(toy_ldr).train[0]
    deep = replace(bare, depth=DepthMapFile(Path("depths/0000/cam0_0.png"), 1.0))
    taken = [
        [need([view], {view.camera: (count, count)}, 1, 0).images for count in (1000, 1001)]
        for view in (bare, deep)
    ]
    assert (taken[1][1] - taken[1][0]) - (taken[0][1] - taken[0][0]) == 64 * 48 * 5


def test_exposures_left_out_by_hand_are_read_and_not_compared_with(toy_ldr: Path) -> None:
    view = load(toy_ldr).train[0]
    request = TrainingRequest(overrides=Overrides(exposures=2))
    few, many = (
        fitting([view], {view.camera: (count, count)}, 10**12, request)[0].images for count in (1000, 1001)
    )
    planes = [(shot.pixels, shot.saturated, shot.dark, shot.valid) for shot in view.shots]
    sizes = [sum(plane.nbytes for plane in of_shot if any(plane.strides)) for of_shot in planes]
    # The first and the last have targets as large as they are, and a weight of three channels.
    assert many - few == sum(sizes) + sizes[0] + sizes[-1] + 64 * 48 * 12


def test_gaussians_take_their_numbers_four_times_and_tables(toy_ldr: Path) -> None:
    view = load(toy_ldr).train[0]
    one, many = (need([view], {view.camera: (1, 1)}, count, 2).gaussians for count in (1000, 3000))
    assert many == 3 * one
    assert one / 1000 == pytest.approx(4 * 4 * (3 + 3 + 4 + 1 + 27) + 1220, rel=0.1)


WHOLE = Need(process=5 * 10**8, images=2 * 10**9, gaussians=10**8, width=640, count=100_000)


def test_what_fits_is_not_refused_and_a_byte_more_is() -> None:
    WHOLE.require("S", WHOLE.images + WHOLE.gaussians + KERNELS)
    with pytest.raises(InputError):
        WHOLE.require("S", WHOLE.images + WHOLE.gaussians + KERNELS - 1)


@pytest.mark.parametrize("free", [4 * 10**8, 10**9, 2 * 10**9])
def test_images_that_do_not_fit_are_refused_with_a_width_that_does(free: int) -> None:
    with pytest.raises(InputError) as refusal:
        WHOLE.require("S", free)
    width = int(re.findall(r"--set width=(\d+)", str(refusal.value))[0])
    replace(WHOLE, images=int(WHOLE.images * (width / 640) ** 2), width=width).require("S", free)


def test_only_what_takes_more_than_a_quarter_of_the_memory_is_worth_a_line() -> None:
    most = 4 * (WHOLE.images + WHOLE.gaussians)
    assert WHOLE.worth_saying(most - 1)
    assert not WHOLE.worth_saying(most)


def test_what_is_in_memory_already_needs_no_room() -> None:
    held = replace(WHOLE, held=15 * 10**8)
    held.require("S", WHOLE.images + WHOLE.gaussians + KERNELS - 15 * 10**8)
    with pytest.raises(InputError):
        held.require("S", WHOLE.images + WHOLE.gaussians + KERNELS - 15 * 10**8 - 1)


def test_a_rig_that_took_one_frame_is_examined_too(toy_ldr: Path, tmp_path: Path) -> None:
    """Each camera has one view."""
    session = shutil.copytree(toy_ldr, tmp_path / "session")
    path = session / "calibration" / "calibration.json"
    record = store.read_json(path)
    record["views"] = [view for view in record["views"] if view["frame"] == 0]
    store.write_json(path, record)
    examined = []
    dataset = load(session, examine=lambda firsts, counts: examined.append((len(firsts), counts)))
    assert examined == [(len(dataset.views), dict.fromkeys(("cam0", "cam1"), (1, 1)))]


def test_gaussians_that_do_not_fit_are_refused_with_a_number_that_does() -> None:
    many = replace(WHOLE, gaussians=10**10, count=10**7)
    with pytest.raises(InputError) as refusal:
        many.require("S", 8 * 10**9)
    count = int(re.findall(r"--set gaussians=(\d+)", str(refusal.value))[0])
    assert count >= 10**7 / 4
    replace(many, gaussians=1000 * count, count=count).require("S", 8 * 10**9)


def test_without_room_for_anything_only_a_larger_machine_is_named() -> None:
    with pytest.raises(InputError, match="use a machine with more memory"):
        WHOLE.require("S", 10**6)


@pytest.mark.skipif(sys.platform != "linux", reason="address space is limited on Linux")
def test_under_a_limit_of_the_address_space_a_training_refuses_in_a_sentence(toy_ldr: Path) -> None:
    words = [sys.executable, "-c", LIMITED, str(toy_ldr)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"Training on .* takes .* of memory where .* are free: .*\.\n", done.stdout)


def test_masks_alike_everywhere_count_nothing(toy_ldr: Path) -> None:
    view = load(toy_ldr).train[0]
    counts = {view.camera: (1, 0)}
    never = np.broadcast_to(np.False_, view.shots[0].dark.shape)
    bare = replace(view, shots=tuple(shot.showing(dark=never, saturated=never) for shot in view.shots))
    masks = sum(p.nbytes for shot in view.shots for p in (shot.dark, shot.saturated) if any(p.strides))
    assert masks > 0
    fewer = need([view], counts, 1, 0).images - need([bare], counts, 1, 0).images
    assert fewer == masks


def test_images_on_the_disk_take_the_memory_of_one_view_however_many_there_are(toy_ldr: Path) -> None:
    view = load(toy_ldr).train[0]
    few, many = (need([view], {view.camera: (count, count)}, 1, 0, stored=True) for count in (10, 1000))
    held = need([view], {view.camera: (10, 10)}, 1, 0)
    assert few.images == many.images < held.images


@pytest.mark.parametrize(("free", "stored"), [(10**10, False), (39 * 10**8, True), (2 * 10**9, True)])
def test_images_go_to_the_disk_where_they_would_take_half_of_the_memory(free: int, stored: bool) -> None:
    assert WHOLE.too_large(free) == stored


def test_images_go_to_the_disk_where_gaussians_need_their_place() -> None:
    many = replace(WHOLE, gaussians=8 * 10**9)
    assert many.too_large(9 * 10**9)
    assert not many.too_large(11 * 10**9)
