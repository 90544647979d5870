"""An image sensor after EMVA 1288: photo-electrons in, digital numbers out.

`DN = clip(round(black + K iso_gain (bent(min(photo + dark, full well)) + read)), 0, ceiling)`: photo- and
dark electrons are Poisson, read noise Gaussian; photo-response and dark signal differ from photosite
to photosite in a fixed pattern; `bent(e) = e (1 - nonlinearity e / white electrons)`. This code stands
alone on purpose: it must not share a mistake with the noise model that calibration fits to its frames.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drivers.sim.seeds import generator
from imaging.arrays import Array, Floats
from imaging.sensor.cfa import Tile, repeated


@dataclass(frozen=True)
class SensorModel:
    """A kind of sensor.

    gain: K, DN per electron at ISO 100; read_noise: electrons; full_well: electrons;
    prnu: relative; dsnu: electrons; dark_current: electrons/s; hot_share: of all photosites;
    hot_current: electrons/s, median of the hot ones; row_noise: electrons, of whole rows;
    black: DN of the sites of a tile; bit_depth: of the DN, white is its largest; dark_spread: of the dark
    current over the photosites, natural log; dead_share: of photosites that see less than half of the
    light; ceiling: the largest DN that the converter gives, white when None; nonlinearity: share of the
    signal that is missing at white.
    """

    gain: float
    read_noise: float
    full_well: float
    black: Tile
    bit_depth: int
    prnu: float = 0.0
    dsnu: float = 0.0
    dark_current: float = 0.0
    hot_share: float = 0.0
    hot_current: float = 1000.0
    row_noise: float = 0.0
    dark_spread: float = 0.0
    dead_share: float = 0.0
    ceiling: int | None = None
    nonlinearity: float = 0.0

    @property
    def white(self) -> int:
        """The largest DN."""
        return (1 << self.bit_depth) - 1

    @property
    def white_electrons(self) -> float:
        """Electrons between black and white at ISO 100."""
        return (self.white - float(np.mean(self.black))) / self.gain


class SimulatedSensor:
    """One sensor of a model, with the fixed pattern that `purpose` (a seed and a serial) gives it."""

    def __init__(self, model: SensorModel, width: int, height: int, *purpose: object) -> None:
        self.model = model
        shape = (height, width)
        self.response: Array = 1.0 + model.prnu * generator(*purpose, "prnu").standard_normal(shape)
        self.offset: Array = model.dsnu * generator(*purpose, "dsnu").standard_normal(shape)
        self.dark_current: Array = np.full(shape, model.dark_current)
        if model.dark_spread > 0.0:
            self.dark_current *= np.exp(
                model.dark_spread * generator(*purpose, "dark").standard_normal(shape)
            )
        hot = generator(*purpose, "hot")
        self.hot = hot.random(shape) < model.hot_share
        self.dark_current[self.hot] = model.hot_current * np.exp(hot.standard_normal(int(self.hot.sum())))
        dead = generator(*purpose, "dead")
        self.dead = dead.random(shape) < model.dead_share
        self.response[self.dead] = dead.uniform(0.0, 0.5, int(self.dead.sum()))
        self._black: Array = repeated(np.array(model.black, np.float64), height, width)

    def expose(
        self,
        photo_electrons: Floats,
        time: float,
        iso_gain: float,
        noise: np.random.Generator,
    ) -> npt.NDArray[np.uint16]:
        """A frame, DN uint16 [H, W], from the mean photo-electrons [H, W] of the exposure.

        time: s, for the dark current; iso_gain: 1 at ISO 100; noise: where the frame's noise comes from.
        """
        model = self.model
        mean = np.asarray(photo_electrons, np.float64) * self.response + self.dark_current * time
        # Far above the full well the count does not matter, and Poisson cannot count without end.
        electrons = noise.poisson(np.clip(mean, 0.0, 10.0 * model.full_well)).astype(np.float64)
        electrons = np.minimum(electrons, model.full_well)
        if model.nonlinearity != 0.0:
            electrons *= 1.0 - model.nonlinearity * electrons / model.white_electrons
        electrons += self.offset + model.read_noise * noise.standard_normal(mean.shape)
        if model.row_noise > 0.0:
            electrons += model.row_noise * noise.standard_normal((mean.shape[0], 1))
        number = np.rint(self._black + model.gain * iso_gain * electrons)
        return np.clip(number, 0.0, model.white if model.ceiling is None else model.ceiling).astype(np.uint16)
