"""Pictures by Mitsuba of PLY files of Gaussians, as EXR: `ASKED.json`."""

import json
import sys
from pathlib import Path

import mitsuba as mi  # type: ignore[import-not-found]

mi.set_variant("llvm_ad_rgb")
for one in json.loads(Path(sys.argv[1]).read_text()):
    film = {
        "type": "hdrfilm",
        "width": one["width"],
        "height": one["height"],
        "pixel_format": "rgb",
        "component_format": "float32",
        "rfilter": {"type": "box"},
    }
    sensor = {
        "type": "perspective",
        "fov": one["fov"],
        "fov_axis": "x",
        "near_clip": 0.01,
        "to_world": mi.ScalarTransform4f(one["to_world"]),
        "film": film,
        "sampler": {"type": "independent", "sample_count": 4},
    }
    integrator = {"type": "volprim_rf_basic", "max_depth": -1, "srgb_primitives": one["srgb"]}
    splats = {"type": "ellipsoids", "filename": one["file"]}
    scene = mi.load_dict({"type": "scene", "sensor": sensor, "integrator": integrator, "splats": splats})
    mi.util.write_bitmap(one["out"], mi.render(scene), write_async=False)
