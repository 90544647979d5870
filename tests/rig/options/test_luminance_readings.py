"""Readings of luminance as they are written on the command line, and words that are none."""

import pytest
import typer

from imaging.errors import InputError
from imaging.request import FORGET
from imaging.session.view_id import ViewId
from rig.options.luminance_readings import ERROR, EXAMPLE, ReadingText, reading_text, readings_of


def test_a_spot_reading_has_a_view_an_area_and_an_error() -> None:
    reading = reading_text(EXAMPLE).reading()
    assert (reading.view, reading.area) == (ViewId(0, "cam0"), (1200, 800, 60, 40))
    assert (reading.luminance, reading.illuminance, reading.error) == (85.0, None, ERROR)
    assert reading.source == "spot meter"
    assert str(reading) == "0000/cam0:1200,800,60,40"


@pytest.mark.parametrize("value", ["85", "85 cd/m2", "85nits", "8.5e1cd/m²"])
def test_units_of_luminance(value: str) -> None:
    assert (
        reading_text(f"3/left:0,0,9,9={value}, ± 2.5 %, by=lamp A").reading()
        == reading_text("0003/left:0,0,9,9=85cd/m2,by=lamp A,+-2.5%").reading()
    )


def test_lux_need_a_reflectance_and_a_chart_has_its_own() -> None:
    card = reading_text("0000/cam0:1,2,30,40=1200lx,18%").reading()
    assert (card.illuminance, card.reflectance, card.source) == (1200.0, 0.18, "light meter")
    chart = reading_text("chart=1200lux").reading()
    assert (chart.view, chart.area, str(chart)) == (None, None, "chart")
    assert chart.known(1.0) == pytest.approx(1200 / 3.14159265, rel=1e-6)
    assert reading_text("chart=80").reading().known(0.9) == pytest.approx(80 / 0.9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("85cd/m2", "a reading follows after '='"),
        ("0000/cam0=85", "a view and left, top, width and height"),
        ("0000/cam0:1,2,3=85", "a view and left, top, width and height"),
        ("cam0:1,2,3,4=85", "a view is called FRAME/CAMERA"),
        ("0000/cam0:1,2,0,4=85", "an area is left, top, width and height in pixels"),
        ("0000/cam0:1,2,3,4=1200lx", "an illuminance needs the reflectance"),
        ("0000/cam0:1,2,3,4=85,18%", "an illuminance needs the reflectance"),
        ("0000/cam0:1,2,3,4=18%", "a luminance or an illuminance"),
        ("chart=1200lx,18%", "the reflectances of a chart are published"),
        ("0000/cam0:1,2,3,4=85 candles", "'85 candles' is no luminance"),
        ("0000/cam0:1,2,3,4=85,+-0%", "greater than 0"),
        ("0000/cam0:1,2,3,4=0", "greater than 0"),
    ],
)
def test_what_is_no_reading_is_refused_in_a_sentence_with_the_fix(text: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        reading_text(text).reading()
    assert message in str(error.value)
    assert EXAMPLE in str(error.value)


def test_none_forgets_and_nothing_keeps() -> None:
    assert readings_of(None) is None
    assert readings_of([]) is None
    assert readings_of([ReadingText("none")]) == FORGET
    with pytest.raises(typer.BadParameter):
        reading_text(" ")
