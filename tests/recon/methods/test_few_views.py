"""One view and two: what they show is right, or they are refused."""

import shutil

import pytest

from imaging.errors import ReconstructionError
from imaging.files import store


def first_views(session, folder, count):
    """The session with only its first views placed."""
    shutil.copytree(session, folder, ignore=shutil.ignore_patterns("reconstructions"))
    path = folder / "calibration" / "calibration.json"
    record = store.read_json(path)
    record["views"] = record["views"][:count]
    store.write_json(path, record)
    return folder


@pytest.mark.parametrize(
    ("count", "name", "method"),
    [(1, "toy", "nh-3dgs"), (1, "toy-ldr", "hdr-gs"), (2, "toy", "vanilla"), (2, "toy-ldr", "hdr-gs")],
)
def test_views_that_have_points(studio, train, tmp_path, count, name, method):
    outcome = train(first_views(studio.session(name, width=48, height=36), tmp_path / "few", count), method)
    assert len(outcome.scene.dataset.train) == count
    assert not outcome.scene.dataset.held_out
    words = "1 view is too few" if count == 1 else "2 views are too few"
    assert outcome.metrics["held_out_note"] == f"{words} to hold one out: take 4 or more."
    assert outcome.stops() < (0.9 if count == 1 else 0.45)


def test_one_view_that_no_point_was_found_in(studio, train):
    """Two views make a point."""
    with pytest.raises(ReconstructionError, match=r"has 0 scene points .*: take images that overlap more"):
        train(studio.session("toy", cameras=1, positions=1))
