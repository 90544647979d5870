"""Rig files: what is read, what is refused and on which line, and what `rig init` writes."""

import re
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.bracket.goals import BracketGoals
from capture.capture_rig import capture_rig
from capture.rigfile.rigfile import RigFile, read_rig_file
from capture.rigfile.tables import SubjectTable
from capture.rigfile.template import EXAMPLE, rig_file_text
from drivers.camera import CameraIdentity, Capabilities
from drivers.discovery import ConnectedCamera
from imaging.errors import CaptureError, InputError
from imaging.optics.exposure import Exposure
from imaging.session.records import Board

SOUND = """\
frames = 2
pause = 10

[bracket]
exposures = [4, -4, 0]
time = "1/60"
f_number = 8

[trigger]
tolerance = 0.005

[[camera]]
name = "left"
serial = "A"
rig = "arm"

[[camera]]
name = "right"
serial = "B"
"""


def read(folder: Path, text: str | bytes) -> RigFile:
    path = folder / "RIG.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_rig_file(path)


def test_a_rig_file_is_read(tmp_path: Path) -> None:
    tables = read(tmp_path, SOUND).tables
    assert [(one.name, one.serial, one.rig) for one in tables.camera] == [
        ("left", "A", "arm"),
        ("right", "B", None),
    ]
    assert (tables.frames, tables.pause, tables.trigger.tolerance) == (2, 10.0, 0.005)
    assert tables.bracket.exposures == (-4.0, 0.0, 4.0)
    assert tables.bracket.middle(100.0) == Exposure(time=1 / 60, f_number=8, iso=100)
    assert tables.bracket.wanted == BracketGoals()


def test_the_least_rig_file_is_a_camera(tmp_path: Path) -> None:
    tables = read(tmp_path, '[[camera]]\nname = "a"\nserial = "1"\n').tables
    assert (tables.frames, tables.pause, tables.bracket.exposures) == (1, "key", "auto")
    assert tables.trigger.mode == "software"
    assert tables.bracket.middle(100.0) is None


