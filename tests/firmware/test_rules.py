"""The table of rules in README.md is that of the tests."""

from tests.firmware import test_conformance, test_faults
from tests.firmware.rules import README, with_table

MODULES = (test_conformance, test_faults)


def test_the_table_of_rules_is_that_of_the_tests():
    text = README.read_text(encoding="utf-8")
    assert with_table(text, *MODULES) == text, "write it by `python -m tests.firmware.write_rules`"


def test_every_test_of_conformance_and_faults_names_its_rule():
    tests = [test for module in MODULES for name, test in vars(module).items() if name.startswith("test_")]
    assert len(tests) > 40
    assert [test.__name__ for test in tests if not getattr(test, "rule", "")] == []
