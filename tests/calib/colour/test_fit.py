"""Matrices from patches: exact where they can be, as good as a matrix is elsewhere, blind to exposure."""

import colour
import numpy as np
import pytest

from calib.colour.chart_values import EDITION, chart
from calib.colour.fit import ChartPatches, ColourModel, Fit, fit, held_out, of_camera
from imaging.colour.difference import delta_e, lab
from imaging.colour.spaces import XYZ_FROM_REC709

from .charts import world

ROW, COLUMN = np.divmod(np.arange(24), 6)
PLACE = np.stack([COLUMN / 2.5 - 1, ROW / 1.5 - 1], axis=1)
CAMERA = np.array([[0.34, 0.11, 0.02], [0.16, 0.72, 0.12], [0.02, 0.15, 0.44]])


def patches(rgb: np.ndarray, noise: float = 1e-3, usable: np.ndarray | None = None) -> ChartPatches:
    return ChartPatches(rgb, noise * rgb, PLACE, np.ones(24, bool) if usable is None else usable)


def test_the_published_chart_as_colour_science_has_it() -> None:
    edition = colour.CCS_COLOURCHECKERS[EDITION]
    xyz = np.array([colour.xyY_to_XYZ(value) for value in edition.data.values()])
    white = colour.xy_to_XYZ(edition.illuminant)
    peer = colour.XYZ_to_Lab(
        colour.adaptation.chromatic_adaptation_VonKries(
            xyz, white, colour.xy_to_XYZ((0.3127, 0.3290)), transform="Bradford"
        ),
        (0.3127, 0.3290),
    )
    assert np.abs(lab(chart()) - peer).max() < 1e-6


def test_lab_of_dark_and_negative_colours() -> None:
    rgb = np.array([[0.0, 0.0, 0.0], [1e-4, 2e-4, 1e-4], [1.0, 1.0, 1.0]])
    peer = colour.XYZ_to_Lab(rgb @ XYZ_FROM_REC709.T, (0.3127, 0.3290))
    assert np.abs(lab(rgb) - peer).max() < 1e-6
    assert np.isfinite(lab([[-0.1, -0.2, 0.3]])).all()


def test_a_camera_that_is_a_matrix_is_found_exactly() -> None:
    camera = CAMERA / CAMERA[1].sum()
    (fitted,) = fit([patches(chart() @ camera.T)], chart(), ColourModel())
    assert np.abs(fitted.camera_from_rec709 - camera).max() < 1e-5
    assert delta_e(fitted.colours(patches(chart() @ camera.T)), chart()).max() < 0.01


def test_light_that_grows_across_the_chart_is_found_and_divided_out() -> None:
    camera = CAMERA / CAMERA[1].sum()
    slope = np.array([0.2, -0.1])
    measured = patches(chart() @ camera.T * np.exp(PLACE @ slope)[:, None])
    (fitted,) = fit([measured], chart(), ColourModel(shaded=True))
    assert fitted.slope == pytest.approx(slope, abs=1e-3)
    assert np.abs(fitted.camera_from_rec709 - camera).max() < 2e-3
    assert held_out([measured], chart(), ColourModel())[0].mean() > 1.5
    assert held_out([measured], chart(), ColourModel(shaded=True))[0].mean() < 0.1


@pytest.mark.parametrize(
    ("camera", "illuminant", "mean", "largest"),
    [("nikon", "D65", 0.95, 3.6), ("nikon", "A", 1.2, 4.0), ("sigma", "D65", 2.2, 5.6)],
)
def test_real_sensitivities_are_fitted_as_well_as_a_matrix_can(
    camera: str, illuminant: str, mean: float, largest: float
) -> None:
    colours = world(camera, illuminant)
    (errors,) = held_out([patches(colours.camera)], colours.truth, ColourModel())
    assert errors.mean() < mean
    assert errors.max() < largest


