"""The session folder: its records, its calibration, its lock, and the way around in it.

Every stage meets the others here, on the disk. Pixels are read in `imaging.files` and `imaging.merge`."""
