"""The halo of veiling glare against a sum in float64, its gradients, and where it does nothing."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from recon.data.light import radiance_image
from recon.observe.glare import RADIUS, scattered, spread
from recon.observe.linear import LinearLight


def summed(image: np.ndarray) -> np.ndarray:
    """The halo of every pixel by the definition."""
    height, width = image.shape[:2]
    y, x = np.ogrid[1 - height : height, 1 - width : width]
    # Of every distance down and across that there is, none in the middle.
    weights = 1 / (1 + (y**2 + x**2) / (height**2 + width**2) / RADIUS**2)
    blurred = np.empty_like(image)
    for row in range(height):
        for column in range(width):
            weight = weights[height - 1 - row :, width - 1 - column :][:height, :width]
            blurred[row, column] = np.tensordot(weight, image, 2) / weight.sum()
    return blurred


def lamps(height: int, width: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    return torch.rand(height, width, 2, generator=generator, dtype=torch.float64) ** 12


def test_a_small_picture_is_that_of_the_sum():
    image = lamps(24, 31)
    torch.testing.assert_close(spread(image), torch.from_numpy(summed(image.numpy())), rtol=1e-9, atol=0)
    near = spread(image.float()).double()
    torch.testing.assert_close(near, torch.from_numpy(summed(image.numpy())), rtol=1e-4, atol=0)


def test_a_large_one_is_near_it():
    """Reckoned in cells of 2 px, half the radius of the halo."""
    image = lamps(120, 160)
    exact = summed(image.numpy())
    assert np.median(np.abs(spread(image).numpy() / exact - 1)) < 0.02


def test_gradients_are_those_of_finite_differences():
    image = lamps(9, 7).requires_grad_(True)
    share = torch.tensor(0.03, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(scattered, (image, share))


def test_even_light_stays_and_nothing_is_scattered_by_nothing():
    even = torch.full((240, 320, 3), 0.25)
    torch.testing.assert_close(scattered(even, 0.1), even)
    image = lamps(24, 31)
    assert scattered(image, 0.0) is image


def test_a_sensor_behind_it_sees_what_is_scattered(toy_dataset):
    view = toy_dataset.train[0]
    light = torch.from_numpy(radiance_image(view)[0])
    veiled = replace(view, frame=90, sensor=replace(view.sensor, glare=0.05))
    observation, k = LinearLight(1.0), view.shots[-1].k
    expected = observation.predict(scattered(light, 0.05), view, k)
    torch.testing.assert_close(observation.predict(light, veiled, k), expected)
    torch.testing.assert_close(
        observation.compare(light, veiled, 1.0)[0], observation.compare(scattered(light, 0.05), view, 1.0)[0]
    )
    assert float((observation.predict(light, view, k) - expected).abs().max()) == pytest.approx(
        float((observation.predict(light - scattered(light, 0.05), view, k)).abs().max()), rel=1e-3
    )
