"""Choice of a training's configuration, with its evidence as rungs. Nothing below trains a scene.

A rung is one decision in a record: its subject, whether it was taken, why, and its gain.
The order, which `decide` has as code (`decisions.py`):

1. method: by the kind of the images and whether a tone curve can be separated from the light
   (`method_choice`); with what the `request` has beside it makes the `settings` that were asked for.
2. iterations at most: as asked for, with early stop as many as were worth it in other scenes
   (`prediction`).
3. report: whether a budget of time has room for it, and for any training at all (`countdown`).
4. degree of the harmonics: by what scene points look like from all sides (`view_dependence`).
5. most Gaussians: by the budget, or by how many samples the training views hold (`size`).
6. room: whether a budget of time has room for the fewest iterations at all, by the speed of a few
   (`probe`); if not, all of this begins again with the width and the number of Gaussians of a smaller
   preset.
7. starting points: with the depths of as many views as the time has room for.
8. trials: whether short trainings may decide what follows (`trials`, `probe`).
9. environment: by whether views look through the points of the start, else by a trial (`far_field`).
10. measured depth: by whether depth maps fit the scene points, as the start takes them, and by trials of
   their weight in the loss (`measured_depth`).
11. corrections of the calibration: by its own errors, else by trials (`corrections`), and by dark scene
   points (`stray_light`).
12. number of Gaussians: by trials that halve it (`size`).
13. iterations, and the predicted quality: by a training in miniature (`probe`, `prediction`).

Before the second, where scene points contradict what the files of photographs state as constant, trials
decide which exposure and white balance all that follows looks at (`stated_settings`).
"""
