"""`cellctl new`: a package of an extension, made of the example packages with the names replaced."""

import ast
import json
import tomllib

import pytest
from typer.testing import CliRunner

from cellctl.cli.verbs import app
from cellctl.files import InputError
from cellctl.operations.new_package import KINDS
from tests.helpers.examples import EXAMPLES


def cellctl(*words):
    """What a call prints. Raises its error."""
    return CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False).stdout


def made(kind, name, folder):
    """File → text of a new package."""
    told = json.loads(cellctl("new", kind, name, "-o", folder, "--json", "-"))
    files = {file.relative_to(folder).as_posix(): file.read_text() for file in folder.rglob("*") if file.is_file()}
    assert {f"{folder}/{file}" for file in files} == set(told["files"])
    return files


@pytest.mark.parametrize("kind", KINDS)
def test_every_entry_point_of_a_new_package_leads_to_an_object_of_a_file_that_it_has(kind, tmp_path):
    files = made(kind, "drop_height", tmp_path / "new")
    trees = {file: ast.parse(text) for file, text in files.items() if file.endswith(".py")}
    groups = tomllib.loads(files["pyproject.toml"])["project"]["entry-points"]
    values = [value for group in groups.values() for value in group.values()]
    assert values
    for module, _, name in (value.partition(":") for value in values):
        tree = trees[f"{module.replace('.', '/')}.py"]
        classes = {node.name for node in tree.body if isinstance(node, ast.ClassDef)}
        assert not name or f"\n{name} = " in files[f"{module.replace('.', '/')}.py"] or name in classes


@pytest.mark.parametrize("kind", KINDS)
def test_a_new_package_has_tests_and_no_name_of_its_example(kind, tmp_path):
    files = made(kind, "drop_gap", tmp_path / "new")
    assert [file for file in files if file.startswith("tests/test_")]
    text = "\n".join([*files, *files.values()])
    assert not [word for word in ("dial", "alibration_kit", "tool_heat", "ToolHeat", "damped") if word in text]
    assert "drop_gap" in text


def test_the_example_of_its_own_name_is_the_example(tmp_path):
    files = made("campaign", "dial_gauge", tmp_path / "new")
    assert files == {file: (EXAMPLES / "dial_gauge" / file).read_text() for file in files}


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("Laser", "cannot be the name"),
        ("class", "cannot be the name"),
        ("../x", "cannot be the name"),
        ("json", "installed package"),
        ("sims", "installed package"),
        ("sphere", "'sphere' is taken in cellctl.steps"),
    ],
)
def test_a_name_that_would_not_work_is_refused_before_anything_is_written(name, why, tmp_path):
    with pytest.raises(InputError, match=why):
        cellctl("new", "campaign", name, "-o", tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_what_is_there_is_not_written_over(tmp_path):
    (tmp_path / "mine.py").touch()
    with pytest.raises(InputError, match="give -o a new or empty folder"):
        cellctl("new", "effect", "my_effect", "-o", tmp_path)
