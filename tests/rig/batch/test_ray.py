"""A command on a Ray cluster: the same words, the same end."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rig.batch.processes import RayWorkers

pytest.importorskip("ray")


@pytest.fixture(scope="module")
def cluster() -> Iterator[RayWorkers]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parents[3]), *filter(None, sys.path)]))
        pool = RayWorkers("local", cores=1, memory=100_000_000)
        try:
            yield pool
        finally:
            pool.close()


def test_commands_end_as_they_do_here(cluster: RayWorkers, tmp_path: Path) -> None:
    good, bad = cluster.submit(["cameras", "--sim", "toy"]), cluster.submit(["check", str(tmp_path / "none")])
    assert [camera["identity"]["serial"] for camera in good.result().data["cameras"]] == [
        "SIM-RAW-001",
        "SIM-RAW-002",
    ]
    assert (good.result().code, bad.result().code) == (0, 2)
    assert str(tmp_path / "none") in bad.result().says
