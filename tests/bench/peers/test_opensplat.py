"""OpenSplat as a peer: its program, its schedule, and the run that takes a budget."""

from dataclasses import replace

import numpy as np
import pytest

from bench.peers import opensplat


def test_a_source_is_of_its_release(tmp_path, monkeypatch):
    commands = []
    monkeypatch.setattr(opensplat, "_run", commands.append)
    (tmp_path / "source").mkdir()
    for release in ("v1.2.0", "v1.3.0"):
        monkeypatch.setattr(opensplat, "RELEASE", release)
        opensplat.built(tmp_path)
        clone, configure, _ = commands[-3:]
        assert clone[:2] == ["git", "clone"]
        assert release in clone
        source = clone[-1]
        assert configure[configure.index("-S") + 1] == source
        (tmp_path / source).mkdir()


@pytest.mark.parametrize("variant", opensplat.VARIANTS, ids=lambda variant: variant.name)
def test_a_run_grows_four_times_or_as_often_as_its_length_allows(variant):
    """Count as model.cpp of 1.2.0 does: multiples of refine-every, from and until being left out."""
    for iterations in range(30, 7000):
        options = opensplat.schedule(variant, iterations)
        since, until = options["densify-from"], options["densify-until"]
        growths = [step for step in range(0, until, options["refine-every"]) if step > since]
        possible = len(range(opensplat.NO_GROWTH + 1, until))
        assert len(growths) == max(min(4, possible), (until - 1) // 500 - 1)
        assert min(growths, default=17) > opensplat.NO_GROWTH
    whole = opensplat.schedule(variant, 30_000)
    assert whole["densify-from"] == whole["refine-every"] == 500


def test_a_run_is_found_that_takes_the_budget(tmp_path, monkeypatch):
    """Try a program whose pace falls as its scene grows."""
    tried = []

    def iterated(program, folder, iterations, variant, ply, most):
        tried.append(iterations)
        spent = 3 + 0.05 * np.arange(1, iterations + 1) + 1e-4 * np.arange(1, iterations + 1) ** 2
        reached = int((spent <= most).sum())
        if reached == iterations:
            ply.write_bytes(b"%d" % iterations)
        return min(spent[-1], most), reached

    monkeypatch.setattr(opensplat, "_iterated", iterated)
    run = opensplat.trained(tmp_path, tmp_path, 60.0, opensplat.VARIANTS[0], tmp_path / "runs")
    assert abs(run.seconds / 60 - 1) < opensplat.CLOSE
    assert run.ply.read_bytes() == b"%d" % run.iterations
    before = len(tried)
    assert opensplat.trained(tmp_path, tmp_path, 60.0, opensplat.VARIANTS[0], tmp_path / "runs") == run
    assert len(tried) == before
    # Another schedule is another run.
    longer = replace(opensplat.VARIANTS[0], growing=1.0)
    opensplat.trained(tmp_path, tmp_path, 60.0, longer, tmp_path / "runs")
    assert len(tried) > before
