"""The command line of the simulators: `run` a cell's hardware, `check` its file, or ask for the `truth`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from sims.cell import CellError, read_cell
from sims.running import Settings, run_cell
from sims.schema import schema_of
from sims.simulators import BadSimulator, installed
from sims.truth import TruthError, write_truth


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0, or 2 if the call or a file is wrong."""
    asked = _parser().parse_args(arguments)
    try:
        return int(asked.do(asked) or 0)
    except (CellError, TruthError, BadSimulator) as error:
        print(error, file=sys.stderr)
    except OSError as error:
        print(f"{error.filename or 'simulated cell'}: {error.strerror}", file=sys.stderr)
    return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m sims", description="The hardware of a cell, simulated.")
    verbs = parser.add_subparsers(required=True, metavar="run|check|truth|schema")
    _add_run(verbs.add_parser("run", help="stand in for the hardware of a cell file that has a simulate: section"))
    _add_check(verbs.add_parser("check", help="every error in a cell file, as JSON; starts nothing"))
    _add_truth(verbs.add_parser("truth", help="the simulated robot's true tool centre point at given joints"))
    schema = verbs.add_parser("schema", help="the JSON Schema of the simulate: section, all installed simulators in it")
    schema.set_defaults(do=_schema)
    return parser


def _add_run(run: argparse.ArgumentParser) -> None:
    run.add_argument("cell", type=Path, help="cell file")
    run.add_argument("--seed", type=_seed, help="wins over the cell file's")
    run.add_argument("--clock", choices=["realtime", "lockstep"], help="wins over the cell file's")
    run.add_argument("--ready", type=Path, help="file to write once every device listens (default: stdout)")
    run.add_argument("--parent", type=int, metavar="PID", help="end when this process is gone")
    run.add_argument("--truth-log", type=Path, help="a JSON line per contact, for tests")
    run.add_argument("--state", type=Path, help="file in which the cell remembers where it stands, from run to run")
    run.add_argument("--wait-for-host", action="store_true", help="lockstep: time stays at 0 until a host attaches")
    run.set_defaults(do=_run)


def _add_check(check: argparse.ArgumentParser) -> None:
    check.add_argument("cell", type=Path, help="cell file")
    check.set_defaults(do=_check)


def _add_truth(truth: argparse.ArgumentParser) -> None:
    truth.add_argument("cell", type=Path, help="cell file")
    truth.add_argument(
        "joints", type=Path, help="CSV: A1…An, degrees; optional D1…Dn, temperature, payload, payload_x…z"
    )
    truth.add_argument("--seed", type=_seed, help="wins over the cell file's")
    truth.add_argument("-o", "--out", type=Path, required=True, help="CSV to write: X,Y,Z, mm, robot's base frame")
    what = truth.add_mutually_exclusive_group()
    what.add_argument("--pose", action="store_true", help="the tool's A,B,C too, degrees")
    what.add_argument("--reflector", metavar="ID", help="a reflector on the robot instead of the tool centre point")
    truth.set_defaults(do=_truth)


def _run(asked: argparse.Namespace) -> None:
    files = asked.ready, asked.parent, asked.truth_log, asked.state
    run_cell(asked.cell, Settings(asked.seed, asked.clock, *files, wait_for_host=asked.wait_for_host))


def _check(asked: argparse.Namespace) -> int:
    """Print the errors as a JSON list of texts, each after the value's path in the file; returns 2 if any."""
    try:
        read_cell(asked.cell, to_run=True)
    except CellError as error:
        print(json.dumps(error.problems))
        return 2
    print("[]")
    return 0


def _truth(asked: argparse.Namespace) -> None:
    write_truth(asked.cell, asked.joints, asked.seed, asked.out, pose=asked.pose, reflector=asked.reflector)


def _schema(asked: argparse.Namespace) -> None:
    print(json.dumps(schema_of(installed()), indent=2))


def _seed(text: str) -> int:
    seed = int(text)
    if seed < 0:
        raise argparse.ArgumentTypeError("not below 0")
    return seed


if __name__ == "__main__":
    sys.exit(main())
