"""Value of the number of Gaussians in a scene: short trainings of several sizes, judged on held-out views.

python examples/how_many_gaussians.py SESSION [GAUSSIANS ...]
"""

import sys

import rig

session, *sizes = sys.argv[1:]
for size in map(int, sizes or (5_000, 10_000, 20_000)):
    scene = rig.reconstruct(session, quality="draft", settings={"gaussians": size}, name=f"draft-{size}")
    figures = rig.evaluate(scene)
    quality = figures.raw_psnr or figures.ldr_psnr_oe
    print(f"{len(scene.gaussians):7,} Gaussians: {quality:.2f} dB of {', '.join(figures.held_out)}")
