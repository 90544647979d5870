"""Keys of `transforms.json` that say more of pixels than an import keeps: a sentence for each, or a refusal.

Those of nerfstudio, of Instant NGP and of Blender scenes, and files that Instant NGP looks for beside a
photograph. Keys that only steer a training (`aabb_scale`, `scale`, `offset`, `sharpen`) mean nothing here.
"""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from capture.imports.layouts.given import FARTHEST, GivenPhoto
from capture.imports.layouts.posed_frame import PosedFrame
from imaging.errors import InputError

Framed = list[tuple[PosedFrame, GivenPhoto]]
"""Frames, and what was made of them."""


def applied_scale(entry: PosedFrame) -> float:
    """Length of 1 of points and depth maps in units of the poses, as nerfstudio takes `applied_scale`."""
    scale = PosedFrame({}, entry.top, entry.where).number("applied_scale")
    if scale is not None and not 0 < scale < FARTHEST:
        raise InputError(f"{entry.where} has an applied_scale of {scale:g}: correct it or take it out.")
    return 1.0 if scale is None else scale


def rays_beside(photo: Path, entry: PosedFrame) -> bool:
    """Return whether Instant NGP would read the rays of a photograph's pixels from a file beside it."""
    rays = photo.parent / f"rays_{photo.stem}.dat"
    return entry.top.get("enable_ray_loading") is not False and rays.is_file()


def notes_of(framed: Framed, top: dict[str, Any]) -> Iterator[str]:
    """A sentence for each thing that is not kept; InputError for pixels that would be read wrongly."""
    if top.get("fix_premult") and any(photo.path.suffix.lower() == ".exr" for _, photo in framed):
        raise InputError(
            f"{framed[0][0].where} states fix_premult, so that its EXR are not multiplied by their alpha as "
            "others are: multiply them, and take the key out."
        )
    yield from _lens_notes(framed, top)
    yield from _motion_notes(framed, top)
    yield from _depth_notes(framed, top)
    for key, sentence in _LIGHT.items():
        if top.get(key) or any(entry.values.get(key) for entry, _ in framed):
            yield sentence
    times = {entry.values["time"] for entry, _ in framed if isinstance(entry.values.get("time"), int | float)}
    if len(times) > 1:
        yield (
            f"The frames are of {len(times)} moments (time): the scene is taken to stand still, and what "
            "moved in it is blurred."
        )
    for name, what in _BESIDE:
        count = sum(name(photo.path).is_file() for _, photo in framed)
        if count:
            yield f"{count} photos have a file {name(framed[0][1].path).name} or alike beside them, {what}."


def _lens_notes(framed: Framed, top: dict[str, Any]) -> Iterator[str]:
    lenses = {photo.lens for _, photo in framed}
    further = any(entry.number("k3") or entry.number("k4") for entry, _ in framed)
    if further and any(lens is not None and not lens.fisheye for lens in lenses):
        yield (
            "The radial terms k3 and k4 are folded into the others, which differs by less than a pixel "
            "anywhere."
        )
    without = [
        photo.path for entry, photo in framed if photo.lens is None and not rays_beside(photo.path, entry)
    ]
    if without:
        yield (
            f"{len(without)} photos come without lens and pose, since no lens of rig is like that of their "
            "camera_model: undistort the images first if the poses matter."
        )
    rays = sum(rays_beside(photo.path, entry) for entry, photo in framed)
    if rays:
        yield (
            f"{rays} photos come without lens and pose, since the rays of their pixels are in files of their "
            "own (rays_*.dat), which no lens of rig is like."
        )
    if top.get("fisheye_crop_radius") and any(lens is not None and lens.fisheye for lens in lenses):
        yield (
            "The fisheye_crop_radius is not kept, so that the black beyond it counts as light: cover it by "
            "--masks FOLDER."
        )


def _motion_notes(framed: Framed, top: dict[str, Any]) -> Iterator[str]:
    moved = [entry.moved() for entry, photo in framed if photo.cam_from_world is not None]
    count = sum(any(one) for one in moved)
    if count:
        far, turn = (max(one[axis] for one in moved) for axis in (0, 1))
        yield (
            f"{count} photos have a rolling shutter (rolling_shutter, transform_matrix_end): each gets the "
            f"pose of its middle row; other rows deviate from it by up to {far:.3g} units of the poses and "
            f"{turn:.2g} degrees."
        )
    keys = [key for key in _MOVES if top.get(key) or any(entry.values.get(key) for entry, _ in framed)]
    if not count and any(entry.rolls() for entry, _ in framed):
        keys.insert(0, "rolling_shutter")
    if keys:
        yield (
            f"A rolling shutter ({', '.join(keys)}) is not modelled: each photo gets one pose for all its "
            "rows."
        )


_MOVES = ("rolling_shutter_time", "camera_linear_velocity", "camera_angular_velocity")
"""Keys of 3DGS on the move (arXiv 2403.13327)."""


def _depth_notes(framed: Framed, top: dict[str, Any]) -> Iterator[str]:
    keys = ("depth_file_path", "depth_path")
    count = sum(any(entry.values.get(key) for key in keys) for entry, _ in framed)
    if count and top.get("enable_depth_loading") is False:
        yield f"{count} photos have a depth map that is not read, since enable_depth_loading is false."
    elif count and applied_scale(framed[0][0]) != 1:
        yield (
            f"{count} photos have a depth map that is not read, since it is not in the unit of the poses "
            f"(applied_scale {applied_scale(framed[0][0]):g}): --depths FOLDER takes maps in that unit."
        )
    stated = top.get("n_frames")
    if isinstance(stated, int) and 0 < stated < len(framed):
        yield f"n_frames limits the photos to the first {stated} of {len(framed)}; all are imported."


_LIGHT = {
    "white_transparent": (
        "White pixels, which Instant NGP takes for transparent (white_transparent), are light here: --masks "
        "FOLDER leaves them out."
    ),
    "black_transparent": (
        "Black pixels, which Instant NGP takes for transparent (black_transparent), are black here: --masks "
        "FOLDER leaves them out."
    ),
    "driver_parameters": "Lamps that move from photo to photo (driver_parameters) are taken to stand still.",
}

_BESIDE: Iterable[tuple[Callable[[Path], Path], str]] = (
    (
        lambda photo: photo.parent / f"dynamic_mask_{photo.stem}.png",
        "a mask of Instant NGP, which is not read: invert it and name it as mask_path",
    ),
    (
        lambda photo: photo.parent / f"{photo.name}.alpha{photo.suffix}",
        "the transparency of Instant NGP, which is not read: name it as mask_path",
    ),
)
"""Files of Instant NGP beside a photograph, and a clause on each kind."""
