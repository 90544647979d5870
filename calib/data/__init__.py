"""Data of a calibration: the views of a session, their previews, and features matched between them."""
