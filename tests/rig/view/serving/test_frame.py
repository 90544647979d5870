"""Place of a picture in the window of a browser."""

import numpy as np
import pytest

from rig.view.serving.frame import BESIDE, Frame, marked


@pytest.mark.parametrize("aspect", [0.5, 4 / 3, 2.5])
def test_a_place_in_the_window_is_the_pixel_that_is_shown_there(aspect: float) -> None:
    rows, columns = np.mgrid[:30, :40].astype(np.float32)
    light = np.dstack([rows, columns, np.full_like(rows, 200)])
    frame = Frame(light, aspect)
    window = frame.in_window(light.astype(np.uint8))
    height, width = window.shape[:2]
    assert width / height == pytest.approx(aspect, rel=0.05)
    count = 0
    for row in range(height):
        for column in range(width):
            place = frame.pixel((column + 0.5) / width, (row + 0.5) / height)
            if place is None:
                assert window[row, column].tolist() == [BESIDE] * 3
            else:
                assert window[row, column].tolist() == [*place, 200]
                count += 1
    assert count == 30 * 40


@pytest.mark.parametrize("window", [(100, 60), (21, 14), (20, 60), (1, 1)])
@pytest.mark.parametrize("middle", [(15, 20), (0, 0), (29, 39)])
def test_pixel_for_pixel_a_place_is_in_the_middle(window: tuple[int, int], middle: tuple[int, int]) -> None:
    rows, columns = np.mgrid[:30, :40].astype(np.uint8)
    picture = np.dstack([rows, columns, np.full_like(rows, 200)])
    centre = (middle[1] + 0.5) / 40, (middle[0] + 0.5) / 30
    frame = Frame(picture.astype(np.float32), 4 / 3, window, centre)
    shown = frame.in_window(picture)
    assert shown.shape == (window[1], window[0], 3)
    assert shown[window[1] // 2, window[0] // 2].tolist() == [*middle, 200]
    assert frame.pixel(0.5, 0.5) == middle
    for row, column in np.ndindex(shown.shape[:2]):
        place = frame.pixel((column + 0.5) / window[0], (row + 0.5) / window[1])
        assert shown[row, column].tolist() == ([BESIDE] * 3 if place is None else [*place, 200])


def test_outside_the_window_is_no_pixel() -> None:
    frame = Frame(np.zeros((3, 4, 3), np.float32), 4 / 3)
    assert frame.pixel(0.999, 0.999) == (2, 3)
    assert frame.pixel(1.0, 0.5) is None
    assert frame.pixel(0.5, -0.01) is None


@pytest.mark.parametrize("place", [(0.5, 0.5), (0.0, 0.0), (0.999, 0.3), (0.2, 1.0)])
def test_a_ring_marks_a_place_and_leaves_the_rest(place: tuple[float, float]) -> None:
    picture = np.full((90, 160, 3), 128, np.uint8)
    shown = marked(picture, *place)
    rows, columns = np.nonzero((shown != picture).any(2))
    away = np.hypot(rows + 0.5 - place[1] * 90, columns + 0.5 - place[0] * 160)
    assert 0 < away.min() < away.max() < 6
    assert {0, 255} <= set(shown.ravel().tolist())
    assert (picture == 128).all()
