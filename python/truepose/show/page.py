"""Self-contained HTML pages with a table of contents and zoomable figures."""

import base64
import platform
import re
from importlib import metadata
from typing import TYPE_CHECKING

from truepose.show.table import Table

if TYPE_CHECKING:
    from jinja2 import Template

_TEMPLATES = "_data/templates"
_HEADING = re.compile(r"<h2>(.*?)</h2>", re.DOTALL)
#: Fewest sections for which a page lists its contents.
_FEWEST = 3


def render(template: str, package: str = "", **values: object) -> str:
    """Render a template with a list of sections and zoomable figures.

    `package` has the template in its folder `templates`, which may use those of the core.
    """
    return _with_contents(_template(template, package).render(**values))


def table_html(table: Table) -> str:
    """Return a table as HTML in the pages' format."""
    return str(_template("page.html.j2").module.show(table))  # type: ignore[attr-defined]


def _template(name: str, package: str = "") -> "Template":
    import jinja2

    loaders = [jinja2.PackageLoader(package)] if package else []
    loaders.append(jinja2.PackageLoader("truepose", _TEMPLATES))
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader(loaders),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


def _with_contents(page: str) -> str:
    """Number the sections, and list them below the title."""
    titles = [re.sub(r"<[^>]+>", "", title) for title in _HEADING.findall(page)]
    if len(titles) < _FEWEST:
        return page
    listed = "".join(
        f'<li><a href="#section-{k}">{title}</a></li>' for k, title in enumerate(titles, 1)
    )
    numbers = iter(range(1, len(titles) + 1))
    page = _HEADING.sub(lambda m: f'<h2 id="section-{next(numbers)}">{m[1]}</h2>', page)
    contents = f'</h1>\n<nav aria-label="Contents"><ol>{listed}</ol></nav>'
    return page.replace("</h1>", contents, 1)


def as_uri(image: bytes) -> str:
    """Return an SVG as a data URI."""
    return f"data:image/svg+xml;base64,{base64.b64encode(image).decode()}"


def versions() -> dict[str, str]:
    """Return versions of the software that writes a page."""
    packages = {name: metadata.version(name) for name in ("truepose", "numpy", "matplotlib")}
    return packages | {"Python": platform.python_version()}
