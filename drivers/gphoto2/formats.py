"""File formats of a body, by their names in libgphoto2, which differ from make to make."""

FORMATS = ("imageformat", "imagequality")
"""Settings that hold the file format of a body."""
_RAW_WORDS = ("raw", "nef", "arw", "cr2", "cr3", "crw", "dng", "orf", "raf", "rw2", "pef")


def says_raw(text: str) -> bool:
    """Return whether a format has a RAW file, alone or beside a photograph."""
    return any(word in text.lower() for word in _RAW_WORDS)


def says_both(text: str) -> bool:
    """Return whether it has a photograph beside the RAW file."""
    return says_raw(text) and "+" in text


def plain_raw(listed: list[str]) -> str | None:
    """The format that is a RAW file and nothing else, the largest where there are several."""
    plain = [text for text in listed if says_raw(text) and "+" not in text]
    return next((text for text in plain if text.lower() in ("raw", "nef (raw)")), next(iter(plain), None))
