"""The files of other programs, one module a format, and how their numbers are packed."""
