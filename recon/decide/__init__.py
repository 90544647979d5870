"""Choice of a training's configuration, with its evidence as rungs. Nothing below trains a scene.

A rung is one decision in a record: its subject, whether it was taken, why, and its gain. The order of the
decisions is the code of `decide` (`decisions.py`): each looks at the evidence and at those before it.
"""
