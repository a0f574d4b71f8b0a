"""Files as accidents leave them: words replaced, lines lost, doubled and moved, bytes of noise."""

import re
from collections.abc import Sequence

import numpy as np

_WORD = re.compile(r"[\w.+-]+|[\[\]:=,#;*]")
_INSTEAD = ["", "nan", "-inf", "1e308", "-1", "0", "1e-9", "[", "]", "=", ":", ";", "#", "\n", "\t"]
_INSTEAD += ["65,1", "9" * 30, "\x00", "é"]


def spoiled(text: str, rng: np.random.Generator, words: Sequence[str] = ()) -> str:
    """Replace words, by some of `words` too, or digits; lose, double or move lines."""
    kind = rng.integers(6)
    lines = text.split("\n")
    if kind == 4:
        return "\n".join(lines[k] for k in np.flatnonzero(rng.random(len(lines)) > 0.02))
    if kind == 5:
        digits = [found.start() for found in re.finditer("[0-9]", text)]
        at = digits[rng.integers(len(digits))]
        return text[:at] + str(rng.integers(10)) + text[at + 1 :]
    if kind == 0:
        some = np.sort(rng.integers(len(lines), size=len(lines)))
        return "\n".join(lines[k] for k in (some if rng.integers(2) else rng.permutation(some)))
    if kind == 1:
        at = rng.integers(len(text))
        return text[:at] + rng.bytes(30).decode("latin-1") + text[at + 30 :]
    for _ in range(rng.integers(1, 4)):
        found = list(_WORD.finditer(text))
        word = found[rng.integers(len(found))]
        text = text[: word.start()] + str(rng.choice([*_INSTEAD, *words])) + text[word.end() :]
    return text
