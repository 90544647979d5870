"""Claims of docs/figures.md on capture and calibration, and on light that the simulator has no part in."""

from .claim import Claim, cell, cells, line

_METHODS = "docs/methods-calibration.md"
_SECONDS = "s", "pycolmap, s"
_PLACED = "turn, degrees", "place, mm"


def _lasers(column: str, place: int = 0) -> list[tuple[float, float]]:
    """A number of each set of bench/real/poses/laser.py, of rig and of pycolmap."""
    both = ([one[place] for one in cells("laser", column, program)] for program in ("rig", "pycolmap"))
    return list(zip(*both, strict=True))


def _untouched(column: str) -> list[float]:
    """First numbers of the sets of bench/real/poses/untouched.py, of those that have any."""
    return [one[0] for one in cells("real_untouched", column) if one]


def _ends(values: list[float]) -> list[float]:
    return [min(values), max(values)]


CLAIMS = (
    Claim(
        r"`rig` places (\d+), (\d+), (\d+), (\d+) and (\d+) of (\d+), (\d+), (\d+), (\d+) and (\d+) views, "
        r"pycolmap (\d+), (\d+), (\d+), (\d+) and (\d+)\.",
        lambda: [
            *_untouched("placed by rig"),
            *_untouched("views"),
            *_untouched("by pycolmap"),
        ],
    ),
    Claim(
        r"between two views differs by ([\d.]+), ([\d.]+), ([\d.]+), ([\d.]+) and ([\d.]+) degrees in the",
        lambda: _untouched("turns"),
    ),
    Claim(
        r"`rig` takes (\d+), (\d+), (\d+), (\d+) and (\d+) s where pycolmap takes (\d+), (\d+), (\d+), (\d+) "
        r"and (\d+): on few",
        lambda: [one for column in _SECONDS for one in _untouched(column)],
    ),
    Claim(
        r"small photographs \| (\d+) to (\d+) s of processor time, ([\d.]+) to ([\d.]+) times as long as "
        r"plain pycolmap, which takes (\d+) to (\d+) s",
        lambda: [
            *_ends(_untouched("s")),
            *_ends([ours / theirs for ours, theirs in zip(*map(_untouched, _SECONDS), strict=True)]),
            *_ends(_untouched("pycolmap, s")),
        ],
        page="README.md",
    ),
    Claim(
        r"first four reach ([\d.]+), ([\d.]+), ([\d.]+) and (\d+\.\d) dB on held-out",
        lambda: _untouched("draft"),
    ),
    Claim(
        r"in ([\d.]+) to ([\d.]+) of the processor seconds and with centres ([\d.]+) to ([\d.]+) times as "
        r"near to the measured ones, ([\d.]+) to ([\d.]+) mm off in the median for ([\d.]+) to (\d+\.\d)",
        lambda: [
            *_ends([ours / theirs for ours, theirs in _lasers("s")]),
            *_ends([theirs / ours for ours, theirs in _lasers("centres, mm")]),
            *_ends([ours for ours, _ in _lasers("centres, mm")]),
            *_ends([theirs for _, theirs in _lasers("centres, mm")]),
        ],
    ),
    Claim(
        r"centres ([\d.]+) to ([\d.]+) mm off in the median, ([\d.]+) to ([\d.]+) by plain pycolmap, in "
        r"([\d.]+) to ([\d.]+) of its processor time",
        lambda: [
            *_ends([ours for ours, _ in _lasers("centres, mm")]),
            *_ends([theirs for _, theirs in _lasers("centres, mm")]),
            *_ends([ours / theirs for ours, theirs in _lasers("s")]),
        ],
        page="README.md",
    ),
    Claim(
        r"the true errors of turns are ([\d.]+) to ([\d.]+) times the stated ones",
        lambda: _ends([one[1] for one in cells("laser", "stated turns", "rig")]),
    ),
    Claim(
        r"in ([\d.]+) to ([\d.]+) of the processor seconds of pycolmap's defaults, and centres are "
        r"([\d.]+) to ([\d.]+)",
        lambda: [
            *_ends([ours / theirs for ours, theirs in _lasers("s")]),
            *_ends([theirs / ours for ours, theirs in _lasers("centres, mm")]),
        ],
        page=_METHODS,
    ),
    Claim(
        r"centres on all six are ([\d.]+) to ([\d.]+) times the stated errors and turns ([\d.]+) to "
        r"([\d.]+) times",
        lambda: [
            *_ends([one[1] for one in cells("laser", "stated, mm", "rig")]),
            *_ends([one[1] for one in cells("laser", "stated turns", "rig")]),
        ],
        page=_METHODS,
    ),
    Claim(
        r"the same result: ([\d.]+) against ([\d.]+) there, ([\d.]+) against ([\d.]+) on a hundred",
        lambda: [
            next(
                auc[0]
                for auc, alike in zip(
                    cells("alike", "AUC@1", name), cells("alike", "alike", name), strict=True
                )
                if alike[0] == count
            )
            for name in ("rig", "walk")
            for count in (10, 20)
        ],
    ),
    Claim(
        r"four terms of a fisheye are within ([\d.]+) px of 25 of them, out to (\d+) degrees",
        lambda: [
            cells("fisheye_models", "OPENCV_FISHEYE, px", "88")[0][1],
            cells("fisheye_models", "degrees from the axis", "88")[0][0],
        ],
        page=_METHODS,
    ),
    Claim(
        r"ratios of RAW brackets 1 EV apart have a median error of ([\d.]+) %, those of JPEG ([\d.]+) %",
        lambda: [
            cells("exposures", "median error, %", kind, "1 EV", but="less a line")[0][0]
            for kind in ("RAW", "JPEG")
        ],
        page=_METHODS,
    ),
    Claim(
        r"they were ([\d.]+) % off before and ([\d.]+) % after, at a stated standard error of ([\d.]+) %",
        lambda: [
            cells("white_balance", column)[0][0]
            for column in ("Off before, %", "Off after, %", "Stated standard error, %")
        ],
        page=_METHODS,
    ),
    Claim(
        r"Of one spot reading (\d+) % .* two on one grey card (\d+) %",
        lambda: [
            cells("luminance", "Within 1.96 standard errors", name)[0][0] for name in ("one spot", "two spot")
        ],
        page=_METHODS,
    ),
    Claim(
        r"held (\d+) % of focal lengths, (\d+) % of turns along .*?, (\d+) % of places and (\d+) % of scales",
        lambda: [
            cells("coverage", column, "all")[0][0] for column in ("focal length", "turn", "place", "scale")
        ],
        page=_METHODS,
    ),
    Claim(
        r"walk aside with a bent lens, with (\d+) % of focal lengths",
        lambda: [min(one[0] for one in cells("coverage", "focal length"))],
        page=_METHODS,
    ),
    Claim(
        r"at 320 px (\d+) % of rotations and (\d+) % of places were inside",
        lambda: [
            cells("calibration", column, "320 px, 0 EV", under="Scene")[0][0]
            for column in ("rotation in", "place in")
        ],
        page=_METHODS,
    ),
    Claim(
        r"the reprojection error is ([\d.]+) px where the poses are ([\d.]+) degrees off, and (\d+) % of",
        lambda: [
            cells("rolling_shutter", column, "walking")[-1][0]
            for column in ("reprojection, px", "turn, degrees", "in")
        ],
        page=_METHODS,
    ),
    Claim(
        r"error is ([\d.]+) degrees for directions between views and ([\d.]+) degrees for rotations",
        lambda: [
            cell("calibration", key, "320 px, 0 EV", under="Scene")
            for key in ("direction, degrees", "rotation, degrees")
        ],
    ),
    Claim(
        r"## Capture On ([\d,]+) simulated scenes",
        lambda: [sum(one[0] for one in cells("planner", "scenes, of these beyond the list"))],
    ),
    Claim(
        r"forecasts for a scene are ([\d.]+) to ([\d.]+) of the clock of simulated",
        lambda: line("forecast", r"side by side the forecast is ([\d.]+) to ([\d.]+) of the clock"),
    ),
    Claim(r"(\d+) captures killed", lambda: [sum(one[0] for one in cells("kill", "sessions"))]),
    Claim(
        r"all axes by (\d+) degrees, the worst error is ([\d.]+) degrees and ([\d.]+) mm; "
        r"by (\d+) degrees, ([\d.]+) and ([\d.]+)\.",
        lambda: [
            cells("apart", column, turned)[0][-1]
            for turned in ("10 degrees", "3 degrees")
            for column in ("motion", "turn, degrees: median, worst", "shift, mm: median, worst")
        ],
    ),
    Claim(
        r"Degenerate motions are refused, (\d+) of (\d+)",
        lambda: [
            sum(all_ - tied for tied, all_ in cells("apart", "tied", but="axes")),
            sum(all_ for _, all_ in cells("apart", "tied", but="axes")),
        ],
    ),
    Claim(
        r"a readout of (\d+) ms that is .*? error is ([\d.]+) degrees and (\d+) mm, against ([\d.]+) "
        r"degrees and ([\d.]+) mm for a static camera\. The reprojection error is ([\d.]+) px against "
        r"([\d.]+),",
        lambda: [
            cells("rolling_shutter", "readout, ms", "walking")[1][0],
            *(cells("rolling_shutter", column, "walking")[1][0] for column in _PLACED),
            *(cell("rolling_shutter", column, "standing") for column in _PLACED),
            cells("rolling_shutter", "reprojection, px", "walking")[1][0],
            cell("rolling_shutter", "reprojection, px", "standing"),
        ],
    ),
    Claim(
        r"hand, the error is ([\d.]+) degrees and ([\d.]+) mm, but (\d+) mm with a readout of (\d+) ms",
        lambda: [
            *(cells("rolling_shutter", column, "by hand")[1][0] for column in _PLACED),
            cells("rolling_shutter", "place, mm", "by hand")[2][0],
            cells("rolling_shutter", "readout, ms", "by hand")[2][0],
        ],
    ),
    Claim(
        r"noise of a sensor to ([\d.]+) %",
        lambda: [
            max(of[0] for key in ("gain %", "read noise %") for of in cells("sensor", key, but="0.2 DN"))
        ],
    ),
    Claim(r"\(([\d.]+) % where the noise", lambda: [cell("sensor", "read noise %", "0.2 DN")]),
    Claim(
        r"response of developed photographs to ([\d.]+) %",
        lambda: [max(of[0] for of in cells("response", "rig"))],
    ),
    Claim(
        r"calibrated to ([\d.]+) degrees and ([\d.]+) mm at worst",
        lambda: [
            max(of[2] for of in cells("calibration", key, but="calibrateMultiview"))
            for key in ("rotation, degrees", "translation, mm")
        ],
    ),
    Claim(
        r"OpenCV, which has to be given only the fully visible boards, reaches ([\d.]+) and ([\d.]+)\.",
        lambda: [
            cell("calibration", key, "calibrateMultiview", nth=2)
            for key in ("rotation, degrees", "translation, mm")
        ],
    ),
    Claim(
        r"median AUC@1 is ([\d.]+), but ([\d.]+) where",
        lambda: [cell("calibration", "AUC@1", f"320 px, {ev} EV", under="Scene") for ev in ("0", "-8")],
    ),
    Claim(
        r"On one of those rigs AUC@1 is ([\d.]+), and focal lengths come out ([\d.]+) % too long\. \(The "
        r".*? With the true lenses held it is ([\d.]+)\. .*? random direction, it is ([\d.]+) \(median "
        r".*? it is ([\d.]+) \(`bench/calibration/faint",
        lambda: [
            cell("faint", "AUC@1", "as it is"),
            cell("faint", "focal length, %", "as it is"),
            *(cell("faint", "AUC@1", name) for name in ("true lenses", "at random", "board")),
        ],
    ),
    Claim(
        r"([\d,]+) of ([\d,]+) pairs are matched, with ([\d.]+) of all matches",
        lambda: [
            *cells("calibration_size", "pairs matched", "rig", under="Pairs")[0],
            cell("calibration_size", "of all their matches", "rig", under="Pairs"),
        ],
    ),
    Claim(
        r"and AUC@1 is ([\d.]+); with all pairs it is ([\d.]+)\. Eleven",
        lambda: [
            cell("calibration_size", "AUC@1", "rig", f"{pairs}, incremental", under="Mappers")
            for pairs in ("chosen", "all")
        ],
    ),
    Claim(
        r"6 megapixels take (\d+) s of processor time and plain pycolmap takes (\d+) s,",
        lambda: [
            cell("calibration_size", "s", "castle", program, under="Whole") for program in ("rig", "pycolmap")
        ],
    ),
    Claim(
        r"alike, (\d+) of (\d+) placed views have wrong poses, .*? checks, it was (\d+) of (\d+)\.",
        lambda: [
            sum(one[0] for one in cells("foreign_poses", column))
            for column in ("wrong 1", "placed with", "wrong", "placed without")
        ],
    ),
    Claim(
        r"all (\d+) views are placed with a median error of ([\d.]+) degrees, and the error of "
        r"held-out views is ([\d.]+) stops, ([\d.]+) in the darkest tenth",
        lambda: [
            cells("foreign", column, "room, RAW of 14 bits", under=under)[-1][0]
            for column, under in (
                ("views", "Poses"),
                ("degrees, median", "Poses"),
                ("stops", "Held-out"),
                ("darkest tenth", "Held-out"),
            )
        ],
    ),
    Claim(
        r"views is ([\d.]+) stops in the median and ([\d.]+) at the far background; merged brackets "
        r"reach ([\d.]+) dB with a chi-square of ([\d.]+)",
        lambda: [
            cells("foreign", column, "objects, RAW of 12 bits, poses given", under=under)[-1][0]
            for column, under in (
                ("stops", "Held-out"),
                ("background", "Held-out"),
                ("merged, dB", "Photographs"),
                ("chi-square", "Photographs"),
            )
        ],
    ),
)
