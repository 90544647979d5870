"""A plate, a render and the truth of a view are one light, without an option."""

from pathlib import Path

import numpy as np
import pytest

import rig as toolkit
from imaging.files.exr.reading import read_exr
from imaging.files.exr.writing import EXPOSURE_FACTOR

LIKE = 0.01
"""Stops by which the middle of all pixels may differ."""
TRAINED = 0.02
"""The same of a scene after 240 iterations; after 300 with more Gaussians it is 0.002."""


def test_plate_and_render_agree_with_the_truth(toy: Path, tmp_path: Path) -> None:
    merged = toolkit.merge(toy, tmp_path / "plates")
    scene = toolkit.reconstruct(toy, quality="draft", settings={"iterations": 240, "gaussians": 1500})
    files = toolkit.render(scene, tmp_path / "renders")
    renders = {file.stem: file for file in files if file.suffix == ".exr"}
    assert scene.exposure == pytest.approx(merged.exposure_factor, rel=1e-12)
    ratios: dict[str, list[np.ndarray]] = {"plate": [], "render": []}
    for view in merged.views:
        plate, render = read_exr(view.file), read_exr(renders[str(view.view).replace("/", "_")])
        assert plate.attributes[EXPOSURE_FACTOR] == render.attributes[EXPOSURE_FACTOR]
        light = read_exr(toy / "truth" / f"{view.view}.exr").rgb() * merged.exposure_factor
        lit = light > 0.1 * np.median(light)  # below it is what noise and the mosaic leave of black
        for name, picture in (("plate", plate), ("render", render)):
            ratios[name].append(np.log2(np.maximum(picture.rgb()[lit], 1e-6) / light[lit]))
    plate, render = (np.concatenate(ratios[name]) for name in ("plate", "render"))
    assert abs(np.median(plate)) < LIKE
    assert abs(np.median(render)) < TRAINED
    assert abs(np.median(plate - render)) < TRAINED
