"""Capture, measured: bad days, planners, disks, merging; `interrupted`: killed processes."""
