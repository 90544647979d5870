"""`rig bench hdr-pretrain` on the painted wall in five exposures."""

import json

import pytest

from imaging.session.session import Session
from recon.decide.presets import QUALITIES, Quality
from tests.rig.benchmarks.hdr_pretrain_scene import hdr_pretrain_scene


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    monkeypatch.setitem(QUALITIES, "draft", Quality(iterations=80, gaussians=300, width=64))


def test_brackets_are_measured_against_their_own_exposures_and_the_true_light(rig, tmp_path):
    hdr_pretrain_scene(tmp_path / "HDR-Pretrain" / "scenes" / "102343992")
    data, place = tmp_path / "HDR-Pretrain" / "scenes", tmp_path / "out"
    arguments = ("bench", "hdr-pretrain", str(data), "--out", str(place), "--quality", "draft")
    code, out, err = rig(*arguments, "--json")
    assert (code, err) == (0, "")
    figures = json.loads(out)["scenes"]["102343992"]
    assert figures["ldr_psnr_oe"] > 25
    assert figures["hdr_psnr_p99"] > 25
    assert 0.8 < figures["hdr_ssim_p99"] <= 1
    assert figures["stops_median"] < 0.2
    split = Session.open(place / "102343992" / "session").split()
    assert (len(split.train), len(split.test)) == (30, 15)
    code, out, _ = rig(*arguments)
    assert code == 0
    assert "HDR dB" in out
    assert "No figures stand beside" in " ".join(out.split())
