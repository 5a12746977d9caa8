"""The pages' templates, read with the same settings."""

from __future__ import annotations

from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, Template


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("cellctl.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def template(name: str) -> Template:
    """A page template by its file name: inserted values are escaped, and an undefined name is an error."""
    return _environment().get_template(name)


def template_of(text: str) -> Template:
    """A template from its text; it may include and import the files of this package."""
    return _environment().from_string(text)
