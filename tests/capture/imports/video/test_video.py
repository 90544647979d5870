"""The sharpest frames of a video become photographs of one camera."""

import struct
from pathlib import Path

import cv2
import imageio_ffmpeg
import numpy as np
import pytest

from capture.imports.photos import import_photos
from capture.imports.video import video
from imaging.errors import InputError
from imaging.files.photo import read_photo
from imaging.session.session import Session


def test_of_every_half_second_the_sharpest_frame_is_taken(tmp_path):
    rng = np.random.default_rng(0)
    cells = [rng.integers(20, 235, (12, 16, 3)).astype(np.uint8) for _ in range(3)]
    sharp = [cv2.resize(one, (128, 96), interpolation=cv2.INTER_NEAREST) for one in cells]
    frames = [one if n == 3 else cv2.GaussianBlur(one, (0, 0), 4) for one in sharp for n in range(5)]
    clip = tmp_path / "clip.mp4"
    writer = cv2.VideoWriter(str(clip), cv2.VideoWriter_fourcc(*"mp4v"), 10, (128, 96))
    for frame in frames:
        writer.write(np.ascontiguousarray(frame[..., ::-1]))
    writer.release()
    said = []
    result = import_photos(
        clip, tmp_path / "s", on_progress=lambda message, done, total: said.append(message)
    )
    assert (result.cameras, result.frames, result.missing) == (1, 3, ())
    assert "3 frames of clip.mp4 are taken, the sharpest of every 0.5 s." in result.guesses[0]
    assert "reading the video" in said
    session = Session.open(tmp_path / "s")
    assert session.shots()[1].source == f"{clip}: clip_0002.png"
    for shot, expected in zip(session.shots(), sharp, strict=True):
        there = read_photo(session.file(shot)).pixels
        blurred = cv2.GaussianBlur(expected, (0, 0), 4)
        assert np.abs(there - expected / 255).mean() < 0.5 * np.abs(there - blurred / 255).mean()


def coded(clip: Path, frames: int, *options: str) -> None:
    """Write a Matroska video of 20 frames a second, each brighter than the last."""
    write = imageio_ffmpeg.write_frames(
        str(clip), (64, 48), fps=20, codec="libx264", pix_fmt_out="yuv420p", macro_block_size=1,
        output_params=["-qp", "10", *options],
    )  # fmt: skip
    write.send(None)
    for level in range(frames):
        write.send(np.full((48, 64, 3), 20 + 5 * level, np.uint8))
    write.close()


def levels(folder: Path) -> list[int]:
    """Numbers of the frames that were taken."""
    return [round((255 * read_photo(path).pixels.mean() - 20) / 5) for path in sorted(folder.iterdir())]


def test_a_video_written_live_which_states_no_length_is_divided_all_the_same(tmp_path, monkeypatch):
    clip = tmp_path / "clip.mkv"
    coded(clip, 40, "-live", "1")
    assert cv2.VideoCapture(str(clip)).get(cv2.CAP_PROP_FRAME_COUNT) < 1
    monkeypatch.setattr(video, "MOST", 2)
    steps = []
    said = video.take_frames(clip, tmp_path / "f", lambda message, done, total: steps.append((done, total)))
    assert "2 frames of clip.mkv are taken, the sharpest of every 1 s." in said
    assert len(levels(tmp_path / "f")) == 2
    assert steps[2:] == [(21, 40), (40, 40), (40, 40)]


def test_the_parts_of_a_video_of_variable_rate_are_equally_long(tmp_path):
    """A second of 20 frames, then four of one each."""
    clip = tmp_path / "clip.mkv"
    coded(clip, 24, "-vf", "setpts='if(lt(N,20),N/20,N-19)/TB'", "-fps_mode", "vfr")
    video.take_frames(clip, tmp_path / "f", lambda message, done, total: None)
    first, second, *others = levels(tmp_path / "f")
    assert first < 10 <= second < 20
    assert others == [20, 21, 22, 23]


def test_frames_whose_times_do_not_rise_are_counted_by_the_rate():
    class Still:
        number = 0

        def grab(self):
            self.number += 1
            return self.number <= 4

        def get(self, key):
            return (7.0, 7.0, 257.0, float("nan"))[self.number - 1]

    assert list(video._times(Still(), 10.0)) == pytest.approx([0, 0.1, 0.25, 0.35])


