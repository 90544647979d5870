"""HDR that only a stream of pictures states, as encoders write it, read as FFmpeg reads it."""

import re
import subprocess
from pathlib import Path

import cv2
import imageio_ffmpeg
import numpy as np
import pytest

from capture.imports.photos import import_photos
from capture.imports.video.stream_colours import UNSAID, colours_in, stream_colours
from imaging.errors import InputError

SOURCE = "-f lavfi -i testsrc=size=64x48:rate=10:duration=0.5"
X264 = "-c:v libx264 -x264-params colorprim={}:transfer={}:colormatrix=bt709"
X265 = "-c:v libx265 -x265-params log-level=none:pools=1:colorprim={}:transfer={}:colormatrix=bt709"
AV1 = "-c:v libaom-av1 -cpu-used 8 -vf setparams=color_primaries={}:color_trc={} -movflags -write_colr"
PRORES = "-c:v prores_ks -vf setparams=color_primaries={}:color_trc={} -movflags -write_colr"


def ffmpeg(*arguments: str) -> str:
    ran = subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), "-nostdin", "-y", *arguments], check=False, capture_output=True
    )
    return ran.stderr.decode(errors="replace")


def clip(path: Path, coding: str, primaries: str = "bt709", transfer: str = "smpte2084") -> Path:
    """A video whose container states no colours."""
    ffmpeg("-v", "error", *SOURCE.split(), *coding.format(primaries, transfer).split(), str(path))
    assert b"colr" not in path.read_bytes()
    return path


CODINGS = {
    "h264": X264,
    "h264-lists": X264 + ":cqm=jvt -pix_fmt yuv444p",
    "h264-fields": X264 + ":interlaced=1:sar=4/3:overscan=show:videoformat=pal:fullrange=on -pix_fmt yuv420p",
    "h264-baseline": X264 + " -profile:v baseline -pix_fmt yuv420p",
    "hevc": X265 + " -pix_fmt yuv420p",
    "hevc-lists": X265 + ":scaling-list=default:sar=4:overscan=show:range=full -pix_fmt yuv444p10le",
    "hevc-layers": X265 + ":temporal-layers=3:bframes=4:repeat-headers=1 -pix_fmt yuv420p -tag:v hev1",
    "av1": AV1 + " -pix_fmt yuv420p",
    "av1-444": AV1 + " -pix_fmt yuv444p10le",
    "av1-grey": AV1 + " -pix_fmt gray",
}


@pytest.mark.parametrize("name", CODINGS)
def test_the_curve_that_an_encoder_writes(tmp_path: Path, name: str) -> None:
    colours = set(stream_colours(clip(tmp_path / "a.mp4", CODINGS[name])))
    assert colours == {(1, 16)}


@pytest.mark.parametrize(("name", "coding"), [
    ("a.mp4", X264), ("a.mkv", X264), ("a.avi", X264 + " -bsf:v h264_mp4toannexb"), ("a.mov", PRORES),
    ("b.mp4", X265), ("b.mkv", X265),
])  # fmt: skip
@pytest.mark.parametrize(("primaries", "transfer", "says"), [
    ("bt2020", "smpte2084", "is HDR coded by PQ"), ("bt709", "arib-std-b67", "is HDR coded by HLG"),
    ("smpte432", "bt709", "has Display P3 as the primaries"), ("bt709", "bt709", None),
])  # fmt: skip
def test_a_video_whose_stream_is_hdr_is_refused(
    tmp_path: Path, name: str, coding: str, primaries: str, transfer: str, says: str | None
) -> None:
    video = clip(tmp_path / name, coding, primaries, transfer)
    if says is None:
        assert import_photos(video, tmp_path / "s").frames == 1
        return
    with pytest.raises(InputError, match=rf"{name} {says}.*: export it as SDR"):
        import_photos(video, tmp_path / "s")
    assert not (tmp_path / "s").exists()


