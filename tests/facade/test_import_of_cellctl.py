"""`import cellctl` is light; its names are typed and are all that is public."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import cellctl

PACKAGE = Path(cellctl.__file__).parent


def test_import_loads_neither_numpy_nor_the_mathematics():
    program = (
        "import sys, cellctl; print([n for n in sys.modules if n.split('.')[0] in ('numpy', 'pydantic', 'pandas')])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_public_name_is_there_and_has_a_type():
    for name in cellctl.__all__:
        assert getattr(cellctl, name) is not None
        assert name in dir(cellctl)
    stub = ast.parse((PACKAGE / "__init__.pyi").read_text())
    typed = {alias.asname for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    typed |= {node.target.id for node in stub.body if isinstance(node, ast.AnnAssign)}
    assert typed == set(cellctl.__all__)
    assert (PACKAGE / "py.typed").exists()


def test_the_page_names_every_public_name():
    page = (PACKAGE.parent / "docs" / "python.md").read_text()
    assert [name for name in cellctl.__all__ if name not in page] == []


def test_another_name_is_no_attribute():
    with pytest.raises(AttributeError, match="'fitt'"):
        cellctl.fitt  # noqa: B018
