"""Another reader of 3DGS files (Kerbl et al., arXiv 2308.04079): numpy, float64, Gaussian by Gaussian."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from recon.splat import SplatCamera

C0 = 0.28209479177387814
C1 = 0.4886025119029199
C2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)


def read(path: Path) -> dict[str, np.ndarray]:
    """Columns by name."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    names = [line.split()[-1] for line in header.decode().split("\n") if line.startswith("property float")]
    table = np.frombuffer(body, "<f4").reshape(-1, len(names)).astype(np.float64)
    return dict(zip(names, table.T, strict=True))


def colours(table: dict[str, np.ndarray], towards: np.ndarray) -> np.ndarray:
    """Colours of every Gaussian [N, 3] towards its own direction [N, 3], camera to Gaussian."""
    count = len(table["x"])
    rest = sorted((name for name in table if name.startswith("f_rest")), key=lambda name: int(name[7:]))
    constant = np.stack([table[f"f_dc_{channel}"] for channel in range(3)], 1)[:, None]
    others = np.array([table[name] for name in rest]).reshape(3, len(rest) // 3, count).transpose(2, 1, 0)
    sh = np.concatenate([constant, others], 1)
    x, y, z = towards.T[:, :, None]
    total = C0 * sh[:, 0]
    if len(rest) >= 9:
        total = total - C1 * y * sh[:, 1] + C1 * z * sh[:, 2] - C1 * x * sh[:, 3]
    if len(rest) >= 24:
        total = total + C2[0] * x * y * sh[:, 4] + C2[1] * y * z * sh[:, 5]
        total = total + C2[2] * (2 * z * z - x * x - y * y) * sh[:, 6]
        total = total + C2[3] * x * z * sh[:, 7] + C2[4] * (x * x - y * y) * sh[:, 8]
    return np.maximum(total + 0.5, 0)


def draw(
    table: dict[str, np.ndarray],
    camera: SplatCamera,
    near: float = 0.01,
    blur: float = 0.3,
    made_up: bool = False,
) -> np.ndarray:
    """Picture of a pinhole in the file's coordinates, [H, W, 3], over a black background.

    blur: px^2. made_up: whether a Gaussian that it spreads is the less opaque.
    """
    motion = camera.cam_from_world
    turn, centre = motion[:3, :3], -motion[:3, :3].T @ motion[:3, 3]
    xyz = np.stack([table[axis] for axis in "xyz"], 1)
    away = xyz - centre
    radiance = colours(table, away / np.linalg.norm(away, axis=1, keepdims=True))
    opacity = 1 / (1 + np.exp(-table["opacity"]))
    sizes = np.exp(np.stack([table[f"scale_{axis}"] for axis in range(3)], 1))
    quats = np.stack([table[f"rot_{part}"] for part in range(4)], 1)
    axes = Rotation.from_quat(quats, scalar_first=True).as_matrix()
    points = away @ turn.T
    rows, columns = np.mgrid[: camera.height, : camera.width]
    image, through = np.zeros((camera.height, camera.width, 3)), np.ones((camera.height, camera.width))
    margins = 1.3 * camera.width / 2 / camera.fx, 1.3 * camera.height / 2 / camera.fy
    for index in np.argsort(points[:, 2], kind="stable"):
        x, y, z = points[index]
        if z < near:
            continue
        u, v = np.clip(x / z, -margins[0], margins[0]), np.clip(y / z, -margins[1], margins[1])
        jacobian = np.array([[camera.fx, 0, -camera.fx * u], [0, camera.fy, -camera.fy * v]]) / z
        spread = jacobian @ turn @ axes[index] * sizes[index]
        sharp = spread @ spread.T
        blurred = sharp + blur * np.eye(2)
        share = np.sqrt(np.linalg.det(sharp) / np.linalg.det(blurred)) if made_up else 1.0
        inverse = np.linalg.inv(blurred)
        dx = columns + 0.5 - camera.cx - camera.fx * x / z
        dy = rows + 0.5 - camera.cy - camera.fy * y / z
        power = inverse[0, 0] * dx * dx + 2 * inverse[0, 1] * dx * dy + inverse[1, 1] * dy * dy
        alpha = np.minimum(0.99, share * opacity[index] * np.exp(-0.5 * power))
        alpha = np.where(alpha < 1 / 255, 0, alpha)
        image += (through * alpha)[..., None] * radiance[index]
        through *= 1 - alpha
    return image
