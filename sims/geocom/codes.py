"""GeoCOM return codes that this instrument gives, from protocols.md 2.4 (GeoCOM Reference Manual)."""

from enum import IntEnum


class Code(IntEnum):
    """Of an RPC (`RC`), and from 3077 to 3110 of the transport (`RC_COM`)."""

    OK = 0
    IVPARAM = 2
    SYSBUSY = 13
    INSTRUMENT_TILT = 22
    NA = 27
    EDM_FLUKT = 776
    EDM_BUSY = 786
    EDM_DISTRANGE = 818
    EDM_DIST_TOO_SHORT = 829
    TMC_NO_FULL_CORRECTION = 1283
    TMC_ACCURACY_GUARANTEE = 1284
    TMC_ANGLE_OK = 1285
    TMC_ANGLE_NO_FULL_CORRECTION = 1288
    TMC_DIST_ERROR = 1292
    TMC_BUSY = 1293
    MOT_UNREADY = 1792
    MOT_BUSY = 1793
    COM_WRONG_FORMAT = 3078
    COM_PROC_UNAVAIL = 3081
    COM_OVERRUN = 3100
    COM_SRVR_RX_CHECKSUM_ERR = 3101
    COM_SRVR_IS_SLEEPING = 3108
    COM_SRVR_IS_OFF = 3109
    AUT_TIMEOUT = 8704
    AUT_NO_TARGET = 8710
    AUT_MULTIPLE_TARGETS = 8711
    AUT_NOT_ENABLED = 8714
    AUT_NO_WORKING_AREA = 8720
    AUT_NO_LOCK = 8725


CARRY_DATA = frozenset(
    {
        Code.OK,
        Code.TMC_NO_FULL_CORRECTION,
        Code.TMC_ACCURACY_GUARANTEE,
        Code.TMC_ANGLE_OK,
        Code.TMC_ANGLE_NO_FULL_CORRECTION,
    }
)
"""The codes whose reply has parameters; every other reply ends with its code."""
