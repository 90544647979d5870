"""The memory of the simulated GigE Vision camera: bootstrap registers, XML, features."""

import socket
from collections.abc import Container

from drivers.camera import CameraIdentity
from drivers.gige.registers import CAN_RESEND, CAN_SCHEDULE, CONTROL, URL_SIZE, Bootstrap
from drivers.sim.genicam import xml
from drivers.sim.genicam.acquisition import ACTION
from drivers.sim.genicam.description import Transport, zipped
from drivers.sim.genicam.feature_registers import Feature
from drivers.sim.genicam.memory import XML, FeatureMemory
from drivers.sim.genicam.quirks import Quirk, in_folder

HEARTBEAT = 3000
"""ms without a word from the host after which it is let go."""
TICKS = 1_000_000_000
PACKET_SIZES = (576, 16000)
_CAN_WRITE_MEMORY, _CAN_ACT, _HAS_SERIAL = 1 << 1, 1 << 6, 1 << 30
_WRITABLE = (
    Bootstrap.HEARTBEAT_TIMEOUT,
    Bootstrap.TIMESTAMP_CONTROL,
    Bootstrap.CONTROL_PRIVILEGE,
    Bootstrap.STREAM_PORT,
    Bootstrap.STREAM_PACKET_SIZE,
    Bootstrap.STREAM_PACKET_DELAY,
    Bootstrap.STREAM_DESTINATION,
    Bootstrap.ACTION_DEVICE_KEY,
    Bootstrap.ACTION_GROUP_KEY,
    Bootstrap.ACTION_GROUP_MASK,
)
STATUSES = (
    *("Initializing", "Faulty", "Disabled", "Listening", "PreMaster"),
    *("Master", "Passive", "Uncalibrated", "Slave"),
)
"""PtpStatus, by number from 0."""


def _whole(name: str, address: int) -> str:
    return xml.integer(name, address, 0, 0xFFFFFFFF)


GIGE = Transport(
    "GEV",
    "big",
    ((Bootstrap.MANUFACTURER, 32), (Bootstrap.MODEL, 32), (Bootstrap.SERIAL, 16)),
    (Bootstrap.TIMESTAMP_CONTROL, 2),
    Bootstrap.TIMESTAMP,
    sources={"Action0": ACTION},
    categories={
        "ActionControl": ("ActionDeviceKey", "ActionSelector", "ActionGroupKey", "ActionGroupMask"),
        "PtpControl": ("PtpEnable", "PtpStatus"),
        "GigEVision": (
            *("GevSCPHostPort", "GevSCPSPacketSize", "GevSCPD", "GevSCDA"),
            *("GevHeartbeatTimeout", "GevTimestampTickFrequency"),
        ),
    },
    parts=(
        _whole("ActionDeviceKey", Bootstrap.ACTION_DEVICE_KEY),
        '<Integer Name="ActionSelector"><Value>0</Value><Min>0</Min><Max>0</Max></Integer>',
        _whole("ActionGroupKey", Bootstrap.ACTION_GROUP_KEY),
        _whole("ActionGroupMask", Bootstrap.ACTION_GROUP_MASK),
        xml.boolean("PtpEnable", Feature.PTP_ENABLE),
        '<Enumeration Name="PtpStatus">'
        + "".join(
            f'<EnumEntry Name="{name}"><Value>{number}</Value></EnumEntry>'
            for number, name in enumerate(STATUSES)
        )
        + "<pValue>PtpStatusReg</pValue></Enumeration>",
        xml.register("IntReg", "PtpStatusReg", Feature.PTP_STATUS, access="RO"),
        xml.integer("GevSCPHostPort", Bootstrap.STREAM_PORT, 0, 0xFFFF),
        '<Integer Name="GevSCPSPacketSize"><pValue>GevSCPSPacketSizeReg</pValue>'
        f"<Min>{PACKET_SIZES[0]}</Min><Max>{PACKET_SIZES[1]}</Max><Inc>4</Inc></Integer>"
        f'<MaskedIntReg Name="GevSCPSPacketSizeReg"><Address>{Bootstrap.STREAM_PACKET_SIZE:#x}</Address>'
        "<Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable>"
        # Bits are counted from the highest where registers are big endian.
        "<LSB>31</LSB><MSB>16</MSB><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></MaskedIntReg>",
        _whole("GevSCPD", Bootstrap.STREAM_PACKET_DELAY),
        _whole("GevSCDA", Bootstrap.STREAM_DESTINATION),
        xml.integer("GevHeartbeatTimeout", Bootstrap.HEARTBEAT_TIMEOUT, 500, 60_000),
        '<Integer Name="GevTimestampTickFrequency"><pValue>TickFrequencyReg</pValue></Integer>',
        xml.register("IntReg", "TickFrequencyReg", Bootstrap.TICK_FREQUENCY, length=8, access="RO"),
    ),
)
"""Features that its description has beyond one of USB3 Vision, in the names of SFNC."""


