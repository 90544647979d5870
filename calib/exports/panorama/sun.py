"""Light that saturates the shortest exposure: its place, and its energy by a meter beside the camera."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from calib.exports.panorama.gathering import Map
from calib.exports.panorama.layout import degrees, directions, solid_angles
from imaging.arrays import Array, Mask
from imaging.errors import InputError
from imaging.merge.picture import CLIPPED, NOTHING

RECOVERED = 32
"""Bit of the mask: the energy of the place was found by a meter, and spread over it evenly."""


@dataclass(frozen=True)
class ClippedRegion:
    """A region that every exposure clips.

    longitude, latitude: of its middle, degrees. solid_angle: sr. illuminance: at least that on a card that
    faces it, lx where the light is in cd/m2. luminance: that was recovered; None: it is a lower bound.
    """

    longitude: float
    latitude: float
    solid_angle: float
    illuminance: float
    luminance: float | None = None

    @property
    def width(self) -> float:
        """Diameter, degrees, of a disc of the same solid angle."""
        return float(2 * np.degrees(np.arccos(max(1 - self.solid_angle / (2 * np.pi), -1.0))))


def clipped_regions(gathered: Map, luminance: Array) -> tuple[list[ClippedRegion], Mask]:
    """The regions that every exposure clips, the one that faces most light first, and its texels.

    luminance: weights [3] of the luminance.
    """
    rows = len(gathered.mask)
    clipped = gathered.mask == CLIPPED
    labels, count = ndimage.label(clipped, np.ones((3, 3)))
    if not count:
        return [], clipped
    joined = np.arange(count + 1)
    for west, east in zip(labels[:, 0], labels[:, -1], strict=True):  # the ends are neighbours
        if west and east:
            joined[joined == joined[east]] = joined[west]

    # Sums over the texels of each region, without a mask of each: thousands of highlights may be clipped.
    of = np.unique(joined[labels[clipped]], return_inverse=True)[1]
    ahead = directions(rows, 0, rows)[clipped]
    angle = np.broadcast_to(solid_angles(rows), clipped.shape)[clipped]
    middles = np.stack([np.bincount(of, ahead[:, axis] * angle) for axis in range(3)], axis=-1)
    towards = middles / np.linalg.norm(middles, axis=-1, keepdims=True)
    facing = np.clip((ahead * towards[of]).sum(axis=-1), 0, None)
    energy = np.bincount(of, gathered.light[clipped] @ luminance * angle * facing)
    order, wide = np.argsort(-energy, kind="stable"), np.bincount(of, angle)
    regions = [
        ClippedRegion(*degrees(towards[one]), float(wide[one]), float(energy[one])) for one in order.tolist()
    ]
    brightest = np.zeros_like(clipped)
    brightest[clipped] = of == order[0]
    return regions, brightest


def with_sun(
    gathered: Map, brightest: tuple[ClippedRegion, Mask], lux: float, luminance: Array
) -> tuple[Map, ClippedRegion]:
    """The map, whose light is in cd/m2, with the light of its brightest clipped region recovered.

    Args:
        gathered: The map.
        brightest: The first region of `clipped_regions`, and its texels.
        lux: Illuminance of a card that faces that region, of all light that falls on it.
        luminance: Weights [3] of the luminance.

    Returns:
        The map, in which the region is evenly white, and the region.

    Raises:
        InputError: The rest of the map gives the card as much light already.
    """
    region, inside = brightest
    rows = len(gathered.mask)
    every, angle = directions(rows, 0, rows), solid_angles(rows)
    middle = (every[inside] * np.broadcast_to(angle, inside.shape)[inside][:, None]).sum(axis=0)
    facing = np.clip(every @ (middle / np.linalg.norm(middle)), 0, None) * angle
    rest = float(((gathered.light @ luminance) * facing)[~inside].sum())
    value = (lux - rest) / float(facing[inside].sum())
    if value * float(facing[inside].sum()) <= region.illuminance:
        raise InputError(
            f"--sun {lux:g}: a card that faces longitude {region.longitude:.0f}, latitude "
            f"{region.latitude:.0f} gets {rest + region.illuminance:.4g} lx already by what the panorama "
            "shows: measure at the place of the camera, with the card square to the sun."
        )
    light, mask = gathered.light.copy(), gathered.mask.copy()
    light[inside], mask[inside] = np.float32(value), mask[inside] | RECOVERED
    return replace(gathered, light=light, mask=mask), replace(region, luminance=value)


def share_unseen(gathered: Map, towards: ClippedRegion) -> float:
    """Share, 0..1, of what falls on a card that faces a region from where no view looks, were all alike."""
    rows = len(gathered.mask)
    longitude, latitude = np.radians([towards.longitude, towards.latitude])
    ahead = np.array(
        [np.cos(latitude) * np.sin(longitude), np.sin(latitude), np.cos(latitude) * np.cos(longitude)]
    )
    facing = np.clip(directions(rows, 0, rows) @ ahead, 0, None) * solid_angles(rows)
    return float(facing[gathered.mask == NOTHING].sum() / facing.sum())
