"""Lenses and rigs of a session from its views of a board."""

import shlex
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from calib.boards import first_guess, ladder, rig, uncertainty
from calib.boards.corners import Corners, find_all
from calib.data.previews import luminance
from calib.data.views import View, read_view, views_of
from calib.poses.sfm import pose_of
from imaging.arrays import Bytes
from imaging.errors import CalibrationError
from imaging.files.colmap import pycolmap
from imaging.merge.bracket import merge_bracket
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.progress import Progress
from imaging.session.calibration import LensError, PoseError, Response
from imaging.session.calibration_evidence import BoardEvidence, BoardPlace
from imaging.session.records import Board, Rung
from imaging.session.session import Session
from imaging.session.view_id import ViewId

EXAMPLE = "7x5,square=150mm,marker=112.5mm,DICT_4X4_50"
"""The board that simulated cameras see, as the command line describes it."""
OUTLIER = 2.5
"""A view, or a camera, that misses by this many times the median of all is named."""
SURE_PX, SURE_RIG_PX = 0.3, 0.5
"""Standard errors of a projection below which a board's lens, and a board's rig, are kept as they are: an
adjustment to a textured scene does about as well."""
DISAGREE = 1.5
"""Times what noise explains, by which two halves of the frames may disagree about a lens."""
_WHITE = 99.5
"""Percentile of a picture that becomes white: a lamp beside the board must not darken it."""


@dataclass(frozen=True, eq=False)
class MeasuredBoard:
    """Result of a board calibration.

    cam_from_rig: metres, of cameras that are mounted together and that views connect. sure_lenses, sure_rig:
    accurate enough to be held in the scene's adjustment; the rest are initial values of it.
    """

    lenses: dict[str, Lens]
    lens_errors: dict[str, LensError]
    cam_from_rig: dict[str, Pose]
    rig_errors: dict[str, PoseError]
    evidence: BoardEvidence
    rungs: tuple[Rung, ...]
    sure_lenses: frozenset[str]
    sure_rig: bool

    def place(self, name: str) -> tuple[float, float, float]:
        """Return where a mounted camera is in the rig, m."""
        pose = self.cam_from_rig[name].matrix()
        x, y, z = (-pose[:3, :3].T @ pose[:3, 3]).tolist()
        return x, y, z


def measure_board(session: Session, board: Board | None, progress: Progress) -> MeasuredBoard | None:
    """Calibrate from the session's shots of kind board; None if it has none.

    board: where the session does not say it or says it wrong. CalibrationError that names the
    cause: no description, no board in any picture, too few views.
    """
    views = {view.id: view for view in views_of(session, "board")}
    if not views:
        return None
    shown = [plan.board for plan in session.plans() if plan.kind == "board" and plan.board is not None]
    board = board or (shown[-1] if shown else None)
    if board is None:
        raise CalibrationError(
            f"nothing describes it: run `rig calibrate {shlex.quote(str(session.folder))} --board {EXAMPLE}` "
            "with the squares and sizes of your own."
        )
    detected, printed = find_all(board, list(views), lambda view: picture_of(session, views[view]), progress)
    sizes = {view.camera: (views[view].shots[0].width, views[view].shots[0].height) for view in detected}
    groups: dict[str, list[str]] = {}
    for camera in session.record.cameras:
        if camera.name in sizes:
            groups.setdefault(camera.rig or f"alone {camera.name}", []).append(camera.name)
    solved = [
        solve_group(
            board,
            {view: corners for view, corners in detected.items() if view.camera in names},
            {name: sizes[name] for name in names},
            progress,
        )
        for names in groups.values()
    ]
    return _joined(board, str(printed), detected, solved)


def picture_of(session: Session, view: View) -> Bytes:
    """Return what a view shows of the board, uint8 [H, W], about evenly spaced to the eye."""
    scales = {shot.file: shot.exposure.scale if shot.exposure is not None else 1.0 for shot in view.shots}
    light, _ = luminance(merge_bracket(read_view(session, view, scales, Response(kind="srgb", evidence=""))))
    white = max(float(np.percentile(light, _WHITE)), 1e-30)
    return np.asarray(np.rint(255.0 * np.sqrt(np.clip(light / white, 0.0, 1.0))), np.uint8)


