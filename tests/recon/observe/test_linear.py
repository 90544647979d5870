"""Observation models against the formula written out pixel by pixel."""

import numpy as np
import pytest
import torch

from bench.recon.methods import OneMuLaw
from imaging.metrics import mu_law
from imaging.sensor.cfa import BAYER, Cfa
from imaging.session.calibration import Response
from recon.data.dataset import Sensor, View
from recon.data.shot import HeldPlanes, Shot
from recon.observe.linear import LIGHT_MU, SIGNAL_MU, LinearLight, colour_filters, join, split, through_filter
from recon.observe.photographs import Display
from recon.splat import SplatCamera
from tests.recon.launches import Launches

HEIGHT, WIDTH = 6, 8
MATRIX = np.array([[0.7, 0.2, -0.05], [0.1, 0.8, 0.1], [-0.02, 0.3, 0.9]])


def make_view(cfa: Cfa | None, shots: tuple[Shot, ...], kind="raw") -> View:
    rng = np.random.default_rng(1)
    return View(
        camera="cam",
        frame=0,
        lens=SplatCamera(np.eye(4), 10.0, 10.0, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT),
        sensor=Sensor(
            kind=kind,
            cfa=cfa,
            camera_from_rec709=MATRIX,
            falloff=rng.uniform(0.6, 1.1, (HEIGHT, WIDTH)).astype(np.float32),
            response=Response(kind="linear", evidence="test"),
        ),
        shots=shots,
    )


def make_shot(k: float, pixels: np.ndarray, saturated=None, valid=None) -> Shot:
    none = np.zeros(pixels.shape, bool)
    return Shot(
        "file",
        k,
        HeldPlanes(
            pixels.astype(np.float32),
            none if saturated is None else saturated,
            none,
            ~none if valid is None else valid,
        ),
    )


def direct(image: np.ndarray, view: View, scale: float) -> np.ndarray:
    """x = V gain (M L)_channel k, one photosite at a time."""
    signal = np.zeros((HEIGHT, WIDTH))
    for row in range(HEIGHT):
        for column in range(WIDTH):
            channel = "RGB".index(view.sensor.cfa.rows[row % 2][column % 2])
            light = sum(MATRIX[channel, c] * image[row, column, c] for c in range(3))
            signal[row, column] = view.sensor.falloff[row, column] * light * scale
    return signal


@pytest.mark.parametrize("cfa", BAYER)
def test_mosaic_of_every_phase_is_the_direct_formula(cfa):
    image = np.random.default_rng(2).uniform(0, 3, (HEIGHT, WIDTH, 3))
    view = make_view(cfa, ())
    predicted = LinearLight(normaliser=5.0).predict(torch.from_numpy(image), view, k=0.02)
    np.testing.assert_allclose(predicted.numpy(), direct(image, view, 5.0 * 0.02), rtol=1e-6)


@pytest.mark.parametrize("cfa", BAYER)
def test_comparison_holds_every_exposure_in_its_own_mu_law(cfa):
    rng = np.random.default_rng(3)
    image = rng.uniform(0, 1, (HEIGHT, WIDTH, 3)).astype(np.float32)
    shots = tuple(make_shot(k, rng.uniform(-0.01, 0.9, (HEIGHT, WIDTH))) for k in (0.01, 0.2))
    view = make_view(cfa, shots)
    prediction, target = LinearLight(normaliser=2.0).compare(torch.from_numpy(image), view, 0.5)
    for index, shot in enumerate(shots):
        planes = slice(4 * index, 4 * index + 4)
        expected = mu_law(direct(image.astype(float), view, 2.0 * shot.k), mu=SIGNAL_MU)
        np.testing.assert_allclose(join(prediction[planes], (2, 2)).numpy(), expected, atol=2e-6)
        np.testing.assert_allclose(
            join(target[planes], (2, 2)).numpy(), mu_law(shot.pixels, mu=SIGNAL_MU), atol=1e-6
        )


def test_camera_rgb_without_a_mosaic():
    image = np.random.default_rng(4).uniform(0, 1, (HEIGHT, WIDTH, 3))
    view = make_view(None, ())
    predicted = LinearLight(normaliser=1.0).predict(torch.from_numpy(image), view, k=0.5).numpy()
    expected = 0.5 * view.sensor.falloff[..., None] * (image @ MATRIX.T)
    np.testing.assert_allclose(predicted, expected, rtol=1e-6)


def test_one_mu_law_for_all_shots_compares_radiance_not_signal():
    rng = np.random.default_rng(5)
    shot = make_shot(0.02, rng.uniform(0, 1, (HEIGHT, WIDTH)))
    view = make_view(Cfa.RGGB, (shot,))
    image = torch.rand(HEIGHT, WIDTH, 3)
    prediction, target = OneMuLaw(100.0).compare(image, view, 0.0)
    expected = mu_law(shot.pixels / (100.0 * 0.02), mu=LIGHT_MU)
    np.testing.assert_allclose(join(target, (2, 2)).numpy(), expected, atol=1e-6)
    expected = mu_law(direct(image.double().numpy(), view, 1.0), mu=LIGHT_MU)
    np.testing.assert_allclose(join(prediction, (2, 2)).numpy(), expected, atol=2e-6)


