"""Options of commands from their signatures and from option groups, which are dataclasses."""

import functools
import inspect
import re
from collections.abc import Callable
from dataclasses import Field, fields, is_dataclass, replace
from typing import Annotated, Any, get_type_hints

import numpy as np
import typer
from typer import Context, Option

from truepose.commands import options
from truepose.exceptions import InputError


def _point(text: str, option: str) -> tuple[float, ...]:
    point = options.numbers_of(text)
    if len(point) != 3 or not np.isfinite(point).all():
        raise InputError(f"{option} {text}: must be three numbers, x,y,z (m)")
    return tuple(point.tolist())


#: Metavar and parser of a field's text, by its metadata "text".
_TEXTS: dict[str, tuple[str, Callable[[str, str], Any]]] = {
    "m": ("LENGTH", functools.partial(options.parse_size, unit="m")),
    "rad": ("ANGLE", functools.partial(options.parse_size, unit="rad")),
    "lean": ("ANGLE[,ANGLE]", lambda text, _: options.parse_lean(text)),
    "point": ("X,Y,Z", _point),
}


def _described(group: type) -> dict[str, str]:
    """Return the description of every field in a group's docstring, as plain text."""
    text = (inspect.getdoc(group) or "").partition("Parameters\n----------\n")[2]
    each = re.split(r"^(\w+) : .*\n", text.partition("\n\n")[0], flags=re.MULTILINE)
    plain = (re.sub(r":\w+:`|`", "", " ".join(of.split())) for of in each[2::2])
    return dict(zip(each[1::2], plain, strict=True))


def _all_help(context: Context, wanted: bool) -> None:
    if wanted:
        for parameter in context.command.params:
            parameter.hidden = False  # type: ignore[attr-defined]
        typer.echo(context.get_help())
        raise typer.Exit


#: Option of commands with a second page of help.
_HELP_ALL = Annotated[
    bool,
    Option("--help-all", callback=_all_help, is_eager=True, help="Show every option, and exit."),
]


def _keyword(name: str, default: Any, annotation: Any) -> inspect.Parameter:
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=default, annotation=annotation)


def _option(of: Field, hint: Any, default: Any, text: str, hidden: bool) -> inspect.Parameter:
    metavar = callback = None
    if word := of.metadata.get("text"):
        metavar, parse = _TEXTS[word]
        name, default, hint = f"--{of.name.replace('_', '-')}", None, str | None

        def callback(text: str | None) -> Any:
            return None if text is None else parse(text, name)

    made = Option(help=text, metavar=metavar, hidden=hidden, callback=callback)
    return _keyword(of.name, default, Annotated[of.metadata.get("words", hint), made])


def with_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command an option for each field of its option groups.

    A parameter is a group if its default is a dataclass. Fields that are typer's options stay as
    they are. Others have their names, types and descriptions; `metadata` has "text", a key of
    `_TEXTS`, of one that is written with a unit, "words", the type of an option that takes words
    alone, and "option": False, of one without an option. These are on the second page of the help
    unless the annotation names them: Annotated[Group, names].
    """
    signature = inspect.signature(command, eval_str=True)
    made: list[inspect.Parameter] = []
    groups: dict[str, tuple[Any, list[str]]] = {}
    paged = False
    for name, parameter in signature.parameters.items():
        if not is_dataclass(group := parameter.default):
            made.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
            continue
        (first,) = getattr(parameter.annotation, "__metadata__", [()])
        hints = get_type_hints(type(group), include_extras=True)
        own = [of for of in fields(group) if of.metadata.get("option", True)]
        groups[name] = group, [of.name for of in own]
        for of in own:
            hint, default = hints[of.name], getattr(group, of.name)
            if hasattr(hint, "__metadata__"):
                made.append(_keyword(of.name, default, hint))
                continue
            paged |= (hidden := of.name not in first)
            text = _described(type(group))[of.name]
            made.append(_option(of, hint, default, text, hidden))
    if paged:
        made.append(_keyword("help_all", False, _HELP_ALL))

    @functools.wraps(command)
    def call(**given: Any) -> Any:
        given.pop("help_all", None)
        for name, (group, own) in groups.items():
            values = {key: given.pop(key) for key in own}
            given[name] = replace(group, **{k: v for k, v in values.items() if v is not None})
        return command(**given)

    call.__signature__ = signature.replace(parameters=made)  # type: ignore[attr-defined]
    call.__annotations__ = {each.name: each.annotation for each in made}
    return call
