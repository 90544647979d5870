"""A bracket that a body shoots by itself, from its release to the last frame."""

from contextlib import closing

from drivers.camera import CameraFile
from drivers.errors import CameraProtocol
from drivers.ptp.autobracket import Fit
from drivers.ptp.picture import as_told
from drivers.ptp.vendors.standard import StandardBody
from imaging.errors import InputError


def shoot(body: StandardBody, found: Fit, frames: list[CameraFile]) -> None:
    """Add the frames of a bracket as they come; in the end the body is set to single frames again.

    The body stands at the middle exposure and is ready. CameraErrors, after which it has to begin anew;
    what came before stays in `frames`.
    """
    bracket = found.bracket
    longest = found.middle.time * 2 ** (bracket.frames // 2 * bracket.thirds / 3)
    try:
        body.set_auto_bracket(bracket)
        with closing(body.shoot_bracket(bracket, 2 * longest)) as files:
            for file in files:
                try:
                    frames.append(as_told(body.fetch(file), file))
                except InputError as error:
                    raise CameraProtocol(f"{body.session.where} delivered a damaged file: {error}") from error
                body.discard(file)
    finally:
        body.set_auto_bracket(None)
