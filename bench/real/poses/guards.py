"""Cost of each rule of placing views on real sets, and its gain where parts of a scene look alike.

    python -m bench.real.poses.guards [--quick] [--json] [--write] [--work FOLDER] [--sets fox,banana,...]

Each set is calibrated up to its poses as `rig calibrate` does, and once more without each rule that made a
difference: one of its functions returned something else than would stand in its place without it. Learned
features, an extra, are not used. Real sets under RIG_DATA, scaled; made ones are path-traced, with known
poses. wrong: against published centres (fox)
or the truth of made sets, unknown elsewhere. focal: of the first camera, in per cent above EXIF's or the
truth. Rows, features and matches are kept in FOLDER. --quick: sceaux.
"""

import argparse
from collections.abc import Callable, Mapping
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

from PIL import Image

from bench.calibration.lookalikes.foreign_poses import judged
from bench.calibration.lookalikes.foreign_scenes import DEVELOPED, SCENES
from bench.calibration.lookalikes.placed import FURTHER, PlacedViews, place
from bench.real.made_sets import METAL, metal_and_glass
from bench.real.poses.judges import WRONG, away_of, photographs, published_centres, stated_focal
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from calib import place_views
from calib.data import learned
from calib.poses import first_model, resolution, sfm
from calib.poses.resolution import ResolvedModel
from calib.poses.rigs import tied_model
from capture.imports.photos import import_photos
from imaging.session.session import Session
from tests.foreign.photographs import session as foreign_session

LONG_SIDE = {"fox": 1000, "banana": 1200, "brighton": 1000, "sceaux": 1000, "monstree": 1000, "lund": 1000}
"""Pixels that photographs of a set are scaled to; those of made ones stay."""
ALIKE = "crate-alike", "column-2", "facade-weathered", "crate-few", "varnished"


@dataclass(frozen=True)
class Part:
    """A function or a number of a rule, and what stands in its place where the rule is left out."""

    module: Any
    name: str
    instead: Any

    def off(self) -> Any:
        """Patch that leaves it out."""
        return patch.object(self.module, self.name, self.instead)

    def watched(self, acted: Callable[[], None]) -> Any:
        """Patch that calls `acted` where the function returns something else than would stand instead."""
        function = getattr(self.module, self.name)
        if not callable(function):
            return nullcontext()

        def watching(*given: Any, **named: Any) -> Any:
            returned = function(*given, **named)
            if not _same(returned, self.instead(*given, **named)):
                acted()
            return returned

        return patch.object(self.module, self.name, watching)


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, ResolvedModel):
        return one.reconstruction is other.reconstruction and not one.left_out
    if isinstance(one, tuple):  # lenses and rungs: a rung that was not taken changes nothing
        one, other = one[0], other[0]
    return one is other or bool(one == other)


def _first_model(reconstruction: Any, matches: Any, **_: Any) -> ResolvedModel:
    return ResolvedModel(reconstruction, frozenset(), (), len(matches.pairs))


ALL = "nothing"
RULES: Mapping[str, tuple[Part, ...]] = {
    ALL: (),
    "contradictions": (Part(first_model, "resolve_contradictions", _first_model),),
    "brightness": (
        Part(resolution, "otherwise_lit", lambda *_: set()),
        Part(resolution, "lit_apart", lambda *_: False),
        Part(resolution, "mostly_apart", lambda *_: False),
        Part(resolution, "warning", lambda *_: None),
    ),
    "third views": (Part(resolution, "unconfirmed", lambda *_: None),),
    "joined by one pair": (Part(first_model, "joined_groups", lambda _, views, __: [set(views)]),),
    "placed at once": (Part(first_model, "map_at_once", lambda *_: None),),
    "further features": (Part(place_views, "enough_features", lambda _: 10**9),),
    "EXIF's focal length": (
        Part(sfm, "focal_priors", lambda _: {}),
        Part(sfm, "settle_focal", lambda _, free, *__: (free, ())),
    ),
    "lens ladder": (Part(sfm, "climb", lambda _, free, *__: (free, ())),),
    "fisheye": (Part(tied_model, "sees_wide", lambda _: False),),
}
"""Rules of placing, by their parts."""


def session_of(name: str, work: Path) -> Path:
    """A set as a session, which is made once."""
    folder = work / f"guards-{name.replace(' ', '-')}"
    session = folder / "S"
    if (session / "session.json").exists():
        return session
    if name in SCENES:
        return foreign_session(session, SCENES[name]().light(), developed=name in DEVELOPED)
    if name == METAL:
        import_photos(photographs(name)[0].parent, session)
        return session
    (folder / "photos").mkdir(parents=True, exist_ok=True)
    for path in photographs(name):
        with Image.open(path) as picture:
            exif = picture.getexif()
            picture.thumbnail((LONG_SIDE[name],) * 2, Image.Resampling.LANCZOS)
            picture.save(folder / "photos" / path.name, quality=95, exif=exif)
    import_photos(folder / "photos", session)
    return session