def test_saturated_photosites_punish_only_what_is_too_dark():
    saturated = np.zeros((HEIGHT, WIDTH), bool)
    saturated[0, 0] = saturated[3, 5] = True
    view = make_view(Cfa.RGGB, (make_shot(1.0, np.where(saturated, 1.0, 0.3), saturated),))
    image = torch.full((HEIGHT, WIDTH, 3), 0.5)
    image[0, 0] = 30.0  # brighter than the sensor can tell: right
    image[3, 5] = 0.2  # darker than it saw: wrong
    image[2, 2] = 30.0  # brighter than an unsaturated photosite: wrong
    image.requires_grad_(True)
    prediction, target = LinearLight(1.0).compare(image, view, 0.0)
    (prediction - target).abs().sum().backward()
    force = image.grad.abs().sum(-1)
    assert force[0, 0] == 0
    assert force[3, 5] > 0
    assert force[2, 2] > 0
    assert join(prediction, (2, 2))[0, 0] == join(target, (2, 2))[0, 0]


def test_pixels_without_a_number_count_for_nothing():
    valid = np.ones((HEIGHT, WIDTH), bool)
    valid[4, 4] = False
    pixels = np.full((HEIGHT, WIDTH), 0.3)
    view = make_view(Cfa.GBRG, (make_shot(1.0, pixels, valid=valid),))
    image = torch.full((HEIGHT, WIDTH, 3), 0.9, requires_grad=True)
    prediction, target = LinearLight(1.0).compare(image, view, 0.0)
    (prediction - target).square().sum().backward()
    force = image.grad.abs().sum(-1)
    assert force[4, 4] == 0
    assert int((force == 0).sum()) == 1


@pytest.mark.parametrize("period", [(2, 2), (3, 4), (6, 2), (1, 1)])
def test_sites_split_and_join(period):
    image = torch.arange(HEIGHT * WIDTH * 2.0).reshape(HEIGHT, WIDTH, 2)
    planes = split(image, period)
    rows, columns = period
    assert planes.shape == (rows * columns, HEIGHT // rows, WIDTH // columns, 2)
    for site, (row, column) in enumerate(np.ndindex(period)):
        assert torch.equal(planes[site], image[row::rows, column::columns])
    assert torch.equal(join(planes, period), image)


@pytest.mark.parametrize("cfa", [Cfa.X_TRANS, Cfa.QUAD_BAYER, Cfa.KODAK_RGBW, Cfa.MONO])
def test_any_table_shows_each_photosite_what_its_filter_lets_through(cfa):
    rng = np.random.default_rng(5)
    light, matrix = rng.random((24, 36, 3)).astype(np.float32), rng.random((len(cfa.letters), 3))
    planes = through_filter(torch.from_numpy(light), colour_filters(torch.from_numpy(matrix).float(), cfa))
    expected = (light @ matrix.T)[(*np.indices((24, 36)), cfa.channels(24, 36))]
    np.testing.assert_allclose(join(planes, cfa.period), expected, rtol=1e-5)


def test_a_mosaic_takes_as_many_operations_as_a_picture_without_one():
    """In float64, so with the operations of a GPU; the filters are ready from the first look on."""
    image, counts = torch.rand(HEIGHT, WIDTH, 3, dtype=torch.float64), []
    for cfa, channels in ((Cfa.RGGB, ()), (None, (3,))):
        view = make_view(cfa, (make_shot(0.5, np.full((HEIGHT, WIDTH, *channels), 0.4)),))
        model = LinearLight(normaliser=1.0)
        model.compare(image, view, 0.5)
        with Launches() as launches:
            model.compare(image, view, 0.5)
        counts.append(launches.count)
    assert counts[0] == counts[1] > 0


def test_display_values_decode_to_radiance_and_back():
    display = Display(Response(kind="srgb", evidence="test"), k=0.25)
    radiance = torch.rand(20, 3) * 3.9
    np.testing.assert_allclose(display.radiance(display.units(radiance)), radiance, rtol=1e-4)


def test_codes_at_either_end_are_one_sided():
    """A saturated code is a lower bound, a black one an upper bound; past them there is no gradient."""
    codes = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    saturated, dark = np.zeros(codes.shape, bool), np.zeros(codes.shape, bool)
    saturated[0, :2], dark[1, :2] = True, True
    codes[0, :2], codes[1, :2] = 1.0, 0.0
    shot = make_shot(0.25, codes, saturated).showing(dark=dark)
    view = make_view(None, (shot,))
    image = torch.full((HEIGHT, WIDTH, 3), 0.5)
    image[0, 0], image[0, 1], image[1, 0], image[1, 1], image[2, 0] = 1.5, 0.9, -0.5, 0.1, 1.5
    image.requires_grad_()
    display = Display(Response(kind="srgb", evidence="test"), k=0.25)
    prediction, target = display.compare(image, view, 0.5)
    off = (prediction - target)[0].detach()
    assert (off[0, 0], off[1, 0]) == (0.0, 0.0)
    assert off[0, 1] == pytest.approx(-0.1)
    assert off[1, 1] == pytest.approx(0.1)
    assert off[2, 0] == pytest.approx(1.0)  # a code between the ends is no bound
    prediction.sum().backward()
    assert image.grad[0, :2, 0].tolist() == [0.0, 1.0]
    assert image.grad[1, :2, 0].tolist() == [0.0, 1.0]
    assert image.grad[2, 0, 0] == 1.0
