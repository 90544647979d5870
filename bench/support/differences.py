"""Difference between two rows of a table, with an error that counts scenes and rigs, not views.

The held-out views of a scene share its rig, its light and its training, so they say little of other scenes.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Difference:
    """Mean over scenes, its standard error (None for a single training), and every scene's own value."""

    mean: float
    error: float | None
    by_scene: Mapping[str, float]

    @property
    def agreed(self) -> bool:
        """True if every scene has the sign of the mean."""
        return all(value * self.mean > 0 for value in self.by_scene.values())

    def words(self, digits: int) -> str:
        """Format for a table; contradictions between scenes are stated."""
        if not self.by_scene:
            return "n/a"
        error = "" if self.error is None else f" +- {self.error:.{digits}f}"
        return f"{self.mean:+.{digits}f}{error}{'' if self.agreed else ', scenes disagree'}"


def paired(
    ours: Sequence[Mapping[str, Any]], theirs: Sequence[Mapping[str, Any]], measure: str
) -> Difference:
    """Differences of ours minus theirs, from rows with `scene`, `seed` and `views`, paired by scene, seed and
    view.

    The mean is that of the scenes, each the mean of its rigs (seeds), each the mean of the views that have
    the measure in both. Its standard error is the larger of that over scenes and that over the rigs of each
    scene: two scenes may be near each other by chance, and one scene is no evidence on another.
    """
    rigs: dict[str, list[float]] = {}
    other = {(row["scene"], row["seed"]): row for row in theirs}
    for row in ours:
        match = other[row["scene"], row["seed"]]
        mine, its = (np.array([view[measure] for view in scene["views"]], float) for scene in (row, match))
        change = mine - its
        if np.isfinite(change).any():
            rigs.setdefault(row["scene"], []).append(float(change[np.isfinite(change)].mean()))
    scenes = {scene: float(np.mean(values)) for scene, values in rigs.items()}
    if not scenes:
        return Difference(math.nan, None, {})
    errors = []
    if len(scenes) > 1:
        errors.append(np.std(list(scenes.values()), ddof=1) / np.sqrt(len(scenes)))
    if all(len(values) > 1 for values in rigs.values()):
        variances = [np.var(values, ddof=1) / len(values) for values in rigs.values()]
        errors.append(np.sqrt(np.sum(variances)) / len(scenes))
    error = float(max(errors)) if errors else None
    return Difference(float(np.mean(list(scenes.values()))), error, scenes)


def units(scenes: int, seeds: int) -> str:
    """Return what a standard error is over, in words."""
    rigs = f"{seeds} rig{'s' if seeds > 1 else ''}{' each' if scenes > 1 else ''}"
    return f"{scenes} scene{'s' if scenes > 1 else ''} of {rigs}"


def stored_rows(rows: Mapping[str, Sequence[Mapping[str, Any]]], measures: Sequence[str]) -> dict[str, Any]:
    """The rows of a table as they are kept beside it, so that what it says can be computed again."""
    return {
        name: [
            {
                "scene": row["scene"],
                "seed": row["seed"],
                "views": [
                    {key: round(view[key], 5) if math.isfinite(view[key]) else None for key in measures}
                    for view in row["views"]
                ],
            }
            for row in scenes
        ]
        for name, scenes in rows.items()
    }
