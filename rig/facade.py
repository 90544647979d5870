"""Functions of `import rig` that no single stage has."""

from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from os import PathLike
from typing import TYPE_CHECKING, Any

from imaging.arguments import checked
from imaging.errors import InputError
from imaging.progress import Progress, unreported

if TYPE_CHECKING:
    from drivers.discovery import ConnectedCamera
    from recon.decide.cost.budget import Budget
    from recon.decide.overrides import Overrides
    from recon.decide.request import TrainingRequest
    from recon.result.scene import Scene


@checked
def find_cameras(
    simulated: str | None = None, *, addresses: Sequence[str] = (), on_progress: Progress = unreported
) -> "list[ConnectedCamera]":
    """Find every connected camera, with its identity and capabilities; none is left open.

    Args:
        simulated: Name of a simulated rig, such as "demo", whose cameras are found instead.
        addresses: Cameras that no search finds, such as "ptpip:192.168.1.2" or, of GigE Vision,
            "192.168.1.20".
        on_progress: Callback for the current step, the steps done, and all of them.

    Returns:
        One entry for each camera, also for those that do not answer.

    Raises:
        InputError: The rig is unknown, an address is invalid, or USB cannot be used on this machine.
    """
    from capture.rigfile.network_address import address_of, ptpip_places
    from drivers.discovery import ask_all
    from rig.cameras.usb_bus import open_bus, open_network

    try:
        named = [address_of(text if ":" in text else f"gige:{text}") for text in addresses]
    except ValueError as error:
        raise InputError(f"addresses has to be made of {error}.") from None
    bus = open_bus(simulated)
    network = open_network(simulated, named)
    places = [] if simulated else ptpip_places(named)
    return list(ask_all(bus.backend, bus.clock, on_progress, network=network, places=places))


def reconstruct(
    session: str | PathLike[str],
    request: "TrainingRequest | None" = None,
    *,
    budget: "Budget | float | str | None" = None,
    settings: Mapping[str, object] | None = None,
    on_progress: Progress = unreported,
    on_message: Callable[[str], None] = lambda line: None,
    on_log: Callable[[dict[str, Any]], None] = lambda line: None,
    **options: object,
) -> "Scene":
    """Train a scene on a calibrated session, keep it in SESSION/reconstructions/NAME, and open it.

    A finished scene is opened as it is, and a stopped one is continued. Ctrl-C saves the scene trained so
    far, and raises KeyboardInterrupt. `recon.reconstruct.reconstruct` has the details.

    Args:
        session: Session, or its folder.
        request: Options.
        budget: Budget in place of that of `request`: seconds, or text as on the command line (`5m`, `30MB`,
            `100k`, `35dB`).
        settings: Overrides in place of those of `request`, by the keys of `rig reconstruct --set`, such as
            {"iterations": 500}.
        on_progress: Callback for the current step, the steps done, and all of them.
        on_message: Callback for lines on predictions and skipped steps.
        on_log: Callback for the numbers of train.jsonl.
        options: Further options by name, in place of those of `request`.

    Returns:
        The scene.

    Raises:
        ReconstructionError: The session cannot be trained.
        InputError: A setting is invalid, or the scene exists with other settings.
        StorageError: The disk refuses.
    """
    from recon.decide.request import TrainingRequest
    from recon.reconstruct import reconstruct as train
    from recon.result.scene import open_scene

    if budget is not None:
        options["budget"] = _budget(budget)
    if settings is not None:
        options["overrides"] = _overrides(settings)
    asked = TrainingRequest.of(request, options)
    return open_scene(train(session, asked, on_progress=on_progress, on_message=on_message, on_log=on_log))


def _budget(budget: object) -> "Budget | None":
    """InputError for a value of a wrong type, or text that states no budget."""
    from recon.decide.cost.budget import Budget

    if isinstance(budget, bool) or not isinstance(budget, Budget | Real | str):
        raise InputError(
            f"reconstruct cannot take {budget!r:.60} for budget: give it seconds, or text such as '5m'."
        )
    return Budget.of(float(budget) if isinstance(budget, Real) else budget)


def _overrides(settings: object) -> "Overrides":
    """InputError for no mapping, a key that does not exist, or a value that is not possible."""
    from pydantic import ValidationError

    from recon.decide.overrides import Overrides

    if not isinstance(settings, Mapping):
        raise InputError(
            f"reconstruct cannot take {settings!r:.60} for settings: give it a mapping such as "
            '{"iterations": 500}.'
        )
    if unknown := sorted(map(str, settings.keys() - Overrides.model_fields.keys())):
        raise InputError(f"settings has no {unknown[0]!r}: it takes {', '.join(Overrides.model_fields)}.")
    try:
        return Overrides.model_validate(dict(settings))
    except ValidationError as error:
        first = error.errors()[0]
        key, value = first["loc"][0], first["input"]
        raise InputError(f"settings: {key}={value!r} cannot be used: {first['msg'].lower()}.") from error
