"""The robot file, as far as the simulated robot needs it, and where the shipped ones are."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import entry_points
from importlib.util import find_spec
from math import cos, radians, sin
from pathlib import Path
from typing import final

from sims.section import Section

Triple = tuple[float, float, float]

CAMPAIGNS = "cellctl.campaigns"
"""The entry point group: the packages whose folder `robots` has the shipped files register in it."""

HAYATI = "mdh-hayati"
"""T = Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)."""
CRAIG = "dh-craig"
"""T = Rx(alpha) Tx(a) Ry(beta) Rz(theta) Tz(d)."""
POE = "poe"
"""By the joints' axes at model zero, and the flange's place there."""


_WORDS: dict[str, Triple] = {"floor": (0.0, 0.0, 0.0), "wall": (0.0, 90.0, 0.0), "ceiling": (0.0, 180.0, 0.0)}
"""Ways to mount a robot, as A, B, C, deg; on a wall its X points down."""


@final
@dataclass(frozen=True, slots=True)
class Link:
    """One row of the geometry, mm and deg; which way round it is read, the convention says."""

    theta: float
    d: float
    a: float
    alpha: float
    beta: float


@final
@dataclass(frozen=True, slots=True)
class Screw:
    """A joint's axis at model zero, in the robot's base: a direction of any length but 0, and a point on it, mm."""

    axis: Triple
    point: Triple


@final
@dataclass(frozen=True, slots=True)
class Joint:
    """Controller reading → model angle: sign · reading + offset (deg); limits of the reading, deg; deg/s."""

    sign: int
    offset: float
    min: float
    max: float
    max_speed: float


@final
@dataclass(frozen=True, slots=True)
class Frame:
    """A place (mm) and KUKA angles A, B, C (deg): Rz(A) Ry(B) Rx(C)."""

    xyz: Triple
    abc: Triple


@final
@dataclass(frozen=True, slots=True)
class Tool:
    """The taught tool in the flange frame, and its mass in kg."""

    xyz: Triple
    abc: Triple
    mass: float


@final
@dataclass(frozen=True, slots=True)
class RobotFile:
    """Nominal geometry of a robot; `repeatability` is 1 σ, 3-D, mm. `convention`: `HAYATI` or `CRAIG`, with `links`, or
    `POE`, with `screws` and `home`, the flange's place at model zero.

    `down`: which way weight pulls, a unit vector in the frame that `base` is given in.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    base: Frame
    tool: Tool
    repeatability: float
    convention: str = HAYATI
    down: Triple = (0.0, 0.0, -1.0)
    screws: tuple[Screw, ...] = ()
    home: Frame = Frame((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def read_robot(section: Section) -> RobotFile:
    """The robot of a robot file; errors are noted in the section's problems."""
    convention = section.word("convention", among=[HAYATI, CRAIG, POE])
    by_axes = convention == POE
    links = tuple(_link(link) for link in section.each("links", required=not by_axes))
    screws = tuple(_screw(screw) for screw in section.each("screws", required=by_axes))
    joints = tuple(_joint(joint) for joint in section.each("joints", required=True))
    if len(screws if by_axes else links) != len(joints):
        rows = f"{len(screws)} screws" if by_axes else f"{len(links)} links"
        section.note("joints", f"{len(joints)} joints for {rows}")
    base, tool, home = section.below("base"), section.below("tool"), section.below("home", required=by_axes)
    zero = (0.0, 0.0, 0.0)
    return RobotFile(
        name=section.word("name"),
        links=links,
        joints=joints,
        base=Frame(base.triple("xyz", zero), base.triple("abc", zero)),
        tool=Tool(tool.triple("xyz", zero), tool.triple("abc", zero), tool.number("mass", 0.0, 0.0)),
        repeatability=section.number("repeatability", 0.0, 0.0),
        convention=convention,
        down=_down(section),
        screws=screws,
        home=Frame(home.triple("xyz", zero), home.triple("abc", zero)),
    )


def _down(section: Section) -> Triple:
    """−z of a level world, as a robot sees it that stands as `mounting` says: a word, or its tilt A, B, C (deg)."""
    tilted = isinstance(section.entries.get("mounting"), dict)
    tilt = section.below("mounting").triple("tilt") if tilted else _WORDS[_mounting(section)]
    b, c = radians(tilt[1]), radians(tilt[2])
    return sin(b), -cos(b) * sin(c), -cos(b) * cos(c)


def _mounting(section: Section) -> str:
    return section.word("mounting", "floor", among=_WORDS) or "floor"


def _link(link: Section) -> Link:
    return Link(*(link.number(key, 0.0) for key in ("theta", "d", "a", "alpha", "beta")))


def _screw(screw: Section) -> Screw:
    axis = screw.triple("axis")
    if not any(axis):
        screw.note("axis", "a direction is expected, not all 0")
    return Screw(axis, screw.triple("point"))


def _joint(joint: Section) -> Joint:
    sign = joint.number("sign", 1.0)
    if sign not in {1.0, -1.0}:
        joint.note("sign", f"1 or -1 is expected, not {sign:g}")
    low, high = joint.number("min"), joint.number("max")
    if not low < high:
        joint.note("max", f"{high:g} is not above min, {low:g}")
    return Joint(int(sign), joint.number("offset", 0.0), low, high, joint.number("max_speed", least=1e-3))


def robot_path(model: str, folder: Path) -> Path:
    """The robot file that `model`, in a cell file in `folder`, means: a path from there, else a shipped name."""
    path = folder / model
    packages = sorted({point.module.partition(".")[0] for point in entry_points(group=CAMPAIGNS)})
    specs = [spec for spec in map(find_spec, packages) if spec]
    places = [Path(place) for spec in specs for place in spec.submodule_search_locations or ()]
    shipped = [place / "robots" / f"{model}.yaml" for place in places]
    return next((file for file in (path, *shipped) if file.is_file()), path)
