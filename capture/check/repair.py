"""`rig check --repair`: the index of a session rebuilt from the files that are there."""

import json
import re
from collections.abc import Sequence
from glob import escape
from os import PathLike
from pathlib import Path

from capture.bracket.deviation import deviates
from capture.check.findings import FindingModel
from capture.check.rename_back import free_name, is_named_for, lost_companions, rename_back
from capture.check.shot_index import DROPS, read_index, stray_files
from capture.imports.given.depths import unit_of
from capture.imports.layouts.given import GivenDepth
from capture.pictures.read import kind_of, read_picture
from capture.record.shot_files import ShotId, depth_file, mask_file
from imaging.arguments import checked
from imaging.errors import InputError
from imaging.files import store
from imaging.merge.masks import read_mask
from imaging.optics.exposure import Exposure
from imaging.progress import Progress, unreported
from imaging.session.lock import sole_writer
from imaging.session.records import ShotRecord
from imaging.session.session import Session


class RepairReport(FindingModel):
    """Result of `repair`. dropped, added: files; renamed: a sentence for each file that has its name again;
    unrepaired: a sentence for each file that is still no shot.

    backup: the index as it was before; None if nothing had to be changed.
    """

    session: str
    dropped: tuple[str, ...]
    added: tuple[str, ...]
    renamed: tuple[str, ...]
    unrepaired: tuple[str, ...]
    backup: str | None


@checked
def repair(session: str | PathLike[str], *, on_progress: Progress = unreported) -> RepairReport:
    """Drop the records of missing files, and add the whole files that have no record.

    A file whose SHA-256 is that of a record gets the name of that record back. A captured file that is torn
    is moved to torn/ and its record dropped, so that its shot is taken again. No file is deleted or changed
    but shots.jsonl, whose old state is kept beside it.

    Args:
        session: Session, or its folder.
        on_progress: Callback for the file being read, files read, and files to read.

    Returns:
        The dropped and the added files.

    Raises:
        InputError: The folder is no session, or another rig writes to it.
        StorageError: The disk refuses.
    """
    opened = Session.open(session)
    session = opened.folder
    with sole_writer(session):
        shots, damaged = read_index(opened)
        sound = _one_a_file([shot for shot in shots if _is_there(opened, shot)])
        torn, altered = _not_as_recorded(opened, sound, {shot.sha256 for shot in shots}, on_progress)
        sound = _without(sound, torn)
        strays = stray_files(opened, sound)
        # Before the index is written: should this be killed, the next repair drops records without files.
        aside = set(strays) & {file for shot in torn for file in (shot.file, shot.developed)}
        for file in sorted(aside):
            _set_aside(session, file)
        strays = [file for file in strays if file not in aside]
        lost = _without(shots, [shot for shot in sound if shot.file not in altered])
        wanted: dict[str, list[str]] = {}
        for shot in _one_a_file(lost):
            if is_named_for(shot):
                wanted.setdefault(shot.sha256, []).append(shot.file)
        renamed, unrepaired = rename_back(session, wanted, strays, altered)
        places = set(renamed.values())
        remaining = _one_a_file([*sound, *(shot for shot in lost if shot.file in places)])
        identities = {shot.identity for shot in remaining}
        sound = [shot for shot in shots if shot.identity in identities and _is_there(opened, shot)]
        strays = [file for file in strays if file not in renamed and file not in unrepaired]
        # Those of the shots that stay, before what is not in its place is taken from their records.
        wanted, altered = lost_companions(opened, sound)
        beside = rename_back(session, wanted, strays, altered)
        renamed, unrepaired = renamed | beside[0], unrepaired | beside[1]
        strays = [file for file in strays if file not in renamed and file not in unrepaired]
        developed = _developed_of([*strays, *(shot.file for shot in sound)])
        companions = set(developed.values())
        strays = [file for file in strays if file not in companions]
        added: list[ShotRecord] = []
        identities = {shot.identity for shot in sound}
        for number, file in enumerate(strays):
            on_progress(f"reading {file}", number, len(strays))
            try:
                shot = _shot_of(opened, file, identities)
                identities.add(shot.identity)
                added.append(_with_developed(opened, shot, developed, unrepaired))
            except InputError as error:
                unrepaired[file] = str(error)
        on_progress("read", len(strays), len(strays))
        dropped = [shot.file for shot in _without(shots, sound)]
        whole = [_with_developed(opened, shot, developed, unrepaired) for shot in sound]
        changed = dropped or damaged or added or whole != sound
        backup = _rewrite(session, [*whole, *added]) if changed else None
    return RepairReport(
        session=str(session),
        dropped=(*(sentence.removesuffix(DROPS) for sentence in damaged), *dropped),
        added=tuple(shot.file for shot in added),
        renamed=tuple(f"{file} is {place}, and is called so again" for file, place in renamed.items()),
        unrepaired=tuple(unrepaired.values()),
        backup=backup,
    )


