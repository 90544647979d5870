"""rig beside OpenSplat on real photographs: the same pixels, poses, split and processor seconds.

    python -m bench.peers.compare [--unseen] [--sets castle,monstree,lego] [--budgets 60,240] [--width 400]
        [--quick] [--opensplat CHECKOUT] [--json] [--write] [--seeds 1] [--work FOLDER]

The sets are those that defaults were chosen on, or with --unseen those that nothing was chosen on.

They are folders of RIG_DATA, 'walk' (100 simulated photographs, `bench/support/walk.py`), or any session,
nerfstudio, COLMAP or Blender folder; without --budgets and --width each has its own. What comes without poses
is calibrated by rig once, and both train on that. One view in eight is held out, or what the set tests on.
rig: `reconstruct` with nothing but the budget, which counts from the first file it reads. OpenSplat: see
`bench/peers/opensplat.py`; of its variants the better one on the held-out views is shown, in its favour. Each
is measured by what it draws itself: rig by its renderer, OpenSplat, whose pictures are not kept, by ours with
the constants of 3DGS (`bench/peers/neutral.py`). rig's rows and OpenSplat's runs are kept in FOLDER.
"""

import argparse
import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.peers import opensplat
from bench.peers.neutral import PlySplats, in_world, measured
from bench.peers.peer_folder import picture_of, write_peer_folder
from bench.support import walk
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from calib.calibrate import calibrate
from capture.imports.photos import import_photos
from imaging.arrays import Array
from imaging.session.session import SESSION
from recon.data.dataset import Dataset, View
from recon.data.light import radiance_image
from recon.data.load import load
from recon.decide.cost.budget import Budget
from recon.decide.presets import QualityName
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.result.model import SPLATS
from recon.result.opened import Opened, open_model
from recon.start.initialisation import start_points
from recon.train.devices.warm_up import warm_up

SETS = {"castle": "sceaux"} | {
    name: name for name in ("monstree", "lego", "lund", "banana", "brighton", "fox")
}
WALK = "walk"
WALKED, WALK_SIZE = 100, (1600, 1200)
"""Photographs of the walk, and their size, px."""
KNOWN = (("castle", 400, (120.0,)), ("monstree", 400, (120.0,)), ("lego", 400, (120.0,)))
"""Each set, its width in px, its budgets in processor seconds: blur, rates and more were chosen on them."""
UNSEEN = ((WALK, 800, (240.0,)), ("lund", 400, (120.0,)))
"""Scenes on which no choice was made."""
QUALITY: QualityName = "best"
BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
PEER_POINTS = 20_000
"""Start points of the peer where poses came without points: rig's own, of its plane sweep."""


def session_of(name: str, work: Path) -> Path:
    """A calibrated session of a set."""
    if name == WALK:
        source = walk.photographs(work, WALKED, WALK_SIZE)
    else:
        source = Path(os.environ["RIG_DATA"]) / SETS[name] if name in SETS else Path(name)
    if (source / SESSION).is_file():
        return source
    session = work / f"{source.name}-session"
    if not (session / SESSION).is_file():
        import_photos(source, session)
    if not (session / "calibration" / "calibration.json").is_file():
        calibrate(session)
    return session


def rig_row(session: Path, width: int, budget: float, seed: int) -> dict[str, Any]:
    """Row of one training by rig; `budget` in processor seconds."""
    warm_up(lambda message, done, total: None)
    before = _used()
    folder = reconstruct(
        session,
        TrainingRequest(
            quality=QUALITY,
            budget=Budget.of(budget),
            seed=seed,
            overrides=_width(width),
            name=f"real-{width}-{budget:g}-{seed}",
            replace=True,
        ),
        clock=time.process_time,
    )
    seconds = _used() - before
    opened = open_model(folder)
    views = list(opened.dataset.held_out)
    figures = measured(views, [picture_of(view) for view in views], lambda view: _drawn_by_rig(opened, view))
    row: dict[str, Any] = {
        "seconds": seconds,
        "iterations": opened.training.iteration,
        "gaussians": len(opened.scene.gaussians),
        "method": opened.record.settings.method,
        **vars(figures),
    }
    # What rig draws itself is what its users see; a viewer that draws its file has to show the same.
    splats = PlySplats.read(folder / SPLATS)

    def viewed(view: View) -> Array:
        return splats.drawn(in_world(view, opened.dataset.world), BLACK)

    def own_before_white(view: View) -> Array:
        covered: Array = opened.scene.covered(view.lens).double().numpy()
        return _drawn_by_rig(opened, view) + 1 - covered[..., None]

    row["viewer"] = measured(views, [picture_of(view) for view in views], viewed).gained
    return row | before_white(views, own_before_white)


def before_white(views: list[View], draw: Callable[[View], Array]) -> dict[str, float]:
    """PSNR of photographs with alpha over white, as NeRF-synthetic is published; empty for others."""
    alphas = [view.alpha for view in views]
    if any(alpha is None for alpha in alphas):
        return {}
    pictures = [
        picture_of(view) + (1 - alpha.astype(np.float64))[..., None]
        for view, alpha in zip(views, alphas, strict=True)
        if alpha is not None
    ]
    return {"white": measured(views, pictures, draw).psnr}


