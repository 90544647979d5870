"""Vendor extensions beyond standard PTP."""
