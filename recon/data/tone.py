"""Linear light to code values: the way back of `imaging.merge.linear_frame.decode`."""

import numpy as np

from imaging.arrays import Array32, Floats
from imaging.colour.spaces import srgb_encode
from imaging.session.calibration import Response


def encode(light: Floats, response: Response) -> Array32:
    """Linear light times exposure scale [..., 3] -> code values, clipped to 0..1, float32 [..., 3].

    Below the lowest code of a measured curve the code falls in proportion to the light.
    """
    if response.kind == "linear":
        return np.asarray(np.clip(light, 0, 1), np.float32)
    if response.kind == "srgb":
        return np.asarray(srgb_encode(np.clip(light, 0, 1)), np.float32)
    nodes = np.asarray(response.codes)
    codes = []
    for channel, curve in enumerate(response.log_exposure):
        low = np.exp(curve[0])
        inside = np.interp(np.log(np.maximum(light[..., channel], low)), curve, nodes)
        codes.append(np.where(light[..., channel] < low, nodes[0] * light[..., channel] / low, inside))
    return np.asarray(np.clip(np.stack(codes, -1), 0, 1), np.float32)
