"""Appearances: what they start from, what they show, and their gradients."""

import numpy as np
import pytest
import torch

from recon.scene.appearance import LuminanceChromaticity, PlainHarmonics, Rate
from recon.scene.harmonics import COEFFICIENTS, DEGREE, basis, series, series_by_torch, sphere

ALL = [LuminanceChromaticity(), PlainHarmonics()]
DIRECTIONS = torch.nn.functional.normalize(
    torch.tensor([[1.0, 2.0, 3.0], [-1.0, 0.5, 0.2], [0.0, 0.0, -1.0], [0.3, -0.9, 0.1]]), dim=1
)
RGB = torch.tensor([[0.5, 0.3, 0.2], [0.02, 0.03, 0.04], [12.0, 14.0, 9.0], [0.7, 0.7, 0.7]])


@pytest.mark.parametrize("appearance", ALL, ids=lambda a: type(a).__name__)
@pytest.mark.parametrize("degree", [0, 1, 2])
def test_starts_with_the_colours_it_was_given(appearance, degree):
    parameters = appearance.start(RGB)
    assert set(parameters) == set(appearance.rates)
    shown = appearance.colours(parameters, DIRECTIONS, degree)
    np.testing.assert_allclose(shown, RGB, rtol=2e-4, atol=1e-6)


@pytest.mark.parametrize("appearance", ALL, ids=lambda a: type(a).__name__)
def test_black_is_finite_and_not_negative(appearance):
    parameters = appearance.start(torch.zeros(4, 3))
    shown = appearance.colours(parameters, DIRECTIONS, 2)
    assert torch.isfinite(shown).all()
    assert (shown >= 0).all()
    assert shown.max() < 1e-4
    assert torch.isfinite(appearance.luminance(parameters)).all()


@pytest.mark.parametrize("appearance", ALL, ids=lambda a: type(a).__name__)
def test_gradients_are_finite_differences(appearance):
    generator = torch.Generator().manual_seed(3)
    parameters = {
        name: (value.double() + 0.05 * torch.randn(value.shape, generator=generator).double()).requires_grad_(
            True
        )
        for name, value in appearance.start(RGB).items()
    }
    directions = DIRECTIONS.double()

    def loss(values):
        return (appearance.colours(values, directions, 2) * torch.arange(1.0, 13.0).reshape(4, 3)).sum()

    loss(parameters).backward()
    for name, value in parameters.items():
        step = torch.randn(value.shape, generator=generator).double() * 1e-6
        with torch.no_grad():
            moved = [{**parameters, name: value + sign * step} for sign in (1, -1)]
            difference = float(loss(moved[0]) - loss(moved[1])) / 2
        assert float((value.grad * step).sum()) == pytest.approx(difference, rel=1e-4, abs=1e-12)


def test_luminance_scales_all_channels_and_all_directions_alike():
    appearance = LuminanceChromaticity()
    parameters = appearance.start(RGB)
    parameters["chroma_rest"] = 0.3 * torch.randn(
        4, COEFFICIENTS - 1, 3, generator=torch.Generator().manual_seed(1)
    )
    before = appearance.colours(parameters, DIRECTIONS, 2)
    parameters["ln_luminance"] = parameters["ln_luminance"] + np.log(8.0)
    np.testing.assert_allclose(appearance.colours(parameters, DIRECTIONS, 2), 8 * before, rtol=1e-5)


def test_luminance_beyond_the_span_keeps_its_gradient():
    appearance = LuminanceChromaticity(stops=17)
    parameters = appearance.start(torch.ones(5, 3))
    parameters["ln_luminance"] = torch.tensor([0.0, 0.0, 0.0, 0.0, 100.0], requires_grad=True)
    shown = appearance.colours(parameters, DIRECTIONS[:1].expand(5, 3), 0)
    assert shown[4].max() <= 2.0**17
    shown[4].sum().backward()
    assert parameters["ln_luminance"].grad[4] > 0


def test_the_penalty_pulls_only_the_gauge():
    appearance = LuminanceChromaticity(pull=1.0)
    parameters = appearance.start(RGB)
    assert float(appearance.penalty(parameters)) == pytest.approx(0, abs=1e-9)
    # (L, f) -> (k L, f / k) shows the same; the penalty tells the two apart.
    other = appearance.start(RGB)
    other["ln_luminance"] = other["ln_luminance"] - np.log(0.5)
    half = 0.5 * RGB / (RGB.amax(1, keepdim=True) / 0.8)
    other["chroma_dc"] = (torch.logit(half) / 0.28209479177387814)[:, None]
    np.testing.assert_allclose(appearance.colours(other, DIRECTIONS, 0), RGB, rtol=1e-4)
    assert float(appearance.penalty(other)) > 0.1


def test_harmonics_are_orthonormal_on_the_sphere():
    directions = torch.from_numpy(sphere(4000))
    values = basis(directions, DEGREE)
    gram = 4 * np.pi / len(directions) * (values.T @ values)
    np.testing.assert_allclose(gram, np.eye(COEFFICIENTS), atol=2e-3)


def test_rates_fall_exponentially():
    rate = Rate(1e-2, 1e-4)
    assert [rate.at(p) for p in (0.0, 0.5, 1.0)] == pytest.approx([1e-2, 1e-3, 1e-4])


@pytest.mark.parametrize("degree", [1, 2])
def test_a_series_is_the_same_by_plain_operations(degree: int) -> None:
    """Compare the path of a GPU with the kernel: value and gradients."""
    rng = np.random.default_rng(3)
    directions = torch.tensor(sphere(20))
    results = []
    for function in (series, series_by_torch):
        constant = torch.tensor(rng.normal(size=(20, 1, 3)), requires_grad=True)
        rest = torch.tensor(rng.normal(size=(20, COEFFICIENTS - 1, 3)), requires_grad=True)
        value = function(constant, rest, directions, degree)
        (value * torch.tensor(rng.normal(size=(20, 3)))).sum().backward()
        results.append((value.detach(), constant.grad, rest.grad))
        rng = np.random.default_rng(3)
    for ours, theirs in zip(*results, strict=True):
        torch.testing.assert_close(ours, theirs)
