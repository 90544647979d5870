"""A machine vision camera on GigE Vision."""

from collections.abc import Sequence

from drivers.clock import Clock
from drivers.genicam.camera import GenicamCamera
from drivers.genicam.session import Session
from drivers.gige.actions import AHEAD, action_source, can_schedule, fire, heed, keeps_time
from drivers.gige.control import ControlChannel
from drivers.gige.network import Network
from drivers.gige.session import ActionTeam, GigeSession, open_session
from imaging.errors import CameraError
from imaging.optics.exposure import Exposure


class GigeCamera(GenicamCamera):
    """The camera with that serial number, at whatever address."""

    _no_pulse = "check that the camera that leads was triggered, and that its commands reach this one."

    def __init__(self, serial: str, network: Network, clock: Clock, address: str = "") -> None:
        """address: where it was discovered, if it was."""
        super().__init__(serial, lambda patience: open_session(serial, network, clock, patience), clock)
        self._address = address
        self._team: ActionTeam | None = None
        self._leads = self._synchronised = self._schedules = False

    @property
    def where(self) -> str:
        """Address by discovery, or of the open session; empty without either."""
        return super().where or (f"GigE {self._address}" if self._address else "")

    def join(self, team: ActionTeam, *, leads: bool) -> None:
        """Expose on action commands from now on, which the one that leads sends when it is triggered.

        CameraRefused if it knows none.
        """
        self._team, self._leads = team, leads
        try:
            source = self._again(lambda session: action_source(session.nodes, session.where))
            self.listen(source)
        except CameraError:
            self._team, self._leads = None, False
            raise

    def wait_for_time(self, seconds: float) -> bool:
        """Return whether it keeps the time of the team; waits for that, as cameras take a while to agree."""
        deadline = self._clock.now() + seconds
        while True:
            synchronised = self._again(self._note)
            if synchronised is not False or self._clock.now() >= deadline:
                return bool(synchronised)
            self._clock.sleep(0.05)

    def verified(self) -> str:
        """Cameras in software: no hardware yet."""
        return "the simulator; the fake cameras of Aravis and viva-genicam"

    def _set_up(self, session: Session) -> None:
        super()._set_up(session)
        if self._team is not None and self._wiring.listens_to is not None:
            heed(session.nodes, self._wiring.listens_to)
            self._schedules = can_schedule(_control(session))

    def _start(self, session: Session, expected: Sequence[Exposure]) -> None:
        super()._start(session, expected)
        if self._team is not None:
            self._note(session)

    def _note(self, session: Session) -> bool | None:
        """Report to the team this camera's address, and whether it shares the others' time; as
        `keeps_time`.
        """
        assert self._team is not None
        synchronised, control = keeps_time(session.nodes), _control(session)
        if synchronised and not self._schedules:
            synchronised = False
        if synchronised:
            reading = self._latched(session)
            synchronised = reading is not None and self._team.time.agrees(reading)
        self._synchronised = bool(synchronised)
        self._team.note(self.serial, control.address, synchronised=self._synchronised)
        return synchronised

    def _fire(self, session: Session) -> float:
        if self._team is None or not self._leads:
            return super()._fire(session)
        team, when = self._team, None
        if team.synchronised and (reading := self._latched(session)) is not None:
            when = reading.device + round(1e9 * AHEAD)
        fire(team.addresses, _control(session).host, when)
        return 0.0 if when is None else AHEAD

    def _moment(self, stamp: int, opened: float) -> float:
        return opened if self._team is None or not self._synchronised else self._team.time.on_host(stamp)


def _control(session: Session) -> ControlChannel:
    assert isinstance(session, GigeSession)
    return session.control


def find_cameras(network: Network, clock: Clock) -> list[GigeCamera]:
    """The cameras that answer, by address, one with several interfaces once; none is opened."""
    cameras: dict[tuple[str, str, str], GigeCamera] = {}
    for about in network.discover():
        camera = GigeCamera(about.serial, network, clock, about.address)
        cameras.setdefault((about.make, about.model, about.serial), camera)
    return list(cameras.values())
