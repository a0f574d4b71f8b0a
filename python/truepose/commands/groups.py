"""Options of commands from option groups: dataclasses with numpydoc docstrings."""

from __future__ import annotations

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


def described(group: type) -> dict[str, str]:
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


_HELP_ALL = Annotated[
    bool,
    Option("--help-all", callback=_all_help, is_eager=True, help="Show every option, and exit."),
]


def _option(of: Field, hint: Any, default: Any, text: str, hidden: bool) -> inspect.Parameter:
    metavar = callback = None
    if word := of.metadata.get("text"):
        metavar, parse = _TEXTS[word]
        name, default, hint = f"--{of.name.replace('_', '-')}", None, str | None

        def callback(text: str | None) -> Any:
            return None if text is None else parse(text, name)

    made = Option(help=text, metavar=metavar, hidden=hidden, callback=callback)
    kind, hint = inspect.Parameter.KEYWORD_ONLY, of.metadata.get("words", hint)
    return inspect.Parameter(of.name, kind, default=default, annotation=Annotated[hint, made])


def grouped(*first: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command an option for each field of the groups that are defaults of its parameters.

    Fields have their names, types and descriptions; `metadata` has "text", a key of `_TEXTS`, of
    one that is written with a unit, "words", the type of an option that takes words alone, and
    "option": False, of one without an option. Options other than `first` are on the second page of
    the help.
    """

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        signature = inspect.signature(function, eval_str=True)
        made: list[inspect.Parameter] = []
        groups: dict[str, tuple[Any, list[str]]] = {}
        for parameter in signature.parameters.values():
            group = parameter.default
            if not is_dataclass(group):
                made.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
                continue
            hints, texts = get_type_hints(type(group)), described(type(group))
            own = [of for of in fields(group) if of.metadata.get("option", True)]
            groups[parameter.name] = group, [of.name for of in own]
            made += [
                _option(of, hints[n], getattr(group, n), texts[n], n not in first)
                for of in own
                for n in [of.name]
            ]
        made.append(made[0].replace(name="help_all", default=False, annotation=_HELP_ALL))

        @functools.wraps(function)
        def call(*, help_all: bool, **given: Any) -> None:
            for name, (group, own) in groups.items():
                values = {key: given.pop(key) for key in own}
                given[name] = replace(group, **{k: v for k, v in values.items() if v is not None})
            function(**given)

        call.__signature__ = signature.replace(parameters=made)  # type: ignore[attr-defined]
        call.__annotations__ = {each.name: each.annotation for each in made}
        return call

    return decorate
