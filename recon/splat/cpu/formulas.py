"""The formulas of the projection as Numba has them, on lanes; see `recon.splat.formulas`."""

from imaging.compute.jit import inlined
from recon.splat.cpu import lanes
from recon.splat.formulas import Language
from recon.splat.formulas.ellipse import ellipse_formulas
from recon.splat.formulas.lens import lens_formulas

_LANGUAGE = Language(
    function=inlined,
    index=int,
    number=float,
    root=lanes.root,
    minus=lanes.minus,
    minimum=lanes.minimum,
    maximum=lanes.maximum,
    above=lanes.above,
    at_least=lanes.at_least,
    both=lanes.both,
    choose=lanes.choose,
)

_LENS = lens_formulas(_LANGUAGE)
_ELLIPSE = ellipse_formulas(_LANGUAGE, _LENS)

radial, radial_by_terms, distort = _LENS.radial, _LENS.radial_by_terms, _LENS.distort
to_camera = _ELLIPSE.to_camera
rotation = _ELLIPSE.rotation
screen_axes = _ELLIPSE.screen_axes
root_covariance = _ELLIPSE.root_covariance
covariance = _ELLIPSE.covariance
ellipse_gradient = _ELLIPSE.ellipse_gradient
shape_gradient = _ELLIPSE.shape_gradient
axes_gradient = _ELLIPSE.axes_gradient
jacobian_gradient = _ELLIPSE.jacobian_gradient
point_gradient = _ELLIPSE.point_gradient
motion_gradient = _ELLIPSE.motion_gradient
lens_gradient = _ELLIPSE.lens_gradient
