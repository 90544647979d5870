"""Facts of photographs that go with the views of a data set into its scene."""

import json
from pathlib import Path

import numpy as np

from capture.imports.photos import import_photos
from imaging.files.photo import encode_jpeg
from imaging.optics.pose import as_held
from imaging.sensor.mosaic import FrameMetadata
from recon.data.load import load
from recon.result.save import scene_views


def test_a_scene_knows_how_its_photographs_were_held(tmp_path: Path) -> None:
    folder, frames, stated = tmp_path / "photos", [], [6, 6, 1, 8]
    folder.mkdir()
    rng = np.random.default_rng(0)
    for number, orientation in enumerate(stated):
        pixels = rng.integers(20, 200, (24, 32, 3), dtype=np.uint8)
        file = folder / f"{number}.jpg"
        file.write_bytes(encode_jpeg(pixels, metadata=FrameMetadata(orientation=orientation)))
        pose = np.eye(4)
        pose[0, 3] = number
        frames.append({"file_path": file.name, "transform_matrix": pose.tolist()})
    top = {"w": 32, "h": 24, "fl_x": 40.0, "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(top))
    import_photos(folder, tmp_path / "S")
    views = scene_views(load(tmp_path / "S"))
    assert [view.orientation for view in views] == stated
    for view, orientation in zip(views, stated, strict=True):
        np.testing.assert_array_equal(view.upright, as_held(view.cam_from_world.matrix(), orientation))
