"""Registers of the features of a simulated machine vision camera."""

from enum import IntEnum

CHUNK_EXPOSURE, CHUNK_IMAGE = 0x1001, 0x1000
LINES = 3
"""Line0 is an input; Line1 and Line2 can be either."""
SETS = 8
"""Sets of the sequencer."""
THROUGHPUT = (1_000_000, 400_000_000)
"""Bytes per second that the link can be limited to; also the step."""


class Feature(IntEnum):
    """Addresses of the feature registers: 4 bytes each, times and black levels 8."""

    WIDTH = 0x10000
    HEIGHT = 0x10008
    OFFSET_X = 0x10010
    OFFSET_Y = 0x10018
    SENSOR_WIDTH = 0x10020
    SENSOR_HEIGHT = 0x10028
    PIXEL_FORMAT = 0x10030
    DYNAMIC_RANGE_MAX = 0x10038
    ACQUISITION_MODE = 0x10040
    ACQUISITION_START = 0x10048
    ACQUISITION_STOP = 0x10050
    FRAME_COUNT = 0x10058
    BURST_COUNT = 0x10060
    TRIGGER_SELECTOR = 0x10068
    TRIGGER_CONTROL = 0x10070
    """One for each trigger: bit 0 is the mode, bits 4 to 7 are the source, bit 8 is 1 for falling edges."""
    TRIGGER_SOFTWARE = 0x10080
    EXPOSURE_TIME = 0x10088
    GAIN = 0x10090
    """Thousandths of the linear gain."""
    BLACK_SELECTOR = 0x10098
    BLACK_LEVEL = 0x100A0
    """First of the black levels: for all, red, green, blue."""
    CHUNK_MODE = 0x100C0
    CHUNK_SELECTOR = 0x100C8
    CHUNK_ENABLE = 0x100D0
    THROUGHPUT_MODE = 0x100D8
    THROUGHPUT_LIMIT = 0x100E0
    SEQUENCER_MODE = 0x100E8
    SEQUENCER_CONFIGURATION = 0x100F0
    SET_SELECTOR = 0x100F8
    SET_SAVE = 0x10100
    SET_START = 0x10108
    SET_NEXT = 0x10110
    PATH_SELECTOR = 0x10118
    SEQUENCER_SOURCE = 0x10120
    LINE_SELECTOR = 0x10128
    LINE_CONTROL = 0x10130
    """One for each line: bit 0 is 1 for an output, bit 4 is 1 where that shows exposures."""
    PTP_ENABLE = 0x10140
    PTP_STATUS = 0x10148
    """Holds values of SFNC's PtpStatus."""
    GAMMA_ENABLE = 0x10150
    BALANCE_SELECTOR = 0x10158
    BALANCE_RATIO = 0x10160
    """Thousandths, of red and of blue."""
    TIME_LATCH = 0x10168
    """The four above are described by cameras with quirks alone."""


READ_ONLY = (Feature.SENSOR_WIDTH, Feature.SENSOR_HEIGHT, Feature.DYNAMIC_RANGE_MAX, Feature.PTP_STATUS)
