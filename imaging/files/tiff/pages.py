"""Selection of the photograph among the images of a TIFF: some begin with a thumbnail, or with a mask."""

from imaging.files.tiff.directory import Directory, TiffReader, integers

SUBFILE_TYPE, OLD_SUBFILE_TYPE = 254, 255
_REDUCED, _MASK = 1, 4
"""Bits of NewSubfileType."""
_OLD_REDUCED = 2


def photograph(reader: TiffReader) -> tuple[int, Directory]:
    """Offset and values of the directory of the photograph; TiffError if the file is damaged before it.

    It is the first that is neither a reduced image nor a mask, in the chain or below it (TIFF/EP keeps the
    photograph below its thumbnail); the first at all where every one is.
    """
    first: tuple[int, Directory] | None = None
    for offset, directory in reader.walk():
        first = first or (offset, directory)
        kind = next(iter(integers(directory, SUBFILE_TYPE)), 0)
        old = next(iter(integers(directory, OLD_SUBFILE_TYPE)), 0)
        if not kind & (_REDUCED | _MASK) and old != _OLD_REDUCED:
            return offset, directory
    return first or (reader.first, {})
