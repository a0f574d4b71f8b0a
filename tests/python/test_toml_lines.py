"""Line numbers of TOML keys."""

import tomllib

import pytest

from truepose import robotfile
from truepose.robotfile import toml_lines

HARD = """
a = 1 # [not] a = table
"b c".'d.e' = "x = [1, \\" # ]"
text = \"\"\"
[table]
key = 3
\"\"\"
list = [ # one
  1,
  { p = 2, q = [3,
    4] }, [5],
]
[t.u]
v = 1979-05-27T07:32:00Z
[[array]]
n = 0.5
[array.sub]
m = 1
[[array]]
n = '''
]'''
[[array.inner]]
o = -1e-6
"""


def leaves(value, path=()):
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in items:
        yield (*path, key)
        if isinstance(inner, (dict, list)):
            yield from leaves(inner, (*path, key))


@pytest.mark.parametrize("text", [HARD, *(p.read_text() for p in robotfile.shipped().values())])
def test_every_key_that_the_parser_finds_has_a_line_and_no_other(text):
    assert set(toml_lines.lines(text)) == set(leaves(tomllib.loads(text)))


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("a",), 2),
        (("b c", "d.e"), 3),
        (("text",), 4),
        (("list", 0), 9),
        (("list", 1, "q", 1), 11),
        (("list", 2, 0), 11),
        (("t", "u", "v"), 14),
        (("array", 0, "n"), 16),
        (("array", 0, "sub", "m"), 18),
        (("array", 1), 19),
        (("array", 1, "n"), 20),
        (("array", 1, "inner", 0, "o"), 23),
    ],
)
def test_a_key_is_on_its_line(path, line):
    assert toml_lines.lines(HARD)[path] == line


def test_a_missing_key_is_looked_for_where_it_should_be():
    where = toml_lines.lines(HARD)
    assert toml_lines.nearest(where, ("array", 1, "missing")) == 19
    assert toml_lines.nearest(where, ("nothing", 3)) == 1
