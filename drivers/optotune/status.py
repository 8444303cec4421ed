"""Bits of the board's status."""

from enum import IntFlag


class MirrorStatus(IntFlag):
    """Bits of the answer to STATUS; ``WAS_`` bits stay until acknowledged."""

    HEAD_DISCONNECTED = 1 << 0
    HEAD_TEMPERATURE = 1 << 1
    MIRROR_TEMPERATURE = 1 << 2
    EEPROM_INVALID = 1 << 3
    NOT_STABLE = 1 << 4
    OUTPUT_LIMIT = 1 << 5
    AVERAGE_OUTPUT_LIMIT = 1 << 6
    TRIMMED = 1 << 7
    WAS_DISCONNECTED = 1 << 8
    WAS_HEAD_TEMPERATURE = 1 << 9
    WAS_MIRROR_TEMPERATURE = 1 << 10
    WAS_OUTPUT_LIMIT = 1 << 11
    WAS_AVERAGE_OUTPUT_LIMIT = 1 << 12
    WAS_TRIMMED = 1 << 13


#: The mirror cannot be trusted to point anywhere.
FAULTS = (
    MirrorStatus.HEAD_DISCONNECTED
    | MirrorStatus.HEAD_TEMPERATURE
    | MirrorStatus.MIRROR_TEMPERATURE
    | MirrorStatus.EEPROM_INVALID
)
#: It could not do what was asked, now or since it was last acknowledged; it may have been elsewhere.
OVERLOADS = (
    MirrorStatus.OUTPUT_LIMIT
    | MirrorStatus.AVERAGE_OUTPUT_LIMIT
    | MirrorStatus.WAS_OUTPUT_LIMIT
    | MirrorStatus.WAS_AVERAGE_OUTPUT_LIMIT
)
LATCHED = (
    MirrorStatus.WAS_DISCONNECTED
    | MirrorStatus.WAS_HEAD_TEMPERATURE
    | MirrorStatus.WAS_MIRROR_TEMPERATURE
    | MirrorStatus.WAS_OUTPUT_LIMIT
    | MirrorStatus.WAS_AVERAGE_OUTPUT_LIMIT
    | MirrorStatus.WAS_TRIMMED
)