def _without(shots: Sequence[ShotRecord], others: Sequence[ShotRecord]) -> list[ShotRecord]:
    """The shots that are not among others."""
    identities = {shot.identity for shot in others}
    return [shot for shot in shots if shot.identity not in identities]


def _developed_of(files: list[str]) -> dict[str, str]:
    """Photographs of the same name that cameras made beside RAW files, by name."""
    raws = {Path(file).with_suffix(""): file for file in files if kind_of(Path(file)) == "raw"}
    photos = [file for file in files if kind_of(Path(file)) == "ldr"]
    return {raws[stem]: file for file in photos if (stem := Path(file).with_suffix("")) in raws}


def _with_developed(
    session: Session, shot: ShotRecord, developed: dict[str, str], unrepaired: dict[str, str]
) -> ShotRecord:
    """The record with the photograph beside its RAW file if it had none; without one that is not there.

    One that cannot be read goes into `unrepaired`.
    """
    companion = developed.get(shot.file)
    if companion is not None and shot.developed is None:
        try:
            digest = store.sha256(store.inside(session.folder, companion))
        except InputError as error:
            unrepaired[companion] = str(error)
            return shot
        return shot.model_copy(update={"developed": companion, "developed_sha256": digest})
    if shot.developed is not None and not (session.folder / shot.developed).is_file():
        return shot.model_copy(update={"developed": None, "developed_sha256": None})
    return shot


def _is_there(session: Session, shot: ShotRecord) -> bool:
    try:
        return session.file(shot).is_file()
    except InputError:
        return False


def _not_as_recorded(
    session: Session, shots: list[ShotRecord], recorded: set[str], on_progress: Progress
) -> tuple[list[ShotRecord], dict[str, str]]:
    """The shots whose files can no longer be read, and the SHA-256 of the other files that are not those of
    their records; none of an import, whose originals are elsewhere.

    Files are whole that are what was recorded, of whatever shot, whatever reads them here.
    """
    torn: list[ShotRecord] = []
    altered: dict[str, str] = {}
    for number, shot in enumerate(shots if session.record.origin != "import" else ()):
        on_progress(f"reading {shot.file}", number, len(shots))
        path = session.file(shot)
        try:
            digest = store.sha256(path)
            if digest not in recorded:
                read_picture(path)
            if digest != shot.sha256:
                altered[shot.file] = digest
        except InputError:
            torn.append(shot)
    return torn, altered


def _set_aside(session: Path, file: str) -> None:
    """Move a file of raw/ to torn/, under a name that is free there."""
    path = session / file
    new = session / "torn" / Path(file).relative_to("raw")
    store.make_folder(new.parent)
    store.rename(path, free_name(new))


def _one_a_file(shots: list[ShotRecord]) -> list[ShotRecord]:
    """Records with duplicate files removed: the one that the file is named for stays, else the first."""
    owner: dict[str, ShotRecord] = {}
    for shot in shots:
        if shot.file not in owner or is_named_for(shot):
            owner[shot.file] = shot
    return list(owner.values())


