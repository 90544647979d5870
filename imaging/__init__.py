"""The common ground of every stage: exposure, mosaics, files, noise, metrics, records, errors.

Conventions, stated once for the whole project:

* pixel centres lie at +0.5: the first pixel's centre is (0.5, 0.5);
* camera axes: x right, y down, z forward;
* poses are `cam_from_world` and `cam_from_rig`; quaternions are wxyz;
* linear light is scene-referred and relative unless a scale is known;
* exposure times are in seconds;
* images are [H, W] or [H, W, C], row-major.
"""