class GigeMemory(FeatureMemory):
    """Big endian, as GigE Vision is."""

    def __init__(
        self, identity: CameraIdentity, address: str, text: str, quirks: Container[Quirk] = ()
    ) -> None:
        """address: IPv4; text: the XML."""
        archive = zipped(text)
        if Quirk.FOLDER_FIRST in quirks:
            archive = in_folder(archive)
        writes = 0 if Quirk.NO_WRITE_MEMORY in quirks else _CAN_WRITE_MEMORY
        super().__init__({0: bytearray(0xA000)}, archive, _WRITABLE, "big")
        url = f"Local:simulated.zip;{XML:x};{len(archive):x}"
        assert len(url) < URL_SIZE
        for register, size, string in (
            (Bootstrap.MANUFACTURER, 32, identity.make),
            (Bootstrap.MODEL, 32, identity.model),
            (Bootstrap.DEVICE_VERSION, 32, "1"),
            (Bootstrap.SERIAL, 16, identity.serial),
            (Bootstrap.FIRST_URL, URL_SIZE, url),
        ):
            self.put_bytes(register, string.encode()[: size - 1])
        ip = int.from_bytes(socket.inet_aton(address), "big")
        # A locally administered one, of the address.
        self.put(Bootstrap.MAC_HIGH, 0x0200)
        for number, value in (
            (Bootstrap.VERSION, 0x00020000),
            (Bootstrap.MAC_LOW, ip),
            (Bootstrap.IP, ip),
            (Bootstrap.INTERFACES, 1),
            (Bootstrap.STREAMS, 1),
            (Bootstrap.ACTIONS, 1),
            (Bootstrap.CAPABILITY, writes | CAN_RESEND | CAN_SCHEDULE | _CAN_ACT | _HAS_SERIAL),
            (Bootstrap.HEARTBEAT_TIMEOUT, HEARTBEAT),
            (Bootstrap.STREAM_PACKET_SIZE, 1500),
        ):
            self.put(number, value)
        self.put(Bootstrap.TICK_FREQUENCY, TICKS, 8)

    @property
    def controlled(self) -> bool:
        """True while a host has control of it."""
        return bool(self.get(Bootstrap.CONTROL_PRIVILEGE) & (CONTROL | 1))

    @property
    def streams(self) -> bool:
        """True while it has a destination for frames."""
        return self.controlled and self.get(Bootstrap.STREAM_PORT) != 0

    @property
    def packet_size(self) -> int:
        """Bytes of a packet."""
        return self.get(Bootstrap.STREAM_PACKET_SIZE) & 0xFFFF

    @property
    def destination(self) -> tuple[str, int]:
        """Destination of frames."""
        return self.host, self.get(Bootstrap.STREAM_PORT) & 0xFFFF

    @property
    def host(self) -> str:
        """The address that frames go to."""
        return socket.inet_ntoa(self.read(Bootstrap.STREAM_DESTINATION, 4))
