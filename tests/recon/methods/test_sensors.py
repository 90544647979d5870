"""Every kind of sensor the whole way: simulated camera, files, light, a short training, against the truth."""

import numpy as np
import pytest

from imaging.sensor.cfa import Cfa
from recon.measure.truth import true_radiance


@pytest.mark.parametrize(
    ("rig", "letters", "period", "limit"),
    [
        ("toy-x-trans", "RGB", (6, 6), 0.45),
        ("toy-quad-bayer", "RGB", (4, 4), 0.45),
        ("toy-rgbw", "RGBW", (4, 4), 0.45),
        ("toy-mono", "W", (1, 1), 0.45),
    ],
)
def test_any_sensor_is_trained_as_right_as_bayer(studio, train, rig, letters, period, limit):
    """The toy rig of Bayer mosaics is held to the same 0.45 stops, at its worst view."""
    outcome = train(studio.session(rig, width=36))
    views = outcome.scene.dataset.views
    assert {(view.sensor.cfa.letters, view.sensor.cfa.period) for view in views} == {(letters, period)}
    assert len({view.sensor.cfa for view in views}) == (1 if letters == "W" else 2), "each begins elsewhere"
    assert outcome.stops() < limit
    if views[0].sensor.cfa == Cfa.MONO:
        light = outcome.light(views[0])
        assert np.ptp(light, axis=-1).max() < 1e-3 * light.max(), "grey"
        return
    for view in views:
        ratio = np.median(outcome.light(view) / true_radiance(outcome.scene.dataset.session, view), (0, 1))
        assert ratio.max() < 1.3 * ratio.min()
