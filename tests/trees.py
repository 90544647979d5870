"""Files below a folder."""

from pathlib import Path


def tree(folder: Path, pattern: str = "*") -> dict[str, bytes]:
    """The bytes of each file below a folder, by its path from there."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob(pattern))
        if path.is_file()
    }
