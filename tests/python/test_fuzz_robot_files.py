"""Fuzzing of the robot-file reader. One line or a robot, nothing else."""

import re

import numpy as np
import pytest

import truepose as tp
from truepose import robotfile
from truepose.commands.robots import check

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


def torn(text: str, rng: np.random.Generator) -> bytes:
    """Random bytes, or a robot file with bytes put in, lines lost, moved or doubled, or its end."""
    data, at = text.encode(), int(rng.integers(len(text)))
    lines = data.splitlines(keepends=True)
    noise = rng.bytes(int(rng.integers(40)))
    some = rng.integers(len(lines), size=len(lines))
    return [
        rng.bytes(int(rng.integers(2000))),
        data[:at] + noise + data[at:],
        data[:at] + noise + data[at + len(noise) :],
        data[:at],
        b"".join(rng.permutation(np.array(lines, dtype=object))),
        b"".join(lines[k] for k in sorted(some)),
        b"".join(line for line, k in zip(lines, some, strict=True) if k > 1),
    ][rng.integers(7)]


def test_torn_files_and_random_bytes_are_refused_line_by_line_or_read(rng, tmp_path, count):
    texts = [path.read_text(encoding="utf-8") for path in robotfile.shipped().values()]
    path = tmp_path / "torn.toml"
    refused = 0
    for _ in range(max(count // 500, 50)):
        path.write_bytes(torn(texts[rng.integers(len(texts))], rng))
        try:
            robot, problems = check(path)
        except tp.RobotFileError as error:  # not text
            robot, problems = None, [str(error)]
        assert (robot is None) == bool(problems)
        assert all("\n" not in line for line in problems)
        refused += robot is None
        if robot is None:
            with pytest.raises(tp.RobotFileError) as raised:
                tp.load(path)
            assert "\n" not in str(raised.value)
    assert refused > 20


@pytest.mark.parametrize("name", tp.list_robots())
def test_a_spoiled_file_is_a_robot_or_one_line_a_problem(name, rng, tmp_path, count):
    text = robotfile.shipped()[name].read_text(encoding="utf-8")
    path = tmp_path / "fuzz.toml"
    refused = 0
    for _ in range(max(count // 5000, 10)):
        path.write_text(spoiled(text, rng), encoding="utf-8")
        robot, problems = check(path)
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
