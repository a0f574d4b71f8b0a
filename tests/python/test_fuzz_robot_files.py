"""Does the reader of robot files survive anything? One line or a robot, nothing else."""

import re

import numpy as np
import pytest

import truepose as tp
from truepose import checking, robot_file

_WORD = re.compile(r'"[^"\n]*"|[\w.+-]+|[\[\]{}=,]')
_INSTEAD = ["", "nan", "-inf", "1e308", "-1", "0", "true", '""', '"x"', "[]", "{}", "[[1]]"]
_INSTEAD += [
    "[0.0, 0.0, 0.0]",
    "1979-05-27",
    "{ a = 1 }",
    "9" * 30,
    "[",
    "}",
    "=",
    "based_on",
    "chain",
]


def spoiled(text: str, rng: np.random.Generator) -> str:
    """Replace a few words of a robot file."""
    for _ in range(rng.integers(1, 4)):
        words = list(_WORD.finditer(text))
        word = words[rng.integers(len(words))]
        text = text[: word.start()] + str(rng.choice(_INSTEAD)) + text[word.end() :]
    return text


@pytest.mark.parametrize("name", tp.robots())
def test_a_spoiled_file_is_a_robot_or_one_line_a_problem(name, rng, tmp_path, count):
    text = robot_file.shipped()[name].read_text(encoding="utf-8")
    path = tmp_path / "fuzz.toml"
    refused = 0
    for _ in range(max(count // 5000, 10)):
        path.write_text(spoiled(text, rng), encoding="utf-8")
        robot, problems = checking.check(path)
        assert (robot is None) == bool(problems)
        refused += robot is None
        for line in problems:
            assert re.match(re.escape(str(path)) + r":\d+: \S", line) and "\n" not in line, line
        if robot is None:
            with pytest.raises(tp.RobotFileError) as raised:
                tp.load(path)
            assert "\n" not in str(raised.value)
        else:
            assert np.isfinite(tp.load(path).ikm(robot.home)).all()
    assert refused
