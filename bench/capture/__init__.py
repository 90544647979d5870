"""Capture, measured: bad days, killed processes, planners, disks, merging."""
