"""The program `uwloc`. Exit codes: 0 done, 1 user error (one sentence on stderr), 2 usage."""

from __future__ import annotations

import argparse
import signal
from collections.abc import Sequence
from functools import cache

from ..version import __version__
from .commands import (
    calibrate,
    check,
    convert_wav,
    demo,
    hash_bag,
    info,
    launch,
    plan,
    process,
    replay,
    report,
    reproduce,
    score,
    simulate,
)
from .console import complain

COMMANDS = {
    "demo": demo,
    "launch": launch,
    "simulate": simulate,
    "process": process,
    "replay": replay,
    "hash": hash_bag,
    "score": score,
    "report": report,
    "info": info,
    "check": check,
    "reproduce": reproduce,
    "calibrate": calibrate,
    "plan": plan,
    "convert-wav": convert_wav,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command; the one place where a user's error becomes a sentence."""
    options = _parser().parse_args(arguments)
    try:
        if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        code: int = options.run(options)
    except ValueError as error:
        complain(str(error))
        return 1
    except OSError as error:
        complain(f"{error.filename or 'operating system'}: {error.strerror}")
        return 1
    except KeyboardInterrupt:
        return 130
    return code


@cache
def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("uwloc", description="Acoustic localization for AUVs, live and from bags.")
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for name, command in COMMANDS.items():
        own = commands.add_parser(name, help=command.HELP)
        command.add(own)
        own.set_defaults(run=command.run)
    return parser