@dataclass(frozen=True, eq=False)
class Group:
    """A rig, or one camera, solved. solved.rms is of the corners that fit; refused: why it could not be."""

    names: tuple[str, ...]
    solved: rig.Solved | None
    doubt: uncertainty.Uncertainty | None
    rungs: tuple[Rung, ...]
    isolated: tuple[str, ...] = ()
    refused: str = ""


def solve_group(
    board: Board, corners: Mapping[ViewId, Corners], sizes: Mapping[str, tuple[int, int]], progress: Progress
) -> Group:
    """Lenses, rig and errors of cameras that are mounted together.

    Args:
        board: Description of the board.
        corners: Corners by view, of these cameras.
        sizes: Width and height of each camera's pictures, px, by name.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        The solved group; if the corners give no rig, the group with the reason in `refused`.
    """
    names = tuple(sizes)
    try:
        begun = first_guess.first_guess(board, corners, sizes)
        inliers, solved = rig.drop_outliers(board, corners, begun, ladder.RICHEST)
        free, rungs = ladder.climb(board, inliers, solved, progress)
        if free == ladder.FISHEYE:  # corners that no radial terms bring near to their place are good ones now
            inliers, solved = rig.drop_outliers(board, corners, solved, free)
        solved = rig.solve(board, inliers, solved, free)
    except CalibrationError as error:
        return Group(names, None, None, (), refused=str(error))
    doubt = uncertainty.bootstrap(board, inliers, solved, free, progress)
    return Group(names, solved, doubt, rungs, begun.isolated)


def _joined(
    board: Board, printed: str, corners: Mapping[ViewId, Corners], groups: list[Group]
) -> MeasuredBoard:
    good = [group for group in groups if group.solved is not None and group.doubt is not None]
    if not good:
        raise CalibrationError(groups[0].refused)
    lenses: dict[str, Lens] = {}
    lens_errors: dict[str, LensError] = {}
    mounted: dict[str, Pose] = {}
    rig_errors: dict[str, PoseError] = {}
    places: list[BoardPlace] = []
    misses, outliers = [], [group.refused for group in groups if group.refused]
    # Groups of cameras that never saw the board together are independent measurements of one rig.
    for group in good:
        solved, doubt = group.solved, group.doubt
        assert solved is not None
        assert doubt is not None
        for name, lens in solved.lenses.items():
            if name in solved.cam_from_rig:
                lenses[name] = lens
            if name in doubt.lenses and np.isfinite(list(doubt.lenses[name].values())).all():
                lens_errors[name] = _lens_error(doubt, name)
        if len(solved.cam_from_rig) > 1:
            for name, pose in solved.cam_from_rig.items():
                mounted[name] = pose_of(pycolmap.Rigid3d(pose[:3]))
                error = (doubt.rotation.get(name, np.nan), doubt.translation.get(name, np.nan))
                if np.isfinite(error).all():
                    rig_errors[name] = PoseError(rotation=error[0], translation=error[1])
        outliers += _doubts(group, doubt)
        places += places_of(solved)
        misses.append(solved.misses)
        outliers += _named(solved)
    # Misses of all groups make one figure, since one board and one person were behind them.
    every = np.concatenate(misses)
    evidence = BoardEvidence(
        board=board,
        printed=printed,
        frames=len({view.frame for view in corners}),
        views=len(corners),
        corners=len(every),
        rms_px=float(np.sqrt(np.mean(every**2))),
        outliers=tuple(outliers),
        places=tuple(sorted(places, key=lambda place: (place.frame, place.cameras))),
    )
    # Lenses that are not sure enough serve as a first guess of structure from motion alone.
    sure_lenses, lens_rung = _sure_lenses(lenses, lens_errors)
    sure_rig, rig_rung = _sure_rig(lenses, rig_errors)
    rungs = [rung for group in good for rung in group.rungs] + [lens_rung] + [rig_rung] * bool(mounted)
    return MeasuredBoard(
        lenses, lens_errors, mounted, rig_errors, evidence, tuple(rungs), sure_lenses, sure_rig
    )


