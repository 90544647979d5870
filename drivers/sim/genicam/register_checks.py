"""Validation of register writes in the simulated machine vision camera: only what its description allows."""

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.sim.genicam.feature_registers import LINES, SETS, THROUGHPUT, Feature
from drivers.sim.genicam.memory import Denied, FeatureMemory, width
from drivers.u3v.gencp import Status

Range = tuple[float, float]
_ANY: Range = (0, 0xFFFFFFFF)
_SWITCH: Range = (0, 1)
_RANGES: Mapping[Feature, Range] = {
    Feature.ACQUISITION_MODE: (0, 2),
    Feature.FRAME_COUNT: (1, 65535),
    Feature.BURST_COUNT: (1, 255),
    Feature.TRIGGER_SELECTOR: _SWITCH,
    Feature.BLACK_SELECTOR: (0, 3),
    Feature.CHUNK_MODE: _SWITCH,
    Feature.CHUNK_SELECTOR: (1, 1),
    Feature.CHUNK_ENABLE: _SWITCH,
    Feature.THROUGHPUT_MODE: _SWITCH,
    Feature.THROUGHPUT_LIMIT: THROUGHPUT,
    Feature.SEQUENCER_MODE: _SWITCH,
    Feature.SEQUENCER_CONFIGURATION: _SWITCH,
    Feature.SET_SELECTOR: (0, SETS - 1),
    Feature.SET_START: (0, SETS - 1),
    Feature.SET_NEXT: (0, SETS - 1),
    Feature.PATH_SELECTOR: (0, 0),
    Feature.SEQUENCER_SOURCE: _SWITCH,
    Feature.LINE_SELECTOR: (0, LINES - 1),
    Feature.PTP_ENABLE: _SWITCH,
    Feature.GAMMA_ENABLE: _SWITCH,
    Feature.BALANCE_SELECTOR: _SWITCH,
    Feature.BALANCE_RATIO: (250, 4000),
}
_ROOM = {
    Feature.WIDTH: (1, Feature.SENSOR_WIDTH, Feature.OFFSET_X),
    Feature.HEIGHT: (1, Feature.SENSOR_HEIGHT, Feature.OFFSET_Y),
    Feature.OFFSET_X: (0, Feature.SENSOR_WIDTH, Feature.WIDTH),
    Feature.OFFSET_Y: (0, Feature.SENSOR_HEIGHT, Feature.HEIGHT),
}
"""The least value, and the registers whose difference is the largest."""


@dataclass(frozen=True)
class Checks:
    """Camera-specific limits. formats: codes; times: us; gains: thousandths, linear."""

    formats: frozenset[int]
    times: Range
    gains: Range

    def check(self, memory: FeatureMemory, address: int, data: bytes) -> None:
        """Denied unless the host may write that to a register."""
        if address not in tuple(Feature) or len(data) != width(address):
            return  # the memory itself refuses what is no register
        register = Feature(address)
        value: float = int.from_bytes(data, memory.order)
        if register is Feature.PIXEL_FORMAT:
            fits = value in self.formats
        else:
            if register is Feature.EXPOSURE_TIME:
                value = memory.float_of(data)
            low, high = self._range(memory, register)
            fits = low <= value <= high
        if not fits:
            raise Denied(Status.BAD_PARAMETER)

    def _range(self, memory: FeatureMemory, register: Feature) -> Range:
        if register in _ROOM:
            least, whole, other = _ROOM[register]
            return least, memory.get(whole) - memory.get(other)
        limits = {Feature.EXPOSURE_TIME: self.times, Feature.GAIN: self.gains}
        return limits.get(register) or _RANGES.get(register, _ANY)