def peer_rows(
    session: Path, width: int, budget: float, program: Path, work: Path, seed: int
) -> list[dict[str, Any]]:
    """Rows of each variant of OpenSplat, of runs of their own for each seed, which it does not take."""
    dataset = load(session, max_width=width)
    behind = "-".join(f"{level:g}" for level in opensplat.BACKGROUND)
    folder = work / f"{session.name}-{width}-peer-{behind}"
    if not (folder / "transforms.json").is_file():
        _write_folder(dataset, folder)
    rows = []
    for variant in opensplat.VARIANTS:
        run = opensplat.trained(
            program, folder, budget, variant, folder / f"runs-{program.parent.name}-{seed}"
        )
        splats = PlySplats.read(run.ply)
        views = list(dataset.held_out)

        def drawn(view: View, white: bool = False, splats: PlySplats = splats) -> Array:
            # Transparent photographs are composited over black or white; the others over its own colour.
            behind = opensplat.BACKGROUND if view.alpha is None else WHITE if white else BLACK
            return splats.drawn(in_world(view, dataset.world), behind)

        figures = measured(views, [picture_of(view) for view in views], drawn)
        rows.append(
            {
                "variant": variant.name,
                "seconds": run.seconds,
                "iterations": run.iterations,
                "gaussians": len(splats),
                **vars(figures),
                **before_white(views, partial(drawn, white=True)),
            }
        )
    return rows


def _write_folder(dataset: Dataset, folder: Path) -> None:
    model = dataset.points()
    points = model.xyz[np.isfinite(model.xyz).all(1)]
    images = [radiance_image(view) for view in dataset.train]
    rng = np.random.Generator(np.random.PCG64(0))
    start = start_points(dataset, images, max(len(points), PEER_POINTS), rng)
    count = start.sparse if len(points) else len(start.xyz)
    colours = (start.rgb[:count] / np.quantile(start.rgb[:count], 0.98)).clip(0, 1) ** (1 / 2.2)
    write_peer_folder(
        dataset, dataset.world.to_world(start.xyz[:count]), colours, folder, opensplat.BACKGROUND
    )


def _drawn_by_rig(opened: Opened, view: View) -> Array:
    (shot,) = view.shots
    image = opened.training.method.observation.predict(opened.render(view.lens), view, shot.k)
    return image.double().numpy()


def _width(width: int) -> Any:
    from recon.decide.overrides import Overrides

    return Overrides(width=width)


def _used() -> float:
    return time.process_time()


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / "real.jsonl")
    program = opensplat.built(options.work / "opensplat", options.opensplat)
    rows = []
    for name, width, budgets in judged(options):
        session = session_of(name, options.work)
        for budget in budgets:
            for seed in range(options.seeds):
                key = f"{name} {width} {budget:g} {seed}"
                ours = cache.get(f"rig {key}", partial(rig_row, session, width, budget, seed))
                theirs = peer_rows(session, width, budget, program, options.work, seed)
                best = max(theirs, key=lambda row: row["gained"])
                what = {"set": name, "width": width, "budget": budget, "seed": seed}
                rows.append(what | {"rig": ours, "OpenSplat": best})
    said = {"machine": machine(), "peer": opensplat.version(program), "unseen": options.unseen}
    return said | {"rows": rows}


def judged(options: argparse.Namespace) -> list[tuple[str, int, tuple[float, ...]]]:
    """Sets, widths and budgets, as asked for or each set's own."""
    usual = {name: (width, budgets) for name, width, budgets in (*KNOWN, *UNSEEN)}
    asked = None if options.budgets is None else tuple(map(float, options.budgets.split(",")))
    return [
        (name, options.width or width, asked or budgets)
        for name in options.sets.split(",")
        for width, budgets in [usual.get(name, KNOWN[0][1:])]
    ]


def report(result: dict[str, Any]) -> str:
    heading, flag, chosen = "# Photographs that nothing was chosen on", "--unseen ", ""
    if not result["unseen"]:
        heading, flag = "# Photographs", ""
        chosen = (
            " Blur, learning rates, backgrounds, splitting and the Gaussians for each view were chosen on "
        )
        chosen += "views of these three sets, the held-out ones among them."
    lines = [
        f"{heading}: rig beside OpenSplat in the same processor seconds",
        "",
        f"`python -m bench.peers.compare {flag}--write`: held-out views, as the script's head says. "
        f"OpenSplat {result['peer']}. {words(result['machine'])}.{chosen}",
        "",
        "| set | px | trainer | processor s | iterations | Gaussians | PSNR, dB | after a gain a channel "
        "| SSIM | over white, dB |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        for trainer in ("rig", "OpenSplat"):
            one = row[trainer]
            what = one.get("method") or one["variant"]
            white = f"{one['white']:.2f}" if "white" in one else ""
            lines.append(
                f"| {row['set']} | {row['width']} | {trainer} ({what}) "
                f"| {one['seconds']:.0f} of {row['budget']:.0f} "
                f"| {one['iterations']:,} | {one['gaussians']:,} | {one['psnr']:.2f} | {one['gained']:.2f} "
                f"| {one['ssim']:.3f} | {white} |"
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__, seeds=1)
    parser.add_argument("--sets")
    parser.add_argument("--unseen", action="store_true", help="Of the sets that nothing was chosen on.")
    parser.add_argument("--budgets")
    parser.add_argument("--width", type=int)
    parser.add_argument("--opensplat", type=Path)
    options = parser.parse_args()
    if options.quick:
        options.sets, options.budgets, options.width = "castle", "30", 200
    if options.sets is None:
        options.sets = ",".join(name for name, _, _ in (UNSEEN if options.unseen else KNOWN))
    result = measure(options)
    deliver(options, "real_unseen" if options.unseen else "real", result, report(result))


if __name__ == "__main__":
    main()
