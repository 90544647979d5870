"""One thin module a command: read the options, call the stage, say what came of it.

Stages are imported inside the functions that run them, so that help and mistyped options answer at once:
`rig reconstruct --help` takes 0.2 s, and the stage behind it another 2.5 s to load.
"""
