"""Names of the generated KRL program's variables, and the numbers it occupies (docs/reference/varproxy-channel.md)."""

PROGRAM = "CELLCTL_KVP"
VERSION = 1

FLAG_STOP = 413
TIMER = 20
INTERRUPT_STOP, INTERRUPT_SILENCE = 22, 23
"""Free on the controller: a flag, a timer and two interrupts."""

STOP = f"$FLAG[{FLAG_STOP}]"
SILENCE = f"$TIMER[{TIMER}]"
SILENCE_STOPPED = f"$TIMER_STOP[{TIMER}]"

SILENCE_MS = 1500
"""A move stops when this computer has not set the timer again for so long."""

MOST_ROWS = 500
BANKS = 3

JOB, JOB_KIND = "KV_JOB", "KV_JOB_T"
BANK_KIND, ROW_KIND = "KV_BANK_T", "KV_ROW_T"


def bank(number: int) -> str:
    """The head of a bank: id, check sum, number of rows."""
    return f"KV_BANK[{number}]"


def row(bank_number: int, number: int) -> str:
    """A row of a bank, from 1."""
    return f"KV_TAB[{bank_number},{number}]"
