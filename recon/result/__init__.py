"""A finished scene: model.json, the files of viewers, and the scene opened again."""
