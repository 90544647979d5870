"""The colour of a DNG: one matrix from XYZ to camera RGB under D65, of the up to three that it holds.

Adobe DNG specification 1.7, "Mapping Camera Color Space to CIE XYZ Space".
"""

import numpy as np

from imaging.arrays import Array
from imaging.files.tiff.directory import Directory, integers, numbers
from imaging.files.tiff.dng_tags import (
    ANALOG_BALANCE,
    CALIBRATION_1,
    CALIBRATION_2,
    CALIBRATION_3,
    CAMERA_SIGNATURE,
    ILLUMINANT_1,
    ILLUMINANT_2,
    ILLUMINANT_3,
    MATRIX_1,
    MATRIX_2,
    MATRIX_3,
    PROFILE_SIGNATURE,
)
from imaging.sensor.mosaic import Matrix, as_matrix

_TEMPERATURES = {
    1: 5500.0,  # daylight
    2: 4150.0,  # fluorescent
    3: 2850.0,  # tungsten
    4: 5500.0,  # flash
    9: 5500.0,  # fine weather
    10: 6500.0,  # cloudy
    11: 7500.0,  # shade
    12: 6400.0,  # fluorescent: daylight, day white, cool white, white, warm white
    13: 5050.0,
    14: 4150.0,
    15: 3525.0,
    16: 2925.0,
    17: 2850.0,  # standard illuminants A, B, C, D55, D65, D75, D50
    18: 5500.0,
    19: 6500.0,
    20: 5500.0,
    21: 6500.0,
    22: 7500.0,
    23: 5000.0,
    24: 3200.0,  # ISO studio tungsten
}
"""Correlated colour temperature, K, of EXIF's light sources, as Adobe's DNG SDK has them."""

DAYLIGHT = 6500.0
"""K, of D65."""


def camera_from_xyz(tags: Directory, channels: int) -> Matrix | None:
    """AnalogBalance x CameraCalibration x ColorMatrix under D65; None if the file has no ColorMatrix.

    A row for each channel; where the file has none of W, it is the sum of the others.

    Between two illuminants both factors are interpolated by the reciprocal of the colour temperature;
    beyond them those of the nearest count. The first matrix stands alone where no illuminant is known.
    """
    calibrated = tags.get(CAMERA_SIGNATURE, "") == tags.get(PROFILE_SIGNATURE, "")
    by_temperature: dict[float, tuple[Array, Array]] = {}
    alone: tuple[Array, Array] | None = None
    for matrix_tag, calibration_tag, illuminant_tag in (
        (MATRIX_1, CALIBRATION_1, ILLUMINANT_1),
        (MATRIX_2, CALIBRATION_2, ILLUMINANT_2),
        (MATRIX_3, CALIBRATION_3, ILLUMINANT_3),
    ):
        matrix = _rows(tags, matrix_tag, 3)
        if matrix is None or len(matrix) not in (3, channels):
            continue
        calibration_rows = _rows(tags, calibration_tag, len(matrix)) if calibrated else None
        pair = (
            matrix,
            np.eye(len(matrix))
            if calibration_rows is None or len(calibration_rows) != len(matrix)
            else calibration_rows,
        )
        if alone is not None and len(alone[0]) != len(matrix):
            continue
        alone = alone or pair
        temperature = _TEMPERATURES.get(next(iter(integers(tags, illuminant_tag)), 0))
        if temperature is not None:
            by_temperature.setdefault(1.0 / temperature, pair)
    if alone is None:
        return None
    colour, calibration = _between(by_temperature) if by_temperature else alone
    balance = numbers(tags, ANALOG_BALANCE)
    gains = balance if len(balance) == len(colour) and all(balance) else (1.0,) * len(colour)
    rows = np.diag(gains) @ calibration @ colour
    return as_matrix(rows if len(rows) == channels else [*rows, rows.sum(0)])


def _between(by_temperature: dict[float, tuple[Array, Array]]) -> tuple[Array, Array]:
    """The pair of matrices at D65, interpolated in the reciprocal temperatures that are the keys."""
    places = sorted(by_temperature)
    weights = [
        np.interp(1.0 / DAYLIGHT, places, [float(other == place) for other in places]) for place in places
    ]
    first, second = (
        sum(weight * by_temperature[place][part] for weight, place in zip(weights, places, strict=True))
        for part in (0, 1)
    )
    return np.asarray(first), np.asarray(second)


def _rows(tags: Directory, tag: int, columns: int) -> Array | None:
    values = numbers(tags, tag)
    known = len(values) in (9, 12, 16) and len(values) % columns == 0 and any(values)
    return np.reshape(values, (-1, columns)) if known else None
