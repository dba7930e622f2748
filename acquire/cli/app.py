"""The ``acquire`` command: its commands, and the exit status of each kind of failure.

Every command lives in a module of its own that imports nothing heavy at its top: ``acquire --help`` stays quick.
"""

from __future__ import annotations

import importlib
import logging
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

DONE, BAD_INPUT, DEVICE, TRIPPED, ABORTED = 0, 2, 3, 4, 5
NOT_PASSED = 6  # of `acquire qualify`: it was done, and the instrument or a reference did not pass
INTERRUPTED = 130  # of the library below, after a KeyboardInterrupt
BUG = 1  # an exception nobody foresaw: a fault of this program, shown with its traceback

# Command -> (module, function). A module that is absent or broken costs its own command only.
COMMANDS: dict[str, tuple[str, str]] = {
    "run": ("acquire.cli.run", "run"),
    "check": ("acquire.cli.check", "check"),
    "safe": ("acquire.cli.safe", "safe"),
    "status": ("acquire.cli.status", "status"),
    "devices": ("acquire.cli.devices", "devices"),
    "sim": ("acquire.cli.sim", "sim"),
    "show": ("acquire.cli.data", "show"),
    "export": ("acquire.cli.data", "export"),
    "report": ("acquire.cli.data", "report"),
    "import": ("acquire.cli.data", "import_"),
    "recover": ("acquire.cli.data", "recover"),
    "ls": ("acquire.cli.data", "ls"),
    "review": ("acquire.cli.review", "review"),
    "qualify": ("acquire.cli.qualify", "qualify"),
    "gui": ("acquire.cli.gui", "gui"),
    "doctor": ("acquire.cli.doctor", "doctor"),
}
# Groups of commands: name -> (module, typer application).
GROUPS: dict[str, tuple[str, str]] = {"gap": ("acquire.cli.gap", "app"), "fit": ("acquire.cli.fit", "app")}

_BROKEN: dict[str, str] = {}  # command -> why its module did not load


def application() -> typer.Typer:
    """The command line with every command whose module can be imported; the others tell their fault."""
    app = typer.Typer(
        name="acquire",
        help="Run skin-mechanics experiments, record them without loss, fit models, and say why simulation differs.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
    )
    app.callback()(_options)
    for name, (module, attribute) in (COMMANDS | GROUPS).items():
        found = _load(name, module, attribute)
        if found is None:
            anything = {"allow_extra_args": True, "ignore_unknown_options": True}
            app.command(name, context_settings=anything)(_missing(name, module))
        elif name in GROUPS:
            app.add_typer(found, name=name)
        else:
            app.command(name)(found)
    return app


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line (``sys.argv`` by default) and return its exit status.

    0 done, 2 bad input, 3 device or link, 4 tripped, 5 aborted by a person, 6 not passed (`acquire qualify`); 1 is a
    fault of this program.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by who called us: an instrument is served all the same
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115 - until the process ends
    try:
        application()(args=None if arguments is None else list(arguments), prog_name=_called())
    except SystemExit as stop:
        if stop.code == INTERRUPTED:
            print("acquire: aborted", file=sys.stderr)
            return ABORTED
        return stop.code if isinstance(stop.code, int) else DONE if stop.code is None else BAD_INPUT
    except KeyboardInterrupt:
        print("acquire: aborted", file=sys.stderr)
        return ABORTED
    except BrokenPipeError:  # the reader of our output (head, less) has gone: not a fault
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - replaces the broken stream until the process ends
        return DONE
    except Exception as error:
        status = exit_status(error)
        if status == BUG or os.environ.get("ACQUIRE_DEBUG"):
            traceback.print_exc()
        print("\n".join(_told(f"acquire: {_message(error)}")), file=sys.stderr)
        return status
    return DONE


def _called() -> str:
    """The command's name as it was typed: acquire, or skinrig."""
    name = Path(sys.argv[0]).stem if sys.argv else ""
    return name if name == "skinrig" else "acquire"


def exit_status(error: BaseException) -> int:
    """The exit status that an exception means."""
    from acquire.engine import Aborted, Tripped
    from drivers.device import DeviceError

    if isinstance(error, Aborted):
        return ABORTED
    if isinstance(error, Tripped):
        return TRIPPED
    if isinstance(error, DeviceError | ConnectionError | TimeoutError):
        return DEVICE
    # Faults in what a person gave us: files, names, units, values. All our error classes for it are ValueErrors. What
    # the system refuses (a name too long, links in a circle, a full disk) is about a file that a person named.
    if isinstance(error, ValueError | OSError | LookupError) and not isinstance(error, IndexError):
        return BAD_INPUT
    return BUG


def _told(message: str) -> list[str]:
    """The lines of a message as a terminal stands them: a name of a megabyte is not printed whole."""
    from protocols.files import shortened

    return [shortened(line, 1000) for line in message.splitlines()]


def _message(error: BaseException) -> str:
    if isinstance(error, OSError) and error.strerror:
        from protocols.files import shortened

        names = " -> ".join(shortened(str(name)) for name in (error.filename, error.filename2) if name is not None)
        return f"{names}: {error.strerror}" if names else error.strerror
    # str(KeyError("text")) has quotes around it.
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    return text or type(error).__name__


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"skinrig {version('skinrig')}")
        raise typer.Exit


def _options(
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Log to stderr.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    level = logging.INFO if verbose else logging.WARNING
    logging.basicConfig(level=level, stream=sys.stderr, format="%(asctime)s %(name)s %(levelname)s %(message)s")


def _load(name: str, module: str, attribute: str) -> Any:
    try:
        return getattr(importlib.import_module(module), attribute)
    except ModuleNotFoundError as error:
        if error.name and not module.startswith(error.name):
            _BROKEN[name] = f"it needs {error.name}, which is not installed"
        return None
    except Exception as error:
        _BROKEN[name] = f"its module {module} does not load: {error!r}"
        return None


def _missing(name: str, module: str) -> Callable[[], None]:
    """A command that says why it cannot work."""
    why = _BROKEN.get(name, f"this installation has no {module}")

    def command() -> None:
        print(f"acquire {name} is not installed: {why}", file=sys.stderr)
        raise typer.Exit(BAD_INPUT)

    command.__doc__ = f"(not installed: {why})"
    return command
