"""Claims of docs/figures.md on reconstruction."""

from .claim import Claim, cell, cells, line
from .figures_of_scenes import (
    ALIKE,
    DEMO,
    EXR,
    RAW,
    before_background,
    beside_peer,
    by_scene,
    compared,
    dark,
    degree_gain,
    dropped,
    far_gain,
    few,
    gained,
    guarded,
    learned,
    noise_gains,
    rate_gains,
    unseen,
)

CLAIMS = (
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
        r"`rig` has ([\d.]+) dB and OpenSplat, which trains without a GPU too, ([\d.]+) on",
        lambda: beside_peer("castle", "PSNR, dB"),
    ),
    Claim(r"castle; ([\d.]+) and ([\d.]+) on 23", lambda: beside_peer("monstree", "PSNR, dB")),
    Claim(r"published, ([\d.]+) and ([\d.]+) on 100 of NeRF", lambda: beside_peer("lego", "over white, dB")),
    Claim(
        r"house, ([\d.]+) px wide, in ([\d.]+) seconds, `rig` has ([\d.]+) dB after ([\d.]+) iterations and "
        r"OpenSplat ([\d.]+) after ([\d.]+);",
        lambda: unseen("walk"),
    ),
    Claim(
        r"ahead, ([\d.]+) px wide, in ([\d.]+) seconds, ([\d.]+) after ([\d.]+) and ([\d.]+) after "
        r"([\d.]+) \(",
        lambda: unseen("lund"),
    ),
    Claim(
        r"has ([\d.]+) dB over white on lego at (\d+) px; 3DGS is published with ([\d.]+) at",
        lambda: [cell("published", name, "lego", "best") for name in ("over white", "px", "3DGS")],
    ),
    Claim(
        r"A draft of its hundred views has ([\d.]+) dB, at (\d+) px, after (\d+) s",
        lambda: [cell("published", name, "lego", "draft") for name in ("over white", "px", "s")],
    ),
    Claim(
        r"OpenSplat makes (\d+) to (\d+) of its",
        lambda: [f([one for (one,) in cells("real", "iterations", "OpenSplat")]) for f in (min, max)],
    ),
    Claim(r"the curve is ([\d.]+) % off and the light ([\d.]+) dB worse", learned),
    Claim(
        r"darkest fifth ([\d.]+) to ([\d.]+) stops off for ([\d.]+) to ([\d.]+)",
        lambda: [*dark("decided"), *dark("left")],
    ),
    Claim(
        r"preset standard, (\d+) px wide, ([\d.]+) dB from the true",
        lambda: [DEMO("px"), DEMO("mu-law over the 99.9th percentile, dB")],
    ),
    Claim(
        r"\(([\d.]+) over the brightest light\), ([\d.]+) stops off in the median, ([\d.]+) in the "
        r"darkest tenth and ([\d.]+) in the brightest hundredth",
        lambda: [
            *map(DEMO, ("over the brightest, dB", "stops, median", "darkest tenth", "brightest hundredth"))
        ],
    ),
    Claim(
        r"photograph of the fruit, (\d+) for (\d+), which would be turned .*? are the judge\)\. "
        r"Without placing at once (\d+) views of the fruit stand "
        r"and (\d+) of the walk; without further features (\d+) of",
        lambda: [
            guarded("nothing")["banana"][0],
            guarded("joined by one pair")["banana"][0],
            guarded("placed at once")["banana"][0],
            guarded("placed at once")["lund"][0],
            guarded("further features")["banana"][0],
        ],
    ),
    Claim(
        r"flight's lens is ([\d.]+) % too long and the walk's ([\d.]+) % too short",
        lambda: line("real_guards", r"EXIF's focal length \| \S+ .*?\+([\d.]+) \(OPENCV.*-([\d.]+) \("),
    ),
    Claim(
        r"look alike (\d+), (\d+) and (\d+) views stand wrongly without the check of contradictions, (\d+), "
        r"(\d+) and (\d+) without that of brightness, and (\d+) without",
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
        r"of the castle it would cost ([\d.]+) dB, and of the fruit ([\d.]+), which look through (\d+) and "
        r"(\d+) % of their points; a yard before the sun with (\d+) % gains ([\d.]+)\.",
        lambda: [
            -far_gain("sceaux")[1],
            -far_gain("banana")[1],
            *(far_gain(name)[0] for name in ("sceaux", "banana", "low-sun")),
            far_gain("low-sun")[1],
        ],
    ),
    Claim(
        r"Its lamps of ([\d,]+) fill .*? percentile, ([\d,]+), lies",
        lambda: [DEMO("brightest"), DEMO("99.9th percentile")],
    ),
    Claim(
        r"RAW mosaics is ([\d.]+) dB above 3DGS with tuned rates and ([\d.]+) \+- ([\d.]+) above 3DGS as pub",
        lambda: [
            compared("methods", EXR, "SH of 3DGS, tuned")[0],
            *compared("methods", EXR, "3DGS, as published"),
        ],
    ),
    Claim(
        r"merged mosaic a view it is ([\d.]+) \+- ([\d.]+) better",
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
    Claim(r"nothing at 4 \((-[\d.]+) \+- ([\d.]+)\)", lambda: noise_gains("4 views")),
    Claim(
        r"HDR-GS reaches ([\d.]+) dB from one exposure a view, where 3DGS, .*? has ([\d.]+)",
        lambda: [cell("hdr_nerf_protocol", "OE dB", f"{name}, Exp-1") for name in ("HDR-GS", "vanilla 3DGS")],
    ),
    Claim(
        r"come out within ([\d.]+) dB of those that it saw, the response within ([\d.]+) %",
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
        r"radiance within ([\d.]+) dB of what NH-3DGS makes of the true light \(([\d.]+) from one",
        lambda: [
            cell("hdr_nerf_protocol", "HDR dB, aligned", "NH-3DGS on the true light")
            - cell("hdr_nerf_protocol", "HDR dB, aligned", f"HDR-GS, {which}")
            for which in ("Exp-3", "Exp-1")
        ],
    ),
    Claim(r"that is worth ([\d.]+) to ([\d.]+) dB", lambda: [min(rate_gains("300")), max(rate_gains("300"))]),
    Claim(r"at 100 (\d) to (\d) \(five", lambda: [min(rate_gains("100")), max(rate_gains("100"))]),
    Claim(r"poses in training gains ([\d.]+) dB", lambda: line("refine", r"(?m)^0\.6 px: ([+-][\d.]+) dB")),
    Claim(
        r"may have, (\d+) % were taken or left as (\d+) simulated",
        lambda: [
            *line("ladder", r"(?m)^([\d.]+) % of \d+ choices"),
            sum(one[0] for one in cells("ladder", "scenes")),
        ],
    ),
    Claim(
        r"lost more than ([\d.]+) dB, their pictures up to ([\d.]+) \(the mean gained ([\d.]+)\)",
        lambda: [
            -min(one[0] for one in cells("ladder", "truth, worst")),
            -min(one[0] for one in cells("ladder", "dB, worst")),
            gained(),
        ],
    ),
    Claim(
        r"need little are at least ([\d.]+) times faster or smaller",
        lambda: line("ladder", r"the least is ([\d.]+) times faster or smaller"),
    ),
    Claim(
        r"the demo and the gallery is ([\d.]+) and ([\d.]+) times",
        lambda: [cell("count", "ratio", name) for name in ("demo", "gallery")],
    ),
    Claim(r"views have up to ([\d.]+) dB more of the light", lambda: [few()]),
    Claim(
        r"is right to ([\d.e-]+) in the worst pixel",
        lambda: [
            max(of[0] for of in cells("stability", "forward", "2^40 (12 decades)", under="Worst error"))
        ],
    ),
)
