"""Reference of a C header in Markdown, from its comments."""

from __future__ import annotations

import re
from collections.abc import Iterator

#: A section's title, or a comment with what it describes up to the next comment or blank line.
PARTS = re.compile(
    r"^/\* -{20,}\n \* (?P<title>.*?)\n \*/$"
    r"|^(?P<comment>/\*\*(?! *\n \* @file)(?:(?!\*/).)*\*/\n)?"
    r"(?P<code>(?:typedef )?(?:enum|struct|union)\b[^;{]*\{.*?^\}[^;\n]*;"
    r"|#ifdef TRUEPOSE_SINGLE.*?^#endif|#define TRUEPOSE_ABI \d+|(?:TRUEPOSE_API|typedef)\b.*?;)",
    re.DOTALL | re.MULTILINE,
)


def reference(name: str, text: str) -> str:
    """Sections of a header; each type and function with its comment and declaration."""
    file = re.match(r"/\*\*\n \* @file\n(.*?)\*/", text, re.DOTALL)
    page = f"## `{name.rpartition('include/')[2]}`\n\n{_prose(file[1])}\n" if file else ""
    for part in PARTS.finditer(text):
        if part["title"]:
            title, *more = re.split(
                r"[.:] |, (?=for )", part["title"].replace("\n *", ""), maxsplit=1
            )
            more = "".join(more)
            page += f"\n### {title}\n" + f"\n{more[:1].upper()}{more[1:]}\n" * bool(more)
        else:
            page += f"\n```c\n{part['code'].replace('TRUEPOSE_API ', '')}\n```\n"
            page += "".join(f"\n{line}\n" for line in _described(part["comment"] or ""))
    return page


def _prose(comment: str) -> str:
    """The paragraphs of a comment, without its stars."""
    return re.sub(
        r"^(?:/\*\*| \*) ?", "", comment.strip().removesuffix("*/"), flags=re.MULTILINE
    ).strip()


def _described(comment: str) -> Iterator[str]:
    """Text, parameters and result of a comment."""
    text, *tags = re.split(r"@(?=param|return)", _prose(comment))
    if text.strip():
        yield text.strip()
    items = []
    for tag in tags:
        kind, _, rest = tag.partition(" ")
        names, _, what = rest.partition("  ") if kind == "param" else ("", "", rest)
        what = " ".join(what.split())
        items.append(f"- `{names.strip()}`: {what}" if names else f"- Returns {what}")
    if items:
        yield "\n".join(items)
