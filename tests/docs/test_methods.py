"""Constants, files and papers in docs/methods.md and docs/methods-calibration.md agree with the code."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from calib.adjustment import focal_evidence, lens_ladder, place_priors, uncertainty
from calib.light import exposure_scales
from calib.light.curves import response_band
from calib.sensor import linearity
from imaging.merge import bracket, ratios
from imaging.sensor.noise import SensorNoise
from recon.observe import calibrated_curves, linear, photographs, tone_grid
from recon.observe.glare import RADIUS
from recon.observe.losses.photometric import Photometric, mu_law
from recon.observe.photographs import ToneCurve
from recon.scene.appearance import ANCHOR, LuminanceChromaticity
from recon.scene.gaussians import TAU
from recon.splat import Limits
from recon.train import schedule
from recon.train.densification import OPACITY, SHRINK, DensityRules
from recon.train.schedule import rate_factor

ROOT = Path(__file__).resolve().parents[2]
TEXT = "".join(
    (ROOT / "docs" / f"{name}.md").read_text("utf-8") for name in ("methods", "methods-calibration")
)
FLOWING = " ".join(TEXT.split())
RULES, LIMITS, COLOURS = DensityRules(1), Limits(), LuminanceChromaticity()
LEARNED = {name: field.default for name, field in ToneCurve.__dataclass_fields__.items()}

SAID: tuple[tuple[str, Callable[[], tuple[float, ...]]], ...] = (
    (r"b = ([\d.]+)\\ \\mathrm\{px\}", lambda: (LIMITS.blur,)),
    (r"ends below \$T = 10\^\{(-\d+)\}\$", lambda: (np.log10(LIMITS.t_min),)),
    (r"\\tau = ([\d.]+)", lambda: (TAU,)),
    (r"\$\$10\^\{(-\d+)\} \\bigl", lambda: (np.log10(COLOURS.pull),)),
    (r"Y_\{00\}\)_c - ([\d.]+)", lambda: (ANCHOR,)),
    (r"clamped to within (\d+) stops", lambda: (COLOURS.stops,)),
    (r"\\mu = (\d+)\$ for signals of a sensor and (\d+) for", lambda: (linear.SIGNAL_MU, linear.LIGHT_MU)),
    (r"\\qquad w = ([\d.]+)", lambda: (Photometric().ssim_weight,)),
    (r"grid of \$(-\d+) \\dots (\d+)\$", lambda: (tone_grid.LOW, tone_grid.HIGH)),
    (
        r"(\d+) nodes a unit between \$(-\d+)\$ and \$([\d.]+)\$ and (\d+) beyond",
        lambda: (
            tone_grid.CORE_DENSITY,
            tone_grid.CORE_LOW,
            tone_grid.CORE_HIGH,
            tone_grid.TAIL_DENSITY,
        ),
    ),
    (r"\\beta = ([\d.]+)", lambda: (tone_grid.LEAK,)),
    (
        r"penalised: \$10\^\{(-\d+)\}\$ \(([\d.]+) where",
        lambda: (np.log10(LEARNED["smoothness"]), calibrated_curves.ASSUMED_SMOOTHNESS),
    ),
    (r"knows it to (\d+) %", lambda: (100 * calibrated_curves.KNOWN_RESIDUAL,)),
    (r"\(([\d.]+) / s\)\^\{([\d.]+)\}", lambda: (photographs.TYPICAL_SLOPE, LEARNED["balance"])),
    (r"gain to the power 1/(\d\.\d)", lambda: (1 / photographs.DISPLAY_POWER,)),
    (r"\(r / ([\d.]+) D\)", lambda: (RADIUS,)),
    (r"\\frac\{(\d+)\}\{n\}\\right\)\^\{([\d.]+)\}", lambda: (schedule.USUAL, schedule.POWER)),
    (r"from (\d+) % to (\d+) % of it", lambda: (100 * RULES.begin, 100 * RULES.end)),
    (r"s' = s / ([\d.]+)", lambda: (SHRINK,)),
    (r"o = ([\d.]+) \\min\(1", lambda: (OPACITY,)),
    (r"share missing at white is above ([\d.]+) %", lambda: (100 * linearity.DEVIATES,)),
    (r"exceeds one standard error and ([\d.]+) per observation", lambda: (lens_ladder.MATERIAL,)),
    (r"have to move by \$(\d) \\cdot 10\^\{-5\}", lambda: (focal_evidence.DETERMINED * 1e5,)),
    (r"in common, \$(\d) \\cdot 10\^\{-6\}", lambda: (place_priors.COMMON * 1e6,)),
    (r"are those of (\d+) resamplings", lambda: (response_band.REPLICAS,)),
    (r"one of (\d+) x 20 cells", lambda: (uncertainty.CELLS,)),
    (r"between (\d+) and (\d+) % of white", lambda: (100 * ratios.LOWEST, 100 * ratios.HIGHEST)),
    (r"\\mathrm\{label\}_i\)\^2\}\{([\d.]+)\^2\}", lambda: (ratios.LABEL_SIGMA,)),
)


@pytest.mark.parametrize(("words", "held"), SAID, ids=[re.sub(r"\W+", " ", words) for words, _ in SAID])
def test_a_constant_is_that_of_the_code(words: str, held: Callable[[], tuple[float, ...]]) -> None:
    (shown,) = re.findall(words, FLOWING)
    figures = [float(one) for one in (shown if isinstance(shown, tuple) else (shown,))]
    assert figures == pytest.approx(held())


def test_words_for_numbers_are_those_of_the_code() -> None:
    assert (bracket.ITERATIONS, bracket.MARGIN) == (3, 3)
    assert "in three rounds" in FLOWING
    assert "within three standard deviations" in FLOWING
    assert (RULES.every, RULES.growth) == (1 / 40, 1 / 4)
    assert "every fortieth" in FLOWING
    assert "at most a quarter at once" in FLOWING
    assert LEARNED["fixed"] == 1 / 5
    assert "first fifth" in FLOWING
    assert exposure_scales.LABEL_SIGMA == ratios.LABEL_SIGMA


def test_formulas_are_those_of_the_code() -> None:
    x, mu = np.array([-0.01, 0.0, 0.3]), 500.0
    exact = np.sign(x) * np.log(1 + mu * np.abs(x)) / np.log(1 + mu)
    assert mu_law(torch.from_numpy(x), mu).numpy() == pytest.approx(exact)
    noise = SensorNoise(gain=0.4, read_noise=3.0, prnu=0.01)
    signal = np.array([0.0, 100.0])
    assert noise.variance(signal) == pytest.approx(1.2**2 + 1 / 12 + 0.4 * signal + (0.01 * signal) ** 2)
    assert rate_factor(300) == pytest.approx((2000 / 300) ** 0.4)
    nodes, values = torch.tensor([-10.0, 0.0, 5.0]), torch.tensor([0.0, 0.4, 1.0])
    outside = tone_grid.apply_curve(torch.tensor([-12.0, 8.0]), values, nodes, leaky=True)
    assert outside.tolist() == pytest.approx([0.01 * -2, 1.01 - 0.01 / np.sqrt(4)])
    assert tone_grid.remap_rate([1 / 8, 2, 32]) == pytest.approx(2 / np.log(16))


def test_papers_are_in_the_citation() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    cited = set(re.findall(r"arXiv (\d{4}\.\d{5})", FLOWING))
    assert len(cited) > 4
    assert {number for number in cited if f"arXiv:{number}" not in citation} == set()
