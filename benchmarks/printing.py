"""Command lines and Markdown tables of the benchmarks."""

import argparse


def arguments(text: str, *what: str, **defaults: int | float | str | tuple) -> argparse.Namespace:
    """Parse a command line: one word of `what`, if any, and options with these defaults.

    An option whose default is a tuple takes one value or more.
    """
    parser = argparse.ArgumentParser(description=text.partition("\n")[0])
    if what:
        parser.add_argument("what", choices=what)
    for name, default in defaults.items():
        one, many = (default[0], "+") if isinstance(default, tuple) else (default, None)
        parser.add_argument(f"--{name}", type=type(one), default=default, nargs=many)
    return parser.parse_args()


def row(*cells: object) -> None:
    """Print a row of a table."""
    print("|", " | ".join(map(str, cells)), "|", flush=True)


def head(*names: str, words: int = 1) -> None:
    """Print the head of a table whose first `words` columns are text."""
    row(*names)
    row(*["---"] * words, *["---:"] * (len(names) - words))
