"""Inputs of structure from motion, in one record."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from calib.adjustment.place_priors import StatedPlace
from calib.data.features import Features
from calib.data.unfinished import Unfinished
from calib.poses.rigs.known_rig import NOTHING, KnownRig
from calib.sensor.focal_length import FocalLength
from imaging.arrays import Array
from imaging.optics.lens import Lens
from imaging.progress import Progress, unreported
from imaging.session.view_id import ViewId


@dataclass(frozen=True, eq=False)
class PoseInputs:
    """Inputs of the poses, except for the lenses, of which two initial guesses may be tried.

    Attributes:
        features: Of every view, in picture pixels.
        rigs: Names of cameras that are rigidly mounted to each other.
        threads: Of the solvers; the same model for the same number only.
        progress: Callback for the current step, the steps done, and all of them.
        focal_known: Cameras whose guess comes from a file's focal length rather than from nothing.
        focal: Prior from the files, at picture size, of the weight that its spread has against the scene.
        stated: Where views were taken, as their files say; the model comes to lie there, in metres, where
            they agree with each other.
        known: Lenses at picture size and rig poses from a board, which stay; the model is in metres where
            that placed two cameras of a rig.
        blank: Reasons why views show nothing.
        pictures: Of views with little noise, as grey PNGs, for places more exact than those of features.
        brightness: Light around each feature of a view.
        exact: Cameras whose brightness differs only where things do.
        steady: Those whose exposure stays the same, beside them.
        unfinished: Matches and models of an earlier run.
        keep_doubtful: Keep views that others contradict, with a warning.
        names: Photographs of views, for warnings.
        turntable: Things turn before the cameras, so that views are not from one place.
    """

    features: Mapping[ViewId, Features]
    rigs: Sequence[Sequence[str]] = ()
    threads: int = 1
    progress: Progress = unreported
    focal_known: Collection[str] = ()
    focal: Mapping[str, FocalLength] = field(default_factory=dict)
    stated: Mapping[ViewId, StatedPlace] = field(default_factory=dict)
    known: KnownRig = NOTHING
    blank: Mapping[ViewId, str] = field(default_factory=dict)
    pictures: Mapping[ViewId, bytes] = field(default_factory=dict)
    brightness: Mapping[ViewId, Array] = field(default_factory=dict)
    exact: Collection[str] = ()
    steady: Collection[str] = ()
    unfinished: Unfinished = field(default_factory=Unfinished)
    keep_doubtful: bool = False
    names: Mapping[ViewId, str] = field(default_factory=dict)
    turntable: bool = False

    @property
    def steady_or_exact(self) -> set[str]:
        """Cameras whose brightness may be compared between views of the same exposure."""
        return {*self.exact, *self.steady}

    def cache_key(self, cameras: Mapping[str, Lens]) -> list[object]:
        """List all that models depend on beside the features, of which their kind says which these are.

        Args:
            cameras: First guesses of the lenses.

        Returns:
            Values that `Steps` compares with those of a stopped run.
        """
        return [
            {str(view): features.kind for view, features in self.features.items()},
            dict(cameras), self.rigs, set(self.focal_known), self.known, sorted(map(str, self.pictures)),
            set(self.exact), dict(self.focal), {str(view): place for view, place in self.stated.items()},
            self.steady_or_exact, self.keep_doubtful, self.turntable,
        ]  # fmt: skip