def test_what_is_neutral_stays_neutral() -> None:
    colours = world("nikon", "A")
    (fitted,) = fit([patches(colours.camera)], colours.truth, ColourModel())
    assert fitted.matrix @ np.ones(3) == pytest.approx(np.ones(3), abs=1e-12)
    assert np.linalg.solve(fitted.camera_from_rec709, fitted.white) == pytest.approx([fitted.white[1]] * 3)
    # The greys reflect all wavelengths nearly alike, so they tell the light's own white.
    assert fitted.white / fitted.white[1] == pytest.approx(colours.white, rel=0.02)
    grey = fitted.colours(patches(colours.camera))[18:22]
    assert delta_e(grey, colours.truth[18:22]).max() < 0.6


@pytest.mark.parametrize("shaded", [False, True])
def test_exposure_changes_nothing(shaded: bool) -> None:
    colours = world("sigma", "D65")
    fits = [
        fit([patches(gain * colours.camera)], colours.truth, ColourModel(shaded=shaded))[0]
        for gain in (1.0, 0.125)
    ]
    assert np.abs(fits[1].camera_from_rec709 - fits[0].camera_from_rec709).max() < 1e-6
    assert np.abs(fits[1].white - fits[0].white / 8).max() < 1e-6


def test_noisy_patches_count_for_less() -> None:
    camera = CAMERA / CAMERA[1].sum()
    rgb = chart() @ camera.T
    rgb[13] *= (1.0, 0.5, 1.0)
    sigma = 1e-3 * rgb
    sure = ChartPatches(rgb, sigma, PLACE, np.ones(24, bool))
    sigma = sigma.copy()
    sigma[13] = 0.5 * rgb[13]
    noisy = ChartPatches(rgb, sigma, PLACE, np.ones(24, bool))
    off = [
        np.abs(fit([one], chart(), ColourModel())[0].camera_from_rec709 - camera).max()
        for one in (sure, noisy)
    ]
    assert off[1] < off[0] / 3


def test_held_out_is_what_a_fit_without_the_patch_says() -> None:
    colours = world("nikon", "D65")
    random = np.random.default_rng(1)
    measured = patches(colours.camera * random.lognormal(0, 0.02, (24, 3)), 0.02)
    (errors,) = held_out([measured], colours.truth, ColourModel())
    (fitted,) = fit([measured.without(7)], colours.truth, ColourModel())
    assert errors[7] == pytest.approx(float(delta_e(fitted.colours(measured)[7], colours.truth[7])))
    missing = np.ones(24, bool)
    missing[3] = False
    (errors,) = held_out([patches(colours.camera, usable=missing)], colours.truth, ColourModel())
    assert list(np.flatnonzero(np.isnan(errors))) == [3]


def test_two_cameras_share_a_matrix_and_keep_their_whites() -> None:
    camera = CAMERA / CAMERA[1].sum()
    tint = np.array([1.1, 1.0, 0.9])
    both = [patches(chart() @ camera.T), patches(chart() @ (tint[:, None] * camera).T)]
    fits = fit(both, chart(), ColourModel())
    assert np.array_equal(fits[0].matrix, fits[1].matrix)
    assert fits[1].camera_from_rec709 == pytest.approx(tint[:, None] * fits[0].camera_from_rec709, rel=1e-6)


def test_the_matrix_of_the_files_with_their_white_and_with_the_charts() -> None:
    camera = CAMERA / CAMERA[1].sum()
    tint = np.array([1.2, 1.0, 0.8])
    measured = patches(3 * chart() @ (tint[:, None] * camera).T)
    (of_files,) = fit([measured], chart(), of_camera(camera, balanced=False))
    (balanced,) = fit([measured], chart(), of_camera(camera, balanced=True))
    assert of_files.camera_from_rec709 == pytest.approx(camera)
    assert balanced.camera_from_rec709 == pytest.approx(tint[:, None] * camera, rel=1e-9)
    errors = [
        held_out([measured], chart(), of_camera(camera, balanced=flag))[0].mean() for flag in (False, True)
    ]
    assert errors[0] > 5
    assert errors[1] < 1e-3


def test_a_fit_says_what_it_was_made_of() -> None:
    one = Fit(np.eye(3), np.array([2.0, 4.0, 1.0]), np.zeros(2))
    assert one.camera_from_rec709 == pytest.approx(np.diag([0.5, 1.0, 0.25]))
    assert one.colours(patches(np.ones((24, 3))))[0] == pytest.approx([0.5, 0.25, 1.0])