def test_a_killed_import_of_a_video_is_completed(tmp_path):
    clip = tmp_path / "clip.mp4"
    clip_in(clip, "mp4v", frames=15)

    class Killed(KeyboardInterrupt):
        pass

    def until_the_second(message, done, total):
        if message.startswith("copying") and done == 1:
            raise Killed

    with pytest.raises(Killed):
        import_photos(clip, tmp_path / "s", on_progress=until_the_second)
    assert len(Session.open(tmp_path / "s").shots()) == 1
    assert import_photos(clip, tmp_path / "s").frames == len(Session.open(tmp_path / "s").shots()) == 3
    with pytest.raises(InputError, match="holds this import already, complete"):
        import_photos(clip, tmp_path / "s")


@pytest.mark.parametrize(
    "option",
    [
        {"exposures": "list.txt"},
        {"depths": "depths"},
        {"bands": "bands.txt"},
        {"layout": "colmap"},
        {"cameras": "serial"},
        {"bracket": 3},
        {"together": "time"},
        {"pixel_shift": True},
    ],
)
def test_options_that_frames_cannot_follow_are_refused(tmp_path, option):
    clip = tmp_path / "clip.mp4"
    clip_in(clip, "mp4v")
    name = "--" + next(iter(option)).replace("_", "-")
    with pytest.raises(InputError, match=f"is a video, and {name} is for photographs: leave"):
        import_photos(clip, tmp_path / "s", **option)
    assert not (tmp_path / "s").exists()


def boxed(data: bytes, kinds: list[bytes], box: bytes) -> bytes:
    """The boxes of `data` with another at the end of the one that `kinds` lead to."""
    out, at = b"", 0
    while at + 8 <= len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + length]
        if kinds and kind == kinds[0]:
            lead = {b"stsd": 8, b"mp4v": 78}.get(kind, 0)
            body = body[:lead] + (boxed(body[lead:], kinds[1:], box) if kinds[1:] else body[lead:] + box)
        out, at = out + struct.pack(">I4s", len(body) + 8, kind) + body, at + length
    return out


REFUSED = [
    (9, 16, "is HDR coded by PQ, .*"),
    (9, 18, "is HDR coded by HLG, .*"),
    (9, 14, "has BT.2020 as the primaries of its colours"),
    (12, 1, "has Display P3 as the primaries of its colours"),
    (1, 1, None),
    (2, 2, None),
]
"""ColourPrimaries, TransferCharacteristics, and what is said of them."""


def clip_in(path: Path, code: str, frames: int = 2) -> bytes:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), 10, (128, 96))
    for level in range(60, 60 + 5 * frames, 5):
        writer.write(np.full((96, 128, 3), level, np.uint8))
    writer.release()
    return path.read_bytes()


def judge(clip: Path, session: Path, says: str | None) -> None:
    if says is None:
        assert import_photos(clip, session).frames == 1
        return
    with pytest.raises(InputError, match=rf"{clip.name} {says}: export it as SDR"):
        import_photos(clip, session)
    assert not session.exists()


@pytest.mark.parametrize("form", [b"nclx", b"nclc"])
@pytest.mark.parametrize(("primaries", "transfer", "says"), REFUSED)
def test_a_video_in_colours_of_other_displays_is_refused(tmp_path, form, primaries, transfer, says):
    clip = tmp_path / "clip.mp4"
    plain = clip_in(clip, "mp4v")
    colour = b"colr" + form + struct.pack(">3H", primaries, transfer, 9) + (b"\x80" * (form == b"nclx"))
    box = struct.pack(">I", len(colour) + 4) + colour
    path = [b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd", b"mp4v"]
    assert plain.index(b"mdat") < plain.index(b"moov")  # so that no offset moves
    clip.write_bytes(boxed(plain, path, box))
    judge(clip, tmp_path / "s", says)


@pytest.mark.parametrize(("primaries", "transfer", "says"), REFUSED)
def test_so_is_one_of_matroska(tmp_path, primaries, transfer, says):
    clip = tmp_path / "clip.mkv"
    write = imageio_ffmpeg.write_frames(
        str(clip), (64, 48), fps=10, codec="libx264", pix_fmt_out="yuv420p", macro_block_size=1,
        output_params=["-vf", f"setparams=color_primaries={primaries}:color_trc={transfer}"],
    )  # fmt: skip
    write.send(None)
    for level in (60, 120):
        write.send(np.full((48, 64, 3), level, np.uint8))
    write.close()
    judge(clip, tmp_path / "s", says)


def test_what_is_no_video_is_refused_and_leaves_nothing(tmp_path):
    clip = Path(tmp_path / "clip.mp4")
    clip.write_bytes(b"no video")
    with pytest.raises(InputError, match=r"clip\.mp4 cannot be read as a video"):
        import_photos(clip, tmp_path / "s")
    assert not (tmp_path / "s").exists()
