"""Pictures of a scene by viewers of others, from files of `rig export`, against the light that they are of.

    python -m bench.output.viewers demo/ [--json] [--write]

Of scenes that are trained, such as that of `make demo`. Needs Chromium and the viewers that `.ci/run`
installs.
With --work FOLDER the files and the pictures stay there.
"""

import argparse
import math
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from bench.support.record import arguments, deliver
from imaging.colour.spaces import srgb_decode
from imaging.session.paths import find_reconstruction
from recon.exports.export import export
from recon.exports.loss import stops_between
from recon.exports.target_coordinates import pinhole
from recon.result.display import displayed
from recon.result.scene import Scene, open_scene
from recon.splat import SplatCamera
from tests.chromium import chromium
from tests.foreign_viewers.viewers import MODULES, PACKAGES, Viewer, turn_of

FILES: tuple[tuple[str, str, bool | None], ...] = (
    ("playcanvas", "sog", None),
    ("playcanvas", "sog", True),
    ("playcanvas", "ply", None),
    ("playcanvas", "glb", None),
    ("spark", "ply", None),
    ("spark", "spz", None),
    ("babylon", "ply", None),
    ("babylon", "glb", None),
    ("babylon", "spz", None),
    ("babylon", "sog", None),
    ("three", "ply", None),
    ("three", "spz", None),
    ("three", "glb", True),
)
"""Viewer, format, and whether light is linear; None: by default."""
FAINT = 2.0**-10
"""Light below which stops do not count; white is 1."""


def measure(options: argparse.Namespace) -> dict[str, Any]:
    scene = open_scene(find_reconstruction(options.scene))
    camera = straight(scene)
    light = scene.render(camera) * scene.exposure
    rows = []
    versions = {name: (MODULES / PACKAGES[name][0] / "package.json").read_text() for name, _, _ in FILES}
    with tempfile.TemporaryDirectory() as made, chromium() as browser:
        folder = options.work or Path(made)
        folder.mkdir(parents=True, exist_ok=True)
        Image.fromarray(displayed(light, 1.0)).save(folder / "rig.png")
        for name in versions:
            with Viewer(browser, name, camera.width, camera.height) as viewer:
                for file, linear in [(file, linear) for viewed, file, linear in FILES if viewed == name]:
                    path = folder / f"scene{'-linear' if linear else ''}.{file}"
                    # A stated exposure, so that the fit is that of today and not of the scene's training.
                    exported = export(scene, path, linear=linear, exposure=math.log2(scene.exposure))
                    tones = "codes" if name == "three" and not linear else "none"
                    codes = viewer.drawn(path, camera, turn=turn_of(file, scene), tones=tones)
                    Image.fromarray(codes).save(folder / f"{name}-{path.name}.png")
                    assert exported.loss is not None
                    rows.append(
                        {"scene": scene.folder.name, "viewer": name, "file": file, "linear": bool(linear)}
                        | compared(light, codes)
                        | {"stated": exported.loss.pixel_median}
                    )
    return {"rows": rows}


def straight(scene: Scene) -> SplatCamera:
    """The camera of a view in the middle, without distortion, with its axis in the middle of the picture."""
    camera = pinhole(scene.views[len(scene.views) // 2].splat_camera)
    return replace(camera, fy=camera.fx, cx=camera.width / 2, cy=camera.height / 2)


def compared(light: np.ndarray, codes: np.ndarray) -> dict[str, float]:
    """Light [H, W, 3], 1 being white, and a canvas: PSNR, and stops of pixels that are not clipped."""
    dim = (light <= 1).all(2)
    off = stops_between(light[dim], srgb_decode(codes[dim] / 255), FAINT)
    error = np.mean(np.square((displayed(light, 1.0).astype(float) - codes) / 255))
    return {
        "median": float(np.median(off)),
        "p99": float(np.quantile(off, 0.99)),
        "db": float(-10 * np.log10(error)),
    }


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Files of `rig export` in viewers of others",
        "",
        "`python -m bench.output.viewers demo/ --write`, after `make demo` and `.ci/run`. PlayCanvas 2.23.3, "
        "Spark 2.2.0, Babylon.js 9.28.0 and three.js 0.187.0 in Chromium, without settings (three.js with "
        "`outputColorSpace = LinearSRGBColorSpace`, but for linear light), no tone map: one view at its own "
        "size, the canvas against what `rig render` draws, PSNR of the codes, and stops of the pixels that "
        "are not clipped; last the median that `rig export` states.",
        "",
        "| scene | viewer | file | light | dB | stops, median | in 1 % | stated |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        light = "linear" if row["linear"] else "by default"
        values = f"{row['db']:.1f} | {row['median']:.3f} | {row['p99']:.2g} | {row['stated']:.3f}"
        lines.append(f"| {row['scene']} | {row['viewer']} | .{row['file']} | {light} | {values} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--work", type=Path, help="folder that keeps the files and the pictures")
    options = parser.parse_args()
    result = measure(options)
    deliver(options, "viewers", result, report(result))


if __name__ == "__main__":
    main()
