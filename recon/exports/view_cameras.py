"""The cameras of a scene's views for other programs: a COLMAP model as text, and `transforms.json`.

Lenses with their distortion, poses in the coordinates of the calibration. Pictures lie in images/ beside
both: those that `rig calibrate` left in the session, or, of a scene without one, drawn ones. Points to start
from are the middles of solid Gaussians.
"""

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from imaging.arrays import Array, Bytes
from imaging.errors import InputError
from imaging.files import store
from imaging.files.nerfstudio import Picture, transforms
from imaging.files.photo import encode_png, read_photo_header
from imaging.optics.lens import Lens
from imaging.progress import unreported
from imaging.session.paths import session_of
from recon.exports.formats.ply import SOLID, offset_line
from recon.exports.formats.vertices import packed_vertices, shown
from recon.exports.job import Job, Written
from recon.exports.splats import display_splats, linear_splats
from recon.exports.target_coordinates import Place
from recon.rendering.cameras.camera_files import OFFSET
from recon.result.display import in_colour, picture
from recon.result.model import MODEL, SceneView
from recon.result.scene import Scene

COLMAP, NERFSTUDIO, IMAGES, POINTS = "colmap", "transforms.json", "images", "sparse_pc.ply"
MOST_POINTS = 100_000
_RIGID = 1e-9
"""Tolerance of mounted cameras' relative poses from frame to frame, relative to the scene's unit."""


def write(job: Job) -> Written:
    """Write the file, as a writer of `rig export`."""
    if job.out.is_file():
        raise InputError(f"{job.out} is a file, and cameras fill a folder: name another --out.")
    files, drawn = write_cameras(job.out, job.scene, job.place)
    note = f"the photographs of {drawn} views, which are not in a session beside the scene: drawn pictures"
    return Written(files, notes=(note,) if drawn else ())


def write_cameras(folder: Path, scene: Scene, place: Place) -> tuple[list[Path], int]:
    """FOLDER/colmap, transforms.json, sparse_pc.ply and images/; the files written, and how many pictures had
    to be drawn. InputError of a scene without views.
    """
    if not scene.views:
        raise InputError(f"{scene.folder} has no views whose cameras could be written.")
    images, lenses, drawn = [], [], 0
    for view in scene.views:
        path = folder / IMAGES / view.id.image_name
        photograph = _photograph(scene, view)
        if photograph is None:
            drawn += 1
            store.write_bytes(path, encode_png(_drawn(scene, view)))
            lenses.append(view.lens)
        else:
            data = photograph.read_bytes()
            width, height, _ = read_photo_header(data, str(photograph))
            store.write_bytes(path, data)
            lenses.append(view.lens.resized(width, height))
        images.append(path)
    motions = [_moved(view.cam_from_world.matrix(), scene) for view in scene.views]
    places, codes = _points(scene)
    texts = _colmap(scene, lenses, motions, places, codes)
    coordinates = {
        "unit": "m" if place.metres else "relative",
        "system": place.note,
        OFFSET: list(scene.left_out),
    }
    pictures = [
        Picture(f"{IMAGES}/{view.id.image_name}", lens, motion)
        for view, lens, motion in zip(scene.views, lenses, motions, strict=True)
    ]
    content = transforms(pictures, coordinates)
    if len(places):
        content = {"ply_file_path": POINTS, **content}
        lines = ["red, green, blue: display values, sRGB", f"coordinates: {place.note}"]
        if any(scene.left_out):
            lines.insert(1, offset_line(scene.left_out))
        store.write_bytes(folder / POINTS, packed_vertices(places, codes, lines))
        images.append(folder / POINTS)
    texts[NERFSTUDIO] = json.dumps(content, indent=1, allow_nan=False)
    for name, text in texts.items():
        store.write_bytes(folder / name, f"{text}\n".encode())
    return [*images, *(folder / name for name in texts)], drawn


def _photograph(scene: Scene, view: SceneView) -> Path | None:
    """The picture that the calibration left of a view in the session of the scene, or None."""
    if not (scene.folder / MODEL).is_file():
        return None  # a file of splats: its lenses are not those of any photograph
    session = session_of(scene.folder)
    path = None if session is None else session / "calibration" / "previews" / view.id.image_name
    return path if path is not None and path.is_file() else None


def _drawn(scene: Scene, view: SceneView) -> Bytes:
    light, alpha = scene.layer(view.splat_camera)
    return picture(in_colour(light, scene.record.bands), alpha, scene.exposure)


