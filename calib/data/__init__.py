"""What calibration looks at: the views of a session, their previews, and features matched between them."""
