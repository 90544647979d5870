"""Quality over iterations, Gaussians and processor seconds on real photographs: what presets come from.

    python -m bench.real.curves [--wide] [--sets lego,monstree,castle] [--width 400] [--quick] [--json]
        [--write] [--seeds 1] [--work FOLDER]

Every number of iterations with every number of Gaussians, all else as decided without trials; the harmonics
of degree 0 and, at the best of them, of degree 2. Held-out views, as `rig evaluate` has them. For each number
of iterations the number of Gaussians is given that is best, and the fewest within 0.25 dB of it; the exponent
says how that grows with the iterations. --wide: at the width that the preset best trains at, of degree 0,
of the castle, with fewer of each. Finished trainings are kept in FOLDER; `--write` draws the curves of 400 px
into docs/real.png.
"""

import argparse
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.peers.compare import session_of
from bench.peers.neutral import measured
from bench.peers.peer_folder import picture_of
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.result.opened import open_model
from recon.train.devices.warm_up import warm_up

ITERATIONS = (250, 1000, 3000)
GAUSSIANS = (10_000, 40_000, 160_000)
WIDE, WIDE_SETS = 1280, "castle"
WIDE_ITERATIONS, WIDE_GAUSSIANS = ITERATIONS[:2], GAUSSIANS[:2]
"""160,000 have 0.4 dB less than 40,000 after 250 iterations of 1,280 px, as they have at 400."""
DOCS = Path(__file__).parents[2] / "docs"
TICKS = (15, 30, 60, 120, 240, 480, 960)
"""Seconds that the picture names."""
NEAR = 0.25
"""dB within which fewer Gaussians are as good."""


def trained(
    session: Path, width: int, iterations: int, gaussians: int, degree: int, seed: int
) -> dict[str, Any]:
    """Figures of one training; `seconds` of the processor, from the first file to the written scene."""
    warm_up(lambda message, done, total: None)
    began = time.process_time()
    overrides = Overrides(
        width=width,
        iterations=iterations,
        gaussians=gaussians,
        degree=degree,
        refine="none",
        environment=False,
    )
    folder = reconstruct(
        session,
        TrainingRequest(quality="best", seed=seed, overrides=overrides, name="curve", replace=True),
        shelf="curves",
    )
    seconds = time.process_time() - began
    opened = open_model(folder)
    views = list(opened.dataset.held_out)
    observation = opened.training.method.observation

    def drawn(view: Any) -> Any:
        (shot,) = view.shots
        return observation.predict(opened.render(view.lens), view, shot.k).double().numpy()

    figures = measured(views, [picture_of(view) for view in views], drawn)
    return {"seconds": seconds, "gaussians": len(opened.scene.gaussians), **vars(figures)}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / "real-curves.jsonl")
    sets = []
    for name in options.sets.split(","):
        session = session_of(name, options.work)

        def mean(
            iterations: int, count: int, degree: int, name: str = name, session: Path = session
        ) -> dict[str, float]:
            rows = [
                cache.get(
                    f"{name} {options.width} {iterations} {count} {degree} {seed}",
                    partial(trained, session, options.width, iterations, count, degree, seed),
                )
                for seed in range(options.seeds)
            ]
            return {key: float(np.mean([row[key] for row in rows])) for key in ("gained", "seconds", "ssim")}

        table = {
            str(iterations): {str(count): mean(iterations, count, 0) for count in options.gaussians}
            for iterations in options.iterations
        }
        last = table[str(options.iterations[-1])]
        best = max(last, key=lambda count: last[count]["gained"])
        turning = None if options.wide else mean(options.iterations[-1], int(best), 2)
        sets.append({"set": name, "table": table, "best": int(best), "turning": turning})
    said = {"machine": machine(), "width": options.width, "seeds": options.seeds, "wide": options.wide}
    return said | {"sets": sets}


def needed(row: dict[str, dict[str, float]]) -> tuple[int, int]:
    """Best number of Gaussians in trainings of one length, and the smallest that is as good."""
    best = max(row, key=lambda count: row[count]["gained"])
    enough = [count for count in row if row[count]["gained"] >= row[best]["gained"] - NEAR]
    return int(best), min(map(int, enough))