def test_byte_order_marks_and_line_ends_of_other_systems_are_read(tmp_path: Path) -> None:
    plain = read(tmp_path, SOUND)
    other = read(tmp_path, b"\xef\xbb\xbf" + SOUND.replace("\n", "\r\n").encode())
    assert (other.tables, other.lines) == (plain.tables, plain.lines)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("frames = 2", "frames = 0", 1, "frames has to be 1 or more"),
        ("frames = 2", "frames = true", 1, "frames has to be a whole number"),
        ("frames = 2", "frames = 2.5", 1, "frames has to be a whole number"),
        ("pause = 10", 'pause = "kye"', 2, 'pause has to be "key", or seconds'),
        ("pause = 10", "pause = nan", 2, 'pause has to be "key", or seconds'),
        ("pause = 10", "pase = 10", 2, "there is no key 'pase'; did you mean pause?"),
        ("pause = 10", "pause 10", 2, "this is not valid TOML (expected '=' after a key"),
        ("pause = 10", "frames = 3", 2, "this is not valid TOML (cannot overwrite a value)"),
        ("[bracket]", "[brackets]", 4, "there is no key 'brackets'; did you mean bracket?"),
        ("[4, -4, 0]", "[]", 5, 'exposures has to be "auto", or stops'),
        ("[4, -4, 0]", "[4, 'x']", 5, 'exposures has to be "auto", or stops'),
        ("[4, -4, 0]", "[4, 4]", 5, "stops that all differ"),
        ("[4, -4, 0]", "[4, 31]", 5, 'exposures has to be "auto", or stops'),
        ('"1/60"', '"fast"', 6, "time has to be a shutter time"),
        ('"1/60"', "0", 6, "time has to be a shutter time"),
        ("= 8", "= true", 7, "f_number has to be a number"),
        ("= 8", "= 8\nsnr = 61", 8, "snr has to be 60"),
        ("0.005", "0", 10, "tolerance has to be above 0"),
        ("0.005", '0.005\nmode = "hard"', 11, 'mode has to be "software", "hardware" or "action"'),
        ("0.005", '0.005\nmode = "hardware"', 11, "a hardware trigger comes in on a line"),
        ("0.005", '0.005\nleader = "cam9"', 11, "there is no camera 'cam9'; the cameras are left, right"),
        ('"left"', '"../left"', 13, "name has to be made of letters"),
        ('"left"', "3", 13, "name has to be text in quotes"),
        ('"A"', '""', 14, "serial has to be text that is not empty"),
        ('rig = "arm"', 'role = "eye"', 15, "there is no key 'role'; the keys here are name, serial, rig"),
        ('serial = "B"', 'serial = "B"\nfocal_length = 8', 20, "right has focal_length and no pixel_pitch"),
        ('serial = "B"', 'serial = "B"\npixel_pitch = 3', 20, "right has pixel_pitch and no focal_length"),
        ('serial = "B"', 'serial = "B"\nfocal_length = 0', 20, "focal_length has to be above 0"),
        ("pause = 10", "subject = {nearest = 2, farthest = 1}", 2, "farthest (1 m) is less than nearest"),
        ("pause = 10", "subject = {farthest = 1}", 2, "the subject has no nearest; add it"),
        ('name = "right"', "", 17, "the camera has no name"),
        ('serial = "B"', "", 17, "the camera has no serial"),
        ('serial = "B"', 'serail = "B"', 19, "there is no key 'serail'; did you mean serial?"),
        ('"right"', '"LEFT"', 18, "line 13 has the name 'LEFT' already"),
        ('"B"', '"A"', 19, "line 14 has the serial 'A' already"),
        ('"B"', '"B', 19, "this is not valid TOML"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(tmp_path, old: str, new: str, line: int, words: str) -> None:
    assert old in SOUND
    with pytest.raises(InputError) as caught:
        read(tmp_path, SOUND.replace(old, new, 1))
    assert str(caught.value).startswith(f"{tmp_path / 'RIG.toml'}, line {line}: ")
    assert words in str(caught.value)


@pytest.mark.parametrize("text", ["", "\n# nothing\n", "frames = 2\n", "camera = []\n"])
def test_a_file_without_cameras_says_how_to_get_one(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match=r"names no camera: add a \[\[camera\]\].*rig init"):
        read(tmp_path, text)


def test_tables_that_are_none_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"line 2: bracket has to be a table, as \[bracket\]"):
        read(tmp_path, '\nbracket = 8\n[[camera]]\nname = "a"\nserial = "1"\n')
    with pytest.raises(InputError, match=r"line 2: camera has to be written with two brackets"):
        read(tmp_path, '\n[camera]\nname = "a"\n')


def test_what_is_no_text_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"line 2: this is not UTF-8"):
        read(tmp_path, b"frames = 2\nx = '\xe9'\n")
    with pytest.raises(InputError, match="nested too deeply"):
        read(tmp_path, "x = " + "[" * 100_000)
    with pytest.raises(InputError, match="is a folder"):
        read_rig_file(tmp_path)
    with pytest.raises(InputError, match="does not exist: create it with `rig init"):
        read_rig_file(tmp_path / "none.toml")


# What `rig init` writes.


def listed(
    serial: str, make: str = "Make", f_numbers: tuple[float, ...] = (4.0, 5.6, 8.0)
) -> ConnectedCamera:
    able = Capabilities(64, 48, 12, (1 / 100, 1 / 10), f_numbers, (100.0,))
    return ConnectedCamera("PTP", "USB 001:002", CameraIdentity(serial, make, "Model", "raw"), able)


def test_cameras_are_named_in_the_order_of_their_serial_numbers(tmp_path: Path) -> None:
    text = rig_file_text([listed("C"), listed("A"), listed("B")])
    tables = read(tmp_path, text).tables
    assert [(one.name, one.serial, one.rig) for one in tables.camera] == [
        ("cam0", "A", "rig"),
        ("cam1", "B", "rig"),
        ("cam2", "C", "rig"),
    ]
    assert tables.bracket.f_number == 8.0
    assert read(tmp_path, rig_file_text([listed("A")])).tables.camera[0].rig is None


