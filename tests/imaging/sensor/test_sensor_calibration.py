"""RAW frames read by what was measured of their sensor."""

import numpy as np
import pytest

from imaging.merge.linear_frame import from_raw
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import FrameMetadata, RawMosaic
from imaging.sensor.sensor_calibration import Defect, Levels, Measured, SensorCalibration

BLACK, WHITE = 100.0, 4095


def measured(value: float) -> Measured:
    return Measured(value=value, sigma=0.0, source="flats")


def raw(light: np.ndarray, bend: float = 0.0) -> RawMosaic:
    """A mosaic of light relative to white, by a response that bends."""
    numbers = np.rint(BLACK + (WHITE - BLACK) * light * (1.0 - bend * light))
    return RawMosaic(
        pixels=np.clip(numbers, 0, WHITE).astype(np.uint16),
        cfa=Cfa.RGGB,
        black=((BLACK, BLACK), (BLACK, BLACK)),
        white=WHITE,
        metadata=FrameMetadata(exposure=Exposure(time=0.1, iso=100.0)),
    )


def sensor(**fields: object) -> SensorCalibration:
    return SensorCalibration.model_validate({"iso": 100.0} | fields)


@pytest.mark.parametrize("bend", [0.02, -0.03, 0.2])
def test_a_bent_response_is_straightened(bend: float) -> None:
    light = np.linspace(0.0, 0.95, 64).reshape(8, 8)
    straightened = from_raw(raw(light, bend), 1.0, [sensor(nonlinearity=measured(bend), linear=False)])
    np.testing.assert_allclose(straightened.signal, light, atol=0.0004)
    assert straightened.ceiling == pytest.approx(2.0 / (1.0 + np.sqrt(1.0 - 4.0 * bend)))


def test_a_bend_that_is_not_significant_changes_nothing() -> None:
    light = np.linspace(0.0, 0.95, 64).reshape(8, 8)
    plain = from_raw(raw(light), 1.0)
    for linear in (True, None):
        frame = from_raw(raw(light), 1.0, [sensor(nonlinearity=measured(0.001), linear=linear)])
        assert np.array_equal(frame.signal, plain.signal)


def test_signals_that_no_light_gives_stay_finite() -> None:
    """Noise below black, and codes above what the parabola reaches."""
    straight = Levels(bend=0.26).straight(np.array([-0.1, 0.0, 0.96, 1.0, 2.0], np.float32))
    assert np.isfinite(straight).all()
    assert (np.diff(straight) > 0).all()


def test_another_iso_never_stands_in() -> None:
    light = np.full((4, 4), 0.5)
    other = sensor(black=[[measured(110.0).model_dump()] * 2] * 2, defects=[Defect(x=1, y=2, kind="hot")])
    frame = from_raw(raw(light), 1.0, [other.model_copy(update={"iso": 200.0})])
    assert np.array_equal(frame.signal, from_raw(raw(light), 1.0).signal)
    here = from_raw(raw(light), 1.0, [other])
    assert not here.valid[2, 1]
    assert here.valid.sum() == 15
    assert (here.signal < frame.signal).all()
