"""The metrics of metrics.json in plain words."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rig.terminal.text import number


@dataclass(frozen=True)
class Metric:
    """A metric: its name in metrics.json, what people call it, its unit, what it says."""

    key: str
    name: str
    unit: str
    meaning: str
    percent: bool = False
    """Stored as a ratio, written in per cent."""
    in_line: str = ""
    """Short name in the terminal's line of important metrics; empty: not among them."""
    on_tile: str = ""
    """Name on a tile at the top of a report; empty: it has no tile."""
    on_axis: str = ""
    """Name on an axis of a trade-off; empty: it has no axis."""

    def written(self, value: float | None) -> str:
        """The value without its unit."""
        if value is None:
            return "n/a"
        if self.unit == "dB":
            return f"{value:.2f}"
        return number(100 * value if self.percent else value, 2 if self.percent else 3)


METRICS = (
    Metric(
        "hdr_psnr_mu_aligned",
        "HDR PSNR (µ-law), aligned, over the brightest light",
        "dB",
        "Closeness to the true light after one scale for the whole scene, relative to the brightest true "
        "light, as in papers. One small lamp raises it by decibels: compare it within one scene only.",
    ),
    Metric(
        "hdr_psnr_mu_p999",
        "HDR PSNR (µ-law), aligned, over the 99.9th percentile",
        "dB",
        "The same over the light that only a thousandth of the pixels exceeds, which counts as that much. "
        "Higher is better; from about 38 dB on, differences are hard to see.",
        in_line="HDR PSNR (mu-law over the 99.9th percentile of the light, aligned)",
        on_tile="HDR PSNR (µ-law over the 99.9th percentile of the light) of held-out views",
    ),
    Metric(
        "hdr_psnr_mu",
        "HDR PSNR (µ-law)",
        "dB",
        "Over the brightest light without that scale, so that an error of the absolute exposure counts too.",
        on_axis="µ-law PSNR of held-out light, dB",
    ),
    Metric(
        "hdr_psnr_mu_dark",
        "HDR PSNR (µ-law), without highlights",
        "dB",
        "Aligned, with everything above 0.4 of the brightest light clipped: the quality of the shadows.",
    ),
    Metric(
        "stops_median",
        "Median error of light",
        "stops",
        "Half of all values are nearer to the true light than this; of real photographs, to the light that "
        "held-out ones show, noise included. Where they clip only less is an error, where noise hides the "
        "light only more. 0.15 stops are 11 %.",
        in_line="median error",
        on_tile="median error of light in held-out views",
    ),
    Metric(
        "stops_dark",
        "Median error of light in its darkest tenth",
        "stops",
        "The same where that light is darkest.",
        in_line="of the darkest tenth",
    ),
    Metric(
        "stops_middle",
        "Median error of light in between",
        "stops",
        "The same of all but the darkest tenth and the brightest hundredth.",
    ),
    Metric(
        "stops_bright",
        "Median error of light in its brightest hundredth",
        "stops",
        "The same of lamps and highlights.",
        in_line="of the brightest hundredth",
    ),
    Metric(
        "stops_brightest",
        "Median error of light in its brightest thousandth",
        "stops",
        "The same of the brightest lamps alone.",
    ),
    Metric(
        "stops_bound",
        "Brightest hundredth that photographs clip",
        "%",
        "Share of it that clips in every exposure, which gives a lower bound: darker is wrong, "
        "brighter is not.",
        percent=True,
    ),
    Metric("pu21_psnr", "PU21 PSNR", "dB", "Closeness as seen by an eye before a display of 1000 cd/m²."),
    Metric(
        "raw_psnr",
        "RAW PSNR",
        "dB",
        "The render, sent through the sensor's model, against held-out RAW files; their noise is part of it.",
        in_line="RAW PSNR",
        on_tile="PSNR against held-out RAW files",
        on_axis="PSNR of held-out RAW files, dB",
    ),
    Metric(
        "ldr_psnr_oe",
        "PSNR of photographs",
        "dB",
        "The render, developed as the camera does, against held-out photographs at trained exposures.",
        in_line="PSNR",
        on_tile="PSNR of held-out photographs",
        on_axis="PSNR of held-out photographs, dB",
    ),
    Metric(
        "ldr_psnr_ne",
        "PSNR at new exposures",
        "dB",
        "The same at exposures that were kept from the training.",
        in_line="PSNR at unseen exposures",
    ),
    Metric(
        "ldr_psnr_white",
        "PSNR over white",
        "dB",
        "That of photographs with alpha before a white background, as NeRF-synthetic is published.",
        in_line="PSNR over white",
    ),
    Metric(
        "ssim",
        "SSIM",
        "",
        "Likeness of structure; 1 is identical.",
        in_line="SSIM",
        on_tile="SSIM of held-out photographs",
    ),
    Metric(
        "ciede2000_mean",
        "Colour difference (CIEDE2000)",
        "",
        "Mean over the pixels of renders/ and references/; below 1 the eye sees none, above 5 at once.",
    ),
    Metric(
        "flip_mean",
        "FLIP",
        "",
        "Mean visible difference of the same pictures when they alternate on a display; 0 is identical.",
    ),
    Metric("hdr_flip_mean", "HDR-FLIP", "", "The same of the light, the worst over all exposures of it."),
    Metric(
        "vdp_jod",
        "ColorVideoVDP",
        "JOD",
        "Of the same pictures on a 4K screen of 200 cd/m² in an office, seen from twice its height; at 10 "
        "no difference is visible, at 9 three of four people see one.",
    ),
    Metric(
        "hdr_vdp_jod",
        "ColorVideoVDP of light",
        "JOD",
        "The same of the light on an HDR screen of 1500 cd/m² in dim light, in cd/m² where the scale is "
        "known; else white is shown at 203 cd/m². It compares contrasts, not overall brightness.",
    ),
    Metric(
        "pose_rotation_deg",
        "Camera orientation error",
        "°",
        "Against the true poses after aligning the two worlds, median over views.",
        on_tile="median error of camera orientation",
    ),
    Metric(
        "pose_translation_relative",
        "Camera position error",
        "% of the rig",
        "The same for positions, relative to the largest distance between two cameras.",
        percent=True,
    ),
    Metric(
        "response_rmse",
        "Response error",
        "code values",
        "Of the response curve, on 0 to 1, against the true one.",
    ),
    Metric(
        "exposure_ratio_error",
        "Exposure ratio error",
        "%",
        "Of the estimated ratios within a bracket against the true ones, median over shots.",
        percent=True,
    ),
    Metric("gain_error", "Camera gain error", "%", "Worst camera, against the true gains.", percent=True),
    Metric(
        "read_noise_error", "Read noise error", "%", "Worst camera, against the true sensor.", percent=True
    ),
)

BY_KEY = {metric.key: metric for metric in METRICS}


def at_width(metrics: Mapping[str, Any]) -> str:
    """` at 640 px`: the width that figures hold at; empty where nothing was measured, or by an older rig."""
    width = metrics.get("width")
    return f" at {width} px" if width else ""


def qualified(metrics: Mapping[str, Any], key: str) -> str:
    """Return what follows the name of a figure: ` (validation)` if training was ended by the views it is of,
    ` (against photographs)` if light is compared with them; else nothing.
    """
    if key == "stops_median" and metrics.get("stops_against") == "photographs":
        return " (against photographs)"
    of_views = any(key in row for row in metrics.get("views", []))
    return " (validation)" if of_views and metrics.get("measured_on") == "validation" else ""