def _shot_of(session: Session, file: str, taken: set[tuple[str, str, int, int]]) -> ShotRecord:
    """The record of a file by its name, the plans and its own metadata; InputError if it is no shot.

    taken: identities of the shots that have a file.
    """
    place = re.fullmatch(r"raw/(\d{4,9})/(.+)_(\d{1,9})\.\w+", file)
    if place is None:
        raise InputError(f"{file} is not named raw/FRAME/CAMERA_STEP: rename it, or move it away.")
    frame, name, step = int(place[1]), place[2], int(place[3])
    camera = session.camera(name)
    plan = next(
        (
            plan
            for plan in reversed(session.plans())
            if name in plan.cameras and frame in plan.frames and step < len(plan.bracket)
        ),
        None,
    )
    if plan is None:
        raise InputError(f"{file} is in no plan of the session: move it away.")
    if (plan.plan, name, frame, step) in taken:
        raise InputError(f"{file} stands for a shot that has another file already: move one of them away.")
    path = store.inside(session.folder, file)
    picture = read_picture(path)
    if picture.kind != camera.kind:
        raise InputError(f"{file} is {picture.kind}, and the camera {name} is {camera.kind}: move it away.")
    planned, imported = plan.bracket[step], session.record.origin == "import"
    stated = picture.metadata.exposure
    shot_id = ShotId(name, frame, step)
    mask = _companion(session, mask_file(shot_id, ""))
    if mask is not None:
        read_mask(store.inside(session.folder, mask), picture.height, picture.width)
    # A unit that only the layout stated is lost, and scene points determine it again.
    depth, unit = _companion(session, depth_file(shot_id, "")), None
    if depth is not None:
        unit = unit_of(GivenDepth(store.inside(session.folder, depth)), picture.height, picture.width)
    return ShotRecord(
        kind=plan.kind,
        plan=plan.plan,
        camera=name,
        frame=frame,
        step=step,
        file=file,
        sha256=store.sha256(path),
        requested=None if imported else planned,
        reported=_exposure_of_import(stated, planned) if imported else stated,
        width=picture.width,
        height=picture.height,
        captured_at=picture.metadata.captured_at,
        mask=mask,
        mask_sha256=None if mask is None else store.sha256(session.folder / mask),
        depth=depth,
        depth_sha256=None if depth is None else store.sha256(session.folder / depth),
        depth_unit=unit,
        band=plan.band(step, camera),
    )


def _exposure_of_import(stated: Exposure | None, planned: Exposure | None) -> Exposure | None:
    """Return the plan's exposure, which a list or layout may have stated in place of the file's.

    That of the file where it says the same, since a plan has one for all frames, which may differ slightly.
    """
    if stated is None or planned is None:
        return stated or planned
    alike = [
        (one is None) == (other is None)
        for one, other in ((stated.iso, planned.iso), (stated.f_number, planned.f_number))
    ]
    return stated if all(alike) and not deviates(stated, planned) else planned


def _companion(session: Session, stem: str) -> str | None:
    """The mask or depth map that an import laid down for a shot."""
    files = sorted(session.folder.glob(f"{escape(stem)}.*"))
    return files[0].relative_to(session.folder).as_posix() if files else None


def _rewrite(session: Path, shots: list[ShotRecord]) -> str | None:
    """Replace the index as a whole; the name of the copy of the old one."""
    index = session / "shots.jsonl"
    backup = None
    if index.exists():
        number = 1
        while (session / f"shots.jsonl.{number}.bak").exists():
            number += 1
        backup = f"shots.jsonl.{number}.bak"
        store.write_bytes(session / backup, index.read_bytes())
    lines = [json.dumps(shot.model_dump(mode="json", exclude_none=True), allow_nan=False) for shot in shots]
    store.write_bytes(index, "".join(f"{line}\n" for line in lines).encode())
    return backup
