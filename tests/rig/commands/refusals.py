"""Every command, and what it is to look like when it refuses: one sentence, exit 2, nothing left."""

import hashlib
from pathlib import Path

ON_SESSION = {
    "check": ["check", "{it}"],
    "repair": ["check", "{it}", "--repair"],
    "calibrate": ["calibrate", "{it}"],
    "reconstruct": ["reconstruct", "{it}", "--quality", "draft"],
    "evaluate": ["evaluate", "{it}"],
    "render": ["render", "{it}", "--out", "{out}"],
    "trade": ["trade", "{it}", "--budget", "1s"],
    "explain": ["explain", "{it}"],
}


ON_PHOTOS = {"import": ["import", "{it}", "{out}"]}


EVERY = ON_SESSION | ON_PHOTOS


def tree(folder: Path) -> dict[str, str]:
    """Every file and folder below, with a hash of each file's bytes; locks apart."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        if path.is_file()
        else "folder"
        for path in sorted(folder.rglob("*"))
    }


def fill(arguments: list[str], it: Path, out: Path) -> list[str]:
    return [argument.format(it=it, out=out) for argument in arguments]


def assert_refused(rig, arguments: list[str], where: Path, *, code: int = 2) -> str:
    """The command ends with `code` and one sentence, and leaves `where` as it was; the sentence."""
    before = tree(where)
    given, out, err = rig(*arguments)
    assert given == code, (out, err)
    assert_one_sentence(err)
    assert tree(where) == before
    return err


def assert_one_sentence(err: str) -> None:
    assert err.count("\n") == 1, err
    assert err.rstrip("\n").isprintable()
    assert err.rstrip("\n").endswith((".", "!", "?"))
    assert "Traceback" not in err
    assert "defect" not in err
