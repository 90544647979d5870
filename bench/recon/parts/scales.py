"""Renders smaller and larger than the photographs that were trained on: what a footprint filter is worth.

    python -m bench.recon.parts.scales [--sets lego,demo] [--quick] [--json] [--write] [--seeds 2]
        [--work FOLDER]

Trained at a quarter of the width there is, and held-out views drawn at 1/4, 1/2, 1, 2 and 4 times that width.
Truth: photographs (lego, castle, monstree), or the simulator's light (demo, poses and exposures given),
averaged over areas. Filters, in training and in drawing alike: the variance `Limits.blur` that is added to
every projected covariance; with "kept", opacity is multiplied by the root of the ratio of determinants before
and after, so that the filter spreads light and adds none; with "3D", every Gaussian is first widened by 0.2
of the squared distance of samples in the training view that sees it finest, likewise compensated (both:
Mip-Splatting, Yu et al., arXiv 2311.16493). They are computed in front of `rasterize`. With "as trained" only
held-out views are filtered, by `recon.scene.sampling`, as every scene that is opened. Finished trainings are
kept in FOLDER.
"""

import argparse
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np
import torch
from torch import Tensor

from bench.peers.compare import session_of
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache, session
from imaging import metrics
from imaging.files import store
from recon.data.dataset import Dataset, View
from recon.data.light import light_of, radiance_image
from recon.data.load import load
from recon.measure.truth import true_radiance
from recon.methods import nh_3dgs, vanilla
from recon.scene.sampling import Sampling, away_from
from recon.splat import Limits, Render, SplatCamera, rasterize
from recon.splat.reference import rotation_matrices
from recon.start.initialisation import gaussians_at, start_points
from recon.train.densification import DensityRules
from recon.train.devices.warm_up import warm_up
from recon.train.trainer import train
from recon.train.training import Plan, Training

WIDTHS = {"lego": 100, "demo": 80, "castle": 200, "monstree": 60}
"""Widths of training, px: a quarter of the full ones."""
FACTORS = (0.25, 0.5, 1, 2, 4)
VIEWS = 6
"""Held-out views that are drawn, spread over all."""
SMOOTHING = 0.2
"""Variance of the 3D filter over the squared distance of samples (Mip-Splatting)."""
EVERY = 100
"""Renders between two looks at which view sees a Gaussian finest."""


@dataclass
class Filter:
    """Filter before `rasterize`: see the head. cameras: those of training."""

    blur: float
    compensated: bool = False
    smoothed: bool = False
    as_trained: bool = False
    cameras: Sequence[SplatCamera] = ()
    renders: int = 0
    distance: Tensor = field(default_factory=lambda: torch.zeros(0))
    """Distance of samples, in the unit of the means, [N]."""

    def name(self) -> str:
        """Name in the table."""
        return f"{self.blur:g}{', kept' if self.compensated else ''}{', 3D' if self.smoothed else ''}" + (
            ", as trained" if self.as_trained else ""
        )

    def __call__(
        self,
        means: Tensor,
        quats: Tensor,
        scales: Tensor,
        opacities: Tensor,
        colours: Tensor,
        camera: SplatCamera,
        background: Tensor | None,
        limits: Limits,
        *rest: Any,
    ) -> Render:
        """Render as `rasterize`."""
        if self.smoothed:
            if torch.is_grad_enabled():
                self.renders += 1
            if len(self.distance) != len(means) or self.renders % EVERY == 0:
                self.distance = distance(means.detach(), self.cameras)
            wide = (scales**2 + SMOOTHING * self.distance[:, None] ** 2).sqrt()
            opacities = opacities * (scales / wide).prod(1)
            scales = wide
        if self.compensated:
            opacities = opacities * compensation(means, quats, scales, camera, self.blur)
        limits = replace(limits, blur=self.blur)
        if self.as_trained and not torch.is_grad_enabled():
            away = away_from(means, camera)
            sampling = Sampling.of(means, self.cameras)
            scales, opacities = sampling.drawn(away, scales, quats, opacities, camera, self.blur)
        return rasterize(means, quats, scales, opacities, colours, camera, background, limits, *rest)


