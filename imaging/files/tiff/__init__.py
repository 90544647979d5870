"""TIFF, and what is built of its directories: DNG and EXIF."""
