"""A bracket that a body shoots by itself, from its release to the last frame."""

from collections.abc import Iterator, Sequence
from contextlib import closing

from drivers.camera import CameraFile
from drivers.errors import CameraProtocol
from drivers.ptp.autobracket import AutoBracket, Fit, best_fit
from drivers.ptp.exposure import dial_values
from drivers.ptp.picture import camera_file
from drivers.ptp.vendors.standard import StandardBody
from imaging.errors import InputError
from imaging.optics.exposure import Exposure


def fit_of(body: StandardBody, exposures: Sequence[Exposure]) -> Fit | None:
    """The bracket of a body that holds the most of the exposures; None if none holds enough of them."""
    offered = body.auto_brackets()
    return best_fit(exposures, offered, dial_values(body.time)) if offered else None


def stand(body: StandardBody, bracket: AutoBracket | None) -> None:
    """Set the bracket of the next release, None: a single frame; settings that already hold are not sent.

    CameraErrors, after which either may be set.
    """
    if body.standing != bracket:
        body.standing = body.standing or bracket
        body.set_auto_bracket(bracket)
        body.standing = bracket


def shoot(body: StandardBody, fit: Fit) -> Iterator[CameraFile]:
    """The frames of a bracket as they come; the body goes on exposing while they are fetched.

    The body stands at the middle exposure and is ready; it is left in the bracket's mode, since the next
    shot is mostly the same bracket. CameraErrors, after which it has to begin anew.
    """
    bracket = fit.bracket
    longest = fit.middle.time * 2 ** (bracket.frames // 2 * bracket.thirds / 3)
    stand(body, bracket)
    with closing(body.shoot_bracket(bracket, 2 * longest)) as files:
        for file in files:
            try:
                frame = camera_file(body.fetch(file), file)
            except InputError as error:
                raise CameraProtocol(f"{body.session.where} delivered a damaged file: {error}") from error
            body.discard(file)
            yield frame
