"""What each maker's cameras want beyond standard PTP."""
