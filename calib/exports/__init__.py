"""What a calibration leaves for other programs: files of their formats, pictures, merged brackets."""
