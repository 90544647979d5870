"""The numbers of PTP: operations, responses, events, properties, formats and data types.

Source: libgphoto2's ptp.h, which drives real cameras (ISO 15740 gives the standard ones the same values).
The vendors' codes overlap one another, so each vendor has enumerations of its own. A camera may send
numbers that stand in none of them: they stay plain integers.
"""

from enum import IntEnum

EVERY_STORAGE = 0xFFFFFFFF
"""GetObjectHandles: look in all storages."""
EVERY_FORMAT, EVERY_PARENT, ROOT_PARENT = 0, 0, 0xFFFFFFFF
"""GetObjectHandles: all formats; objects in all folders, or only those in none."""
UNKNOWN_LENGTH = 0xFFFFFFFF
"""A container, or an object, whose size does not fit or is not known."""


class Operation(IntEnum):
    """Operation codes."""

    GET_DEVICE_INFO = 0x1001
    OPEN_SESSION = 0x1002
    CLOSE_SESSION = 0x1003
    GET_STORAGE_IDS = 0x1004
    GET_STORAGE_INFO = 0x1005
    GET_NUM_OBJECTS = 0x1006
    GET_OBJECT_HANDLES = 0x1007
    GET_OBJECT_INFO = 0x1008
    GET_OBJECT = 0x1009
    GET_THUMB = 0x100A
    DELETE_OBJECT = 0x100B
    SEND_OBJECT_INFO = 0x100C
    SEND_OBJECT = 0x100D
    INITIATE_CAPTURE = 0x100E
    FORMAT_STORE = 0x100F
    RESET_DEVICE = 0x1010
    SELF_TEST = 0x1011
    POWER_DOWN = 0x1013
    GET_DEVICE_PROP_DESC = 0x1014
    GET_DEVICE_PROP_VALUE = 0x1015
    SET_DEVICE_PROP_VALUE = 0x1016
    RESET_DEVICE_PROP_VALUE = 0x1017
    TERMINATE_OPEN_CAPTURE = 0x1018
    GET_PARTIAL_OBJECT = 0x101B
    INITIATE_OPEN_CAPTURE = 0x101C


class CanonOperation(IntEnum):
    """Canon EOS."""

    REMOTE_RELEASE = 0x910F
    GET_PARTIAL_OBJECT = 0x9107
    SET_DEVICE_PROP_VALUE_EX = 0x9110
    SET_REMOTE_MODE = 0x9114
    SET_EVENT_MODE = 0x9115
    GET_EVENT = 0x9116
    TRANSFER_COMPLETE = 0x9117
    PC_HDD_CAPACITY = 0x911A
    KEEP_DEVICE_ON = 0x911D
    BULB_START = 0x9125
    BULB_END = 0x9126
    REMOTE_RELEASE_ON = 0x9128
    REMOTE_RELEASE_OFF = 0x9129
    GET_PARTIAL_OBJECT_64 = 0x9172


class NikonOperation(IntEnum):
    """Nikon."""

    INITIATE_CAPTURE_REC_IN_SDRAM = 0x90C0
    CHANGE_CAMERA_MODE = 0x90C2
    GET_EVENT = 0x90C7
    DEVICE_READY = 0x90C8
    GET_VENDOR_PROP_CODES = 0x90CA
    INITIATE_CAPTURE_REC_IN_MEDIA = 0x9207
    TERMINATE_CAPTURE = 0x920C


class SonyOperation(IntEnum):
    """Sony."""

    SDIO_CONNECT = 0x9201
    GET_EXT_DEVICE_INFO = 0x9202
    SET_CONTROL_A = 0x9205
    SET_CONTROL_B = 0x9207
    GET_ALL_EXT_DEVICE_PROP_INFO = 0x9209


