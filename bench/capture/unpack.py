"""Unpacking of machine vision pixel formats on one core, beside numpy doing the same.

    python -m bench.capture.unpack [--quick] [--json] [--write]

Frames of 4 (in the cache) and of 24 megapixels (in memory); the median of the repetitions, both in turn in
one run. "kernel" is into memory that is used again, "frame" is `drivers.genicam.pixels.unpack`, which takes
new memory for each frame, as a camera does. --write puts the table into bench/results/unpack.md.
"""

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from bench.support.record import arguments, deliver, machine, words
from drivers.genicam import pixels
from drivers.genicam.pixels import BY_NAME, unpack
from imaging.arrays import Bytes

Pixels = npt.NDArray[np.uint16]
FORMATS = ("BayerRG12p", "BayerRG12Packed", "BayerRG10p", "BayerRG10Packed")
GOAL = 4.0
"""Gpixel/s of 12p on one core that the project wants."""


def with_numpy(data: Bytes, name: str) -> Pixels:
    """The same in numpy, as one would write it: whole groups of pixels."""
    if name == "BayerRG10p":
        five = data.reshape(-1, 5).astype(np.uint16)
        out = np.empty((len(five), 4), np.uint16)
        for place in range(4):
            shift = 2 * place
            out[:, place] = (five[:, place] >> shift) | (five[:, place + 1] << (8 - shift)) & 0x3FF
        return out.reshape(-1)
    first, middle, last = (data[start::3].astype(np.uint16) for start in range(3))
    out = np.empty((len(first), 2), np.uint16)
    if name == "BayerRG12p":
        out[:, 0], out[:, 1] = first | (middle & 15) << 8, middle >> 4 | last << 4
    elif name == "BayerRG12Packed":
        out[:, 0], out[:, 1] = first << 4 | middle & 15, last << 4 | middle >> 4
    else:
        out[:, 0], out[:, 1] = first << 2 | middle & 3, last << 2 | middle >> 4 & 3
    return out.reshape(-1)


def seconds(act: Callable[[], object]) -> float:
    began = time.perf_counter()
    act()
    return time.perf_counter() - began


def rate(name: str, megapixels: int, repetitions: int) -> dict[str, Any]:
    packed, height = BY_NAME[name], 1024 * megapixels // 4
    count = 4096 * height
    data = np.random.default_rng(0).integers(0, 256, packed.row_bytes(count)).astype(np.uint8)
    kernel: Callable[[Bytes, Pixels], None] = pixels._KERNELS[packed.bits, packed.packing]
    out = np.empty(count, np.uint16)
    acts: dict[str, Callable[[], object]] = {
        "kernel": lambda: kernel(data, out),
        "frame": lambda: unpack(data, packed, 4096, height),
        "numpy": lambda: with_numpy(data, name),
    }
    assert np.array_equal(unpack(data, packed, 4096, height).reshape(-1), with_numpy(data, name))
    kernel(data, out)
    times: dict[str, list[float]] = {what: [] for what in acts}
    for _ in range(repetitions):
        for what, act in acts.items():
            times[what].append(seconds(act))
    speeds = {what: count / statistics.median(taken) / 1e9 for what, taken in times.items()}
    return {"format": name, "megapixels": megapixels, **speeds, "ratio": speeds["kernel"] / speeds["numpy"]}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Unpacking machine vision frames",
        "",
        "`python -m bench.capture.unpack --write`: Gpixel/s on one core, beside numpy; the goal is "
        f"{GOAL:g} for 12p. {words(result['machine'])}.",
        "",
        "| format | Mpixel | kernel | into new memory | numpy | kernel / numpy |",
        "|---|---|---|---|---|---|",
    ]
    for row in result["rates"]:
        lines.append(
            f"| {row['format']} | {row['megapixels']} | {row['kernel']:.2f} | {row['frame']:.2f} | "
            f"{row['numpy']:.2f} | {row['ratio']:.1f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    options = parser.parse_args()
    sizes, repetitions = ((4,), 5) if options.quick else ((4, 24), 15)
    rates = [rate(name, size, repetitions) for name in FORMATS for size in sizes]
    result = {"machine": machine(), "rates": rates}
    deliver(options, "unpack", result, report(result))


if __name__ == "__main__":
    main()
