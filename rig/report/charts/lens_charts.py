"""Lenses: the field of residuals, how sure a projection is over the image, distortion, terms with errors."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from markupsafe import Markup, escape

from imaging.arrays import Array
from imaging.optics import lens as optics
from imaging.optics.lens import BROWN_TERMS, FISHEYE_TERMS, Lens, LensModel
from imaging.session.calibration import CalibrationRecord, CameraCalibration, LensError
from rig.report.charts.chart import COLOURS, AxisStyle, Series, chart
from rig.report.charts.residuals import CameraResiduals, Residuals
from rig.report.charts.topic import NOT_DETERMINED, Figure, Table, Topic, plus_minus
from rig.terminal.text import number

MOST_CAMERAS = 8
"""Cameras that are drawn one by one; of a larger rig those that miss most, or are least sure."""
COLUMNS, FEWEST, LONGEST = 12, 8, 1.5
"""Cells across the field of residuals, observations that a cell takes, and cells that the longest arrow may
span."""
WIDTH = 300
FREE: dict[LensModel, tuple[str, ...]] = {
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("fx", "fy", "cx", "cy", "k1"),
    "RADIAL": ("fx", "fy", "cx", "cy", "k1", "k2"),
    "OPENCV": BROWN_TERMS,
    "RADIAL_FISHEYE": FISHEYE_TERMS[:6],
    "OPENCV_FISHEYE": FISHEYE_TERMS,
}


def lens_topic(record: CalibrationRecord, residuals: Residuals) -> Topic:
    """Return the lenses, as far as scene points or a board determine them."""
    return Topic(
        "Lenses",
        figures=tuple(_figures(record, residuals)),
        tables=tuple(_tables(record)),
    )


def _figures(record: CalibrationRecord, residuals: Residuals) -> Iterable[Figure]:
    worst = sorted(residuals.cameras.items(), key=lambda item: -item[1].rms)[:MOST_CAMERAS]
    if worst:
        yield Figure(
            "Residual field",
            "Mean of seen less projected, over cells of the image. Short arrows in all directions are noise "
            "(faint: below twice their standard error); a pattern is distortion that the lens model lacks."
            + _chosen(len(worst), len(residuals.cameras), "those that miss most"),
            _small([field(name, camera) for name, camera in sorted(worst)]),
            wide=True,
        )
    maps = [
        (camera.name, camera.lens_error.projection_map(), camera.lens)
        for camera in record.cameras
        if camera.lens_error is not None and camera.lens_error.projection and camera.lens is not None
    ]
    unsure = sorted(maps, key=lambda item: -float(np.max(item[1])))[:MOST_CAMERAS]
    if unsure:
        top = max(
            (float(error) for _, values, _ in unsure for error in values[np.isfinite(values)]), default=0.0
        )
        yield Figure(
            "Projection uncertainty",
            "Standard error, px, of where a far point lands in the image, with the camera's own rotation "
            "left out: what the board leaves unknown of the lens. Large in corners that it never reached, "
            "and unknown (?) where its frames do not even show that the lens sees that far."
            + _chosen(len(unsure), len(maps), "the least sure"),
            _small([heat_map(name, values, lens, top) for name, values, lens in sorted(unsure)]),
            wide=True,
        )
    bent = [camera for camera in record.cameras if camera.lens is not None]
    if any(camera.lens and (camera.lens.fisheye or camera.lens.k1 or camera.lens.k2) for camera in bent):
        yield Figure(
            "Distortion",
            "How far the radial terms move a pixel outwards, by its distance from the principal point; of a "
            "fisheye, against a lens whose distances are its focal length times the angle from the axis.",
            chart(
                "Distortion",
                [
                    _distortion(camera.name if len(bent) <= COLOURS else "", camera.lens)
                    for camera in bent
                    if camera.lens
                ],
                "distance from the principal point, px",
                AxisStyle("moved outwards, px", zero=True),
            ),
        )
    if residuals.cameras:
        yield _histogram(residuals)


def _chosen(shown: int, of: int, which: str) -> str:
    return f" Of {of} cameras, {which}." if shown < of else ""


def _small(drawings: Sequence[Markup]) -> Markup:
    return Markup('<div class="small">') + Markup("").join(drawings) + Markup("</div>")


def field(name: str, residuals: CameraResiduals) -> Markup:
    """Arrows from the middle of cells of the image, all magnified alike; the factor is stated below."""
    width, height = residuals.size
    rows = max(1, round(COLUMNS * height / width))
    column = np.clip((residuals.observed[:, 0] / width * COLUMNS).astype(int), 0, COLUMNS - 1)
    row = np.clip((residuals.observed[:, 1] / height * rows).astype(int), 0, rows - 1)
    cell, cells = row * COLUMNS + column, COLUMNS * rows
    count = np.bincount(cell, minlength=cells)
    filled = np.flatnonzero(count >= FEWEST)
    sums = np.stack([np.bincount(cell, residuals.miss[:, axis], cells)[filled] for axis in (0, 1)], 1)
    mean: Array = sums / count[filled, None]
    square = np.bincount(cell, (residuals.miss**2).sum(1), cells)[filled] / count[filled]
    error = np.sqrt(np.maximum(square - (mean**2).sum(1), 0) / count[filled])
    length = np.hypot(*mean.T)
    scale = WIDTH / width
    longest = float(length.max()) if len(length) else 0.0
    factor = _magnified(LONGEST * width / COLUMNS / longest) if longest > 1e-9 else 1.0
    tall = height * scale
    parts = [
        f'<figure><svg class="chart field" viewBox="0 0 {WIDTH} {tall:.0f}" role="img" '
        f'aria-label="Residual field of {escape(name)}"><rect class="sheet-of" width="{WIDTH}" '
        f'height="{tall:.1f}"/>'
    ]
    for index, at in enumerate(filled):
        x = (at % COLUMNS + 0.5) * WIDTH / COLUMNS
        y = (at // COLUMNS + 0.5) * tall / rows
        dx, dy = mean[index] * scale * factor
        sure = length[index] > 2 * error[index]
        parts.append(_arrow(x, y, float(dx), float(dy), "" if sure else " faint"))
    parts.append(
        f"</svg><figcaption><b>{escape(name)}</b> · rms {number(residuals.rms)} px from "
        f"{len(residuals.observed):,} observations · arrows × {factor:,.0f}</figcaption></figure>"
    )
    return Markup("".join(parts))


def _magnified(most: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is at most `most`, and at least 1."""
    power = 10.0 ** math.floor(math.log10(max(most, 1.0)))
    return max(power * factor for factor in (1, 2, 5) if power * factor <= max(most, 1.0))


