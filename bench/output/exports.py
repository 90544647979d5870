"""Loss of a scene's light in each format of `rig export`, and the size of its file.

    python -m bench.output.exports demo/ [--json] [--write]

Of scenes that are trained, such as that of `make demo`. The loss is that of the command: the Gaussians as the
file holds them against those of the scene, and pictures drawn of both.
"""

import argparse
import math
import tempfile
from pathlib import Path
from typing import Any

from bench.support.record import arguments, deliver, machine, words
from recon.exports.export import export
from recon.exports.request import ExportRequest, FormatName
from recon.result.scene import Scene, open_scene

FORMATS: tuple[tuple[FormatName, bool | None], ...] = (
    ("usd", True),
    ("glb", True),
    ("ply", True),
    ("html", True),
    ("sog", True),
    ("sog", None),
    ("glb", False),
    ("ply", False),
    ("sog", False),
    ("spz", False),
)
"""Each with whether its light is linear; None: codes above white, too."""
ENDS = {"usd": "usdc"}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    rows = []
    for folder in options.scenes:
        scene = open_scene(folder)
        rows += [{"scene": scene.folder.name} | one(scene, format, linear) for format, linear in FORMATS]
    return {"machine": machine(), "rows": rows}


def one(scene: Scene, format: FormatName, linear: bool | None) -> dict[str, Any]:
    """A file, and what it lost."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"scene.{ENDS.get(format, format)}"
        # A stated exposure, so that display values are fitted as today and not as at the scene's training.
        exposure = math.log2(scene.exposure)
        exported = export(scene, file, ExportRequest(format, linear, exposure))
        return exported.data()


def report(result: dict[str, Any]) -> str:
    lines = [
        "# What formats of other programs lose of the light",
        "",
        "`python -m bench.output.exports demo/ --write`, after `make demo`. Stops, without sign: of the "
        "light of single Gaussians in the median and at worst, of the pixels of four views, clipped ones "
        "left out, in the median and in 1 %; the share of pixels brighter than the file holds. Display "
        "values and codes as PlayCanvas and Spark draw them. "
        f"{words(result['machine'])}.",
        "",
        "| scene | format | light | Gaussians | bytes each | of a Gaussian | of a pixel | clipped |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        loss = row["loss"]
        of_gaussians = "-"
        if loss["gaussian_median"] is not None:
            of_gaussians = f"{stops(loss['gaussian_median'])}, {stops(loss['gaussian_worst'])}"
        cells = (
            row["scene"],
            row["format"],
            "linear" if row["linear"] else "display" if row["brightest"] == 1 else "codes",
            f"{row['gaussians']:,}",
            f"{row['bytes'] / row['gaussians']:.0f}",
            of_gaussians,
            f"{stops(loss['pixel_median'])}, {stops(loss['pixel_p99'])}",
            f"{100 * loss['clipped']:.1f} %",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def stops(value: float) -> str:
    return f"{value:.2g}" if value >= 0.001 else "< 0.001"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("scenes", type=Path, nargs="+")
    options = parser.parse_args()
    result = measure(options)
    deliver(options, "exports", result, report(result))


if __name__ == "__main__":
    main()
