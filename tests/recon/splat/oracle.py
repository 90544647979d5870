"""How closely the kernels have to follow the dense float64 oracle."""

import torch

from recon.splat import Render, SplatCamera, SplatStats


def same_image(render: Render, expected: Render, camera: SplatCamera) -> None:
    image, truth = render.image.detach().cpu().double(), expected.image.detach()
    error = ((image - truth).abs() / (truth.abs() + 1e-6 * truth.abs().max() + 1e-30)).flatten()
    # A pixel at the very edge of a Gaussian may fall on either side of a cut-off; hence no maximum.
    assert error.mean() < 1e-5
    assert torch.quantile(error, 0.99) < 1e-5
    assert (render.alpha.cpu().double() - expected.alpha).abs().mean() < 1e-6
    assert render.culled == expected.culled == 0
    assert render.visible >= expected.visible
    blocks = -(-camera.width // 8) * -(-camera.height // 8)
    assert 64 * expected.visible <= render.pairs <= 64 * blocks * render.visible


def same_gradient(ours: torch.Tensor | None, theirs: torch.Tensor | None, what: str, bound: float) -> None:
    assert ours is not None, what
    assert torch.isfinite(ours).all(), what
    if theirs is None or not theirs.any():
        assert not ours.any(), what
        return
    error = (ours.double() - theirs).abs()
    assert error.norm() < bound * theirs.norm(), what
    assert error.median() < 1e-5 * theirs.abs().mean(), what


def same_statistics(ours: SplatStats, theirs: SplatStats, bound: float) -> None:
    for what in ("tension", "radius", "weight"):
        a, b = getattr(ours, what).cpu(), getattr(theirs, what)
        assert (a - b).norm() <= bound * b.norm(), what
