"""The page of a hand-over folder: what is in it, in which units, and how to open it."""

import math
from collections.abc import Sequence
from html import escape
from pathlib import Path

from recon.exports.job import Job
from recon.exports.loss import Loss
from recon.result.scene import Scene
from recon.result.splats.splat_files import what_is_shown

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 46rem;
       margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.6rem } h2 { font-size: 1.2rem; margin-top: 2rem }
table { border-collapse: collapse; width: 100% }
td { padding: .3rem .6rem .3rem 0; border-bottom: 1px solid #ddd; vertical-align: top;
     overflow-wrap: anywhere }
td:first-child { width: 13rem; min-width: 6rem }
code { font: .9em ui-monospace, monospace; background: #f3f3f3; padding: .1em .3em; border-radius: .2em;
       overflow-wrap: anywhere }
@media (prefers-color-scheme: dark) {
  body { color: #ddd; background: #1a1a1a } td { border-color: #444 } code { background: #2a2a2a }
}
"""


def page(scene: Scene, job: Job, loss: Loss, notes: Sequence[str], files: Sequence[Path]) -> str:
    """The whole page, which loads nothing.

    Args:
        scene: Scene that is handed over.
        job: Export of its USD file: place, exposure and name.
        loss: Loss of light in the USD file.
        notes: What the folder does not hold, a part of a sentence each.
        files: Files of the folder so far: that of the USD and its sky, renders, and plates if there are any.

    Returns:
        HTML.
    """
    record, factor = scene.record, job.exposure_factor
    sky = next((path.name for path in files if path.suffix == ".exr" and path.parent == job.out.parent), None)
    absolute = "not known: it was not measured"
    if record.luminance is not None:
        value, error = (part / factor for part in record.luminance)
        absolute = f"1.0 is {value:.4g} &plusmn; {error:.2g} cd/m&sup2;"
    frames = sorted({view.frame for view in scene.views})
    cameras = sorted({view.camera for view in scene.views})
    facts = {
        "Light": f"{what_is_shown(record.bands)}, scene-referred (<code>lin_rec709_scene</code>), "
        f"{escape(record.radiance)}, times {factor:.6g} ({math.log2(factor):+.2f} stops), "
        "which EXR state as <code>rig:exposureFactor</code>",
        "Absolute": absolute,
        "Lengths": "metres"
        if job.place.metres
        else "in a unit of the scene's own; metersPerUnit 1 is a guess",
        "Up": "z" if job.place.z_up else "y, as the photographers held their cameras",
        "Coordinates": escape(job.place.note)
        + ("; less an offset of ({!r}, {!r}, {!r})".format(*scene.left_out) if any(scene.left_out) else ""),
        "Gaussians": f"{len(scene.gaussians):,}, harmonics of degree {record.degree}",
        "Cameras": f"{escape(', '.join(cameras))}; frames {frames[0]} to {frames[-1]}" if frames else "none",
        "Lost in the USD": escape(str(loss)),
    }
    if notes:
        facts["Not in it"] = escape("; ".join(notes))
    contents = {
        "scene.usdc": "the Gaussians (<code>/World/Splats</code>, a ParticleField3DGaussianSplat) and the "
        "cameras (<code>/World/Cameras</code>, animated by frame)",
        "renders/": "each view as the USD's camera sees it, EXR, float32, named "
        "<code>CAMERA.FRAME.exr</code>; without lens distortion, so that it lines up",
        "plates/, plates_as_shot/": "the merged photographs in the same light and under the same names: "
        "without the lens, so that they lie under the renders, and as shot, with standard deviation and mask",
        "lenses/": "an STMap of each camera both ways (<code>undistort</code> takes the lens out of a plate, "
        "<code>redistort</code> puts it into a render), and the lens as OpenCV's YAML",
        "handover.nk": "a script of Nuke that reads plates and renders through them",
        "cameras/": "in the coordinates of the USD, <code>cameras.abc</code> (Alembic) if it is there, and a "
        "<code>.chan</code> of each camera; in those of the calibration, which <code>/World</code> of the "
        "USD turns, lenses with their distortion: <code>transforms.json</code> and a COLMAP model, with "
        "pictures and points",
        "config.ocio": "OpenColorIO: the ACES configuration for CG, which reads the EXR of this folder as "
        "Linear Rec.709 (sRGB), STMaps as data, and other files as it always does",
    }
    if any(view.lens.height > view.lens.width for view in scene.views):
        contents["cameras/"] += (
            "; in Blender, set <em>Sensor Fit</em> of the cameras of Alembic to <em>Horizontal</em>, since "
            "some pictures are higher than wide"
        )
    there = {path.parent.name for path in files}
    if "plates" not in there:
        for name in ("plates/, plates_as_shot/", "lenses/", "handover.nk"):
            del contents[name]
    if sky is not None:
        contents[sky] = "the light from far away, a map of latitude and longitude: the USD's dome light"
    name = escape(scene.folder.resolve().name)
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<title>{name}</title><style>{_STYLE}</style></head><body>
<h1>{name}, handed over</h1>
<table>{_rows(facts)}</table>
<h2>In this folder</h2>
<table>{_rows({f"<code>{escape(key)}</code>": value for key, value in contents.items()})}</table>
<h2>Colour, in every program</h2>
<p>Set <code>OCIO=/path/to/config.ocio</code> before the program starts, or choose the colour space
<code>Linear Rec.709 (sRGB)</code> for the renders by hand. Values are not tone-mapped and not clipped; change
the exposure in the viewer, not in the files.</p>
<h2>Nuke</h2>
<p>Nuke 17.1 and later: <code>GeoImport</code> of <code>scene.usdc</code>, then <code>SplatRender</code>
with a camera imported from the same file; its controls say in which colour space it writes. In 17.0 enter
<code>{{isa:ParticleField3DGaussianSplat}}</code> as its mask. Earlier versions read the cameras alone.
Read <code>renders/CAMERA.####.exr</code> to compare.</p>
<h2>Houdini</h2>
<p>In Solaris, a <code>Sublayer</code> LOP of <code>scene.usdc</code> brings the cameras and the dome light.
Houdini 21 draws the Gaussians of <code>rig export --format ply --linear</code>, by a <code>File</code>
SOP and <code>Bake GSplat</code>; those of USD need a plug-in that knows ParticleField3DGaussianSplat.</p>
<h2>usdview</h2>
<p><code>usdview scene.usdc</code>, of OpenUSD 26.03 or later; choose a camera under <em>Camera</em>, and
<code>/World/Splats</code> to read its numbers.</p>
</body></html>
"""


def _rows(pairs: dict[str, str]) -> str:
    return "\n".join(f"<tr><td>{key}</td><td>{value}</td></tr>" for key, value in pairs.items())
