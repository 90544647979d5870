import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.imports.sorting.exposure_list import read_exposure_list
from imaging.errors import InputError
from imaging.optics.exposure import Exposure


def read(tmp_path, text: str, name: str = "list.csv") -> dict[str, Exposure]:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return read_exposure_list(path)


def test_a_table_of_seconds_with_or_without_a_heading_f_number_and_iso(tmp_path):
    text = '\ufefffile, seconds, f-number, ISO\n# dusk\na.jpg, 1/60, 4, 200\n"b, c.jpg",2\nd.jpg,0.5,,400\n'
    assert read(tmp_path, text) == {
        "a.jpg": Exposure(time=1 / 60, f_number=4, iso=200),
        "b, c.jpg": Exposure(time=2),
        "d.jpg": Exposure(time=0.5, iso=400),
    }


def test_the_sample_of_the_manual_of_pfsinhdrgen(tmp_path):
    text = "/var/tmp/images/img08.jpg 4 2.8 100 0\n/var/tmp/images/img09.jpg 58.8235 2.8 100 0\n"
    assert read(tmp_path, text, "sample.hdrgen") == {
        "/var/tmp/images/img08.jpg": Exposure(time=0.25, f_number=2.8, iso=100),
        "/var/tmp/images/img09.jpg": Exposure(time=1 / 58.8235, f_number=2.8, iso=100),
    }


def test_a_list_of_hdrshop(tmp_path):
    text = "# file 1/shutter f/stop gain ND\na.png 0.03125 8 0 0\nb.png 32 8 6 0\n"
    assert read(tmp_path, text, "image_list.txt") == {
        "a.png": Exposure(time=32, f_number=8),
        "b.png": Exposure(time=1 / 32, f_number=8, iso=400),
    }


@pytest.mark.parametrize(
    "line",
    [
        "b.jpg, soon",
        "b.jpg, 0",
        "b.jpg, -1",
        "b.jpg, nan",
        "b.jpg, inf",
        "b.jpg, 1/0",
        "b.jpg, 1, 0",
        "b.jpg, 1, 4, 100, 7",
        ", 1",
        "a.jpg, 2",
        "b.jpg",
        "b.jpg 1",
    ],
)
def test_a_line_that_is_none_is_named_by_file_and_number(tmp_path, line):
    with pytest.raises(InputError, match=r"list\.csv, line 3 is not 'file.*correct or remove it\.$"):
        read(tmp_path, f"name, seconds\na.jpg, 1\n{line}\n")


@pytest.mark.parametrize(
    "line", ["a.jpg 4 2.8", "a.jpg 0 2.8 100 0", "a.jpg 4 2.8 100 0 1 2", "a.jpg x 1 1 0"]
)
def test_a_line_that_is_no_hdrgen_is_named_too(tmp_path, line):
    with pytest.raises(InputError, match=r"s\.hdrgen, line 1 is not 'file 1/shutter f-number ISO 0'"):
        read(tmp_path, line, "s.hdrgen")


NAMES = st.text(st.characters(categories=["L", "N"], max_codepoint=0x2FF), min_size=1, max_size=12)
POSITIVE = st.floats(1e-6, 1e6)


@given(
    rows=st.dictionaries(NAMES, st.tuples(POSITIVE, st.none() | POSITIVE, st.none() | POSITIVE), min_size=1)
)
@settings(max_examples=60)
def test_what_is_written_is_read(tmp_path_factory, rows):
    lines = [f"{name}, {t!r}, {f or ''!s}, {iso or ''!s}" for name, (t, f, iso) in rows.items()]
    exposures = read(tmp_path_factory.mktemp("lists"), "\n".join(lines))
    assert exposures == {name: Exposure(time=t, f_number=f, iso=iso) for name, (t, f, iso) in rows.items()}


@given(data=st.binary(max_size=80), name=st.sampled_from(["x.csv", "x.hdrgen", "image_list.txt"]))
@settings(max_examples=150)
def test_any_bytes_are_a_list_or_refused(tmp_path_factory, data, name):
    path = tmp_path_factory.mktemp("lists") / name
    path.write_bytes(data)
    try:
        exposures = read_exposure_list(path)
    except InputError as error:
        assert "line" in str(error)  # noqa: PT017 - either outcome is right
    else:
        assert all(exposure.time > 0 for exposure in exposures.values())
