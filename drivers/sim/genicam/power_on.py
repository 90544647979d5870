"""Power-on state of a simulated machine vision camera."""

from collections.abc import Container, Mapping

from drivers.sim.camera import shutter
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.genicam import frames
from drivers.sim.genicam.description import Transport, describe
from drivers.sim.genicam.feature_registers import SETS, THROUGHPUT, Feature
from drivers.sim.genicam.memory import FeatureMemory
from drivers.sim.genicam.quirks import Quirk, altered
from drivers.sim.genicam.register_checks import Checks


def _formats(camera: SimulatedCamera) -> Mapping[str, int]:
    return frames.offered(camera.body.cfa, camera.body.sensor.bit_depth)


def _times() -> tuple[float, float]:
    times = [1e6 * time for time in shutter.APPLIED_TIME.values()]
    return min(times), max(times)


def description_of(camera: SimulatedCamera, transport: Transport, quirks: Container[Quirk] = ()) -> str:
    """GenICam XML."""
    lens = camera.body.optics.lens
    model, size = camera.identify().model, (lens.width, lens.height)
    plain = describe(model, size, _formats(camera), _times(), max(shutter.ISOS), transport)
    nodes = {
        "gamma": Feature.GAMMA_ENABLE,
        "balance selector": Feature.BALANCE_SELECTOR,
        "balance": Feature.BALANCE_RATIO,
        "time latch": Feature.TIME_LATCH,
    }
    order = f"{transport.order.title()}Endian"
    return altered(plain, quirks, nodes).replace("LittleEndian", order)


def checks_of(camera: SimulatedCamera) -> Checks:
    """Return what its registers take."""
    return Checks(frozenset(_formats(camera).values()), _times(), (1000, 10 * max(shutter.ISOS)))


def power_on(camera: SimulatedCamera, memory: FeatureMemory, quirks: Container[Quirk] = ()) -> None:
    """Set the features to what they are at first."""
    for index, ratio in enumerate((1600, 1300) if Quirk.GAMMA in quirks else (1000, 1000)):
        memory.put(Feature.BALANCE_RATIO + 4 * index, ratio)
    memory.put(Feature.GAMMA_ENABLE, int(Quirk.GAMMA in quirks))
    lens = camera.body.optics.lens
    for feature, value in {
        Feature.WIDTH: lens.width,
        Feature.HEIGHT: lens.height,
        Feature.SENSOR_WIDTH: lens.width,
        Feature.SENSOR_HEIGHT: lens.height,
        Feature.PIXEL_FORMAT: next(iter(_formats(camera).values())),
        Feature.FRAME_COUNT: 1,
        Feature.BURST_COUNT: 1,
        Feature.CHUNK_SELECTOR: 1,
        Feature.LINE_SELECTOR: 1,
        Feature.THROUGHPUT_LIMIT: THROUGHPUT[1],
        Feature.SET_NEXT: SETS - 1,
    }.items():
        memory.put(feature, value)
