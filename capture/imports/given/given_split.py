"""Split of a layout into training and test views, kept as the session's `split.json`."""

from collections.abc import Sequence

from capture.imports.copying import Place
from capture.imports.layouts.given import Given
from capture.record.shot_files import shot_file
from imaging.files import store
from imaging.session.records import SplitRecord
from imaging.session.session import SPLIT, Session
from imaging.session.view_id import ViewId


def write_split(session: Session, given: Given, places: Sequence[Place]) -> list[str]:
    """Write `split.json` and say so, if the layout has photographs of both uses; else do nothing."""
    uses = {photo.path: photo.use for photo in given.photos}
    files: dict[str | None, list[str]] = {"train": [], "test": [], None: []}
    views: dict[str | None, set[ViewId]] = {"train": set(), "test": set(), None: set()}
    for place in places:
        if place.original.picture is None:
            continue
        use = uses[place.original.path]
        files[use].append(shot_file(place.shot_id, place.original.path.suffix.lower().lstrip(".")))
        views[use].add(place.shot_id.view)
    if not (files["train"] and files["test"]):
        return []
    record = SplitRecord(reason=given.teller, train=tuple(files["train"]), test=tuple(files["test"]))
    store.write_json(session.folder / SPLIT, record.model_dump(mode="json"))
    aside = f", {len(files[None])} photographs are for neither" if files[None] else ""
    return [
        f"{len(views['train'])} views are for training and {len(views['test'])} for testing, as "
        f"{given.layout} has it{aside}; without {SPLIT} rig holds out views of its own choice."
    ]
