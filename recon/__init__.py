"""Session and calibration to scene: Gaussians, methods, training, evaluation, export."""
