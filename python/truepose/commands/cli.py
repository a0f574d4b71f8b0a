"""Command line: `truepose --help`."""

import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable
from importlib import metadata
from typing import Any

import typer
from typer import Option
from typer.exceptions import TyperException

from truepose import files, moved
from truepose.commands import (
    accuracy,
    calibrate,
    design,
    export,
    faults,
    follow,
    info,
    margins,
    monte_carlo,
    plan,
    robots,
    simulate,
)
from truepose.commands.groups import with_options
from truepose.exceptions import TrueposeError
from truepose.plugins import plugins
from truepose.show.terminal import prepare, say

app = typer.Typer(
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help="Makes parallel robots accurate with redundant sensors.",
)


#: Groups of the help, in the order in which a robot's builder needs them.
_GROUPS: dict[str, dict[str, Callable[..., Any]]] = {
    "Robots": {
        "list": robots.list_command,
        "info": info.command,
        "new": robots.new_command,
        "check": robots.check_command,
    },
    "Before building": {
        "accuracy": accuracy.command,
        "error-budget": accuracy.error_budget_command,
        "design": design.command,
        "plan": plan.command,
        "faults": faults.command,
    },
    "Calibration": {
        "calibrate": calibrate.command,
        "zero": calibrate.zero_command,
        "follow": follow.command,
    },
    "Simulation and control": {
        "simulate": simulate.command,
        "simulate-log": monte_carlo.simulate_log_command,
        "monte-carlo": monte_carlo.study_command,
        "margins": margins.command,
    },
}
#: Groups of registered commands; others are of machines.
_GROUP_OF = {"import": "Robots", "view": "Robots"} | dict.fromkeys(
    ("workbench", "reproduce"), "Demonstration"
)

for _group, _commands in _GROUPS.items():
    for _name, _command in _commands.items():
        app.command(_name, rich_help_panel=_group)(with_options(_command))
app.add_typer(export.app, name="export", rich_help_panel="Robots")
_ANYTHING = {"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}
for _name, _new in moved.RENAMED.items():
    app.command(_name, hidden=True, context_settings=_ANYTHING)(
        moved.answer(f"truepose {_name}: is called truepose {_new}")
    )
_registered = plugins("commands")  # of packages and integrations
for _path in sorted(_registered.keys() | moved.COMMANDS):
    _under, _, _name = _path.rpartition(".")
    _parent = {"": app, "export": export.app}[_under]
    if _path not in _registered:
        _where = moved.where(f"truepose {_path.replace('.', ' ')}", moved.COMMANDS[_path])
        _parent.command(_name, hidden=True, context_settings=_ANYTHING)(moved.answer(_where))
        continue
    _loaded = _registered[_path].load()
    _panel = None if _under else _GROUP_OF.get(_name, "Machines")
    if isinstance(_loaded, typer.Typer):
        _parent.add_typer(_loaded, name=_name, rich_help_panel=_panel)
    else:
        _parent.command(_name, rich_help_panel=_panel)(with_options(_loaded))


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"truepose {metadata.version('truepose')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _options(
    context: typer.Context,
    version: bool = Option(
        False, "--version", callback=_version, is_eager=True, help="Print the version."
    ),
) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def _stop(number: int, _frame: object) -> None:
    """End the process: an exception could be lost in a callback of the interpreter."""
    files.clear()
    shown = b"\x1b[?25h" * os.isatty(2)  # a progress bar hides the cursor
    os.write(2, shown + b"truepose: stopped\n")
    os._exit(128 + number)


def main() -> None:
    """Run the command line; print an error as one line and exit with status 2."""
    prepare()
    signals = [signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else [])]
    if threading.current_thread() is not threading.main_thread():
        signals = []  # only the main thread may install handlers
    before = {number: signal.signal(number, _stop) for number in signals}
    try:
        with warnings.catch_warnings():  # one line each, without the line of code
            warnings.showwarning = lambda message, *_: say(f"truepose: {message}", err=True)
            code, message = _run()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if message:
        say(f"truepose: {message}", err=True)
    sys.exit(code)


def _said(error: TyperException) -> str:
    """Return the message about a command line, with the wrong value and the choices."""
    said = error.format_message().replace("Value error, ", "")  # pydantic's prefix
    context: Any = getattr(error, "ctx", None)
    if errors := getattr(error.__cause__, "errors", None):
        value = str(errors()[0]["input"])
        said += f" ('{value}' was given)" * (value not in said)
    if context and said.startswith("No such command") and "Did you mean" not in said:
        known = context.command.commands.items()
        said += f" (choices: {', '.join(name for name, one in known if not one.hidden)})"
    elif context and said.startswith(("Missing", "Got unexpected")):
        said += f" ({context.command_path} --help)"
    return said or "no command given; try --help"


def _run() -> tuple[int, str]:
    """Return the exit status and the last message of a command."""
    try:
        code = app(prog_name="truepose", standalone_mode=False) or 0
        sys.stdout.flush()
        return code, "interrupted" if code == 130 else ""  # typer's own answer to Ctrl-C
    except TrueposeError as error:
        return 2, f"error: {error}"
    except TyperException as error:
        return 2, f"error: {_said(error)}"
    except KeyboardInterrupt:
        return 130, "interrupted"
    except BrokenPipeError:  # the reader ended, as in `truepose info h4 | head -1`
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 – until the end
        return 128 + 13, ""
    except Exception as error:
        if os.environ.get("TRUEPOSE_DEBUG"):
            raise
        if isinstance(error, OSError):
            return 2, f"error: {error.filename or 'standard output'}: {error.strerror or error}"
        reason = f"{type(error).__name__}: {error}".removesuffix(": ")
        return 2, f"error: {reason}; a bug in truepose: TRUEPOSE_DEBUG=1 prints the traceback"


if __name__ == "__main__":
    main()
