"""How does a result become a page? One HTML file, its figures in it."""

from __future__ import annotations

import base64
import platform
from importlib import metadata

import jinja2


def render(template: str, **values) -> str:
    """Fill one of the package's templates."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("truepose", "_data/templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**values)


def as_uri(image: bytes) -> str:
    """Put an SVG into a page as a data URI."""
    return f"data:image/svg+xml;base64,{base64.b64encode(image).decode()}"


def versions() -> dict[str, str]:
    """What made a page."""
    packages = {name: metadata.version(name) for name in ("numpy", "matplotlib")}
    python = platform.python_version()
    return {"truepose": metadata.version("truepose"), "Python": python, **packages}
