"""The tone curve's comparison with photographs: what a code tells, and how much an error of it counts."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import imaging.compute.threads as threads
from imaging.colour.spaces import srgb_encode
from imaging.session.calibration import Response
from recon.data.dataset import Sensor, View
from recon.data.shot import HeldPlanes, Shot
from recon.observe.calibrated_curves import ASSUMED, ASSUMED_SMOOTHNESS
from recon.observe.photographs import DISPLAY_POWER, LEAST_SLOPE, TYPICAL_SLOPE, Display, ToneCurve
from recon.observe.targets import Targets
from recon.observe.tone_grid import curve_parameters, grid_nodes, sampled
from recon.splat import SplatCamera
from recon.train.adam import Adam

HEIGHT, WIDTH = 3, 40
SCALES = (1 / 8, 2.0, 32.0)
RATE, MIDDLE = 0.72, -1.0


def make_curve(balance: float) -> ToneCurve:
    """A sigmoid of the logarithm of light, the three channels a little apart."""
    nodes = grid_nodes()
    values = np.stack([1 / (1 + np.exp(-nodes / rate)) for rate in (0.9, 1.0, 1.1)])
    values = (values - values[:, :1]) / (values[:, -1:] - values[:, :1])
    return ToneCurve(
        normaliser=4.0,
        nodes=torch.from_numpy(nodes.astype(np.float32)),
        theta=curve_parameters(values)[None],
        of_camera={"cam": 0},
        rate=RATE,
        middle=MIDDLE,
        epsilon=1e-9,
        balance=balance,
    )


def make_view(curve: ToneCurve, image: torch.Tensor, trusted: tuple[float, float] = (0.02, 0.9)) -> View:
    """Photographs of the image itself; a calibration that ends at the trusted codes flags all beyond them."""
    plain = np.ones((HEIGHT, WIDTH), np.float32)
    response = Response(kind="srgb", evidence="test")
    lens = SplatCamera(np.eye(4), 10.0, 10.0, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT)
    empty = View("cam", 0, lens, Sensor("ldr", None, np.eye(3), plain, response), ())
    shots = []
    for k in SCALES:
        codes = np.rint(curve.predict(image, empty, k).detach().numpy() * 255).astype(np.float32) / 255
        low, high = (codes <= trusted[0], codes >= trusted[1])
        shots.append(Shot("file", k, HeldPlanes(codes, high, low, np.ones(codes.shape, bool))))
    return View("cam", 0, lens, empty.sensor, tuple(shots))


def ramp() -> torch.Tensor:
    """Light from far below what the longest exposure tells to beyond what the shortest does."""
    light = np.geomspace(1e-5, 1e3, HEIGHT * WIDTH * 3).reshape(HEIGHT, WIDTH, 3)
    return torch.from_numpy(light.astype(np.float32))


def test_codes_bound_the_light_at_the_ends_of_the_scale_and_not_where_the_calibration_ends():
    curve, image = make_curve(0.0), ramp()
    view = make_view(curve, image)
    for factor, end in ((4.0, 255), (0.25, 0)):
        prediction, target = curve.compare(image * factor, view, 0.5)
        codes = torch.round(target.detach() * 255)
        inner = (codes >= 2) & (codes <= 253)
        beyond = inner & ((codes >= 230) if end else (codes <= 5))
        error = (prediction - target).detach()
        assert beyond.sum() > 20
        assert (error[inner].abs() > 0.9 / 255).all()
        assert (error[(codes - end).abs() <= 1].abs() < 0.5 / 255).all()


@pytest.mark.parametrize("balance", [0.0, 0.5, 1.0])
def test_errors_of_light_count_alike_as_far_as_balance_says(balance):
    """Finite differences: codes that all shots of a pixel gain together when its light grows."""
    curve, image = make_curve(balance), ramp()
    view = make_view(curve, image)
    step = 1e-2
    gained = [curve.compare(image * np.exp(sign * step / 2), view, 0.5)[0].detach() for sign in (-1, 1)]
    gain = ((gained[1] - gained[0]).unflatten(0, (-1, 3)).mean(0) / step).numpy()
    plain = make_curve(0.0)
    codes = [plain.compare(image * np.exp(sign * step / 2), view, 0.5)[0].detach() for sign in (-1, 1)]
    slope = ((codes[1] - codes[0]).unflatten(0, (-1, 3)).mean(0) / step).numpy()
    steep = slope > 1.2 * LEAST_SLOPE
    assert steep.mean() > 0.3
    expected = slope[steep] * (TYPICAL_SLOPE / slope[steep]) ** balance
    # Codes are rounded, so that the slope at a code is not quite that at its light.
    np.testing.assert_allclose(gain[steep], expected, rtol=0.1)
    # Where no shot tells anything, the weight has an end.
    assert (gain <= slope * (TYPICAL_SLOPE / LEAST_SLOPE) ** balance * 1.01 + 1e-5).all()


def test_weights_are_those_of_the_start_when_a_training_goes_on():
    fresh, later, image = make_curve(0.5), make_curve(0.5), ramp()
    view = make_view(fresh, image)
    theta = later.theta.clone()
    later.theta.data.mul_(0.3)  # as a checkpoint sets it
    other = later.compare(image * 2, view, 0.5)[0]
    later.theta.data.copy_(theta)
    expected = fresh.compare(image * 2, view, 0.5)[0]
    assert not torch.allclose(other, expected, atol=0.01)
    assert torch.equal(later.compare(image * 2, view, 0.5)[0], expected)


def test_what_is_trained_depends_on_the_progress_and_on_no_comparison_before():
    curve = make_curve(0.5)
    view = make_view(curve, ramp())
    curve.theta.requires_grad_(True)
    curve.compare(ramp(), view, 0.0)
    early, late = curve.penalty(curve.fixed - 0.01), curve.penalty(curve.fixed)
    assert early == 0.0
    assert late.requires_grad
    assert late > 0


def test_white_balance_of_a_photograph_is_light_of_its_channels() -> None:
    curve, image = make_curve(0.5), ramp()
    view = make_view(curve, image)
    white = (1.3, 1.0, 0.6)
    balanced = replace(view, sensor=replace(view.sensor, white_balance=white))
    for k in SCALES:
        plain = curve.predict(image * torch.tensor(white), view, k)
        assert torch.allclose(curve.predict(image, balanced, k), plain, atol=2e-6)


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("masked", [True, False])
def test_what_is_kept_of_photographs_is_small_and_compares_as_planes_of_floats_do(
    whole: bool, masked: bool
) -> None:
    """Against codes, floor and ceiling of float32, to the bit, and the gradient with them."""
    image, rng = ramp(), np.random.default_rng(0)
    view = make_view(make_curve(0.0), image, (1 / 255, 254 / 255))
    shots = [
        shot.showing(
            pixels=shot.pixels if whole else (shot.pixels * np.float32(0.999)),
            valid=rng.random(shot.valid.shape) > (0.2 if masked else -1),
        )
        for shot in view.shots
    ]
    view = replace(view, shots=tuple(shots))

    def planes(name: str) -> torch.Tensor:
        return torch.from_numpy(np.concatenate([getattr(shot, name).transpose(2, 0, 1) for shot in shots]))

    target, ignored = planes("pixels"), ~planes("valid")
    low = planes("dark") & (target <= 1.5 / 255) | ignored
    high = planes("saturated") & (target >= 1 - 1.5 / 255) | ignored
    floor, ceiling = (torch.where(at, target, end) for at, end in ((low, -torch.inf), (high, torch.inf)))
    assert low.any()
    assert high.any()
    assert bool(ignored.any()) == masked

    display = Display(Response(kind="srgb", evidence="test"), 1.0)
    shown = (1.4 * torch.rand(image.shape, generator=torch.Generator().manual_seed(0)) - 0.2).requires_grad_()
    prediction, codes = display.compare(shown, view, 0.0)
    expected = shown.movedim(2, 0).repeat(len(shots), 1, 1).clamp(floor, ceiling)
    assert torch.equal(codes, target)
    assert torch.equal(prediction, expected)
    pull = torch.rand(expected.shape, generator=torch.Generator().manual_seed(1))
    (ours,), (theirs,) = (torch.autograd.grad(each, shown, pull) for each in (prediction, expected))
    assert torch.equal(ours, theirs)

    _, prepared = display._prepared._cached[view.name]
    stored = vars(prepared).values()
    held = sum(each.nbytes for each in stored if each is not None)
    assert held == (3 if whole else 6) * target.numel()


def test_a_curve_that_was_assumed_becomes_the_one_that_made_the_photographs() -> None:
    """Begin at sRGB, which is flat where the true curve, a sigmoid, is not; the light is known here."""
    true, image = make_curve(0.5), ramp()
    view = make_view(true, image, (0.0, 1.0))
    nodes = grid_nodes()
    srgb = Response(kind="srgb", evidence="assumed")
    curve = replace(
        true, theta=sampled(srgb, nodes, RATE, MIDDLE)[None].requires_grad_(), curve_rate=ASSUMED,
        smoothness=ASSUMED_SMOOTHNESS, fixed=0.0, _prepared=Targets(),
    )  # fmt: skip
    begun = curve.curves()[0]
    optimizer = Adam([{"params": [curve.theta]}])
    steps = 150
    for step in range(steps):
        for group in optimizer.param_groups:
            group["lr"] = curve.curve_rate.at(step / steps)
        optimizer.zero_grad()
        prediction, target = curve.compare(image, view, 0.5)
        loss = (prediction - target).abs().mean() + curve.penalty(0.5)
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
    measured = slice(int(np.searchsorted(nodes, -4.0)), int(np.searchsorted(nodes, 4.0)))
    goal = true.curves()[0]
    before, after = ((each - goal)[:, measured].square().mean().sqrt() for each in (begun, curve.curves()[0]))
    assert before > 0.1
    assert after < 0.02


def test_display_values_know_what_each_photograph_was_developed_with_and_no_label() -> None:
    """Twice the light, bluer, as sRGB has it but for its foot; else all photographs are alike."""
    view, image = make_view(make_curve(0.5), ramp()), torch.linspace(0.2, 0.5, 3 * HEIGHT * WIDTH)
    image = image.reshape(HEIGHT, WIDTH, 3)
    white = (0.9, 1.0, 1.2)
    bright = replace(view, sensor=replace(view.sensor, white_balance=white))
    knows, plain = (Display(Response(kind="srgb", evidence="test"), 0.5, known) for known in (True, False))
    shown = knows.predict(image, bright, 1.0)
    light = knows.radiance(image) * np.float32(0.5) * 2 * torch.tensor(white)
    exact = torch.from_numpy(srgb_encode(light.numpy().astype(np.float64)))
    torch.testing.assert_close(shown.double(), exact, atol=0.02, rtol=0)
    torch.testing.assert_close(knows.predict(image, view, 0.5), image)
    torch.testing.assert_close(plain.predict(image, bright, 1.0), image)
    ours, theirs = knows.compare(image, bright, 0.0)
    assert ours.shape == theirs.shape == (3 * len(SCALES), HEIGHT, WIDTH)


def test_what_only_darker_photographs_tell_is_beyond_white() -> None:
    knows = Display(Response(kind="srgb", evidence="test"), 0.5, True)
    light = torch.tensor([[0.02, 0.5, 1.9], [2.1, 4.0, 30.0]])
    codes = knows.units(light)
    assert codes[1, 2] == pytest.approx(15**DISPLAY_POWER, rel=1e-4)
    torch.testing.assert_close(knows.radiance(codes), light, rtol=1e-4, atol=1e-5)
    assert Display(knows.response, 0.5).units(light).max() <= 1.0001


def developed_views(height: int, width: int) -> tuple[Display, View]:
    """Three photographs of noise, with exposures, white balance, falloff, and bounds here and there."""
    rng = np.random.default_rng(7)
    shots = []
    for k in (0.2, 0.5, 1.4):
        codes = (rng.integers(0, 256, (height, width, 3)) / np.float32(255)).astype(np.float32)
        valid = rng.random(codes.shape) > 0.1
        shots.append(Shot("file", k, HeldPlanes(codes, codes > 0.995, codes < 0.005, valid)))
    falloff = rng.uniform(0.5, 1.1, (height, width)).astype(np.float32)
    response = Response(kind="srgb", evidence="test")
    sensor = Sensor("ldr", None, np.eye(3), falloff, response, (1.2, 1.0, 0.7))
    lens = SplatCamera(np.eye(4), 10.0, 10.0, width / 2, height / 2, width, height)
    return Display(response, 0.5, True), View("cam", 0, lens, sensor, tuple(shots))


def in_float64(image: torch.Tensor, view: View, k: float) -> tuple[torch.Tensor, torch.Tensor]:
    """The prediction of `Display` by its formula, and where it moves with the light."""
    rows, moves = [], []
    for shot in view.shots:
        gains = torch.tensor(shot.k / k * np.array(view.sensor.white_balance))
        shown = image * (torch.from_numpy(view.sensor.falloff).double()[..., None] * gains) ** (1 / 2.2)
        codes, valid = torch.from_numpy(shot.pixels).double(), torch.tensor(shot.valid)
        dark, bright = torch.tensor(shot.dark), torch.tensor(shot.saturated)
        beyond = (shown < codes) & (dark | ~valid) | (shown > codes) & (bright | ~valid)
        rows.append(torch.where(beyond, codes, shown).movedim(2, 0))
        moves.append(~beyond.movedim(2, 0))
    return torch.cat(rows), torch.cat(moves)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (5, 7), (37, 50)])
def test_photographs_developed_apart_are_the_formula_and_its_slope(height: int, width: int) -> None:
    display, view = developed_views(height, width)
    generator = torch.Generator().manual_seed(2)
    image = (1.6 * torch.rand(height, width, 3, generator=generator) - 0.2).requires_grad_()
    prediction, target = display.compare(image, view, 0.0)
    exact = image.detach().double().requires_grad_()
    expected, moves = in_float64(exact, view, display.k)
    torch.testing.assert_close(prediction.double(), expected, rtol=4e-7, atol=1e-7)
    assert torch.equal(
        target, torch.from_numpy(np.concatenate([shot.pixels.transpose(2, 0, 1) for shot in view.shots]))
    )
    pull = torch.rand(prediction.shape, generator=generator) - 0.5
    (ours,) = torch.autograd.grad(prediction, image, pull)
    (theirs,) = torch.autograd.grad(expected, exact, pull.double())
    assert (ours - theirs).norm() <= 3e-7 * theirs.norm()
    # The formula is straight but for the bounds: what does not cross one has this difference, too.
    step = 1e-6 * torch.randn(image.shape, generator=generator).double()
    ends = [in_float64(exact.detach() + sign * step, view, display.k) for sign in (1, -1)]
    same = ends[0][1] & ends[1][1] | ~ends[0][1] & ~ends[1][1] & ~moves
    rise = (pull * same * (ends[0][0] - ends[1][0])).sum() / 2
    (inner,) = torch.autograd.grad(display.compare(image, view, 0.0)[0], image, pull * same)
    assert float((inner * step).sum()) == pytest.approx(float(rise), rel=1e-5, abs=1e-12)


def test_one_pass_over_photographs_is_what_plain_operations_give() -> None:
    """The operations of a GPU, here in float64 on the CPU; and any number of threads gives the same bits."""
    display, view = developed_views(70, 33)
    image = torch.rand(70, 33, 3, generator=torch.Generator().manual_seed(3))
    plain = display.compare(image.double(), view, 0.0)[0]
    before, results = threads.thread_count(), []
    try:
        for count in (1, 3):
            threads.set_threads(count)
            leaf = image.clone().requires_grad_()
            prediction = display.compare(leaf, view, 0.0)[0]
            (prediction**2).sum().backward()
            torch.testing.assert_close(prediction.double(), plain, rtol=4e-7, atol=1e-7)
            results.append(prediction.detach().numpy().tobytes() + leaf.grad.numpy().tobytes())
    finally:
        threads.set_threads(before)
    assert results[0] == results[1]


def test_the_power_of_a_falloff_is_made_once() -> None:
    display, view = developed_views(5, 7)
    other = replace(view, frame=1)
    for each in (view, other, view):
        display.compare(torch.ones(5, 7, 3), each, 0.0)
    assert len(display._shades) == 1
