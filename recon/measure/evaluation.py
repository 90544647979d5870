"""Results of an evaluation, as in `metrics.json`; `rig.report.metric_words` explains the names."""

from typing import Any, Literal

from pydantic import Field

from imaging.record import Record


class Figures(Record):
    """Figures of held-out views; None without a reference, or without held-out views.

    PSNRs are in dB. The light is held against the truth, `aligned` by one scale for the whole scene; RAW
    files and photographs against their prediction from the render.
    """

    hdr_psnr_mu_aligned: float | None = None
    hdr_psnr_mu: float | None = None
    hdr_psnr_mu_dark: float | None = None
    hdr_psnr_mu_p999: float | None = None
    """Aligned, over the 99.9th percentile of the true light instead of its maximum, both clipped there."""
    stops_median: float | None = None
    """Median absolute error in stops, against the truth; without a truth, against the light of the held-out
    photographs, noise included, which is but a bound where they clip.
    """
    stops_dark: float | None = None
    """The same of the darkest tenth of that light."""
    stops_middle: float | None = None
    """The same between that and the brightest hundredth."""
    stops_bright: float | None = None
    """The same in the brightest hundredth."""
    stops_brightest: float | None = None
    """The same in the brightest thousandth."""
    pu21_psnr: float | None = None
    raw_psnr: float | None = None
    ldr_psnr_oe: float | None = None
    """PSNR of photographs at exposures that were trained on."""
    ldr_psnr_ne: float | None = None
    """PSNR at other exposures."""
    ldr_psnr_white: float | None = None
    """PSNR of photographs with alpha over a white background."""
    ssim: float | None = None
    ssim_ne: float | None = None
    ciede2000_mean: float | None = None
    ciede2000_median: float | None = None
    flip_mean: float | None = None
    flip_median: float | None = None
    hdr_flip_mean: float | None = None
    hdr_flip_median: float | None = None
    vdp_jod: float | None = None
    """ColorVideoVDP of the pictures on the screen of `recon.measure.vdp`; 10: no difference is visible."""
    hdr_vdp_jod: float | None = None
    """The same of the light on an HDR screen."""


class ViewFigures(Figures):
    """Figures of one view."""

    view: str
    """`frame/camera`."""


class BandFigures(Record):
    """Figures of one band of a scene of bands; the light is aligned by the scale of all bands."""

    band: str
    raw_psnr: float | None = None
    hdr_psnr_mu_aligned: float
    stops_median: float


class Decade(Record):
    """Relative error of the light where the truth is from `low` to `high`, as shares of the truth."""

    low: float
    high: float
    count: int
    """Values."""
    median: float
    p95: float


class Evaluation(Figures):
    """Figures of a scene: means over its held-out views, or values common to them."""

    schema_version: Literal[1] = 1
    method: str
    measured_on: Literal["test", "validation"] | None = None
    """Kind of the views: test views, or views that ended the training; None without views."""
    held_out_note: str | None = None
    """Caveat about the held-out views, if any."""
    left_out: str | None = None
    """Sentences on the views and figures that there was not time for, and on a metric that is installed but
    does not start; None: all are here.
    """
    stops_against: Literal["truth", "photographs"] | None = None
    """Reference of the errors in stops."""
    stops_bound: float | None = None
    """Share of the brightest hundredth that all photographs clip: less light than their bound is an error."""
    alignment_scale: float | None = None
    """Scale factor that aligns the scene's radiance with the truth."""
    width: int | None = None
    """px of the widest picture that is measured; scenes of one session can be compared at the same only."""
    truth_peak: float | None = None
    """Maximum of the true light over the held-out views."""
    truth_p999: float | None = None
    """99.9th percentile of the truth."""
    pu21_display_peak: float | None = None
    """cd/m2 at which PU21 takes that maximum."""
    relative_error_by_decade: tuple[Decade, ...] | None = None
    """Darkest first."""
    bands: tuple[BandFigures, ...] | None = None
    pose_rotation_deg: float | None = None
    """Pose error of a simulated session: degrees, median over views, after the best similarity; `_max`: the
    worst.
    """
    pose_rotation_deg_max: float | None = None
    pose_translation_relative: float | None = None
    """Relative to the largest distance of two cameras."""
    pose_translation_relative_max: float | None = None
    exposure_ratio_error: float | None = None
    exposure_ratio_error_max: float | None = None
    gain_error: float | None = None
    read_noise_error: float | None = None
    response_rmse: float | None = None
    """RMS error of the response, in code values of 0..1."""
    train_seconds: float
    iterations: int
    gaussians: int
    size_bytes: int
    """Size of splats.ply."""
    held_out: tuple[str, ...]
    """Names of the test views."""
    validation: tuple[str, ...]
    """Names of the views that could end the training."""
    views: tuple[ViewFigures, ...]
    """Figures of each view that was measured."""
    render_fps: float | None = Field(default=None, gt=0)
    """Held-out views drawn per second, on the processor."""

    def known(self) -> dict[str, Any]:
        """Available figures, by name: the content of metrics.json."""
        return self.model_dump(mode="json", exclude_none=True)