def _points(scene: Scene) -> tuple[Array, Bytes]:
    """The middles of solid Gaussians [N, 3], less the offset, and what screens show of them."""
    if scene.record.display is None:
        splats = linear_splats(scene, scene.exposure, with_dome=False)
    else:
        splats = display_splats(scene, None, unreported)
    chosen = np.flatnonzero(
        (splats.opacities >= SOLID)
        & np.isfinite(splats.means).all(1)
        & np.isfinite(splats.harmonics[:, 0]).all(1)
        & (np.arange(len(splats)) < len(scene.gaussians))
    )
    chosen = chosen[:: -(-len(chosen) // MOST_POINTS) or 1]
    solid = splats.rows(chosen)
    return solid.means, shown(solid.light * solid.factor)


def _colmap(
    scene: Scene,
    lenses: list[Lens],
    motions: list[Array],
    places: Array,
    codes: Bytes,
) -> dict[str, str]:
    """The texts of a model by their names; cameras that are mounted together are one rig."""
    numbers: dict[tuple[str, Lens], int] = {}
    for view, lens in zip(scene.views, lenses, strict=True):
        numbers.setdefault((view.camera, lens), len(numbers) + 1)
    cameras = [
        f"{number} {'OPENCV_FISHEYE' if lens.fisheye else 'OPENCV'} {lens.width} {lens.height} "
        + " ".join(repr(term) for term in lens.terms)
        for (_, lens), number in numbers.items()
    ]
    taken_by = [numbers[view.camera, lens] for view, lens in zip(scene.views, lenses, strict=True)]
    frames = [view.frame for view in scene.views]
    mounted = _mounted(taken_by, frames, motions, scene.record.world.unit)
    images, texts = [], {}
    if any(scene.left_out):
        images.append(f"# {offset_line(scene.left_out)}")
    for number, (view, motion) in enumerate(zip(scene.views, motions, strict=True), 1):
        images += [f"{number} {_pose(motion)} {taken_by[number - 1]} {view.id.image_name}", ""]
    rigs, framed = _rigs(taken_by, frames, motions, mounted)
    points = [
        f"{number} {' '.join(map(repr, place))} {' '.join(map(str, code))} 0"
        for number, (place, code) in enumerate(zip(places.tolist(), codes.tolist(), strict=True), 1)
    ]
    for name, lines in (
        ("rigs", rigs),
        ("cameras", cameras),
        ("frames", framed),
        ("images", images),
        ("points3D", points),
    ):
        texts[f"{COLMAP}/{name}.txt"] = "\n".join(lines)
    return texts


def _mounted(
    taken_by: list[int], frames: list[int], motions: list[Array], unit: float
) -> dict[int, Array] | None:
    """Camera-from-rig [4, 4] of each camera, if all keep their places to the first; else None."""
    mounts: dict[int, Array] = {1: np.eye(4)}
    first = {
        frame: motion for camera, frame, motion in zip(taken_by, frames, motions, strict=True) if camera == 1
    }
    for camera, frame, motion in zip(taken_by, frames, motions, strict=True):
        if frame not in first:
            return None
        relative = motion @ np.linalg.inv(first[frame])
        known = mounts.setdefault(camera, relative)
        if not np.allclose(known, relative, rtol=0, atol=_RIGID * max(1.0, unit)):
            return None
    return mounts


def _rigs(
    taken_by: list[int], frames: list[int], motions: list[Array], mounted: dict[int, Array] | None
) -> tuple[list[str], list[str]]:
    """The lines of rigs.txt and frames.txt: one rig of what is mounted, or one for each camera."""
    rows = range(len(taken_by))
    if mounted is None:
        rigs = [f"{camera} 1 CAMERA {camera}" for camera in sorted(set(taken_by))]
        framed = [
            f"{row + 1} {taken_by[row]} {_pose(motions[row])} 1 CAMERA {taken_by[row]} {row + 1}"
            for row in rows
        ]
        return rigs, framed
    others = [f"CAMERA {camera} 1 {_pose(motion)}" for camera, motion in mounted.items() if camera != 1]
    framed = []
    for number, frame in enumerate(dict.fromkeys(frames), 1):
        frame_rows = [row for row in rows if frames[row] == frame]
        first = next(row for row in frame_rows if taken_by[row] == 1)
        data = " ".join(f"CAMERA {taken_by[row]} {row + 1}" for row in frame_rows)
        framed.append(f"{number} 1 {_pose(motions[first])} {len(frame_rows)} {data}")
    return [" ".join([f"1 {len(mounted)} CAMERA 1", *others])], framed


def _pose(motion: Array) -> str:
    wxyz = Rotation.from_matrix(motion[:3, :3]).as_quat(canonical=True, scalar_first=True)
    return " ".join(repr(float(part)) for part in (*wxyz, *motion[:3, 3]))


def _moved(motion: Array, scene: Scene) -> Array:
    """A pose [4, 4] in coordinates less the scene's offset."""
    moved = motion.copy()
    moved[:3, 3] += motion[:3, :3] @ np.asarray(scene.record.offset)
    return moved
