"""A view at a smaller width, made of the one in memory as it would be read from its files."""

from dataclasses import replace

from imaging.arrays import Array32
from recon.data.dataset import View
from recon.data.pixels import area_mean, narrowed

Falloffs = dict[tuple[int, int], tuple[Array32, Array32]]
"""Whole and smaller falloffs, by the id of the whole one and the smaller width: held once for all views that
have one in common."""


def narrower(view: View, width: int, falloffs: Falloffs) -> View:
    """The view at a width, px, averaged over areas in linear light; itself where it is no wider.

    A mosaic of at least twice the width is demosaicked for that, and any other stays as it is.
    """
    sensor, lens = view.sensor, view.lens
    pairs = (narrowed(shot, sensor.kind, sensor.cfa, sensor.response, width) for shot in view.shots)
    shots, cfas = zip(*pairs, strict=True)
    height, now = shots[0].shape[:2]
    if now == lens.width:
        return view
    if sensor.kind == "raw":  # the last of an odd number of rows and columns is in no pair
        lens = replace(lens, width=lens.width // 2 * 2, height=lens.height // 2 * 2)
    place = id(sensor.falloff), width
    if place not in falloffs:
        smaller = area_mean(sensor.falloff[: lens.height, : lens.width], (now, height))
        falloffs[place] = sensor.falloff, smaller
    sensor = replace(sensor, cfa=cfas[0], falloff=falloffs[place][1])
    return replace(view, lens=lens.resized(now), sensor=sensor, shots=shots)