def exponent(table: dict[str, dict[str, dict[str, float]]]) -> float:
    """Exponent of the smallest number of Gaussians as good as any, over the iterations: a line through
    logarithms.
    """
    lengths = np.log([float(iterations) for iterations in table])
    counts = np.log([float(needed(row)[1]) for row in table.values()])
    return float(np.polyfit(lengths, counts, 1)[0])


def report(result: dict[str, Any]) -> str:
    wide = result["wide"]
    lines = [
        f"# Real photographs{', wide' * wide}: quality over iterations and Gaussians",
        "",
        f"`python -m bench.real.curves {'--wide ' * wide}--write`: {result['width']} px wide, "
        f"{result['seeds']} seed(s), harmonics of degree 0, no corrections. dB of held-out views after a "
        f"gain a channel, and processor seconds. {words(result['machine'])}.",
    ]
    for one in result["sets"]:
        table = one["table"]
        counts = [int(count) for count in next(iter(table.values()))]
        lines += [
            "",
            f"## {one['set']}",
            "",
            "| iterations | " + " | ".join(f"{count:,}" for count in counts) + " | best | as good |",
            "|" + "---|" * (len(counts) + 3),
        ]
        for iterations, row in table.items():
            cells = [f"{row[str(c)]['gained']:.2f} ({row[str(c)]['seconds']:.0f} s)" for c in counts]
            best, enough = needed(row)
            lines.append(f"| {int(iterations):,} | " + " | ".join(cells) + f" | {best:,} | {enough:,} |")
        power = round(exponent(table), 2) + 0.0  # which has no negative zero
        sentence = f"What is as good grows with the iterations to the power {power:.2f}."
        if one["turning"] is not None:
            last = table[list(table)[-1]][str(one["best"])]
            sentence += (
                f" Harmonics of degree 2 with {one['best']:,}: "
                f"{one['turning']['gained'] - last['gained']:+.2f} dB, {one['turning']['seconds']:.0f} s."
            )
        lines += ["", sentence]
    return "\n".join(lines) + "\n"


def draw(sets: Sequence[dict[str, Any]], path: Path) -> None:
    """Quality over processor seconds, a line for each number of Gaussians."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, panels = plt.subplots(
        1, len(sets), figsize=(4.2 * len(sets), 3.6), layout="constrained", squeeze=False
    )
    for axes, one in zip(panels[0], sets, strict=True):
        table = one["table"]
        for count in next(iter(table.values())):
            points = [row[count] for row in table.values()]
            seconds, db = [p["seconds"] for p in points], [p["gained"] for p in points]
            axes.plot(seconds, db, marker="o", ms=4, label=f"{int(count):,} Gaussians")
            for iterations, x, y in zip(table, seconds, db, strict=True):
                axes.annotate(f"{int(iterations):,}", (x, y), (0, 5), textcoords="offset points", fontsize=6)
        axes.set_xscale("log")
        axes.set_xticks(TICKS, [str(tick) for tick in TICKS])
        axes.minorticks_off()
        axes.set_title(one["set"], fontsize=10)
        axes.set_xlabel("processor seconds, from the first file to the scene", fontsize=8)
        axes.tick_params(labelsize=8)
        axes.grid(alpha=0.3)
    panels[0][0].set_ylabel("held-out PSNR after a gain a channel, dB", fontsize=8)
    panels[0][0].legend(fontsize=7)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    parser = arguments(__doc__, seeds=1)
    parser.add_argument("--wide", action="store_true", help="at the width of the preset best")
    parser.add_argument("--sets")
    parser.add_argument("--width", type=int)
    options = parser.parse_args()
    options.sets = options.sets or (WIDE_SETS if options.wide else "lego,monstree,castle")
    options.width = options.width or (WIDE if options.wide else 400)
    options.iterations, options.gaussians = (
        (WIDE_ITERATIONS, WIDE_GAUSSIANS) if options.wide else (ITERATIONS, GAUSSIANS)
    )
    if options.quick:
        options.iterations, options.gaussians = ITERATIONS[:2], GAUSSIANS[:2]
    result = measure(options)
    deliver(options, "real_curves_wide" if options.wide else "real_curves", result, report(result))
    if options.write and not options.wide:
        draw(result["sets"], DOCS / "real.png")


if __name__ == "__main__":
    main()
