"""Unpacking against a slow reader of single bits, written from the naming convention's definition."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import CameraProtocol, CameraRefused
from drivers.genicam.pixels import BY_NAME, FORMATS, PixelFormat, format_of, unpack
from drivers.sim.genicam.pixels import pack
from imaging.arrays import Bytes
from imaging.sensor.cfa import Cfa


def bit_places(pixels: PixelFormat, index: int) -> list[int]:
    """Places of a pixel's bits in the payload, lowest first, as 8 * byte + bit."""
    bits = pixels.bits
    if pixels.packing == "plain":
        return [pixels.stored_bits * index + bit for bit in range(bits)]
    if pixels.packing == "p":
        return [bits * index + bit for bit in range(bits)]
    # Pairs of 3 bytes: the high 8 bits of each around a byte with the low bits of both.
    start = 24 * (index // 2)
    second, low = index % 2, bits - 8
    lower = [start + 8 + 4 * second + bit for bit in range(low)]
    return lower + [start + 16 * second + bit for bit in range(8)]


def slowly(data: bytes, pixels: PixelFormat, count: int) -> list[int]:
    return [
        sum((data[place // 8] >> place % 8 & 1) << bit for bit, place in enumerate(bit_places(pixels, index)))
        for index in range(count)
    ]


def payload(seed: int, size: int, pixels: PixelFormat) -> Bytes:
    data = np.random.default_rng(seed).integers(0, 256, size).astype(np.uint8)
    if pixels.packing == "plain" and pixels.stored_bits == 16:
        data[1::2] &= (1 << (pixels.bits - 8)) - 1  # The unused bits are zero.
    return data


@pytest.mark.parametrize("pixels", FORMATS, ids=lambda one: one.name)
@settings(max_examples=12)
@given(st.integers(1, 40), st.integers(1, 7), st.integers(0, 2**32 - 1))
def test_every_format_bit_by_bit(pixels: PixelFormat, width: int, height: int, seed: int) -> None:
    size = -(-width * height * pixels.stored_bits // 8)
    data = payload(seed, size, pixels)
    image = unpack(data, pixels, width, height)
    assert image.dtype == np.uint16
    assert image.shape == (height, width)
    assert image.reshape(-1).tolist() == slowly(data.tobytes(), pixels, width * height)


@pytest.mark.parametrize("name", ["BayerRG8", "BayerGB10p", "BayerBG12p", "BayerGR12Packed", "Mono16"])
@pytest.mark.parametrize(("width", "padding"), [(7, 1), (16, 4), (1, 3)])
def test_padded_rows_begin_at_bytes(name: str, width: int, padding: int) -> None:
    pixels, height = BY_NAME[name], 5
    row = -(-width * pixels.stored_bits // 8)
    data = payload(1, (row + padding) * height, pixels)
    image = unpack(data, pixels, width, height, padding)
    for index in range(height):
        begin = index * (row + padding)
        expected = slowly(data[begin : begin + row].tobytes(), pixels, width)
        assert image[index].tolist() == expected


@pytest.mark.parametrize("pixels", FORMATS, ids=lambda one: one.name)
def test_unaligned_and_longer_payloads_are_read_alike(pixels: PixelFormat) -> None:
    data = payload(2, 2 * 37 * 3 + 2, pixels)
    shifted = np.empty(len(data) + 1, np.uint8)[1:]
    shifted[:] = data
    assert np.array_equal(unpack(shifted, pixels, 37, 3), unpack(data, pixels, 37, 3))


@pytest.mark.parametrize("pixels", FORMATS, ids=lambda one: one.name)
def test_one_byte_too_few_is_refused(pixels: PixelFormat) -> None:
    size = -(-9 * 5 * pixels.stored_bits // 8)
    with pytest.raises(CameraProtocol, match=pixels.name):
        unpack(np.zeros(size - 1, np.uint8), pixels, 9, 5)


def test_the_long_loop_of_12p_agrees_with_numpy() -> None:
    data = payload(3, 3 * 50_000, BY_NAME["BayerRG12p"])
    a, b, c = (data[start::3].astype(int) for start in range(3))
    expected = np.stack([a + 256 * (b % 16), b // 16 + 16 * c], 1).reshape(-1)
    assert np.array_equal(unpack(data, BY_NAME["BayerRG12p"], 100_000, 1)[0], expected)


@pytest.mark.parametrize("pixels", FORMATS, ids=lambda one: one.name)
@pytest.mark.parametrize(("width", "height"), [(1, 1), (8, 3), (7, 5)])
def test_what_the_simulated_camera_packs_is_unpacked(pixels: PixelFormat, width: int, height: int) -> None:
    values = np.random.default_rng(4).integers(0, 1 << pixels.bits, (height, width)).astype(np.uint16)
    data = np.frombuffer(pack(values, pixels), np.uint8)
    assert len(data) == pixels.row_bytes(width * height)
    assert np.array_equal(unpack(data, pixels, width, height), values)


CODES: dict[str, tuple[int, Cfa]] = {
    "BayerRG8": (0x01080009, Cfa.RGGB),
    "BayerBG12p": (0x010C0053, Cfa.BGGR),
    "BayerGB12p": (0x010C0055, Cfa.GBRG),
    "BayerGR12p": (0x010C0057, Cfa.GRBG),
    "BayerRG12p": (0x010C0059, Cfa.RGGB),
    "BayerBG10p": (0x010A0052, Cfa.BGGR),
    "BayerRG10p": (0x010A0058, Cfa.RGGB),
    "BayerGR16": (0x0110002E, Cfa.GRBG),
    "BayerGB12Packed": (0x010C002C, Cfa.GBRG),
    "BayerGB10Packed": (0x010C0028, Cfa.GBRG),
    "Mono12p": (0x010C0047, Cfa.MONO),
}


@pytest.mark.parametrize(("name", "expected"), CODES.items())
def test_codes_and_phases(name: str, expected: Any) -> None:
    pixels = BY_NAME[name]
    assert (pixels.code, pixels.cfa) == expected
    assert format_of(expected[0]) is pixels


def test_no_code_is_there_twice() -> None:
    assert len({one.code for one in FORMATS}) == len({one.name for one in FORMATS}) == len(FORMATS) == 40


def test_an_unknown_code_is_refused() -> None:
    with pytest.raises(CameraRefused, match="0x02180014"):
        format_of(0x02180014)
