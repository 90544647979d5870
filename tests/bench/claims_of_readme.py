"""Claims of the table of the README."""

import math
from functools import partial

from .claim import Claim as Claimed
from .claim import cell, cells
from .figures_of_scenes import beside_peer

Claim = partial(Claimed, page="README.md")

CLAIMS = (
    Claim(
        r"\| ([\d.]+) dB mu-law PSNR with the 99\.9th percentile of the light as its peak, ([\d.]+) dB with "
        r"the maximum; median error ([\d.]+) stops, ([\d.]+) in the darkest tenth, ([\d.]+) in the brightest "
        r"hundredth; (\d+) px, preset standard in (\d+) s",
        lambda: [
            cell("demo", column)
            for column in (
                "mu-law over the 99.9th percentile, dB",
                "over the brightest, dB",
                "stops, median",
                "darkest tenth",
                "brightest hundredth",
                "px",
                "s",
            )
        ],
    ),
    Claim(
        r"\| (\d+) s of processor time; plain pycolmap takes (\d+) s \|",
        lambda: [
            cell("calibration_size", "s", "castle", program, under="Whole") for program in ("rig", "pycolmap")
        ],
    ),
    Claim(
        r"\| ([\d,]+) s of processor time; plain pycolmap takes ([\d,]+) s; both",
        lambda: [
            cells("calibration_full_size", "processor s", program, but="freed")[0][0]
            for program in ("rig", "pycolmap")
        ],
    ),
    Claim(
        r"the tree reach (\d+) to (\d+) dB\.",
        lambda: [
            math.floor(min(beside_peer(name, "PSNR, dB")[0] for name in ("castle", "monstree"))),
            math.ceil(max(beside_peer(name, "PSNR, dB")[0] for name in ("castle", "monstree"))),
        ],
    ),
    Claim(
        r"close views of an object reach (\d+) dB",
        lambda: [math.floor(beside_peer("lego", "over white, dB")[0])],
    ),
    Claim(r"castle ([\d.]+) dB \(OpenSplat ([\d.]+)\),", lambda: beside_peer("castle", "PSNR, dB")),
    Claim(r"tree ([\d.]+) \(([\d.]+)\),", lambda: beside_peer("monstree", "PSNR, dB")),
    Claim(r"lego ([\d.]+) \(([\d.]+)\);", lambda: beside_peer("lego", "over white, dB")),
    Claim(
        r"\| ([\d.]+) dB at (\d+) px; published 3DGS has ([\d.]+) at",
        lambda: [cell("published", name, "lego", "best") for name in ("over white", "px", "3DGS")],
    ),
    Claim(
        r"error of held-out views ([\d.]+) stops, ([\d.]+) in the darkest tenth",
        lambda: [
            cells("foreign", column, "room, RAW of 14 bits", under="Held-out")[-1][0]
            for column in ("stops", "darkest tenth")
        ],
    ),
    Claim(
        r"\| (\d+) of (\d+) placed views have wrong poses",
        lambda: [sum(one[0] for one in cells("foreign_poses", key)) for key in ("wrong 1", "placed with")],
    ),
    Claim(r"\| (\d+) captures killed", lambda: [sum(one[0] for one in cells("kill", "sessions"))]),
    Claim(
        r"error ([\d.e-]+) in the worst pixel",
        lambda: [
            max(of[0] for of in cells("stability", "forward", "2^40 (12 decades)", under="Worst error"))
        ],
    ),
    Claim(
        r"two cores \| ([\d.]+) ms",
        lambda: [cell("splat", "forward + backward, ms", "`recon.splat`", under="50,000 Gaussians")],
    ),
)
