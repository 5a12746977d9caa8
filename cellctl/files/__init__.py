"""Files: strict YAML with positions, canonical JSON, atomic writes."""

from cellctl.files.atomic import is_stream, write_atomically
from cellctl.files.canonical import canonical_json, sha256_of
from cellctl.files.problems import InputError, Problem
from cellctl.files.strict_yaml import Document, Path, load_yaml, parse_yaml

__all__ = [
    "Document",
    "InputError",
    "Path",
    "Problem",
    "canonical_json",
    "is_stream",
    "load_yaml",
    "parse_yaml",
    "sha256_of",
    "write_atomically",
]