def _arrow(x: float, y: float, dx: float, dy: float, kind: str) -> str:
    tip_x, tip_y, head = x + dx, y + dy, 0.3
    left = (tip_x - head * (dx - 0.6 * dy), tip_y - head * (dy + 0.6 * dx))
    right = (tip_x - head * (dx + 0.6 * dy), tip_y - head * (dy - 0.6 * dx))
    return (
        f'<path class="arrow{kind}" d="M{x:.1f} {y:.1f}L{tip_x:.1f} {tip_y:.1f}M{left[0]:.1f} {left[1]:.1f}'
        f'L{tip_x:.1f} {tip_y:.1f}L{right[0]:.1f} {right[1]:.1f}"/>'
    )


def heat_map(name: str, grid: Array, lens: Lens, top: float) -> Markup:
    """Numbers over the image, the larger the darker; `top`: the value that is darkest; inf: not known."""
    rows, columns = grid.shape
    tall = WIDTH * lens.height / lens.width
    wide, high = WIDTH / columns, tall / rows
    parts = [
        f'<figure><svg class="chart heat" viewBox="0 0 {WIDTH} {tall:.0f}" role="img" '
        f'aria-label="Projection uncertainty of {escape(name)}">'
    ]
    for (row, column), value in np.ndenumerate(grid):
        x, y = column * wide, row * high
        share = min(float(value) / top, 1.0) if top > 0 else 0.0
        parts.append(
            f'<rect class="cell" x="{x:.1f}" y="{y:.1f}" width="{wide:.2f}" height="{high:.2f}" '
            f'fill-opacity="{0.04 + 0.66 * share:.2f}"/>'
            f'<text x="{x + wide / 2:.1f}" y="{y + high / 2 + 4:.1f}">{_known(value)}</text>'
        )
    middle = float(np.median(grid[rows // 2 - 1 : rows // 2 + 1, columns // 2]))
    parts.append(
        f"</svg><figcaption><b>{escape(name)}</b> · {_known(middle)} px in the middle, "
        f"{_known(float(grid.max()))} px at most</figcaption></figure>"
    )
    return Markup("".join(parts))


def _known(value: float) -> str:
    return number(value, 2) if math.isfinite(value) else "?"


def _distortion(name: str, lens: Lens) -> Series:
    corner = max(math.hypot(x - lens.cx, y - lens.cy) for x in (0.0, lens.width) for y in (0.0, lens.height))
    radius = np.linspace(0.0, corner, 41)
    if lens.fisheye:
        angle = optics.fisheye_angle(radius / lens.fx, lens.terms[4:])
        return Series(name, radius.tolist(), (radius - lens.fx * angle).tolist())
    square = (radius / lens.fx) ** 2
    return Series(name, radius.tolist(), (radius * square * (lens.k1 + lens.k2 * square)).tolist())


def _histogram(residuals: Residuals) -> Figure:
    """Both coordinates of all residuals against the Gaussian of the same middle spread."""
    values = np.concatenate([camera.miss.ravel() for camera in residuals.cameras.values()])
    sigma = max(1.4826 * float(np.median(np.abs(values - np.median(values)))), 1e-9)
    edges = np.linspace(-5 * sigma, 5 * sigma, 61)
    density, _ = np.histogram(values, edges)
    share = density / len(values) / (edges[1] - edges[0])
    x = np.linspace(-5 * sigma, 5 * sigma, 121)
    bell = np.exp(-0.5 * (x / sigma) ** 2) / (sigma * math.sqrt(2 * math.pi))
    far = float((np.abs(values) > 3 * sigma).mean())
    return Figure(
        "Residuals against a Gaussian",
        f"Both coordinates of {len(values) // 2:,} observations, in px of the pictures that poses "
        f"were found in. {100 * far:.2g} % lie beyond three times the width of their middle; "
        "of a Gaussian 0.27 % would.",
        chart(
            "Residuals",
            [
                Series("residuals", np.repeat(edges, 2)[1:-1].tolist(), np.repeat(share, 2).tolist()),
                Series(f"Gaussian, σ = {number(sigma)} px", x.tolist(), bell.tolist(), dashed=True),
            ],
            "seen less projected, px",
            AxisStyle("share per px", zero=True),
        ),
    )


def _tables(record: CalibrationRecord) -> Iterable[Table]:
    lenses = [camera for camera in record.cameras if camera.lens is not None]
    if lenses:
        named = {name for camera in lenses if camera.lens for name in camera.lens.names}
        terms = [name for name in (*BROWN_TERMS, *FISHEYE_TERMS[6:]) if name in named]
        yield Table(
            "Terms of the lenses",
            "Value ± standard error; lengths in px, pixel centres at +0.5. "
            "A dash: a term that the ladder did not take.",
            ("Camera", "Model", *(f"#{term}" for term in terms)),
            tuple(_terms(camera, terms) for camera in lenses),
        )
    mounted = [camera for camera in record.cameras if camera.cam_from_rig is not None]
    if len(mounted) > 1:
        from_board = not record.views or any(rung.name == "board_rig" and rung.taken for rung in record.rungs)
        unit = "mm" if record.unit == "m" else "relative"
        scale = 1000.0 if record.unit == "m" else 1.0
        yield Table(
            "Places in the rig",
            "Where each camera stands in the rig's frame, and how far it is turned from it. Standard errors "
            + ("are those of the board." if from_board else "are those of its views, from the scene."),
            ("Camera", f"#x, {unit}", f"#y, {unit}", f"#z, {unit}", "#Turned, °", f"#Standard error, {unit}",
             "#Standard error, °"),
            tuple(_place(camera, scale) for camera in mounted),
        )  # fmt: skip


def _terms(camera: CameraCalibration, terms: Sequence[str]) -> tuple[str, ...]:
    lens, error = camera.lens, camera.lens_error
    assert lens is not None
    free = FREE[lens.model]
    return (
        camera.name,
        lens.model,
        *(_term(lens, error, term) if term in free else "–" for term in terms),
    )


def _term(lens: Lens, error: LensError | None, term: str) -> str:
    sigma = getattr(error, term) if error is not None else None
    return plus_minus(float(getattr(lens, term)), sigma)


def _place(camera: CameraCalibration, scale: float) -> tuple[str, ...]:
    pose, error = camera.cam_from_rig, camera.cam_from_rig_error
    assert pose is not None
    motion = pose.matrix()
    centre = -motion[:3, :3].T @ motion[:3, 3] * scale
    turned = math.degrees(math.acos(float(np.clip((np.trace(motion[:3, :3]) - 1) / 2, -1, 1))))
    return (
        camera.name,
        *(number(float(value), 4).replace("-", "−") for value in centre + 0.0),
        number(turned),
        NOT_DETERMINED if error is None else number(scale * error.translation, 2),
        NOT_DETERMINED if error is None else number(error.rotation, 2),
    )
