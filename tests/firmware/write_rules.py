"""Writes the table of rules into README.md."""

from tests.firmware import test_conformance, test_faults
from tests.firmware.rules import README, with_table

if __name__ == "__main__":
    README.write_text(with_table(README.read_text(encoding="utf-8"), test_conformance, test_faults), encoding="utf-8")
