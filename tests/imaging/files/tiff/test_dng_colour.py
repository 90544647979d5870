"""Choice of the matrix for the colour of a DNG."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from imaging.files.raw import read_raw
from imaging.files.tiff.directory import ASCII, RATIONAL, SHORT, SRATIONAL, Entry, rational

Write = Callable[..., Path]

TUNGSTEN = ((0.9, -0.3, -0.1), (-0.4, 1.2, 0.2), (0.0, 0.2, 0.6))  # of the sample


def test_the_matrix_for_daylight_is_preferred(write: Write) -> None:
    daylight = Entry(SRATIONAL, [2, 0, 0, 0, 1, 0, 0, 0, 1])
    path = write(MATRIX_2=daylight, ILLUMINANT_1=Entry(SHORT, [17]), ILLUMINANT_2=Entry(SHORT, [21]))
    assert read_raw(path).camera_from_xyz == ((2.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    path = write(MATRIX_2=daylight, ILLUMINANT_1=Entry(SHORT, [21]), ILLUMINANT_2=Entry(SHORT, [17]))
    assert read_raw(path).camera_from_xyz == ((0.9, -0.3, -0.1), (-0.4, 1.2, 0.2), (0.0, 0.2, 0.6))


def test_analog_balance_scales_the_rows_of_the_matrix(write: Write) -> None:
    path = write(ANALOG_BALANCE=Entry(RATIONAL, [2, 1, 4]))
    assert read_raw(path).camera_from_xyz == ((1.8, -0.6, -0.2), (-0.4, 1.2, 0.2), (0.0, 0.8, 2.4))


@pytest.mark.parametrize(
    ("illuminants", "share"),
    [
        ((17, 23), 1.0),  # standard illuminant A and D50: the latter is nearer to D65
        ((17, 20), 1.0),
        ((23, 17), 0.0),
        ((23, 22), (1 / 6500 - 1 / 5000) / (1 / 7500 - 1 / 5000)),  # D65 lies between D50 and D75
        ((22, 23), (1 / 6500 - 1 / 7500) / (1 / 5000 - 1 / 7500)),
        ((0, 17), 1.0),  # an unknown light tells nothing
        ((0, 255), 0.0),
    ],
)
def test_the_matrix_is_that_of_the_light_nearest_to_daylight(
    write: Write, illuminants: tuple[int, int], share: float
) -> None:
    second = np.diag([0.5, 1.0, 2.0])
    path = write(
        MATRIX_2=Entry(SRATIONAL, [rational(value) for value in second.ravel()]),
        ILLUMINANT_1=Entry(SHORT, [illuminants[0]]),
        ILLUMINANT_2=Entry(SHORT, [illuminants[1]]),
    )
    expected = (1 - share) * np.array(TUNGSTEN) + share * second
    assert np.allclose(read_raw(path).camera_from_xyz, expected, atol=1e-9)


def test_a_third_light_counts_too(write: Write) -> None:
    third = Entry(SRATIONAL, [3, 0, 0, 0, 3, 0, 0, 0, 3])
    lights = {"ILLUMINANT_1": 17, "ILLUMINANT_2": 22, "ILLUMINANT_3": 21}
    path = write(
        MATRIX_2=Entry(SRATIONAL, [2, 0, 0, 0, 2, 0, 0, 0, 2]),
        MATRIX_3=third,
        **{name: Entry(SHORT, [light]) for name, light in lights.items()},
    )
    assert np.array_equal(read_raw(path).camera_from_xyz, 3 * np.eye(3))


@pytest.mark.parametrize("illuminant", [21, 17])
def test_what_was_measured_of_one_camera_counts(write: Write, illuminant: int) -> None:
    # XYZ to camera is AnalogBalance x CameraCalibration x ColorMatrix
    of_camera = np.array([[1.2, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, -0.1, 0.8]])
    calibration = Entry(SRATIONAL, [rational(value, signed=True) for value in of_camera.ravel()])
    tags = {"ILLUMINANT_1": Entry(SHORT, [illuminant]), "ANALOG_BALANCE": Entry(RATIONAL, [2, 1, 4])}
    path = write(CALIBRATION_1=calibration, **tags)
    expected = np.diag([2, 1, 4]) @ of_camera @ np.array(TUNGSTEN)
    assert np.allclose(read_raw(path).camera_from_xyz, expected, atol=1e-9)
    # of the other light, which has no matrix
    path = write(CALIBRATION_2=calibration, **tags)
    assert np.allclose(read_raw(path).camera_from_xyz, np.diag([2, 1, 4]) @ np.array(TUNGSTEN), atol=1e-9)


def test_a_calibration_for_another_profile_does_not_count(write: Write) -> None:
    calibration = Entry(SRATIONAL, [2, 0, 0, 0, 2, 0, 0, 0, 2])
    path = write(CALIBRATION_1=calibration, CAMERA_SIGNATURE=Entry(ASCII, "com.adobe"))
    assert np.allclose(read_raw(path).camera_from_xyz, TUNGSTEN)
    same = {name: Entry(ASCII, "com.adobe") for name in ("CAMERA_SIGNATURE", "PROFILE_SIGNATURE")}
    assert np.allclose(
        read_raw(write(CALIBRATION_1=calibration, **same)).camera_from_xyz, 2 * np.array(TUNGSTEN)
    )
