"""Still cameras through libgphoto2, for those that rig's own PTP cannot drive; the package gphoto2 has it.

Nothing is imported here: each camera has a process of its own, which imports only what it serves with.
"""