@pytest.mark.parametrize("other", ["band", "filters"])
def test_every_setting_that_is_commented_out_may_be_used(tmp_path: Path, other: str) -> None:
    """Each `# key = value` of the file, without its mark, is a setting that is understood; a filter that
    stays and a wheel exclude each other."""
    lines = rig_file_text([listed("A", f_numbers=())]).splitlines()
    options = [n for n, line in enumerate(lines) if re.match(r"# (\[\w+\]|\w+ = )", line)]
    assert len(options) == 22
    for number in options:
        if lines[number].startswith(f"# {other} = "):
            continue
        lines[number] = lines[number].removeprefix("# ")
    tables = read(tmp_path, "\n".join(lines)).tables
    bracket = tables.bracket
    assert tables.board == EXAMPLE
    assert tables.subject == SubjectTable(nearest=0.6, farthest=1.4)
    assert (tables.camera[0].focal_length, tables.camera[0].pixel_pitch) == (8, 3.45)
    assert (bracket.f_number, bracket.iso, bracket.total, bracket.slowest) == (8, 100, 2, 1 / 4)


def test_a_board_that_is_known_stands_in_the_file(tmp_path: Path) -> None:
    board = Board(columns=12, rows=9, square=0.0301, marker=0.022, dictionary="DICT_5X5_100")
    assert read(tmp_path, rig_file_text([listed("A")], board)).tables.board == board
    assert read(tmp_path, rig_file_text([listed("A")])).tables.board is None


def test_no_board_is_shot_that_nothing_describes(tmp_path: Path) -> None:
    """The sentence holds a line that can be pasted; no camera is looked for before it."""
    rig = read(tmp_path, SOUND)
    with pytest.raises(InputError, match="does not describe the board") as refused:
        capture_rig(rig, tmp_path / "S", kind="board")
    assert not (tmp_path / "S").exists()
    line = str(refused.value).split("`")[1]
    assert read(tmp_path, f"{line}\n{SOUND}").tables.board == EXAMPLE


def test_positions_and_boards_that_cannot_be_name_their_line(tmp_path: Path) -> None:
    camera = '[[camera]]\nname = "a"\nserial = "1"\n'
    text = f"[board]\ncolumns = 7\nrows = 5\nsquare = 0.03\nmarker = 0.04\n{camera}"
    with pytest.raises(InputError, match=r"line 1: .*marker has to be smaller"):
        read(tmp_path, text)
    text = f"{camera}position = [1, 2]\n"
    with pytest.raises(InputError, match=r"line 4: .*three numbers, metres"):
        read(tmp_path, text)
    placed = read(tmp_path, text.replace("[1, 2]", "[1, 2.5, 0]"))
    assert placed.tables.camera[0].position == (1.0, 2.5, 0.0)


@settings(max_examples=100)
@given(serial=st.text(st.characters(exclude_categories=["Cs"]), min_size=1), make=st.text())
def test_whatever_cameras_say_of_themselves_stays_text(serial: str, make: str) -> None:
    (camera,) = tomllib.loads(rig_file_text([listed(serial, make)]))["camera"]
    assert camera == {"name": "cam0", "serial": serial}


def test_cameras_that_could_not_be_asked_are_comments(tmp_path: Path) -> None:
    silent = ConnectedCamera("PTP", "USB 001:003", error="USB 001:003 is held\nby another program.")
    text = rig_file_text([silent, listed("A")])
    assert "# Left out: USB 001:003 is held by another program." in text
    assert len(read(tmp_path, text).tables.camera) == 1
    with pytest.raises(CaptureError, match="no camera can be used"):
        rig_file_text([silent])
    with pytest.raises(CaptureError, match="no camera is connected"):
        rig_file_text([])


def test_cameras_that_cannot_be_told_apart_are_refused() -> None:
    with pytest.raises(CaptureError, match="2 cameras have the serial number 'A'"):
        rig_file_text([listed("A"), listed("B"), listed("A")])