def one(name: str, rule: str, work: Path) -> dict[str, Any]:
    """Return what became of the views of a set without a rule, and which rules made a difference."""
    session = session_of(name, work)
    stack = ExitStack()
    stack.enter_context(patch.object(learned, "available", lambda: False))
    acted: set[str] = set()
    for part in RULES[rule]:
        stack.enter_context(part.off())
    for other in RULES.keys() - {rule}:
        for part in RULES[other]:
            stack.enter_context(part.watched(partial(acted.add, other)))
    placed = place(session, stack)
    row: dict[str, Any] = {
        "views": len({(shot.frame, shot.camera) for shot in Session.open(session).shots("scene")}),
        "placed": len(placed.poses),
        "wrong": _wrong(name, session, placed),
        "doubts": placed.doubts,
        "further": placed.taken(*FURTHER),
        "refused": placed.refused,
        "acted": sorted(acted | ({"further features"} if placed.taken(*FURTHER) else set())),
    }
    if placed.model is not None:
        lens = next(iter(placed.model.lenses.values()))
        row |= {"lens": lens.model, "focal": lens.fx / max(lens.width, lens.height)}
    return row


def _wrong(name: str, session: Path, placed: PlacedViews) -> int | None:
    if name in SCENES:
        return judged(placed.poses, SCENES[name]().poses)["wrong"]
    if name == METAL:
        return judged(placed.poses, metal_and_glass(WORK / "metal_and_glass")[1])["wrong"]
    published = published_centres(name)
    if published is None or len(placed.poses) < 3:
        return None
    sources = {
        (shot.frame, shot.camera): Path(shot.source or shot.file).stem
        for shot in Session.open(session).shots("scene")
    }
    centres = {
        sources[view.frame, view.camera]: -pose[:3, :3].T @ pose[:3, 3] for view, pose in placed.poses.items()
    }
    return int((away_of(centres, published) > WRONG).sum())


def stated(name: str) -> float | None:
    """Return EXIF's focal length of a set, in long sides of the image; None where files say nothing."""
    if name in SCENES or name == METAL:
        return None
    px = stated_focal(name)
    with Image.open(photographs(name)[0]) as picture:
        return None if px is None else px / max(picture.size)


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Rows of each set: with all rules, and without each that made a difference."""
    cache = Cache(options.work / "guards.jsonl")
    rows: dict[str, dict[str, Any]] = {}
    for name in options.sets:
        row = cache.get(f"{name} {ALL}", partial(one, name, ALL, options.work))
        rows[name] = {ALL: row} | {
            rule: cache.get(f"{name} {rule}", partial(one, name, rule, options.work)) for rule in row["acted"]
        }
    return {"machine": machine(), "rows": rows}


def table(result: dict[str, Any]) -> str:
    """Markdown."""
    rows = result["rows"]
    lines = [
        "# What each rule of placing costs and gains",
        "",
        f"`python -m bench.real.poses.guards --write`. {words(result['machine'])}.",
        "",
        "Views that are placed, of these wrongly (where it is known), and what is said, with all rules and",
        "without each that made a difference; empty: it made none. Then the focal length, in per cent above",
        "EXIF's.",
        "",
        "| without | " + " | ".join(f"{name} ({row[ALL]['views']})" for name, row in rows.items()) + " |",
        "|" + "---|" * (len(rows) + 1),
    ]
    for rule in RULES:
        lines.append(f"| {rule} | " + " | ".join(_cell(row.get(rule)) for row in rows.values()) + " |")
    with_focal = {name: exif for name in rows if (exif := stated(name)) is not None}
    lines += ["", "| without | " + " | ".join(with_focal) + " |", "|" + "---|" * (len(with_focal) + 1)]
    for rule in RULES:
        cells = [_focal(rows[name].get(rule), exif) for name, exif in with_focal.items()]
        lines.append(f"| {rule} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _cell(row: Mapping[str, Any] | None) -> str:
    if row is None:
        return ""
    if row["refused"]:
        return "refused"
    wrong = "" if row["wrong"] is None else f", {row['wrong']} wrong"
    said = [name.removeprefix("pose_").replace("_", " ") for name in (*row["doubts"], *row["further"])]
    return f"{row['placed']}{wrong}{f' ({chr(44).join(said)})' if said else ''}"


def _focal(row: Mapping[str, Any] | None, exif: float) -> str:
    if row is None or "focal" not in row:
        return ""
    return f"{100 * (row['focal'] / exif - 1):+.1f} ({row['lens']})"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, default=WORK / "guards", help="keeps sessions and finished rows")
    parser.add_argument("--sets", default=",".join((*LONG_SIDE, METAL, *ALIKE)), help="comma-separated")
    options = parser.parse_args()
    options.sets = ("sceaux",) if options.quick else tuple(options.sets.split(","))
    options.work.mkdir(parents=True, exist_ok=True)
    result = measure(options)
    deliver(options, "real_guards", result, table(result))


if __name__ == "__main__":
    main()
