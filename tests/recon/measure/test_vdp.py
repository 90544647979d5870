"""ColorVideoVDP in an evaluation: what its authors' package says of the same pictures."""

import sys
from collections.abc import Iterator
from types import ModuleType
from unittest.mock import MagicMock

import numpy as np
import pytest
import torch
from torch.nn.functional import conv2d, pad

from recon.measure import vdp
from recon.measure.flip import LightPair, Pair
from tests.foreign_viewers.viewers import MODULES

PACKAGE = MODULES.parent / "cvvdp"
UNUSED = "einops", "einops.layers", "einops.layers.torch", "ffmpeg", "huggingface_hub", "torchvision.ops"


class GaussianBlur:
    """That of torchvision, of a kernel of `size` px, mirrored at the borders."""

    def __init__(self, size: int, sigma: float) -> None:
        bell = torch.exp(-0.5 * (torch.linspace(-(size - 1) / 2, (size - 1) / 2, size) / sigma) ** 2)
        self.bell, self.border = bell / bell.sum(), size // 2

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Blur planes [N, 1, H, W]."""
        wide = pad(image, [self.border] * 4, mode="reflect")
        return conv2d(conv2d(wide, self.bell[None, None, None]), self.bell[None, None, :, None])


@pytest.fixture(scope="module", autouse=True)
def _package() -> Iterator[None]:
    """The package without what pictures need not: of torchvision, built for GPUs, it uses a blur."""
    if not PACKAGE.is_dir():
        pytest.skip(f"{PACKAGE} is not there: see .ci/run")
    torchvision, transforms = ModuleType("torchvision"), ModuleType("torchvision.transforms")
    transforms.GaussianBlur = GaussianBlur  # type: ignore[attr-defined]
    modules = {"torchvision": torchvision, "torchvision.transforms": transforms}
    before = set(sys.modules)
    with pytest.MonkeyPatch.context() as patch:
        for name, module in (modules | {name: MagicMock() for name in UNUSED}).items():
            patch.setitem(sys.modules, name, module)
        patch.setattr(sys, "path", [*sys.path, str(PACKAGE)])
        forget()
        yield
        forget()
    for name in set(sys.modules) - before:
        if name.partition(".")[0] in ("pycvvdp", "third_party", "interp"):
            del sys.modules[name]


def forget() -> None:
    """Look for the package anew."""
    vdp._metric.cache_clear()
    vdp._package.cache_clear()


def made(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    truth = np.kron(rng.uniform(0.1, 0.9, (10, 12, 3)), np.ones((16, 16, 1)))
    return truth, np.clip(truth + rng.normal(0, 0.05, truth.shape), 0, 1)


def test_pictures_and_light_have_the_jod_of_the_package() -> None:
    import pycvvdp

    truth, noisy = made()
    codes = [np.rint(255 * side).astype(np.uint8) for side in (noisy, truth)]
    everywhere = np.ones(truth.shape[:2], bool)
    light = LightPair((400 * noisy).astype(np.float32), (400 * truth).astype(np.float32), everywhere, 2.0)
    values = vdp.Vdp(1, np.inf).of([Pair("a", *codes, everywhere)], light)
    sdr = pycvvdp.cvvdp(display_name="standard_4k", quiet=True, device=torch.device("cpu"))
    assert values["vdp_jod"] == pytest.approx(float(sdr.predict(*codes, dim_order="HWC")[0]), abs=1e-5)
    hdr = pycvvdp.cvvdp(display_name="standard_hdr_linear", quiet=True, device=torch.device("cpu"))
    in_nits = [np.float32(800) * side.astype(np.float32) for side in (noisy, truth)]
    assert values["hdr_vdp_jod"] == pytest.approx(float(hdr.predict(*in_nits, dim_order="HWC")[0]), abs=1e-3)
    assert 5 < values["vdp_jod"] < 9.9


def test_what_is_alike_or_masked_is_not_seen() -> None:
    truth, noisy = made()
    half = np.zeros(truth.shape[:2], bool)
    half[:80] = True
    noisy[:80] = truth[:80]
    noisy[80:] = np.nan
    values = vdp.Vdp(1, np.inf).of(
        [], LightPair(noisy.astype(np.float32), truth.astype(np.float32), half, 100.0)
    )
    assert values == {"hdr_vdp_jod": pytest.approx(10.0, abs=1e-4)}


def test_light_above_the_peak_of_the_screen_is_not_told_apart() -> None:
    truth, _ = made()
    bright = (1e5 * (1 + truth)).astype(np.float32)
    everywhere = np.ones(truth.shape[:2], bool)
    values = vdp.Vdp(1, np.inf).of([], LightPair(2 * bright, bright, everywhere, 1.0))
    assert values["hdr_vdp_jod"] == pytest.approx(10.0, abs=1e-4)


def test_white_is_that_of_hdr_video_where_the_scale_is_not_known() -> None:
    assert vdp.nits(0.5, None) == 101.5
    assert vdp.nits(0.5, (250.0, 3.0)) == 250.0


def test_no_time_is_said() -> None:
    truth, noisy = made()
    codes = [np.rint(255 * side).astype(np.uint8) for side in (noisy, truth)]
    visible = vdp.Vdp(4, 10.0, clock=iter([0.0, 0.0, 9.0, 11.0, 11.0, 11.0, 11.0, 11.0]).__next__)
    for _ in range(4):
        visible.of([Pair("a", *codes, np.ones(truth.shape[:2], bool))], None)
    assert visible.left_out() == ["ColorVideoVDP of 1"]


def test_a_picture_too_narrow_for_contrast_has_no_figure() -> None:
    light = LightPair(
        np.ones((40, 7, 3), np.float32), np.ones((40, 7, 3), np.float32), np.ones((40, 7), bool), 1
    )
    codes = np.zeros((7, 40, 3), np.uint8)
    assert vdp.Vdp(1, np.inf).of([Pair("a", codes, codes, np.ones((7, 40), bool))], light) == {}


def test_a_dark_picture_is_no_warning(caplog: pytest.LogCaptureFixture) -> None:
    black = np.zeros((64, 64, 3), np.float32)
    light = LightPair(black, black, np.ones((64, 64), bool), 1.0)
    assert vdp.Vdp(1, np.inf).of([], light) == {"hdr_vdp_jod": pytest.approx(10.0, abs=1e-4)}
    assert caplog.records == []


def test_without_the_package_there_is_no_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, noisy = made()
    monkeypatch.setitem(sys.modules, "pycvvdp", None)
    forget()
    light = LightPair(noisy.astype(np.float32), truth.astype(np.float32), np.ones(truth.shape[:2], bool), 1.0)
    assert vdp.Vdp(1, np.inf).of([], light) == {}
    assert vdp.trouble() is None
    forget()


def test_a_package_that_does_not_start_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    assert vdp.trouble() is None
    for name in [name for name in sys.modules if name.partition(".")[0] == "pycvvdp"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torchvision.transforms", None)
    forget()
    assert vdp._metric(vdp.SCREEN) is None
    assert "is installed but does not start (" in (vdp.trouble() or "")
    assert "torchvision.transforms" in (vdp.trouble() or "")
    forget()
