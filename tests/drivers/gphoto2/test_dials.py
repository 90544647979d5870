"""The texts that libgphoto2 has for exposures, as its makers write them."""

import pytest

from drivers.gphoto2.dials import choices, f_number, number, plain_raw, says_both, says_raw, seconds


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
        ("1/0", None),
        ("-1", None),
        ("", None),
    ],
)
def test_times(text: str, wanted: float | None) -> None:
    assert seconds(text) == (None if wanted is None else pytest.approx(wanted))


def test_f_numbers_and_isos() -> None:
    assert [f_number(text) for text in ("f/2.8", "F5.6", "11", "implicit auto")] == [2.8, 5.6, 11.0, None]
    assert [number(text) for text in ("100", "Auto", "Auto Multi Frame Noise Reduction")] == [
        100.0,
        None,
        None,
    ]
    assert choices(["Auto", "400", "100", "100", "200"], number) == {"100": 100.0, "200": 200.0, "400": 400.0}


def test_formats() -> None:
    """Of Canon, Nikon, Sony and Fuji bodies."""
    assert plain_raw(["Large Fine JPEG", "RAW + Large Fine JPEG", "mRAW", "RAW"]) == "RAW"
    assert plain_raw(["JPEG Basic", "NEF+Fine", "NEF (Raw)"]) == "NEF (Raw)"
    assert plain_raw(["JPEG Fine"]) is None
    assert says_both("RAW+JPEG (Std)")
    assert not says_both("Fine")
    assert not says_raw("Extra Fine")
