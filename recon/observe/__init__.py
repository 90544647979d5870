"""From rendered light to what a camera recorded: tone curves, losses, and corrections of the calibration."""
