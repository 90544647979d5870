"""`rig import`: a session made of photographs that exist, copied byte for byte."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory

from capture.imports.copying import Place
from capture.imports.given.depths import Depths, depths_asked, depths_note
from capture.imports.given.given_calibration import check_sizes, has_poses
from capture.imports.given.masks import masks_asked, masks_note, transparency_notes
from capture.imports.import_plans import places_of, plans_of
from capture.imports.layouts import detect, read_layout
from capture.imports.layouts.given import Given
from capture.imports.originals import FOREIGN, Original, Survey, survey
from capture.imports.request import ImportRequest, LayoutName
from capture.imports.sorting.band_list import bands_of, read_band_list
from capture.imports.sorting.camera_sorting import sort_into_cameras
from capture.imports.sorting.frame_numbering import Numbered, frames_in_time, frames_of_layout
from capture.imports.sorting.pixel_shift import put_together
from capture.imports.sorting.strays import without_strays
from capture.imports.video.video import is_video, take_frames
from capture.imports.written_session import write_session
from imaging.arguments import checked
from imaging.errors import InputError, PartialError
from imaging.progress import Progress, unreported
from imaging.session.records import Band, PlanRecord

_DEFAULTS = ImportRequest()


@dataclass(frozen=True)
class ImportResult:
    """Result of an import.

    Attributes:
        session: Session folder.
        layout: Layout of the imported folder.
        cameras: Number of cameras.
        frames: Number of frames.
        shots: Number of shots.
        views: Views that came with a pose.
        guesses: A sentence for each guess.
        missing: A sentence for each file left out.
    """

    session: Path
    layout: LayoutName
    cameras: int
    frames: int
    shots: int
    views: int
    guesses: tuple[str, ...]
    missing: tuple[str, ...] = ()

    def require_complete(self) -> None:
        """PartialError that lists what is missing, if anything is."""
        if self.missing:
            count, whole = len(self.missing), self.shots + len(self.missing)
            raise PartialError(
                f"{self.session}: {count} of {whole} file{'' if whole == 1 else 's'} could not be read "
                f"({'; '.join(self.missing)}): repair {'it' if count == 1 else 'them'} and import again into "
                "a new folder."
            )


@checked
def import_photos(
    folder: str | PathLike[str],
    out: str | PathLike[str],
    request: ImportRequest = _DEFAULTS,
    *,
    on_progress: Progress = unreported,
    **options: object,
) -> ImportResult:
    """Make a session of photographs; these stay untouched.

    An import that was killed is completed by the same call. A file that cannot be read is listed in the
    result.

    Args:
        folder: Folder of the photographs, with its subfolders; or a video, whose sharpest frames are taken.
        out: Session folder.
        request: Options.
        on_progress: Callback for the current step, the steps done, and all of them.
        options: Options by name, in place of those of `request`.

    Returns:
        The session, its guesses, and the files left out.

    Raises:
        InputError: `folder` holds nothing usable, its layout is damaged, or `out` is not empty or in
            `folder`.
        StorageError: The disk refuses. Both leave nothing behind.
    """
    folder, out = Path(folder), Path(out)
    if not is_video(folder):
        return _import_folder(folder, out, request, on_progress)
    _refuse_options_of_photos(folder, request)
    with TemporaryDirectory() as aside:
        frames = Path(aside) / folder.stem
        note = take_frames(folder, frames, on_progress)
        shot = ImportRequest(layout="photos", cameras="one", bracket=1, masks=request.masks)
        result = _import_folder(frames, out, shot, on_progress, folder)
    return replace(result, guesses=(note,))


def _import_folder(
    folder: Path, out: Path, request: ImportRequest, on_progress: Progress, video: Path | None = None
) -> ImportResult:
    """Import the photographs of a folder; `video`: that they are frames of."""
    exposures, bands = (None if path is None else Path(path) for path in (request.exposures, request.bands))
    _check_folders(folder, out, request.bracket)
    # What a layout states is taken in place of guesses; without one, the files speak for themselves.
    name = request.layout or detect(folder)
    given = read_layout(folder, name)
    named = None if given is None else {photo.path: photo.exposure for photo in given.photos}
    filters = () if bands is None else read_band_list(bands)
    surveyed = survey(folder, on_progress, named=named, exposures=exposures)
    strays: list[str] = []
    if given is None and request.cameras is None:
        remaining, strays = without_strays(surveyed.originals)
        surveyed = replace(surveyed, originals=remaining)
    lost = () if given is None else given.missing
    # Refused before anything is sorted, so that the sentence names files and not brackets.
    if not any(original.picture for original in surveyed.originals):
        raise _nothing_usable(folder, surveyed.originals, lost)
    notes = [*surveyed.notes, *strays]
    if given is not None:
        check_sizes(given, surveyed.originals)
        notes = [_layout_note(given, request.layout), *given.notes, *_absent(given), *notes]
    band_of = bands_of(folder, [original.path for original in surveyed.originals], filters) if filters else {}
    numbered, guesses = _numbered(folder, request, given, surveyed.originals, filters, band_of)
    covers, deep, beside = _beside(folder, request, given, surveyed)
    plans: list[PlanRecord] = []
    places: list[Place] = []
    for entry in numbered:
        new_plans = plans_of(entry, band_of)
        plans.extend(new_plans)
        places.extend(places_of(entry, new_plans, covers, deep, band_of))
    places = [replace(place, video=video) for place in places]
    cameras = tuple(entry.camera for entry in numbered)
    written = write_session(out, cameras, plans, places, given, filters, on_progress)
    unreadable = [original.error for original in surveyed.originals if original.error is not None]
    return ImportResult(
        session=out,
        layout=name,
        cameras=len(cameras),
        frames=len({place.shot_id.frame for place in places}),
        shots=len([place for place in places if place.original.picture]) - len(written.unread),
        views=written.views,
        guesses=(*notes, *beside, *written.notes, *guesses),
        missing=(*unreadable, *written.unread),
    )


def _beside(
    folder: Path, request: ImportRequest, given: Given | None, surveyed: Survey
) -> tuple[dict[Path, Path], Depths, list[str]]:
    """Masks and depth maps of the photographs: those asked for by hand come before those of the layout,
    or those that lie beside photographs without one.

    Returns:
        The mask and the depth map of each photograph that has one, and a sentence on each kind.
    """
    paths = [original.path for original in surveyed.originals]
    covers = (
        dict(surveyed.masks)
        if given is None
        else {photo.path: photo.mask for photo in given.photos if photo.mask}
    )
    notes = []
    if request.masks is not None:
        covers, mask_note = masks_asked(paths, folder, Path(request.masks))
        notes.append(mask_note)
    elif covers:
        notes.append(masks_note(covers, len(paths)))
    notes += transparency_notes(surveyed.originals, covers)
    deep = _depths(given, paths, folder, None if request.depths is None else Path(request.depths))
    if deep:
        notes.append(depths_note(deep, len(paths)))
    return covers, deep, notes


def _numbered(
    folder: Path,
    request: ImportRequest,
    given: Given | None,
    originals: Sequence[Original],
    filters: Sequence[Band],
    band_of: Mapping[Path, str],
) -> tuple[list[Numbered], list[str]]:
    """Sort photographs into cameras, frames and brackets, as the layout names them or by what they show.

    Returns:
        The brackets of each camera, and a sentence for each guess.
    """
    labels = None if given is None else {photo.path: photo.camera for photo in given.photos}
    series, guesses = sort_into_cameras(
        folder,
        originals,
        request.cameras,
        labels,
        frozenset(band.name.casefold() for band in filters),
        turn=request.depths is None and not filters,
    )
    if request.pixel_shift:
        if given is not None:
            raise InputError("pixel shift is read of folders of photographs: add --layout photos.")
        series, notes = put_together(series)
        guesses += notes
    if given is None or filters:
        by_folder = request.cameras == "folder"
        numbered, why = frames_in_time(
            series, request.bracket, request.together, band_of, filters, ordered=by_folder
        )
    else:
        numbered, why = frames_of_layout(series, given, request.bracket, request.together)
    return numbered, guesses + why


def _layout_note(given: Given, asked: LayoutName | None) -> str:
    what = f"Lenses and poses are those of {given.teller}" if has_poses(given) else "There are no poses"
    reason = "as given" if asked is not None else "--layout photos takes the photographs alone"
    return f"{what}, the folder being read in the layout of {given.layout}; {reason}."


def _absent(given: Given) -> list[str]:
    """A sentence on what a data set lists without having it, as many that are handed on in part."""
    if not given.missing:
        return []
    count = len(given.missing)
    photos = "1 photo that is listed is" if count == 1 else f"{count} photos that are listed are"
    return [f"{photos} not there and left out: {given.missing[0]}{' (the first)' if count > 1 else ''}."]


def _refuse_options_of_photos(video: Path, request: ImportRequest) -> None:
    """Raise InputError for an option that frames of a video cannot follow."""
    asked = {
        "--layout": request.layout not in (None, "photos"),
        "--cameras": request.cameras not in (None, "one"),
        "--bracket": request.bracket not in (None, 1),
        "--together": request.together is not None,
        "--exposures": request.exposures is not None,
        "--depths": request.depths is not None,
        "--bands": request.bands is not None,
        "--pixel-shift": request.pixel_shift,
    }
    for option in (name for name, given in asked.items() if given):
        raise InputError(f"{video} is a video, and {option} is for photographs: leave {option} out.")


def _check_folders(folder: Path, out: Path, bracket: int | None) -> None:
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder: name the folder that holds the photographs.")
    if (folder / "session.json").is_file():
        raise InputError(
            f"{folder} is a session, with renders and previews of its own: name the folder of the "
            f"photographs themselves, such as {folder / 'raw'}."
        )
    if out.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{out} lies inside {folder}: name a folder outside of the photographs.")
    if bracket is not None and bracket < 1:
        raise InputError(f"a bracket of {bracket} photos is empty: give 1 or more.")


def _nothing_usable(folder: Path, originals: Sequence[Original], lost: Sequence[str]) -> InputError:
    if lost:
        return InputError(f"{lost[0]}, and no other photograph is: copy the photographs to {folder}.")
    if not originals:
        suffixes = {path.suffix.lower() for path in folder.rglob("*")} & FOREIGN.keys()
        fix = FOREIGN[min(suffixes)] if suffixes else "name a folder of photographs"
        return InputError(f"{folder} holds no RAW, JPEG, PNG, TIFF, EXR or HDR file: {fix}.")
    names = "; ".join(str(original.error) for original in originals[:3])
    more = f"; and {len(originals) - 3} more" if len(originals) > 3 else ""
    return InputError(f"{folder} holds no photograph that can be read ({names}{more}): copy them again.")


def _depths(given: Given | None, photos: list[Path], folder: Path, asked: Path | None) -> Depths:
    """Depth maps of the requested folder, else those that the layout names."""
    if asked is not None:
        return depths_asked(photos, folder, asked)
    return {} if given is None else {photo.path: photo.depth for photo in given.photos if photo.depth}
