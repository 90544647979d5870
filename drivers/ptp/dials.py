"""The dials of a still camera together: where they were set, and where its pictures prove them to stand."""

from collections.abc import Callable
from dataclasses import dataclass, field

from drivers.ptp.exposure import SAME, Dial, DialChoice, apart
from drivers.ptp.vendors.standard import StandardBody
from imaging.optics.exposure import Exposure


@dataclass(frozen=True)
class Setting:
    """Dial positions that were set. asked: the requested value of each property."""

    choices: list[tuple[Dial, DialChoice]] = field(default_factory=list)
    asked: dict[int, float] = field(default_factory=dict)


class Dials:
    """Exposure settings, written as rarely as the pictures allow.

    setting: the last. confirmed: whether the file last looked at was exposed as the camera had read back, by
    its own metadata. certain: whether what was last set has one meaning, or a file has shown which one it is.
    """

    def __init__(self) -> None:
        self.setting = Setting()
        self._proven: dict[tuple[int, float], DialChoice] = {}
        """Proven dial positions by property and requested value: those that the last picture shows."""
        self.confirmed = self.certain = False

    def forget(self) -> None:
        """Believe no picture: the camera was away."""
        self._proven = {}

    def set(
        self, body: StandardBody, exposure: Exposure, sleep: Callable[[float], None], *, afresh: bool
    ) -> Exposure:
        """Set the nearest exposure that the camera lists and return what it reads back.

        afresh: also dials that the last picture proves to stand right.
        """
        assert body.time is not None
        wanted = [
            (dial, value)
            for dial, value in (
                (body.f_number, exposure.f_number),
                (body.iso, exposure.iso),
                (body.time, exposure.time),
            )
            if dial is not None and value is not None
        ]
        asked = {dial.code: value for dial, value in wanted}
        # A dial is left alone if the last picture proves that it stands right: less to go wrong.
        stands = {} if afresh else self._proven
        self._proven = {key: choice for key, choice in stands.items() if asked.get(key[0]) == key[1]}
        self.setting = Setting(self.setting.choices, asked)  # until all are set: who was asked may have moved
        choices = [
            (dial, self._proven.get((dial.code, value)) or dial.set(value, sleep)) for dial, value in wanted
        ]
        self.setting = Setting(choices, asked)
        self.certain = all(choice.certain for _, choice in choices)
        at = {dial.code: choice.value for dial, choice in choices}
        return Exposure(time=at[body.time.code], f_number=_at(at, body.f_number), iso=_at(at, body.iso))

    def learn(self, body: StandardBody, stated: Exposure | None, setting: Setting) -> None:
        """Hold what a file says of its exposure against how the camera was set for it, and learn from it.

        Of dials of a `body` that was lost since then nothing is learned: it may have come back otherwise.
        """
        self._proven = {}
        self.confirmed = stated is not None
        if stated is None:
            return
        pairs = ((body.time, stated.time), (body.f_number, stated.f_number), (body.iso, stated.iso))
        values = {id(dial): value for dial, value in pairs if value is not None}
        for dial, choice in setting.choices:
            value = values.get(id(dial))
            if value is None:
                continue
            dial.learn(choice, value)
            agrees = apart(choice.value, value) <= SAME
            self.confirmed &= agrees
            # The dial may have been turned since, for the next shot.
            wanted = setting.asked[dial.code]
            if agrees and choice.certain and self.setting.asked.get(dial.code) == wanted:
                self._proven[dial.code, wanted] = choice
        self.certain = self.certain or self.confirmed


def _at(values: dict[int, float], dial: Dial | None) -> float | None:
    return None if dial is None else values.get(dial.code)
