"""Where a picture lies in the window of a browser."""

import numpy as np
import pytest

from rig.view.serving.frame import BESIDE, Frame


@pytest.mark.parametrize("aspect", [0.5, 4 / 3, 2.5])
def test_a_place_in_the_window_is_the_pixel_that_is_shown_there(aspect: float) -> None:
    rows, columns = np.mgrid[:30, :40].astype(np.float32)
    light = np.dstack([rows, columns, np.full_like(rows, 200)])
    frame = Frame(light, aspect)
    window = frame.in_window(light.astype(np.uint8))
    height, width = window.shape[:2]
    assert width / height == pytest.approx(aspect, rel=0.05)
    seen = 0
    for row in range(height):
        for column in range(width):
            place = frame.pixel((column + 0.5) / width, (row + 0.5) / height)
            if place is None:
                assert window[row, column].tolist() == [BESIDE] * 3
            else:
                assert window[row, column].tolist() == [*place, 200]
                seen += 1
    assert seen == 30 * 40


def test_outside_the_window_is_no_pixel() -> None:
    frame = Frame(np.zeros((3, 4, 3), np.float32), 4 / 3)
    assert frame.pixel(0.999, 0.999) == (2, 3)
    assert frame.pixel(1.0, 0.5) is None
    assert frame.pixel(0.5, -0.01) is None
