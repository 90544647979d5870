"""Values packed as a machine vision camera sends them: the other way round from `drivers.genicam.pixels`.

Written from bits, not from that module's kernels, so that both cannot share a mistake.
"""

import numpy as np
import numpy.typing as npt

from drivers.genicam.pixels import PixelFormat


def pack(values: npt.NDArray[np.uint16], pixels: PixelFormat) -> bytes:
    """The payload of an image [H, W], without padding."""
    flat = values.reshape(-1)
    if pixels.packing == "plain":
        return flat.astype("<u2" if pixels.stored_bits == 16 else "u1").tobytes()
    # One row of bits a pixel, the lowest first.
    bits = np.unpackbits(flat.astype("<u2").view(np.uint8).reshape(-1, 2), axis=1, bitorder="little")
    bits = bits[:, : pixels.bits]
    if pixels.packing == "p":
        return np.packbits(bits.reshape(-1), bitorder="little").tobytes()
    size = pixels.row_bytes(len(flat))
    if len(flat) % 2:
        bits = np.concatenate([bits, np.zeros((1, pixels.bits), np.uint8)])
    low = pixels.bits - 8
    groups = np.zeros((len(bits) // 2, 24), np.uint8)
    groups[:, :8], groups[:, 16:] = bits[0::2, low:], bits[1::2, low:]
    groups[:, 8 : 8 + low], groups[:, 12 : 12 + low] = bits[0::2, :low], bits[1::2, :low]
    return np.packbits(groups.reshape(-1), bitorder="little").tobytes()[:size]
