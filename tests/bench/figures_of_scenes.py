"""Figures of the tables on reconstruction, as docs/figures.md has them."""

import math
import re
from functools import partial

from recon.decide.presets import QUALITIES

from .claim import FIGURE, RESULTS, cell, cells, stored, tables

EXR, RAW = "merged EXR", "RAW brackets"
DEMO = partial(cell, "demo")


ALIKE = "crate-alike", "column-2", "crate-few"


def guarded(rule: str) -> dict[str, list[float]]:
    """Views that are placed without a rule, and those of them that stand wrongly, by set."""
    (row,) = (row for row in tables("real_guards")[0][1] if row["without"] == rule)
    return {
        title.partition(" (")[0]: [float(number) for number in re.findall(r"\d+", cell)]
        for title, cell in row.items()
        if title != "without"
    }


def degree_gain(scene: str) -> float:
    """dB that harmonics of degree two gain photographs of a set."""
    text = (RESULTS / "real_curves.md").read_text()
    (gain,) = re.findall(rf"## {scene}\n.*?degree 2 with [\d,]+: ([+-][\d.]+) dB", text, re.DOTALL)
    return float(gain)


def far_gain(name: str) -> tuple[float, float]:
    """Percentage of points that are looked through, and dB that a far field gains."""
    share, without, far = (cell("real_far_field", key, name) for key in ("looked through", "without", "with"))
    return share, far - without


def by_scene(name: str, scene: str, trained: str, coloured: str) -> float:
    """dB of a scene in the table by scene that follows a comparison."""
    (figure,) = [
        one[scene]
        for one in tables(name)[1][1]
        if (one["trained on"], one["appearance"]) == (trained, coloured)
    ]
    return float(figure)


def compared(name: str, trained: str, coloured: str) -> list[float]:
    """Difference and error, dB, of the row of a comparison that is of this input and this appearance."""
    (row,) = [
        one for one in tables(name)[0][1] if (one["trained on"], one["appearance"]) == (trained, coloured)
    ]
    return [float(one) for one in FIGURE.findall(row["dB"])][1:]


def presets(quality: str, key: str) -> list[float]:
    """Rows of every scene that all presets were tried on."""
    rows = [one["presets"] for one in stored("presets")["rows"]]
    return [lie[quality][key] for lie in rows if set(lie) == set(QUALITIES)]


def longer(kind: str, *sets: str) -> list[list[float]]:
    """Gain of standard over draft on real sets of few photographs, and its standard error over views."""
    return [cells("real_more_time", kind, name, under="Gain over draft")[0] for name in sets]


def wide(iterations: str, count: str) -> list[float]:
    """dB and processor seconds of a training of the castle at 1,280 px."""
    (row,) = [one for one in tables("real_curves_wide")[0][1] if one["iterations"] == iterations]
    return [float(one) for one in FIGURE.findall(row[count])]


def rate_gains(iterations: str) -> list[float]:
    """dB of the light, scene by scene, between the usual rates and those nearest to what is taken."""
    gains = []
    for one in tables("learning_rates")[0][1]:
        if one["iterations"] == iterations:
            figures = [FIGURE.findall(part) for part in one["factor: pictures / light, dB"].split(", ")]
            light = {float(factor): float(value) for factor, _, value in figures}
            near = min(light, key=lambda factor: abs(math.log(factor / float(one["taken"]))))
            gains.append(light[near] - light[1.0])
    return gains


def dark(what: str) -> list[float]:
    """Least and most stops that the darkest fifth is off, of all lenses that scatter light."""
    rows = [one for one in tables("glare")[0][1] if float(one["scattered, %"]) > 0]
    stops = [float(one[f"dark, {what}"]) for one in rows]
    return [min(stops), max(stops)]


def learned() -> list[float]:
    """Error of a learned curve, %, and dB of the light that it costs beside a measured one."""
    rows = {one["changed"]: one for one in tables("ablation_hdr_gs")[0][1]}
    learned_row, best = rows["learned from sRGB on, Exp-3"], rows["measured, Exp-3"]
    light = "HDR dB, aligned"
    return [float(learned_row["response RMSE, %"]), float(best[light]) - float(learned_row[light])]


def few() -> float:
    """The most that colours of no direction gain of the light of few views, dB."""
    degrees = [[at[1] for at in cells("few_views", f"degree {degree}")] for degree in range(3)]
    return max(plain - other for plain, *others in zip(*degrees, strict=True) for other in others)


def noise_gains(views: str) -> list[float]:
    """RAW dB that whitened residuals gain, and its standard error."""
    return cells("rawnerf_protocol", views, "whitened, squares", but="three scales")[0][1:]


def denoised_gain(views: int) -> float:
    """RAW dB of pictures denoised before training over mosaics, at the best of its strengths."""
    return max(row[1] for row in cells("rawnerf_protocol", f"{views} views", "enhanced first"))


def gained() -> float:
    """Mean over the scenes of the ladder, dB."""
    of = [
        (one[0], mean[0])
        for one, mean in zip(cells("ladder", "scenes"), cells("ladder", "dB, mean"), strict=True)
    ]
    return sum(count * mean for count, mean in of) / sum(count for count, _ in of)


def beside_peer(name: str, column: str) -> list[float]:
    """Figures of rig and of OpenSplat on a set of photographs."""
    return [cell("real", column, name, trainer) for trainer in ("rig", "OpenSplat")]


def unseen(name: str) -> list[float]:
    """Figures on a set that no training was chosen on: width, seconds, dB and iterations of rig and of
    OpenSplat.
    """
    what = [cell("real_unseen", "px", name, "rig"), cells("real_unseen", "processor s", name, "rig")[0][1]]
    return what + [
        cell("real_unseen", column, name, trainer)
        for trainer in ("rig", "OpenSplat")
        for column in ("PSNR, dB", "iterations")
    ]


def regularised(candidate: str, *runs: str) -> list[float]:
    """dB that a candidate adds on sets and splits."""
    (row,) = (row for row in tables("real_few_views")[0][1] if row["candidate"] == candidate)
    return [float(FIGURE.findall(row[run])[0]) for run in runs]


def dropped() -> list[float]:
    """Least and most that drop-out with a pull at opacities gains on the flight, and what it costs others."""
    name = "drop-out 0.3, opacity 0.01"
    flight = regularised(name, *(f"brighton {split}" for split in ("quarter", "eighth", "fifth")))
    costs = regularised(name, "banana eighth", "monstree quarter")
    return [min(flight), max(flight), *(-cost for cost in costs)]


def before_background() -> list[float]:
    """What a background of 0 or 1 gains on the flight, and the least and most that it costs others."""
    name = "background 0 or 1"
    costs = regularised(name, "banana quarter", "banana eighth", "monstree quarter")
    flight = regularised(name, "brighton eighth", "brighton quarter")
    return [*flight, -max(costs), -min(costs)]


def behind(candidate: str, name: str, column: str = "dB") -> list[float]:
    """Difference that a map of far light makes to drafts of a set, and its standard error over views."""
    return cells("real_backdrop", column, candidate, name)[0]


def fixed_behind() -> list[float]:
    """dB that a coarse, fixed map gains on each set, with errors: castle, flight, tree, banana."""
    sets = "castle", "brighton", "monstree", "banana"
    return [number for name in sets for number in behind("coarse map, fixed", name)]
