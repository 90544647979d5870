"""Goals of the judges, and the part of `docs/figures.md` that says which are met."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from imaging.files import store

PAGE = Path(__file__).parents[2] / "docs" / "figures.md"
BEGIN, END = "<!-- bench:judges -->", "<!-- /bench -->"
MOST_TIMES = 1.3
"""Processor seconds of rig over those of pycolmap's defaults, at most, on every set."""
SECONDS = "seconds"


@dataclass(frozen=True)
class Fact:
    """A known fact of a set: the key of a row, in words with its unit, and what is asked of it."""

    key: str
    words: str
    asked: str
    met: Callable[[float], bool]

    def said(self, value: float) -> str:
        """Format a value beside what is asked of it."""
        return f"{self.words.format(value)} ({self.asked})"


@dataclass(frozen=True)
class Goal:
    """A set in words, the fewest views that have to be placed, and known facts.

    why: why a fact, `placed` or `seconds` is missed, where it is.
    """

    title: str
    placed: int
    facts: tuple[Fact, ...] = ()
    why: Mapping[str, str] = field(default_factory=dict)


GOALS: Mapping[str, Goal] = {
    "fox": Goal(
        "a telephone's video before wallpaper, exposed automatically, without EXIF",
        50,
        (
            Fact(
                "centre_median", "centres {:.3f} % of the extent off", "at most 0.06", lambda off: off <= 0.06
            ),
        ),
        {
            "centre_median": "published centres are another program's, and pycolmap is farther from them",
        },
    ),
    "banana": Goal(
        "fruit on a carpet, one photograph of it blurred",
        15,
        why={"placed": "one pair of views alone holds the others"},
    ),
    "brighton": Goal(
        "a drone's flight over a park",
        18,
        (
            Fact("focal_off", "focal length {:.1f} % from EXIF's", "at most 5", lambda off: off <= 5),
            Fact("ground_below", "ground {:.1f} m below", "36.2 ± 1.5", lambda far: abs(far - 36.2) <= 1.5),
            Fact("height_span", "heights within {:.2f} m", "at most 0.4", lambda span: span <= 0.4),
            Fact("tilt", "axes tilted by {:.2f} degrees", "at most 0.5", lambda tilt: tilt <= 0.5),
        ),
        {
            "height_span": "each strip of six views is bowed by 0.8 m, as rows that are read one after "
            "another or a rest of distortion would bow it; rows are not modelled",
            "tilt": "neighbouring photographs turn by two degrees where the flight turns back, without any "
            "adjustment; the gimbal hangs with the body",
        },
    ),
    "sceaux": Goal("a castle", 11),
    "monstree": Goal("a tree", 23),
    "lund": Goal("a walk along a building front", 25),
    "metal and glass": Goal(
        "a path-traced ring of metal and glass, in JPEG brackets",
        25,
        (Fact("wrong", "{:.0f} wrong", "none", lambda wrong: wrong == 0),),
        {
            SECONDS: "features and matching take half of them, and each bracket is read three times, while "
            "pycolmap is given fused pictures"
        },
    ),
}
"""Goals as they were set before the sets were tried."""


def missed(row: Mapping[str, Any], goal: Goal) -> list[str]:
    """List what misses its goal, by key."""
    rig, peer = row["rig"], row["pycolmap"]
    keys = [] if rig["placed"] >= max(goal.placed, right_of(peer)) else ["placed"]
    keys += [fact.key for fact in goal.facts if fact.key in rig and not fact.met(rig[fact.key])]
    return keys if rig["seconds"] <= MOST_TIMES * peer["seconds"] else [*keys, SECONDS]


def right_of(peer: Mapping[str, Any]) -> int:
    """Count the views that a program places, without those that are known to be wrong."""
    return int(peer["placed"]) - int(peer.get("wrong", 0))


def table(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Markdown of every set: what was placed, how long it took, known facts, and each goal that is missed."""
    lines = [
        "| set | placed | goal | by pycolmap | s | times pycolmap's | known facts (goal) | missed |",
        "|---" * 8 + "|",
    ]
    for name, row in rows.items():
        goal, rig, peer = GOALS[name], row["rig"], row["pycolmap"]
        facts = "; ".join(fact.said(rig[fact.key]) for fact in goal.facts if fact.key in rig)
        faults = "; ".join(f"{key.replace('_', ' ')}: {goal.why[key]}" for key in missed(row, goal))
        lines.append(
            f"| {goal.title} | {rig['placed']} | {goal.placed} | {peer['placed']} | {rig['seconds']:.0f} "
            f"| {rig['seconds'] / peer['seconds']:.1f} | {facts} | {faults or 'nothing'} |"
        )
    return "\n".join(lines)


def write_page(rows: Mapping[str, Mapping[str, Any]]) -> None:
    """Put the table where the page has its place."""
    before, rest = PAGE.read_text().split(BEGIN, 1)
    after = rest.split(END, 1)[1]
    store.write_bytes(PAGE, f"{before}{BEGIN}\n{table(rows)}\n{END}{after}".encode())
