"""The texts that libgphoto2 has for exposures, as its makers write them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.gphoto2.dials import choices, f_number, iso, seconds
from drivers.gphoto2.formats import plain_raw, says_both, says_raw


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("1/250", 1 / 250),
        ("0.0001s", 1 / 8000),  # 1 tick of 100 us
        ("0.0166s", 1 / 60),
        ("0.0020s", 1 / 500),
        ("30.0000s", 30.0),
        ("13/10", 1.3),
        ("0.3", 0.3),
        ("30", 30.0),
        ("Bulb", None),
        ("bulb", None),
        ("Auto", None),
        ("60m", 3600.0),  # Fuji's, as those below
        ("2m", 120.0),
        ("30s", 30.0),
        ("2.5s", 2.5),
        ("1s", 1.0),
        ("0.8s", 0.8),
        ("1/1.3s", 1 / 1.3),
        ("1/2.5s", 0.4),
        ("1/60s", 1 / 60),
        ("1/1.3", 1 / 1.3),  # Panasonic's
        ("25/10", 2.5),
        ("0,5", 0.5),
        ("2,5 s", 2.5),  # French
        ("0,0166 s", 1 / 60),
        ("1/60 s", 1 / 60),
        ("1/2 с", 0.5),  # Ukrainian
        ("30 秒", 30.0),
        ("1/2gy", 0.5),  # Vietnamese
        ("1 ث", 1.0),
        ("30 Sek.", 30.0),
        ("1/1,000", 0.001),
        ("1 1/3", 4 / 3),
        ('0"4', 0.4),
        ('30"', 30.0),
        ("250 ms", 0.25),
        ("x 200", None),
        ("Time", None),
        ("Composite", None),
        ("unknown value 0x1c", None),
        ("1/60s (flash)", None),
        ("0.5 m s", None),
        ("4 K", None),
        ("1/0", None),
        ("-1", None),
        ("", None),
    ],
)
def test_times(text: str, wanted: float | None) -> None:
    assert seconds(text) == (None if wanted is None else pytest.approx(wanted))


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        *(("f/2.8", 2.8), ("F5.6", 5.6), ("f/8", 8.0), ("F8.0", 8.0), ("11", 11.0), ("f/5,6", 5.6)),
        *(("ƒ/4", 4.0), ("implicit auto", None), ("auto", None), ("f/0", None), ("T2.8", None)),
        ("unknown value 0x3", None),
    ],
)
def test_f_numbers(text: str, wanted: float | None) -> None:
    assert f_number(text) == wanted


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        *(("100", 100.0), ("ISO 100", 100.0), ("ISO100", 100.0), ("100 ISO", 100.0), ("12,800", 12800.0)),
        *(("12.800", 12800.0), ("ISO 12 800", 12800.0), ("ISO 100/21°", 100.0), ("0", None)),
        *(("Auto", None), ("Auto ISO", None), ("自動 ISO", None), ("ISO Auto 6400", None)),
        *(("Lo 1", None), ("Hi 0.3", None), ("100 Multi Frame Noise Reduction", None)),
        ("Factory Default", None),
    ],
)
def test_isos(text: str, wanted: float | None) -> None:
    assert iso(text) == wanted


def test_choices_are_those_that_are_numbers() -> None:
    assert choices(["Auto", "400", "100", "100", "200"], iso) == {"100": 100.0, "200": 200.0, "400": 400.0}
    assert choices(["bulb", "2m", "1s", "1/2"], seconds) == {"1/2": 0.5, "1s": 1.0, "2m": 120.0}


@given(st.text(alphabet="0123456789./,\"'s mfFiISO°ISO٣²½+-", max_size=12))
def test_no_text_is_more_than_not_understood(text: str) -> None:
    for decode in (seconds, f_number, iso):
        value = decode(text)
        assert value is None or value > 0


def test_formats() -> None:
    """Read formats of Canon, Nikon, Sony and Fuji bodies."""
    assert plain_raw(["Large Fine JPEG", "RAW + Large Fine JPEG", "mRAW", "RAW"]) == "RAW"
    assert plain_raw(["JPEG Basic", "NEF+Fine", "NEF (Raw)"]) == "NEF (Raw)"
    assert plain_raw(["JPEG Fine"]) is None
    assert says_both("RAW+JPEG (Std)")
    assert not says_both("Fine")
    assert not says_raw("Extra Fine")
