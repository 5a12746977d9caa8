"""Files: strict YAML with positions, canonical JSON, atomic writes."""

from cellctl.files._strict_yaml import Document, Path, load_yaml, parse_yaml
from cellctl.files.problems import InputError, Problem, grouped
from cellctl.files.writing import canonical_json, is_stream, sha256_of, write_atomically

__all__ = [
    "Document",
    "InputError",
    "Path",
    "Problem",
    "canonical_json",
    "grouped",
    "is_stream",
    "load_yaml",
    "parse_yaml",
    "sha256_of",
    "write_atomically",
]
