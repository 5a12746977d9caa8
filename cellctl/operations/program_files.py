"""The files of a KRL program: the program, its data list beside it, and the controller's `$config.dat`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import final

from cellctl.files import InputError, Problem
from cellctl.krl import KrlFile


@final
@dataclass(frozen=True)
class ProgramFiles:
    """src: the program. dat: its data list, None where there is none beside it. config: None where it is not given."""

    src: Path
    dat: Path | None
    config: Path | None

    @classmethod
    def of(cls, src: Path, config: Path | None) -> ProgramFiles:
        """The data list is the file beside `src` with the same name and the suffix .dat, in any case. Raises InputError
        where `src` is not a program, or a file is not there.
        """
        if src.suffix.lower() != ".src":
            raise InputError(Problem(str(src), 0, 0, "is not a KRL program", "give the .src; its .dat is read too"))
        missing = [path for path in (src, config) if path is not None and not path.is_file()]
        if missing:
            raise InputError(Problem(str(path), 0, 0, "there is no such file") for path in missing)
        wanted = f"{src.stem}.dat".lower()
        beside = sorted(path for path in src.parent.iterdir() if path.name.lower() == wanted and path.is_file())
        if len(beside) > 1:
            names = ", ".join(path.name for path in beside)
            raise InputError(Problem(str(src), 0, 0, f"has several data lists: {names}", "leave one"))
        return cls(src, beside[0] if beside else None, config)

    @property
    def read(self) -> list[Path]:
        """All files that are read."""
        return [path for path in (self.src, self.dat, self.config) if path]

    def load(self) -> tuple[KrlFile, KrlFile | None, KrlFile | None]:
        """Program, data list and `$config.dat`. Raises OSError."""
        src, *others = (KrlFile.load(path) if path else None for path in (self.src, self.dat, self.config))
        assert src is not None
        return src, others[0], others[1]

    def outputs(self, out: Path) -> dict[str, Path]:
        """Where the changed files go, by part: into the folder `out`, or to the program `out` and its data list.

        Raises InputError where `out` is neither.
        """
        if out.is_dir():
            paths = {"src": out / self.src.name, "dat": out / (self.dat or self.src).name}
        elif out.suffix.lower() == ".src":
            paths = {"src": out, "dat": out.with_suffix(self.dat.suffix if self.dat else ".dat")}
        else:
            raise InputError(Problem("--out", 0, 0, f"{out} is neither a folder nor a .src file", "give one of these"))
        return paths if self.dat else {"src": paths["src"]}
