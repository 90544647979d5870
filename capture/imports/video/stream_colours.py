"""Colour that a stream of pictures states itself: H.264 (ITU-T H.264), HEVC (H.265), AV1 and ProRes.

Of a video's first packet and the codec's own data. Numbers are those of ITU-T H.273; what a stream does not
say, or says in a form that is not understood, is unspecified.
"""

import struct
from collections.abc import Iterator
from pathlib import Path

import cv2

from imaging.files.silence import quiet
from imaging.files.tags.cicp import UNSPECIFIED

Colours = tuple[int, int]
"""ColourPrimaries and TransferCharacteristics."""
UNSAID = (UNSPECIFIED, UNSPECIFIED)

_FLEXIBLE = (100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135)
"""Profiles of H.264 whose parameter sets say the sampling of colours."""
_LONGEST = 4096
"""Bytes of a parameter set that are looked through."""
_MOST_SETS = 64
_ALTERNATIVE = 147
"""Message by which broadcasters state HLG in a stream that old displays take for SDR."""


def stream_colours(video: Path) -> Iterator[Colours]:
    """Colours that a video's codec states, each once for every place that does."""
    with quiet():
        capture = cv2.VideoCapture(str(video), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
        try:
            if not capture.isOpened():
                return
            code = int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
            codec = code.to_bytes(4, "little").lower()
            there, packet = capture.read()
            known, extra = capture.retrieve(flag=int(capture.get(cv2.CAP_PROP_CODEC_EXTRADATA_INDEX)))
        finally:
            capture.release()
    for read, data in ((known, extra), (there, packet)):
        if read and data is not None:
            yield from colours_in(codec, data.tobytes())


def colours_in(codec: bytes, data: bytes) -> Iterator[Colours]:
    """Colours stated in a packet or in a codec's own data (avcC, hvcC, av1C, or plain units)."""
    try:
        if data[4:8] == b"icpf" and len(data) > 24:
            yield data[22], data[23]
        elif codec == b"av01":
            yield from (_av1(unit) for unit in _open_units(data[4:] if data[:1] == b"\x81" else data))
        elif codec in (b"h264", b"hevc"):
            hevc = codec == b"hevc"
            for unit in _units(data, hevc):
                kind = unit[0] >> 1 & 63 if hevc else unit[0] & 31
                body = unit[2 if hevc else 1 :].replace(b"\0\0\3", b"\0\0")
                if kind == (33 if hevc else 7):
                    yield (_hevc if hevc else _h264)(_Bits(body[:_LONGEST]))
                elif kind == (39 if hevc else 6):
                    yield from _messages(body)
    except (IndexError, struct.error):
        return


class _Bits:
    """Bits of a parameter set, the highest of a byte first; IndexError behind the last one."""

    def __init__(self, data: bytes) -> None:
        self._value, self._remaining = int.from_bytes(data), 8 * len(data)

    def take(self, count: int = 1) -> int:
        """The next bits as a number."""
        if count > self._remaining:
            raise IndexError
        self._remaining -= count
        return self._value >> self._remaining & (1 << count) - 1

    def skip(self, *counts: int) -> None:
        """Leave out numbers of these sizes, in bits."""
        for count in counts:
            self.take(count)

    def golomb(self) -> int:
        """A number of as many bits as it needs: ue(v)."""
        zeros = 0
        while not self.take():
            zeros += 1
        return (1 << zeros) - 1 + self.take(zeros)

    def signed(self) -> int:
        """The same with a sign: se(v)."""
        number = self.golomb()
        return (number + 1) // 2 if number % 2 else -(number // 2)

    def golombs(self, count: int) -> None:
        """Leave out some of them."""
        for _ in range(count):
            self.golomb()


def _units(data: bytes, hevc: bool) -> Iterator[bytes]:
    """Units of a stream: behind start codes, in the records of MP4, or behind their lengths."""
    if data[:3] == b"\0\0\1" or data[:4] == b"\0\0\0\1":
        yield from (unit for unit in data.split(b"\0\0\1") if unit.strip(b"\0"))
        return
    if data[:1] != b"\1":
        yield from _behind_lengths(data, 0, len(data), 4)
        return
    place, groups = (22, data[22]) if hevc else (5, 1)
    place += hevc
    for _ in range(groups):
        if hevc:
            count, place = struct.unpack_from(">H", data, place + 1)[0], place + 3
        else:
            count, place = data[place] & 31, place + 1
        for unit in _behind_lengths(data, place, count, 2):
            yield unit
            place += 2 + len(unit)


def _behind_lengths(data: bytes, place: int, count: int, size: int) -> Iterator[bytes]:
    while place + size < len(data) and count:
        length = int.from_bytes(data[place : place + size])
        if not length:
            return
        yield data[place + size : place + size + length]
        place, count = place + size + length, count - 1


def _messages(body: bytes) -> Iterator[Colours]:
    """Curves of a unit of supplemental enhancement information."""
    place = 0
    while place + 2 < len(body):
        numbers = []
        for _ in range(2):
            number = 0
            while body[place] == 255:
                number, place = number + 255, place + 1
            numbers.append(number + body[place])
            place += 1
        if numbers[0] == _ALTERNATIVE and numbers[1]:
            yield UNSPECIFIED, body[place]
        place += numbers[1]


def _usability(bits: _Bits) -> Colours:
    """Colours of the VUI, which begins alike in H.264 and HEVC."""
    if not bits.take():
        return UNSAID
    if bits.take() and bits.take(8) == 255:
        bits.skip(16, 16)
    if bits.take():
        bits.skip(1)
    if not bits.take():
        return UNSAID
    bits.skip(3, 1)
    return (bits.take(8), bits.take(8)) if bits.take() else UNSAID


def _h264(bits: _Bits) -> Colours:
    """Colours of a sequence parameter set, 7.3.2.1.1."""
    profile = bits.take(8)
    bits.skip(8, 8)
    bits.golomb()
    if profile in _FLEXIBLE:
        sampling = bits.golomb()
        bits.skip(*[1] * (sampling == 3))
        bits.golombs(2)
        bits.skip(1)
        if bits.take():
            for number in range(12 if sampling == 3 else 8):
                if bits.take():
                    _scaling_list(bits, 16 if number < 6 else 64)
    bits.golomb()
    order = bits.golomb()
    if order == 0:
        bits.golomb()
    elif order == 1:
        bits.skip(1)
        bits.golombs(2)
        bits.golombs(bits.golomb())
    bits.golomb()
    bits.skip(1)
    bits.golombs(2)
    if not bits.take():
        bits.skip(1)
    bits.skip(1)
    if bits.take():
        bits.golombs(4)
    return _usability(bits)


def _scaling_list(bits: _Bits, count: int) -> None:
    last = following = 8
    for _ in range(count):
        if following:
            following = (last + bits.signed()) % 256
        last = following or last


def _hevc(bits: _Bits) -> Colours:
    """Colours of a sequence parameter set, 7.3.2.2."""
    bits.skip(4)
    layers = bits.take(3)
    bits.skip(1, 96)
    present = [(bits.take(), bits.take()) for _ in range(layers)]
    bits.skip(*[2] * (8 - layers if layers else 0))
    for profile, level in present:
        bits.skip(88 * profile, 8 * level)
    bits.golomb()
    if bits.golomb() == 3:
        bits.skip(1)
    bits.golombs(2)
    if bits.take():
        bits.golombs(4)
    bits.golombs(2)
    order_bits = bits.golomb() + 4
    bits.golombs(3 * (layers + 1 if bits.take() else 1))
    bits.golombs(6)
    if bits.take() and bits.take():
        _scaling_lists(bits)
    bits.skip(2)
    if bits.take():
        bits.skip(4, 4)
        bits.golombs(2)
        bits.skip(1)
    pictures: list[list[int]] = []
    for _ in range(min(bits.golomb(), _MOST_SETS)):
        pictures.append(_references(bits, pictures))
    if bits.take():
        for _ in range(bits.golomb()):
            bits.skip(order_bits, 1)
    bits.skip(2)
    return _usability(bits)


def _scaling_lists(bits: _Bits) -> None:
    for size in range(4):
        for _ in range(0, 6, 3 if size == 3 else 1):
            if not bits.take():
                bits.golomb()
                continue
            if size > 1:
                bits.signed()
            bits.golombs(min(64, 1 << 4 + 2 * size))


def _references(bits: _Bits, before: list[list[int]]) -> list[int]:
    """Distances of a set of pictures that others are predicted from, those before first, nearest first."""
    if before and bits.take():
        sign = bits.take()
        step = (bits.golomb() + 1) * (-1 if sign else 1)
        candidates = [distance + step for distance in before[-1]] + [step]
        distances = [distance for distance in candidates if bits.take() or bits.take()]
    else:
        counts = bits.golomb(), bits.golomb()
        if sum(counts) > _MOST_SETS:
            raise IndexError
        distances = []
        for sign, count in zip((-1, 1), counts, strict=True):
            distance = 0
            for _ in range(count):
                distance += sign * (bits.golomb() + 1)
                bits.skip(1)
                distances.append(distance)
    earlier = sorted((distance for distance in distances if distance < 0), reverse=True)
    return earlier + sorted(distance for distance in distances if distance > 0)


def _open_units(data: bytes) -> Iterator[bytes]:
    """Sequence headers among the units of AV1 (AV1 Bitstream and Decoding Process Specification, 5.3)."""
    place = 0
    while place < len(data):
        head, place = data[place], place + 1
        place += head >> 2 & 1
        if not head & 2:
            length = len(data) - place
        else:
            length = shift = 0
            while True:
                part, place = data[place], place + 1
                length |= (part & 127) << shift
                shift += 7
                if part < 128 or shift > 56:
                    break
        if head >> 3 & 15 == 1:
            yield data[place : place + length]
        place += length


def _av1(unit: bytes) -> Colours:
    """Colours of a sequence header, 5.5."""
    bits = _Bits(unit[:_LONGEST])
    profile, _, reduced = bits.take(3), bits.take(), bits.take()
    if reduced:
        bits.skip(5)
    else:
        _operating_points(bits)
    widths = bits.take(4) + 1, bits.take(4) + 1
    bits.skip(*widths)
    if not reduced and bits.take():
        bits.skip(4, 3)
    bits.skip(1, 1, 1)
    if not reduced:
        bits.skip(1, 1, 1, 1)
        ordered = bits.take()
        bits.skip(*[1, 1] * ordered)
        forced = 2 if bits.take() else bits.take()
        if forced and not bits.take():
            bits.skip(1)
        bits.skip(3 * ordered)
    bits.skip(1, 1, 1)
    if bits.take() and profile == 2:
        bits.skip(1)
    if profile != 1:
        bits.skip(1)
    return (bits.take(8), bits.take(8)) if bits.take() else UNSAID


def _operating_points(bits: _Bits) -> None:
    delay = 0
    if bits.take():
        bits.skip(32, 32)
        if bits.take():
            bits.golomb()
        if bits.take():
            delay = bits.take(5) + 1
            bits.skip(32, 5, 5)
    displayed = bits.take()
    for _ in range(bits.take(5) + 1):
        bits.skip(12)
        if bits.take(5) > 7:
            bits.skip(1)
        if delay and bits.take():
            bits.skip(delay, delay, 1)
        if displayed and bits.take():
            bits.skip(4)