class ResponseCode(IntEnum):
    """Response codes."""

    OK = 0x2001
    GENERAL_ERROR = 0x2002
    SESSION_NOT_OPEN = 0x2003
    INVALID_TRANSACTION_ID = 0x2004
    OPERATION_NOT_SUPPORTED = 0x2005
    PARAMETER_NOT_SUPPORTED = 0x2006
    INCOMPLETE_TRANSFER = 0x2007
    INVALID_STORAGE_ID = 0x2008
    INVALID_OBJECT_HANDLE = 0x2009
    DEVICE_PROP_NOT_SUPPORTED = 0x200A
    INVALID_OBJECT_FORMAT_CODE = 0x200B
    STORE_FULL = 0x200C
    ACCESS_DENIED = 0x200F
    STORE_NOT_AVAILABLE = 0x2013
    CAPTURE_ALREADY_TERMINATED = 0x2018
    DEVICE_BUSY = 0x2019
    INVALID_DEVICE_PROP_FORMAT = 0x201B
    INVALID_DEVICE_PROP_VALUE = 0x201C
    INVALID_PARAMETER = 0x201D
    SESSION_ALREADY_OPENED = 0x201E
    TRANSACTION_CANCELLED = 0x201F
    CHANGE_CAMERA_MODE_FAILED = 0xA003
    """Nikon's: of bodies that take orders all the same."""
    BULB_RELEASE_BUSY = 0xA200
    """Nikon's: the shutter is open for as long as somebody leaves it so."""
    SILENT_RELEASE_BUSY = 0xA201
    """Nikon's: said by bodies that are ready, and for ever."""


class EventCode(IntEnum):
    """Event codes."""

    CANCEL_TRANSACTION = 0x4001
    OBJECT_ADDED = 0x4002
    OBJECT_REMOVED = 0x4003
    STORE_ADDED = 0x4004
    STORE_REMOVED = 0x4005
    DEVICE_PROP_CHANGED = 0x4006
    DEVICE_INFO_CHANGED = 0x4008
    STORE_FULL = 0x400A
    DEVICE_RESET = 0x400B
    CAPTURE_COMPLETE = 0x400D
    UNREPORTED_STATUS = 0x400E


class CanonEvent(IntEnum):
    """Records of Canon's GetEvent."""

    OBJECT_ADDED_EX = 0xC181
    REQUEST_OBJECT_TRANSFER = 0xC186
    PROP_VALUE_CHANGED = 0xC189
    AVAILABLE_LIST_CHANGED = 0xC18A
    OBJECT_ADDED_EX_64 = 0xC1A7
    REQUEST_OBJECT_TRANSFER_64 = 0xC1A9
    OBJECT_ADDED_EX_64_LONG_NAME = 0xC1B6
    REQUEST_OBJECT_TRANSFER_64_LONG_NAME = 0xC1B8


class NikonEvent(IntEnum):
    """Nikon."""

    OBJECT_ADDED_IN_SDRAM = 0xC101
    CAPTURE_COMPLETE_REC_IN_SDRAM = 0xC102


class SonyEvent(IntEnum):
    """Sony."""

    OBJECT_ADDED = 0xC201


class PropertyCode(IntEnum):
    """Standard properties, and the units of those that have one."""

    BATTERY_LEVEL = 0x5001
    IMAGE_SIZE = 0x5003
    """String, as 6048x4024."""
    COMPRESSION_SETTING = 0x5004
    WHITE_BALANCE = 0x5005
    F_NUMBER = 0x5007
    """uint16, hundredths."""
    FOCAL_LENGTH = 0x5008
    """uint32, hundredths of a millimetre."""
    FOCUS_MODE = 0x500A
    """1 is manual."""
    EXPOSURE_TIME = 0x500D
    """uint32, 100 us; 0xFFFFFFFF is bulb."""
    EXPOSURE_PROGRAM_MODE = 0x500E
    """1 is manual."""
    EXPOSURE_INDEX = 0x500F
    """uint16, ISO; 0xFFFF is automatic."""
    EXPOSURE_BIAS = 0x5010
    """int16, thousandths of a stop."""
    DATE_TIME = 0x5011
    CAPTURE_DELAY = 0x5012
    """uint32, milliseconds."""
    STILL_CAPTURE_MODE = 0x5013
    """1 single, 2 burst; Sony has its brackets here too."""
    BURST_NUMBER = 0x5018


