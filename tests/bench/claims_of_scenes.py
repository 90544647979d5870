"""Claims of docs/figures.md on reconstruction."""

from .claim import Claim, cell, cells, line
from .figures_of_scenes import (
    ALIKE,
    DEMO,
    EXR,
    RAW,
    before_background,
    behind,
    beside_peer,
    by_scene,
    compared,
    dark,
    degree_gain,
    denoised_gain,
    dropped,
    far_gain,
    few,
    fixed_behind,
    gained,
    guarded,
    learned,
    noise_gains,
    rate_gains,
    unseen,
)

MIXED = "with strangers", "with noise"

CLAIMS = (
    Claim(
        r"Of (\d+) photographs of other scenes and (\d+) of noise (\d) and (\d) are placed; (\d+) of the "
        r"(\d+) views that belong are, as (\d+) of (\d+) are without strangers, and the warnings name (\d) "
        r"and (\d) views: each",
        lambda: [
            *(cell("real_strangers", column, kind) for column in ("strangers", "placed 1") for kind in MIXED),
            *(cell("real_strangers", column, "with strangers") for column in ("placed", "belonging")),
            *(cell("real_strangers", column, "as it is") for column in ("placed", "belonging")),
            *(cell("real_strangers", "named", kind) for kind in ("with strangers", "as it is")),
        ],
    ),
    Claim(
        r"gains ([\d.]+) to ([\d.]+) dB on three splits of the drone's flight, and costs the banana ([\d.]+) "
        r"and the tree ([\d.]+)\.",
        dropped,
    ),
    Claim(
        r"opaque gains ([\d.]+) and ([\d.]+) dB on two of these splits, and costs the banana and the tree "
        r"([\d.]+) to ([\d.]+);",
        before_background,
    ),
    Claim(
        r"two folds of the castle SSIM falls by ([\d.]+)\.",
        lambda: [-behind("fine map, trained", "castle", "SSIM")[0]],
    ),
    Claim(
        r"adds ([\d.]+) \+- ([\d.]+) dB to the castle, ([\d.]+) \+- ([\d.]+) to the drone's flight, "
        r"([\d.]+) \+- ([\d.]+) to the tree and ([\d.]+) \+- ([\d.]+) to the banana;",
        fixed_behind,
    ),
    Claim(
        r"trained, it costs a fold of the banana ([\d.]+)\.",
        lambda: [-behind("coarse map, trained", "banana")[0]],
    ),
    Claim(
        r"castle `rig` reaches ([\d.]+) dB and OpenSplat, which also trains without a GPU, ([\d.]+);",
        lambda: beside_peer("castle", "PSNR, dB"),
    ),
    Claim(r"on 23 of a tree, ([\d.]+) and ([\d.]+);", lambda: beside_peer("monstree", "PSNR, dB")),
    Claim(r"as is published, ([\d.]+) and ([\d.]+)\. These", lambda: beside_peer("lego", "over white, dB")),
    Claim(
        r"house, ([\d.]+) px wide, in ([\d.]+) seconds, `rig` reaches ([\d.]+) dB after ([\d.]+) "
        r"iterations and OpenSplat ([\d.]+) after ([\d.]+);",
        lambda: unseen("walk"),
    ),
    Claim(
        r"ahead, ([\d.]+) px wide, in ([\d.]+) seconds, ([\d.]+) after ([\d.]+) and ([\d.]+) after "
        r"([\d.]+) \(",
        lambda: unseen("lund"),
    ),
    Claim(
        r"reaches ([\d.]+) dB over white on lego at (\d+) px; published 3DGS has ([\d.]+) at",
        lambda: [cell("published", name, "lego", "best") for name in ("over white", "px", "3DGS")],
    ),
    Claim(
        r"A draft of its hundred views reaches ([\d.]+) dB, at (\d+) px, after (\d+) s",
        lambda: [cell("published", name, "lego", "draft") for name in ("over white", "px", "s")],
    ),
    Claim(
        r"OpenSplat completes (\d+) to (\d+) of its",
        lambda: [f([one for (one,) in cells("real", "iterations", "OpenSplat")]) for f in (min, max)],
    ),
    Claim(r"the curve is ([\d.]+) % off and the light ([\d.]+) dB worse", learned),
    Claim(
        r"darkest fifth to between ([\d.]+) and ([\d.]+) stops, from between ([\d.]+) and ([\d.]+) \(",
        lambda: [*dark("decided"), *dark("left")],
    ),
    Claim(
        r"preset standard, (\d+) px wide, reach ([\d.]+) dB against the true",
        lambda: [DEMO("px"), DEMO("mu-law over the 99.9th percentile, dB")],
    ),
    Claim(
        r"\(([\d.]+) over the brightest light\)\. Their error is ([\d.]+) stops in the median, "
        r"([\d.]+) in the darkest tenth and ([\d.]+) in the brightest hundredth",
        lambda: [
            *map(DEMO, ("over the brightest, dB", "stops, median", "darkest tenth", "brightest hundredth"))
        ],
    ),
    Claim(
        r"photograph of the fruit, (\d+) for (\d+), which would be rotated .*? another view\)\. "
        r"Without global mapping, (\d+) views of the fruit are placed "
        r"and (\d+) of the walk\.",
        lambda: [
            guarded("nothing")["banana"][0],
            guarded("joined by one pair")["banana"][0],
            guarded("placed at once")["banana"][0],
            guarded("placed at once")["lund"][0],
        ],
    ),
    Claim(
        r"flight's lens is ([\d.]+) % too long and the walk's ([\d.]+) % too short",
        lambda: line("real_guards", r"EXIF's focal length \| \S+ .*?\+([\d.]+) \(OPENCV.*-([\d.]+) \("),
    ),
    Claim(
        r"look alike, (\d+), (\d+) and (\d+) views have wrong poses without the check for "
        r"contradictions, (\d+), (\d+) and (\d+) without the check of brightness, and (\d+) without",
        lambda: [
            *(guarded(rule)[name][1] for rule in ("contradictions", "brightness") for name in ALIKE),
            guarded("joined by one pair")["varnished"][1],
        ],
    ),
    Claim(
        r"degree two gain lego ([\d.]+) dB and cost the castle ([\d.]+) and the tree ([\d.]+),",
        lambda: [degree_gain("lego"), -degree_gain("castle"), -degree_gain("monstree")],
    ),
    Claim(
        r"would cost the castle ([\d.]+) dB and the fruit ([\d.]+), although their views look through "
        r"(\d+) and (\d+) % of the points; a sunlit yard with (\d+) % gains ([\d.]+)\.",
        lambda: [
            -far_gain("sceaux")[1],
            -far_gain("banana")[1],
            *(far_gain(name)[0] for name in ("sceaux", "banana", "low-sun")),
            far_gain("low-sun")[1],
        ],
    ),
    Claim(
        r"The lamps, at ([\d,]+), fill .*? percentile, ([\d,]+), also lies",
        lambda: [DEMO("brightest"), DEMO("99.9th percentile")],
    ),
    Claim(
        r"RAW mosaics is ([\d.]+) dB above 3DGS with tuned learning rates and ([\d.]+) \+- ([\d.]+) "
        r"above 3DGS as pub",
        lambda: [
            compared("methods", EXR, "SH of 3DGS, tuned")[0],
            *compared("methods", EXR, "3DGS, as published"),
        ],
    ),
    Claim(
        r"merged mosaic per view it is ([\d.]+) \+- ([\d.]+) better",
        lambda: [
            -compared("methods", "merged mosaics", "luminance-chromaticity")[0],
            compared("methods", "merged mosaics", "luminance-chromaticity")[1],
        ],
    ),
    Claim(
        r"Bilinear demosaicking costs 3DGS ([\d.]+) dB",
        lambda: [
            compared("methods", "merged EXR, bilinear", "SH of 3DGS, tuned")[0]
            - compared("methods", EXR, "SH of 3DGS, tuned")[0]
        ],
    ),
    Claim(
        r"same mosaics it is ([\d.]+) \+- ([\d.]+) dB above 3DGS with tuned",
        lambda: compared("methods", RAW, "SH of 3DGS, tuned"),
    ),
    Claim(
        r"([\d.]+) \+- ([\d.]+) above 3DGS with its usual",
        lambda: compared("methods", RAW, "SH of 3DGS, usual rates"),
    ),
    Claim(
        r"scenes disagree: (-[\d.]+) dB on the demo, ([\d.]+) on the gallery",
        lambda: [
            by_scene("methods", scene, RAW, "luminance-chromaticity")
            - by_scene("methods", scene, RAW, "softplus of SH")
            for scene in ("demo", "gallery")
        ],
    ),
    Claim(
        r"noise gains ([\d.]+) and ([\d.]+) dB of RAW",
        lambda: [noise_gains(f"{views} views")[0] for views in (8, 12)],
    ),
    Claim(r"at night and ([\d.]+) \+- ([\d.]+) at 4; Raw3DGS", lambda: noise_gains("4 views")),
    Claim(
        r"lose ([\d.]+), ([\d.]+) and ([\d.]+) dB to the mosaics at 20, 12 and 8 views, and gain ([\d.]+) at",
        lambda: [abs(denoised_gain(views)) for views in (20, 12, 8, 4)],
    ),
    Claim(
        r"HDR-GS reaches ([\d.]+) dB from one exposure per view, whereas 3DGS, .*? reaches ([\d.]+)\.",
        lambda: [cell("hdr_nerf_protocol", "OE dB", f"{name}, Exp-1") for name in ("HDR-GS", "vanilla 3DGS")],
    ),
    Claim(
        r"Unseen exposures are within ([\d.]+) dB of seen ones, the response within ([\d.]+) %",
        lambda: [
            max(
                cell("hdr_nerf_protocol", "OE dB", name) - cell("hdr_nerf_protocol", "NE dB", name)
                for name in ("HDR-GS, Exp-1", "HDR-GS, Exp-3")
            ),
            max(of[0] for of in cells("hdr_nerf_protocol", "response RMSE, %", "HDR-GS, Exp")),
        ],
        bound=True,
    ),
    Claim(
        r"radiance within ([\d.]+) dB of NH-3DGS on the true light \(([\d.]+) from one",
        lambda: [
            cell("hdr_nerf_protocol", "HDR dB, aligned", "NH-3DGS on the true light")
            - cell("hdr_nerf_protocol", "HDR dB, aligned", f"HDR-GS, {which}")
            for which in ("Exp-3", "Exp-1")
        ],
    ),
    Claim(
        r"this gains ([\d.]+) to ([\d.]+) dB of light",
        lambda: [min(rate_gains("300")), max(rate_gains("300"))],
    ),
    Claim(r"and (\d) to (\d) at 100 \(five", lambda: [min(rate_gains("100")), max(rate_gains("100"))]),
    Claim(r"poses in training gains ([\d.]+) dB", lambda: line("refine", r"(?m)^0\.6 px: ([+-][\d.]+) dB")),
    Claim(
        r"On (\d+) simulated scenes with known needs, (\d+) % of",
        lambda: [
            sum(one[0] for one in cells("ladder", "scenes")),
            *line("ladder", r"(?m)^([\d.]+) % of \d+ choices"),
        ],
    ),
    Claim(
        r"lost more than ([\d.]+) dB of light, or ([\d.]+) dB of its pictures \(the mean gained ([\d.]+)\)",
        lambda: [
            -min(one[0] for one in cells("ladder", "truth, worst")),
            -min(one[0] for one in cells("ladder", "dB, worst")),
            gained(),
        ],
    ),
    Claim(
        r"few needs are at least ([\d.]+) times faster or smaller",
        lambda: line("ladder", r"the least is ([\d.]+) times faster or smaller"),
    ),
    Claim(
        r"the demo and the gallery is ([\d.]+) and ([\d.]+) times",
        lambda: [cell("count", "ratio", name) for name in ("demo", "gallery")],
    ),
    Claim(r"colours gain up to ([\d.]+) dB of light", lambda: [few()]),
    Claim(
        r"has an error of ([\d.e-]+) in the worst pixel",
        lambda: [
            max(of[0] for of in cells("stability", "forward", "2^40 (12 decades)", under="Worst error"))
        ],
    ),
)
