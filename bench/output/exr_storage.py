"""Size and error of the storages of light in EXR, of renders of a scene and of its merged photographs.

    python -m bench.output.exr_storage demo/ [--json] [--write]

Of sessions with a scene, such as that of `make demo`: their views as trained, and their brackets.
"""

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from bench.support.record import arguments, deliver
from calib.exports.merge_session import merge
from imaging.choices import ExrStorage
from imaging.files.exr.reading import read_exr
from imaging.files.exr.writing import write_exr
from recon.exports.loss import stops_between
from recon.rendering.render import render

FAINT = 2.0**-10
"""Light below which stops do not count; white is 1."""


def measure(options: argparse.Namespace) -> dict[str, Any]:
    rows = []
    for session in options.sessions:
        with tempfile.TemporaryDirectory() as made:
            rendered = [path for path in render(session, Path(made) / "renders") if path.suffix == ".exr"]
            merged = [view.file for view in merge(session, Path(made) / "plates").views]
            for kind, files in (("renders", rendered), ("plates", merged)):
                rows += [
                    {"session": session.name, "of": kind, "storage": storage} | compared(files, storage)
                    for storage in get_args(ExrStorage)
                ]
    return {"rows": rows}


def compared(files: Sequence[Path], storage: ExrStorage) -> dict[str, float]:
    """Bytes a pixel of the light alone, and stops by which it is off: median, in 1 %, at most."""
    size, pixels, off = 0, 0, []
    for path in files:
        light = read_exr(path).rgb()
        again = path.with_suffix(".again.exr")
        write_exr(again, light, storage=storage)
        size, pixels = size + again.stat().st_size, pixels + light[..., 0].size
        off.append(stops_between(light, read_exr(again).rgb(), FAINT).ravel())
    stops = np.concatenate(off)
    return {
        "bytes": size / pixels,
        "median": float(np.median(stops)),
        "p99": float(np.quantile(stops, 0.99)),
        "most": float(stops.max()),
    }


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Storages of light in EXR",
        "",
        "`python -m bench.output.exr_storage demo/ --write`, after `make demo`. All views as `rig render` "
        "and `rig merge` write them: bytes a pixel of the light, and stops by which what is read back is "
        "off, light below a 1024th of white counted as that.",
        "",
        "| session | pictures | --exr | bytes a pixel | stops, median | in 1 % | at most |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        values = f"{row['bytes']:.1f} | {row['median']:.2g} | {row['p99']:.2g} | {row['most']:.2g}"
        lines.append(f"| {row['session']} | {row['of']} | {row['storage']} | {values} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("sessions", type=Path, nargs="+")
    options = parser.parse_args()
    result = measure(options)
    deliver(options, "exr_storage", result, report(result))


if __name__ == "__main__":
    main()
