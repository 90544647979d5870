"""Colour of an EXR, against OpenColorIO, and the precedence of contradicting statements."""

import numpy as np
import PyOpenColorIO as ocio
import pytest

from imaging.colour.spaces import PRIMARIES
from imaging.errors import InputError
from imaging.files.tags.exr_colour import colour_of

LIGHT = np.array([[0.18, 0.18, 0.18], [4.0, 0.5, 0.01], [0.02, 0.9, 3.0], [0.3, 0.1, 40.0]], np.float32)


def chromaticities(name: str) -> tuple[float, ...]:
    return tuple(part for point in PRIMARIES[name] for part in point)


def as_rec709(attributes: dict[str, object]) -> np.ndarray:
    matrix = colour_of(attributes).matrix
    return LIGHT if matrix is None else LIGHT @ matrix.T


@pytest.mark.parametrize(
    "space",
    [
        "lin_rec709_scene",
        "lin_ap0_scene",
        "lin_ap1_scene",
        "lin_rec2020_scene",
        "lin_p3d65_scene",
        "lin_adobergb_scene",
        "lin_ciexyzd65_scene",
    ],
)
def test_light_is_converted_as_opencolorio_does(space: str) -> None:
    config = ocio.Config.CreateFromBuiltinConfig("studio-config-latest")
    expected = LIGHT.copy()
    config.getProcessor(space, "lin_rec709_scene").getDefaultCPUProcessor().applyRGB(expected)
    for name in (space, f"studio:{space}"):
        np.testing.assert_allclose(as_rec709({"colorInteropID": name}), expected, rtol=1e-3, atol=1e-3)
        assert not colour_of({"colorInteropID": name}).doubt


def test_the_id_counts_before_chromaticities_and_the_aces_flag_before_both() -> None:
    wide = as_rec709({"colorInteropID": "lin_ap1_scene"})
    both = {"colorInteropID": "lin_ap1_scene", "chromaticities": chromaticities("rec709")}
    assert np.array_equal(as_rec709(both), wide)
    assert colour_of(both).doubt == (
        "chromaticities contradict the colorInteropID lin_ap1_scene, which counts."
    )
    assert not colour_of(both | {"chromaticities": chromaticities("ap1")}).doubt
    container = both | {"acesImageContainerFlag": 1.0}
    assert np.array_equal(as_rec709(container), as_rec709({"colorInteropID": "lin_ap0_scene"}))
    assert "ACES container" in colour_of(container).doubt
    assert not colour_of({"acesImageContainerFlag": 1.0, "colorInteropID": "lin_ap0_scene"}).doubt


@pytest.mark.parametrize("stated", ["unknown", "studio:its-own", "show:studio:lin_ap1_scene"])
def test_an_id_that_says_nothing_leaves_it_to_the_chromaticities(stated: str) -> None:
    colour = colour_of({"colorInteropID": stated, "chromaticities": chromaticities("ap1")})
    assert colour.matrix == pytest.approx(colour_of({"colorInteropID": "lin_ap1_scene"}).matrix)
    alone = colour_of({"colorInteropID": stated})
    assert alone.matrix is None
    for one in (colour, alone):
        assert (one.doubt == "") == (stated == "unknown")


def test_what_is_no_linear_light_is_refused() -> None:
    with pytest.raises(InputError, match="are data, not light"):
        colour_of({"colorInteropID": "data"})
    for stated in ("srgb_rec709_scene", "ocio:g24_rec709_display"):
        with pytest.raises(InputError, match="is not linear"):
            colour_of({"colorInteropID": stated})
