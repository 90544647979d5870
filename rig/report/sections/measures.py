"""The metrics of metrics.json in plain words."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rig.terminal.text import number


@dataclass(frozen=True)
class Measure:
    """A metric: its name in metrics.json, what people call it, its unit, what it says."""

    key: str
    name: str
    unit: str
    meaning: str
    percent: bool = False
    """Stored as a ratio, written in per cent."""

    def written(self, value: float | None) -> str:
        """The value without its unit."""
        if value is None:
            return "n/a"
        if self.unit == "dB":
            return f"{value:.2f}"
        return number(100 * value if self.percent else value, 2 if self.percent else 3)


MEASURES = (
    Measure(
        "hdr_psnr_mu_aligned",
        "HDR PSNR (µ-law), aligned",
        "dB",
        "Closeness to the true light over the whole range of brightness, after one scale for the whole "
        "scene. Higher is better; from about 38 dB on, differences are hard to see.",
    ),
    Measure(
        "hdr_psnr_mu",
        "HDR PSNR (µ-law)",
        "dB",
        "The same without that scale, so that an error of the absolute exposure counts too.",
    ),
    Measure(
        "hdr_psnr_mu_dark",
        "HDR PSNR (µ-law), without highlights",
        "dB",
        "The same with everything above 0.4 of the peak clipped: says how good the shadows are.",
    ),
    Measure(
        "stops_median",
        "Median error of light",
        "stops",
        "Half of all pixels are nearer to the true light than this. 0.15 stops are 11 %.",
    ),
    Measure("pu21_psnr", "PU21 PSNR", "dB", "Closeness as seen by an eye before a display of 1000 cd/m²."),
    Measure(
        "raw_psnr",
        "RAW PSNR",
        "dB",
        "The render, sent through the sensor's model, against held-out RAW files; their noise is part of it.",
    ),
    Measure(
        "ldr_psnr_oe",
        "PSNR of photographs",
        "dB",
        "The render, developed as the camera does, against held-out photographs at trained exposures.",
    ),
    Measure(
        "ldr_psnr_ne",
        "PSNR at new exposures",
        "dB",
        "The same at exposures that were kept from the training.",
    ),
    Measure("ssim", "SSIM", "", "Likeness of structure; 1 is identical."),
    Measure(
        "ciede2000_mean",
        "Colour difference (CIEDE2000)",
        "",
        "Mean over the pixels of renders/ and references/; below 1 the eye sees none, above 5 at once.",
    ),
    Measure(
        "flip_mean",
        "FLIP",
        "",
        "Mean visible difference of the same pictures when they alternate on a display; 0 is identical.",
    ),
    Measure("hdr_flip_mean", "HDR-FLIP", "", "The same of the light, the worst over all exposures of it."),
    Measure(
        "pose_rotation_deg",
        "Camera orientation error",
        "°",
        "Against the true poses after aligning the two worlds, median over views.",
    ),
    Measure(
        "pose_translation_relative",
        "Camera position error",
        "% of the rig",
        "The same for positions, relative to the largest distance between two cameras.",
        percent=True,
    ),
    Measure(
        "response_rmse",
        "Response error",
        "code values",
        "Of the response curve, on 0 to 1, against the true one.",
    ),
    Measure(
        "exposure_ratio_error",
        "Exposure ratio error",
        "%",
        "Of the estimated ratios within a bracket against the true ones, median over shots.",
        percent=True,
    ),
    Measure("gain_error", "Camera gain error", "%", "Worst camera, against the true gains.", percent=True),
    Measure(
        "read_noise_error", "Read noise error", "%", "Worst camera, against the true sensor.", percent=True
    ),
)

BY_KEY = {measure.key: measure for measure in MEASURES}


def validation(metrics: Mapping[str, Any], key: str) -> str:
    """What a figure's name ends in if it is of a view that the training was ended by; else nothing."""
    of_views = any(key in row for row in metrics.get("views", []))
    return " (validation)" if of_views and metrics.get("measured_on") == "validation" else ""
