"""Calibration, measured against the truth and against peers: poses, boards.

`light`: sensors, colour; `at_size`: many views; `lookalikes`: scenes whose parts look alike.
"""
