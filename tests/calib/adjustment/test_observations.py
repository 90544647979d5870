"""Observations as arrays are those that COLMAP tells one by one."""

import numpy as np

from calib.adjustment.bundle_adjustment import misses
from calib.adjustment.observations import observations
from imaging.files.colmap import pycolmap


def test_every_observation_of_a_model_with_holes() -> None:
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_frames_per_rig, options.num_points3D = 1, 5, 80
    options.num_points2D_without_point3D, options.track_length = 7, 3
    pycolmap.set_random_seed(0)
    model = pycolmap.synthesize_dataset(options)
    noise = pycolmap.SyntheticNoiseOptions()
    noise.point2D_stddev = 0.5
    pycolmap.synthesize_noise(noise, model)
    for number in sorted(model.points3D)[::4]:
        model.delete_point3D(number)
    table = observations(model)
    expected = {
        (element.image_id, element.point2D_idx): number
        for number, point in model.points3D.items()
        for element in point.track.elements
    }
    assert (
        dict(zip(zip(table.image, table.feature, strict=True), table.numbers[table.point], strict=True))
        == expected
    )
    for image, feature, point, place in zip(
        table.image, table.feature, table.point, table.observed, strict=True
    ):
        assert (place == np.ravel(model.image(int(image)).point2D(int(feature)).xy)).all()
        assert (table.world[point] == model.points3D[int(table.numbers[point])].xyz).all()
    model.update_point_3d_errors()
    error = misses(model).error
    assert np.isclose(error.mean(), model.compute_mean_reprojection_error(), rtol=1e-9)
    assert [image for image, _ in table.of_images()] == sorted(model.reg_image_ids())


def test_a_model_of_nothing_has_none() -> None:
    assert len(misses(pycolmap.Reconstruction()).error) == 0
    assert observations(pycolmap.Reconstruction()).of_images() == []