def compensation(means: Tensor, quats: Tensor, scales: Tensor, camera: SplatCamera, blur: float) -> Tensor:
    """[N] root of the ratio of the determinants of projected covariances before and after the blur.

    For lenses without distortion; of points behind the camera, which are not drawn, it means nothing.
    """
    motion = torch.from_numpy(np.asarray(camera.cam_from_world, np.float64))
    rotation = motion[:3, :3]
    x, y, z = (means.double() @ rotation.T + motion[:3, 3]).unbind(1)
    z = z.clamp_min(1e-2)
    low_u, high_u, low_v, high_v = camera.tangent_bounds(Limits().tangent_margin)
    u, v, nothing = (x / z).clamp(low_u, high_u), (y / z).clamp(low_v, high_v), torch.zeros_like(z)
    rows = [
        torch.stack([camera.fx / z, nothing, -camera.fx * u / z], 1),
        torch.stack([nothing, camera.fy / z, -camera.fy * v / z], 1),
    ]
    root = torch.stack(rows, 1) @ rotation @ rotation_matrices(quats.double()) * scales.double()[:, None]
    before = (torch.linalg.cross(root[:, 0], root[:, 1]) ** 2).sum(1)
    after = before + blur * (root**2).sum((1, 2)) + blur**2
    factor: Tensor = ((before + 1e-12) / after).sqrt()
    return factor.float()


@torch.no_grad()
def distance(means: Tensor, cameras: Sequence[SplatCamera]) -> Tensor:
    """[N] least depth over focal length of the cameras that see a point; the largest found, if none does."""
    least = torch.full_like(means[:, 0], float("inf"))
    for camera in cameras:
        motion = torch.from_numpy(np.asarray(camera.cam_from_world, np.float32))
        x, y, z = (means @ motion[:3, :3].T + motion[:3, 3]).unbind(1)
        column, row = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        visible = (z > 0.01) & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
        least = torch.where(visible, torch.minimum(least, z / camera.fx), least)
    known = least.isfinite()
    return torch.where(known, least, least[known].max() if known.any() else torch.zeros(()))


def patched(filtered: Filter) -> AbstractContextManager[Any]:
    """Every render goes through a filter."""
    return mock.patch("recon.scene.gaussians.rasterize", filtered)


