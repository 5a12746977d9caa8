"""The pages' templates, all read in one way."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined, Template


def template(name: str) -> Template:
    """A page by its file's name: what is put into it is escaped, and a name that nobody filled in is an error."""
    return Environment(
        loader=PackageLoader("cellctl.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    ).get_template(name)