def _lens_error(doubt: uncertainty.Uncertainty, name: str) -> LensError:
    """The errors of a lens, and its map of errors of the projection, None where it is not known."""
    projection = tuple(
        tuple(one if np.isfinite(one) else None for one in row) for row in doubt.map[name].tolist()
    )
    return LensError.model_validate({**doubt.lenses[name], "projection": projection})


def _doubts(group: Group, doubt: uncertainty.Uncertainty) -> Iterator[str]:
    """A sentence for each reason to doubt the measurement of a group."""
    if group.isolated:
        yield (
            f"{', '.join(group.isolated)} never saw the board together with the other cameras: hold it "
            "where both see it."
        )
    if doubt.failed:
        yield (
            f"{doubt.failed} of {doubt.failed + doubt.draws} random choices of the board's frames give "
            f"no lens of {', '.join(group.names)}: show the board in more frames, and larger."
        )
    for name, ratio in doubt.halves.items():
        if ratio > DISAGREE:
            yield (
                f"odd and even frames of the board disagree about the lens of {name} {ratio:.1f} times as "
                "far as noise explains: lock its focus, keep the board flat, or its lens is of another kind."
            )


def places_of(solved: rig.Solved) -> list[BoardPlace]:
    """Return where the board stood at every frame that has a corner which fits."""
    cameras_at: dict[int, set[str]] = {}
    for view, _ in solved.places:
        cameras_at.setdefault(view.frame, set()).add(view.camera)
    return [
        BoardPlace(
            frame=frame,
            cameras=tuple(sorted(names)),
            cam_from_board=pose_of(
                pycolmap.Rigid3d((solved.cam_from_rig[min(names)] @ solved.rig_from_board[frame])[:3])
            ),
        )
        for frame, names in sorted(cameras_at.items())
    ]


def _sure_lenses(lenses: Mapping[str, Lens], errors: Mapping[str, LensError]) -> tuple[frozenset[str], Rung]:
    """Cameras whose lens, and its middle, are known to a fraction of a pixel over the whole image."""
    off = {
        name: max(float(np.mean(error.projection_map())), error.cx, error.cy)
        for name, error in errors.items()
    }
    sure = frozenset(name for name in lenses if off.get(name, np.inf) < SURE_PX)
    worst = max((off.get(name, np.inf) for name in lenses), default=np.inf)
    least = f"to {worst:.2g} px" if np.isfinite(worst) else "not everywhere in its image"
    reason = (
        f"the board determines {len(sure)} of {len(lenses)} lenses to {SURE_PX:g} px or better (the worst "
        f"{least}); a scene adjusts the others"
    )
    return sure, Rung(name="board_lenses", taken=bool(sure), reason=reason)


def _sure_rig(lenses: Mapping[str, Lens], errors: Mapping[str, PoseError]) -> tuple[bool, Rung]:
    """Return whether where the cameras look is known to a fraction of a pixel."""
    off = [float(np.radians(error.rotation)) * lenses[name].fx for name, error in errors.items()]
    worst = max(off, default=float("inf"))
    reason = f"the board determines where the cameras look to {worst:.2g} px"
    if worst >= SURE_RIG_PX:
        reason += (
            "; a scene determines it better, and the board only the scale: show it in more frames, and larger"
        )
    return worst < SURE_RIG_PX, Rung(name="board_rig", taken=worst < SURE_RIG_PX, reason=reason)


def _named(solved: rig.Solved) -> list[str]:
    """A sentence for each camera, and each view, that fits much worse than the typical one."""
    words = []
    by: tuple[Callable[[ViewId], str], ...] = (
        lambda view: f"camera {view.camera}",
        lambda view: f"view {view}",
    )
    for name_of in by:
        squares: dict[str, list[float]] = {}
        for (view, _), miss in zip(solved.places, solved.misses, strict=True):
            squares.setdefault(name_of(view), []).append(float(miss) ** 2)
        errors = {name: float(np.sqrt(np.mean(misses))) for name, misses in squares.items()}
        typical = float(np.median(list(errors.values())))
        words += [
            f"the board misses by {rms:.2f} px in {name}, {typical:.2f} px in the others."
            for name, rms in errors.items()
            if rms > OUTLIER * typical
        ]
    return words
