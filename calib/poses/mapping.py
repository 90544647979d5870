"""Views placed one after another by COLMAP's incremental mapper, or all at once by its global one."""

from collections.abc import Sequence
from tempfile import TemporaryDirectory
from typing import Any

from calib.poses.steps import Growth
from imaging.files.colmap import pycolmap
from imaging.progress import Progress

MANY = 60
"""Views beyond which a model is adjusted as a whole less often, and less exactly, while it grows."""
GROWTH = 1.3
"""Growth of the model between two adjustments then; 1.1 else."""
STILL = 1e-5
"""Share of the loss that a step of those adjustments has to gain."""


def map_views(
    database: Any,
    images: Sequence[str],
    max_error: float,
    fixed: frozenset[int],
    threads: int,
    progress: Progress,
    growth: Growth,
    ahead: bool = False,
) -> Any | None:
    """Place views one after another.

    Args:
        database: pycolmap's, with verified pairs.
        images: Names of the views to place.
        max_error: Largest error of a reprojection, px.
        fixed: Numbers of cameras whose lenses stay.
        threads: Of the adjustments.
        progress: Callback for the number of placed views.
        growth: Has the model that a stopped run began, and keeps the first that grows, mostly the only one.
        ahead: Begin with two views of which one was taken by going ahead from the other, too, and be content
            with fewer matches of each further one: things beside a road leave the image after a few steps.

    Returns:
        The pycolmap model with the most views; None if no two can be placed.
    """
    views = len(images)
    options = pycolmap.IncrementalPipelineOptions()
    options.constant_cameras = set(fixed)
    options.image_names = list(images) if views < database.num_images() else []
    options.min_model_size = 2
    options.random_seed = 0
    options.num_threads = threads
    options.extract_colors = False
    options.ba_refine_principal_point = False
    options.mapper.init_min_tri_angle = 8
    if ahead:
        options.mapper.init_max_forward_motion = 1.0
        options.mapper.init_min_tri_angle = 4
        options.mapper.abs_pose_min_num_inliers = 15
    if views > MANY:
        options.ba_global_frames_ratio = options.ba_global_points_ratio = GROWTH
        options.ba_global_function_tolerance = options.ba_local_function_tolerance = STILL
    options.mapper.filter_max_reproj_error = max_error
    options.triangulation.merge_max_reproj_error = max_error
    options.triangulation.complete_max_reproj_error = max_error
    options.triangulation.ignore_two_view_tracks = views >= 4
    models = pycolmap.ReconstructionManager()
    if (before := growth.before()) is not None:
        with TemporaryDirectory(prefix="rig-") as folder:
            before.write_binary(folder)
            models.read(folder)
    pipeline = pycolmap.IncrementalPipeline(options, database, models)

    def placed() -> None:
        growth.keep(models.get(0))
        progress("placing views", min(models.get(models.size() - 1).num_reg_images(), views), views)

    progress("placing views", 0, views)
    pipeline.add_callback(0, placed)  # the first pair of a model, or what there is of it
    pipeline.add_callback(1, placed)  # one more image
    pipeline.run()
    every = [models.get(index) for index in range(models.size())]
    return max(every, key=lambda model: model.num_reg_images(), default=None)


def map_at_once(database: Any, fixed: frozenset[int], images: Sequence[str] = ()) -> Any | None:
    """Place all views at once: first their turns, then where they stand.

    Pan et al., "Global Structure-from-Motion Revisited", 2024.

    Args:
        database: pycolmap's, with verified pairs.
        fixed: Numbers of cameras whose lenses stay; with any, all lenses do.
        images: Names of those to place; all if empty.

    Returns:
        The pycolmap model with the most images; None if no two can be placed.
    """
    options = pycolmap.GlobalPipelineOptions()
    options.image_names = list(images)
    options.min_model_size = 2
    options.num_threads = options.mapper.num_threads = 1
    options.random_seed = options.mapper.random_seed = 0
    adjusted = options.mapper.bundle_adjustment
    adjusted.refine_focal_length = adjusted.refine_extra_params = not fixed
    models = pycolmap.ReconstructionManager()
    # That no model can be made is logged as an error; here it is an answer.
    level, pycolmap.logging.minloglevel = pycolmap.logging.minloglevel, int(pycolmap.logging.FATAL)
    try:
        pycolmap.GlobalPipeline(options, database, models).run()
    finally:
        pycolmap.logging.minloglevel = level
    every = [models.get(index) for index in range(models.size())]
    return max(every, key=lambda model: model.num_reg_images(), default=None)
