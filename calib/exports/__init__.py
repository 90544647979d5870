"""Exports of a calibration: files of other programs' formats, pictures, merged brackets."""
