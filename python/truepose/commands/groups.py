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
    metavar = None
    if word := of.metadata.get("text"):
        (metavar, _), default, hint = _TEXTS[word], None, str | None
    hint = of.metadata.get("words", hint)
    made = Option(help=text, metavar=metavar, hidden=hidden)
    kind = inspect.Parameter.KEYWORD_ONLY
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
        groups = {
            p.name: p.default for p in signature.parameters.values() if is_dataclass(p.default)
        }
        made: list[inspect.Parameter] = []
        owned: dict[str, dict[str, Field]] = {}
        for parameter in signature.parameters.values():
            if (group := groups.get(parameter.name)) is None:
                made.append(parameter)
                continue
            hints, texts = get_type_hints(type(group)), described(type(group))
            own = {of.name: of for of in fields(group) if of.metadata.get("option", True)}
            owned[parameter.name] = own
            made += [
                _option(of, hints[name], getattr(group, name), texts[name], name not in first)
                for name, of in own.items()
            ]
        made = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in made]
        made.append(made[-1].replace(name="help_all", default=False, annotation=_HELP_ALL))

        @functools.wraps(function)
        def call(**given: Any) -> None:
            del given["help_all"]
            for name, own in owned.items():
                values = {key: given.pop(key) for key in own}
                for key, of in own.items():
                    if of.metadata.get("text") is None:
                        continue
                    if (text := values.pop(key)) is not None:
                        parse = _TEXTS[of.metadata["text"]][1]
                        values[key] = parse(text, f"--{key.replace('_', '-')}")
                given[name] = replace(groups[name], **values)
            function(**given)

        call.__signature__ = signature.replace(parameters=made)  # type: ignore[attr-defined]
        call.__annotations__ = {each.name: each.annotation for each in made}
        return call

    return decorate