def chosen(views: Sequence[View]) -> Sequence[View]:
    """Some of them, spread over all."""
    return views[:: max(1, len(views) // VIEWS)][:VIEWS]


def folder_of(name: str, options: argparse.Namespace) -> Path:
    """The session of a set."""
    return session(options.work, name, 0, "truth") if name == "demo" else session_of(name, options.work)


def trained(
    name: str, filtered: Filter, seed: int, options: argparse.Namespace, pictures: Path | None
) -> dict[str, float]:
    """dB by factor of the width."""
    folder, width = folder_of(name, options), WIDTHS[name]
    dataset = load(folder, max_width=width)
    filtered.cameras = [view.lens for view in dataset.train]
    images = [radiance_image(view) for view in dataset.train]
    light = light_of(dataset, images)
    rng = np.random.Generator(np.random.PCG64([seed, 0x57A27]))
    start = start_points(dataset, images, options.gaussians // 2, rng)
    compose = nh_3dgs.compose if name == "demo" else vanilla.compose
    method = compose(dataset, light)
    gaussians = gaussians_at(start, method.appearance, method.observation.units)
    training = Training.begin(method, light, gaussians, dataset.extent)
    warm_up(lambda message, done, total: None)
    plan = Plan(options.iterations, DensityRules(options.gaussians), seed, log_every=options.iterations)
    with patched(filtered):
        train(training, dataset, plan)
        row = {}
        for factor in FACTORS:
            sized = judged(folder, round(factor * width))
            row[f"{factor:g}"] = quality(
                sized, training, pictures, f"{name}-{filtered.name().replace(', ', '-')}-{factor:g}"
            )
    return row


@cache
def judged(folder: Path, width: int) -> Dataset:
    """The held-out views of a session at a width, read once for all trainings."""
    return replace(load(folder, max_width=width), train=())


@torch.no_grad()
def quality(dataset: Dataset, training: Training, pictures: Path | None, label: str) -> float:
    """Mean PSNR of held-out views: of display values, or of light as the project measures it."""
    views, observation = chosen(dataset.held_out), training.method.observation
    pairs = []
    for view in views:
        image = training.renderer()(training.gaussians, view.lens, degree=training.method.degree(1.0)).image
        if dataset.kind == "raw":
            pairs.append((observation.radiance(image).numpy(), true_radiance(dataset.session, view)))
        else:
            (shot,) = view.shots
            pairs.append((observation.predict(image, view, shot.k).numpy().clip(0, 1), shot.pixels))
    ours, true = ([pair[side].reshape(-1, 3) for pair in pairs] for side in (0, 1))
    peak, scale = 1.0, 1.0
    if dataset.kind == "raw":
        peak = max(float(light.max()) for light in true)
        scale = metrics.align_scale(np.concatenate(ours), np.concatenate(true))
    if pictures is not None:
        show(pairs[0], scale / peak, dataset.kind == "raw", pictures / f"{label}.png")
    if dataset.kind == "raw":
        return float(np.mean([metrics.hdr_psnr_mu(a * scale, b, peak) for a, b in pairs]))
    return float(np.mean([metrics.psnr(a, b) for a, b in pairs]))


def show(pair: tuple[Any, Any], scale: float, linear: bool, path: Path) -> None:
    """A render beside its truth."""
    both = np.concatenate([pair[0] * scale, pair[1] * (scale if not linear else 1.0)], axis=1)
    codes = (255 * np.clip(both, 0, 1) ** (1 / 2.2 if linear else 1)).astype(np.uint8)
    store.write_bytes(path, cv2.imencode(".png", codes[..., ::-1])[1].tobytes())


def filters() -> list[Filter]:
    """Filters in the order of the table; the first is that of 3DGS."""
    return [
        Filter(0.3),
        Filter(0.1, compensated=True),
        Filter(0.1),
        Filter(0.1, as_trained=True),
        Filter(0.3, compensated=True),
        Filter(0.1, compensated=True, smoothed=True),
    ]


def measure(options: argparse.Namespace) -> dict[str, Any]:
    finished, rows = Cache(options.work / "scales.jsonl"), []
    sets = options.sets.split(",")
    done: dict[tuple[str, str], list[dict[str, float]]] = {}
    for seed in range(options.seeds):
        for name in sets:
            for one in filters():
                key = f"{name} {one.name()} {seed} {options.iterations} {options.gaussians}"
                pictures = options.work / "scales" if seed == 0 else None
                got = finished.get(key, partial(trained, name, one, seed, options, pictures))
                done.setdefault((name, one.name()), []).append(got)
    for (name, what), got in done.items():
        keys = [f"{factor:g}" for factor in FACTORS]
        means = {key: [one[key] for one in got] for key in keys}
        rows.append({"set": name, "filter": what, "db": means})
    shape = {
        "sets": options.sets,
        "iterations": options.iterations,
        "gaussians": options.gaussians,
        "seeds": options.seeds,
    }
    return {"machine": machine(), "rows": rows, **shape}


def report(result: dict[str, Any]) -> str:
    trained_at = ", ".join(f"{WIDTHS[name]} px ({name})" for name in result["sets"].split(","))
    lines = [
        "# Renders at other widths than the photographs'",
        "",
        f"`python -m bench.recon.parts.scales --sets {result['sets']} --write`: {result['iterations']:,} "
        f"iterations, {result['gaussians']:,} Gaussians, {result['seeds']} seed(s), trained at {trained_at}. "
        f"dB of at most {VIEWS} held-out views by the width drawn: mean and half the range over seeds. The "
        "filters are those of the script's head, and the first is that of 3DGS. "
        f"{words(result['machine'])}.",
        "",
        "| set | filter | " + " | ".join(f"{factor:g}x" for factor in FACTORS) + " |",
        "|---|---|" + "---|" * len(FACTORS),
    ]
    for row in result["rows"]:
        cells = [f"{np.mean(got):.2f} +- {np.ptp(got) / 2:.2f}" for got in row["db"].values()]
        lines.append(f"| {row['set']} | {row['filter']} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__, seeds=2)
    parser.add_argument("--sets", default=",".join(WIDTHS))
    options = parser.parse_args()
    options.iterations, options.gaussians = 500, 6_000
    if options.quick:
        options.iterations, options.gaussians, options.seeds = 100, 1_000, 1
    result = measure(options)
    deliver(options, "scales", result, report(result))


if __name__ == "__main__":
    main()