def test_so_is_av1(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is HDR coded by HLG"):
        import_photos(clip(tmp_path / "a.mp4", CODINGS["av1"], transfer="arib-std-b67"), tmp_path / "s")


def test_broadcasters_state_hlg_in_a_message(tmp_path: Path) -> None:
    video = clip(tmp_path / "a.mp4", X265 + ":atc-sei=18 -pix_fmt yuv420p", transfer="bt709")
    assert (2, 18) in set(stream_colours(video))
    with pytest.raises(InputError, match="is HDR coded by HLG"):
        import_photos(video, tmp_path / "s")


def test_vp9_states_it_in_its_box(tmp_path: Path) -> None:
    video = clip(
        tmp_path / "a.mp4", AV1.replace("libaom-av1 -cpu-used 8", "libvpx-vp9") + " -pix_fmt yuv420p"
    )
    assert list(stream_colours(video)) == []
    with pytest.raises(InputError, match="is HDR coded by PQ"):
        import_photos(video, tmp_path / "s")


@pytest.mark.parametrize(
    ("box", "says"),
    [
        (b"dvcC" + bytes([1, 0, 10, 9, compatible << 4]), "is HDR coded for Dolby Vision")
        for compatible in (0, 1, 4)
    ]
    + [(b"dvvC" + bytes([1, 0, 16, 9, 0x20]), None)]
    + [(b"colr" + kind, "has an ICC profile") for kind in (b"prof", b"rICC")],
)
def test_dolby_vision_and_profiles(tmp_path: Path, box: bytes, says: str | None) -> None:
    """A free box in moov stands for the sample entry's own, since a decoder knows what it is there."""
    video = clip(tmp_path / "a.mp4", X264, transfer="bt709")
    data = video.read_bytes()
    place = data.index(b"moov")
    inner = b"free" + box + bytes(20)
    inner = (len(inner) + 4).to_bytes(4) + inner
    length = int.from_bytes(data[place - 4 : place]) + len(inner)
    assert data.index(b"mdat") < place  # so that no offset moves
    video.write_bytes(data[: place - 4] + length.to_bytes(4) + data[place:] + inner)
    if says is None:
        assert import_photos(video, tmp_path / "s").frames == 1
    else:
        with pytest.raises(InputError, match=says):
            import_photos(video, tmp_path / "s")


class Written:
    """Bits of a parameter set, as a string."""

    def __init__(self) -> None:
        self.bits = ""

    def put(self, value: int, count: int = 1) -> "Written":
        self.bits += f"{value:0{count}b}"
        return self

    def golomb(self, *values: int) -> "Written":
        for value in values:
            code = f"{value + 1:b}"
            self.bits += "0" * (len(code) - 1) + code
        return self

    def unit(self, head: bytes) -> bytes:
        bits = self.bits + "1"
        body = int(bits + "0" * (-len(bits) % 8), 2).to_bytes(-(-len(bits) // 8))
        return head + re.sub(rb"\0\0(?=[\0-\3])", lambda _: b"\0\0\3", body)


def parameter_set(usability: bool = True) -> bytes:
    """One of HEVC with all that an encoder may put before its colours."""
    out = Written().put(0, 4).put(0, 3).put(1)  # its video's parameter set, layers, nesting
    out.put(0, 2).put(0).put(2, 5).put(0x60000000, 32).put(0b1001, 4).put(0, 44).put(93, 8)  # Main 10
    out.golomb(0, 1, 64, 48).put(1).golomb(0, 0, 0, 0)  # 4:2:0, size, window
    out.golomb(2, 2, 4).put(1).golomb(4, 2, 0)  # bits of samples and of the order, pictures kept
    out.golomb(0, 2, 0, 3, 1, 1).put(0).put(1).put(1)  # blocks, no lists, two filters
    out.put(1).put(7, 4).put(7, 4).golomb(0, 0).put(0)  # blocks as they are
    out.golomb(4)  # four sets of pictures
    out.golomb(3, 2)
    for step in (0, 1, 3):  # -1, -3, -7
        out.golomb(step).put(1)
    for step in (1, 2):  # 2, 5
        out.golomb(step).put(1)
    # From it by -2: -3, -5, -9, 0, 3 and -2 itself; the third is not kept, and a distance of 0 is none.
    out.put(1).put(1).golomb(1)
    for used, value in ((1, 1), (1, 1), (0, 0), (1, 1), (0, 1), (1, 1)):
        out.put(used)
        if not used:
            out.put(value)
    # From that, of four pictures, by 3.
    out.put(1).put(0).golomb(2)
    for _ in range(5):
        out.put(1)
    # Its own: of a set derived from -2, -3, -5, 3 by 3 there are 1, -2, 6 and 3, and 0 is none.
    out.put(0).golomb(1, 0).golomb(0).put(1)
    out.put(1).golomb(1).put(5, 8).put(1)  # one picture of long ago, of 8 bits
    out.put(1).put(1)  # two more filters
    out.put(int(usability))
    if usability:
        out.put(1).put(255, 8).put(4, 16).put(3, 16).put(1).put(0).put(1).put(5, 3).put(0).put(1)
        out.put(9, 8).put(16, 8).put(9, 8)
        out.put(0).put(0).put(0).put(0).put(0).put(0).put(0)  # nothing else of the VUI
    out.put(0)  # no extension
    return out.unit(b"\x42\x01")


def test_all_that_may_stand_before_the_colours_of_hevc(tmp_path: Path) -> None:
    data = b"\0\0\0\1" + parameter_set()
    assert list(colours_in(b"hevc", data)) == [(9, 16)]
    assert list(colours_in(b"hevc", b"\0\0\0\1" + parameter_set(usability=False))) == [UNSAID]
    # FFmpeg reads the same set between those of a stream.
    stream = clip(tmp_path / "a.hevc", X265 + " -pix_fmt yuv420p", transfer="bt709").read_bytes()
    units = stream.split(b"\0\0\0\1")
    number = next(n for n, unit in enumerate(units) if unit[:1] == b"\x42")
    units[number] = parameter_set()
    (tmp_path / "b.hevc").write_bytes(b"\0\0\0\1".join(units))
    said = ffmpeg(
        "-v", "verbose", "-f", "hevc", "-i", str(tmp_path / "b.hevc"), "-c", "copy",
        "-bsf:v", "trace_headers", "-f", "null", "-",
    )  # fmt: skip
    assert re.search(r"num_short_term_ref_pic_sets +\d+ = 4", said)
    assert re.search(r"transfer_characteristics +\d+ = 16", said)


@pytest.mark.parametrize("codec", [b"h264", b"hevc", b"av01", b"apch", b"VP90"])
def test_any_bytes_are_read_or_not(codec: bytes) -> None:
    rng = np.random.default_rng(3)
    whole = b"\0\0\0\1" + parameter_set() + b"\0\0\1\x67\x64\0\x0a" + bytes(rng.integers(0, 256, 60).tolist())
    for _ in range(400):
        data = bytearray(whole[: rng.integers(1, len(whole))])
        for place in rng.integers(0, len(data), 4):
            data[place] = rng.integers(0, 256)
        head = [b"", b"\1", b"\x81", b"\0\0\0\x20"][rng.integers(4)]
        for colours in colours_in(codec, head + bytes(data)):
            assert all(0 <= number < 256 for number in colours)


def test_what_is_no_video_states_nothing(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"no video")
    assert list(stream_colours(tmp_path / "a.mp4")) == []
    writer = cv2.VideoWriter(str(tmp_path / "b.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10, (64, 48))
    writer.write(np.zeros((48, 64, 3), np.uint8))
    writer.release()
    assert list(stream_colours(tmp_path / "b.avi")) == []
