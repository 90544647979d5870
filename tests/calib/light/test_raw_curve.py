"""A RAW camera that left a curve on is named, and nothing else that RAW may have is called a curve."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from calib.data.views import scene_views
from calib.light import radiometry
from calib.light.radiometry import Radiometry
from imaging.colour.spaces import srgb_encode
from imaging.optics.exposure import Exposure
from imaging.progress import unreported
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import FrameMetadata, RawMosaic
from imaging.session.session import Session
from tests.calib.conftest import make_session

from .curves.test_response import smooth

Curve = Callable[[np.ndarray], np.ndarray]
BLACK, WHITE, ELECTRONS = 256, 4095, 9000
TIMES = (1 / 500, 1 / 60, 1 / 15, 1 / 4)
"""Times as dials have them: 1/60 is 1/64, 1/500 is 1/512."""
EXACT = tuple(2.0 ** round(np.log2(time)) for time in TIMES)


@dataclass(frozen=True)
class Body:
    """Distortion of a camera's RAW signal. off: DN by which its files state black wrongly."""

    curve: Curve = np.asarray
    off: float = 0.0
    pedestal_too: bool = False


def mosaic(body: Body, light: np.ndarray, time: float, rng: np.random.Generator) -> RawMosaic:
    """A noisy mosaic of light [H, W], 12 bits."""
    signal = rng.poisson(np.minimum(8 * light * time, 4) * ELECTRONS) / ELECTRONS
    signal = np.clip(signal + rng.normal(0, 4 / ELECTRONS, light.shape), 0, 1)
    if body.pedestal_too:
        dn = WHITE * body.curve(BLACK / WHITE + signal * (1 - BLACK / WHITE))
    else:
        dn = BLACK + (WHITE - BLACK) * body.curve(signal)
    return RawMosaic(
        pixels=np.rint(np.clip(dn, 0, WHITE)).astype(np.uint16),
        cfa=Cfa("RGGB"),
        black=((BLACK + body.off,),),
        white=WHITE,
        metadata=FrameMetadata(make="Maker", model="One", serial="cam"),
    )


def measured(
    folder: Path, bodies: Sequence[Body], times: Sequence[float], labels: Sequence[float]
) -> Radiometry:
    """Estimated light of three views of each camera, cam0 and on."""
    views, names = [], []
    for number, body in enumerate(bodies):
        for view in range(3):
            rng = np.random.default_rng((number, view))
            light = smooth(rng, 1e-2, 30.0)[..., 0]
            views.append(
                [
                    (mosaic(body, light, time, rng), Exposure(time=label, iso=100))
                    for time, label in zip(times, labels, strict=True)
                ]
            )
            names.append(f"cam{number}")
    session = Session.open(make_session(folder / "S", views, cameras=names))
    return radiometry.measure_light(session, scene_views(session), unreported)


def doubts(light: Radiometry) -> list[str]:
    return [rung.reason for rung in light.rungs if rung.name == "raw_curve" and rung.taken]


@pytest.mark.parametrize("power", [0.45, 0.8, 1.25])
def test_a_gamma_on_raw_is_named_with_what_to_switch_off(tmp_path: Path, power: float) -> None:
    """Switch it on in cam1 of two cameras; labels are as rounded as dials have them."""
    light = measured(tmp_path, [Body(), Body(lambda x: x**power)], EXACT, TIMES)
    (said,) = doubts(light)
    assert said.startswith("the RAW of cam1 (light to the power ")
    assert "cam0" not in said
    assert "switch off gamma, lookup table, tone curve and contrast in the camera and shoot again" in said
    assert float(said.split("power ")[1].split(")")[0]) == pytest.approx(power, abs=0.03)
    assert "to the power" in light.responses["cam1"].evidence
    assert "agree with a straight line" in light.responses["cam0"].evidence


@pytest.mark.parametrize("power", [0.45, 0.8, 1.25])
def test_a_gamma_that_bends_the_black_level_too_is_named(tmp_path: Path, power: float) -> None:
    """It departs at some levels more than at others; files state the black that they have."""
    black = WHITE * (BLACK / WHITE) ** power
    bent = Body(lambda x: x**power, black - BLACK, pedestal_too=True)
    light = measured(tmp_path, [Body(), bent], EXACT, TIMES)
    (why,) = (rung.reason for rung in light.rungs if rung.name == "response_curve")
    assert "that of cam1 departs by more than 1 %: switch off gamma, lookup table, tone curve" in why
    assert all("cam1 (light to the power" in said for said in doubts(light))


def test_two_exposures_are_enough(tmp_path: Path) -> None:
    light = measured(tmp_path, [Body(lambda x: x**0.8)], EXACT[1:3], EXACT[1:3])
    (said,) = doubts(light)
    assert "power 0.80" in said
    assert "or correct the exposure times if those are wrong" in said


def test_a_curve_of_pictures_is_named_as_well(tmp_path: Path) -> None:
    assert len(doubts(measured(tmp_path, [Body(srgb_encode)], EXACT, TIMES))) == 1


@pytest.mark.parametrize(
    ("body", "labels"),
    [
        (Body(), TIMES),
        (Body(off=-40.0), EXACT),
        (Body(off=40.0), EXACT),
        (Body(lambda x: x - 0.04 * x**2), EXACT),
        (Body(), (*EXACT[:3], EXACT[3] / 2)),
        (Body(), (EXACT[0], EXACT[1] / 2, *EXACT[2:])),
    ],
    ids=[
        "rounded labels",
        "black too low",
        "black too high",
        "near saturation",
        "last label",
        "second label",
    ],
)
def test_nothing_else_is_called_a_gamma(tmp_path: Path, body: Body, labels: Sequence[float]) -> None:
    assert doubts(measured(tmp_path, [body], EXACT, labels)) == []


def test_a_bend_of_another_shape_names_the_camera_and_what_may_bend_it(tmp_path: Path) -> None:
    light = measured(tmp_path, [Body(), Body(lambda x: x + 0.05 * np.sin(2 * np.pi * x))], EXACT, EXACT)
    (why,) = (rung.reason for rung in light.rungs if rung.name == "response_curve")
    assert "that of cam1 departs by more than 1 %: switch off gamma, lookup table, tone curve" in why
    assert "check black level, white level and the light" in why
