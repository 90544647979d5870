"""Brackets to EXR: import photographs, look for trouble, measure exposures, merge, say how far they reach.

python examples/brackets_to_exr.py PHOTOS SESSION OUT
"""

import sys

import numpy as np

import rig

photos, session, out = sys.argv[1:]
for guess in rig.import_photos(photos, session).guesses:
    print(guess)
for problem in rig.check(session).problems:
    print(f"{problem.file}: {problem.message}")
rig.calibrate(session, only="response", on_progress=lambda what, done, total: print(f"{what} {done}/{total}"))
merged = rig.merge(session, out)
for view in merged.views:
    light = rig.read_exr(view.file).rgb().max(axis=2)
    darkest, brightest = np.percentile(light[light > 0], [1, 99.9])
    print(f"{view.file}: {np.log2(brightest / darkest):.1f} stops")
