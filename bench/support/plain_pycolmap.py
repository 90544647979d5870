"""Photographs placed by pycolmap: features, all pairs, incremental mapping, each by its defaults."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.support.spent import processor_seconds
from imaging.files.colmap import pycolmap


def place(images: Path, work: Path, names: Sequence[str] = (), **options: Any) -> tuple[Any | None, float]:
    """Return pycolmap's model with the most views, or None, and the processor seconds that it took.

    images: the photographs' folder; work: emptied, and the database and models written into it; names: files
    to take, all of them where empty; options: of `pycolmap.extract_features`, such as `camera_mode`.
    """
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    database = work / "database.db"
    began = processor_seconds()
    pycolmap.extract_features(database, images, image_names=list(names), **options)
    pycolmap.match_exhaustive(database)
    models = pycolmap.incremental_mapping(database, images, work)
    seconds = processor_seconds() - began
    return max(models.values(), key=lambda model: model.num_reg_images(), default=None), seconds