class CanonProperty(IntEnum):
    """Canon EOS."""

    APERTURE = 0xD101
    SHUTTER_SPEED = 0xD102
    ISO_SPEED = 0xD103
    DRIVE_MODE = 0xD106
    """0 single, 1 continuous."""
    AVAILABLE_SHOTS = 0xD11B
    CAPTURE_DESTINATION = 0xD11C
    IMAGE_FORMAT = 0xD120
    AEB = 0xD1D9
    """Eighths of a stop to either side, thirds rounded as those of the dials; 0 off."""


class NikonProperty(IntEnum):
    """Nikon."""

    ISO_EX = 0xD0B4
    BRACKET_SET = 0xD078
    """Quantity that a bracket varies: 1 is exposure alone."""
    MANUAL_BRACKET = 0xD079
    """Setting that it varies at manual exposure: 0 is time."""
    BRACKET_ENABLE = 0xD0C0
    BRACKET_STEP = 0xD0C1
    BRACKET_PROGRAM = 0xD0C2
    SHUTTER_SPEED = 0xD100
    RECORDING_MEDIA = 0xD10B


class SonyProperty(IntEnum):
    """Sony."""

    SHUTTER_SPEED = 0xD20D
    OBJECT_IN_MEMORY = 0xD215
    ISO = 0xD21E
    SAVE_DESTINATION = 0xD222
    SHUTTER_SPEED_MODE_2 = 0xD229
    FORMAT_MODE_2 = 0xD253
    HALF_PRESS = 0xD2C1
    FULL_PRESS = 0xD2C2


class FormatCode(IntEnum):
    """Object format; vendors name their RAW formats freely, so a file's name decides."""

    UNDEFINED = 0x3000
    ASSOCIATION = 0x3001
    EXIF_JPEG = 0x3801
    TIFF = 0x380D
    DNG = 0x3811
    VENDOR_RAW_1 = 0xB101
    """Canon CR2, Sony ARW."""
    VENDOR_RAW_2 = 0xB103
    """Canon CR2."""
    CANON_CR3 = 0xB108


class VendorId(IntEnum):
    """Vendor extension in DeviceInfo; some bodies state MICROSOFT or 0xFFFFFFFF whatever their maker."""

    MICROSOFT = 0x6
    NIKON = 0xA
    CANON = 0xB
    FUJI = 0xE
    SONY = 0x11


USB_VENDORS = {0x04B0: VendorId.NIKON, 0x04A9: VendorId.CANON, 0x054C: VendorId.SONY, 0x04CB: VendorId.FUJI}
"""The maker by USB vendor id, for bodies whose DeviceInfo does not say."""


class DataType(IntEnum):
    """The type of a property's value."""

    INT8 = 0x0001
    UINT8 = 0x0002
    INT16 = 0x0003
    UINT16 = 0x0004
    INT32 = 0x0005
    UINT32 = 0x0006
    INT64 = 0x0007
    UINT64 = 0x0008
    INT128 = 0x0009
    UINT128 = 0x000A
    ARRAY_INT8 = 0x4001
    ARRAY_UINT8 = 0x4002
    ARRAY_INT16 = 0x4003
    ARRAY_UINT16 = 0x4004
    ARRAY_INT32 = 0x4005
    ARRAY_UINT32 = 0x4006
    ARRAY_INT64 = 0x4007
    ARRAY_UINT64 = 0x4008
    ARRAY_INT128 = 0x4009
    ARRAY_UINT128 = 0x400A
    STRING = 0xFFFF

    @property
    def is_array(self) -> bool:
        """True for arrays of integers."""
        return self != DataType.STRING and bool(self & 0x4000)

    @property
    def item_size(self) -> int:
        """Bytes of an integer of it, or of one item of an array."""
        return 1 << (((self & 0xF) - 1) // 2)

    @property
    def is_signed(self) -> bool:
        """True for signed integers."""
        return bool(self & 1)
