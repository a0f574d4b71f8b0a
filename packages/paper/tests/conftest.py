"""Fixtures of the paper's robots and of its reproduction."""

import numpy as np
import pytest

import truepose as tp
from truepose_paper import article, with_paper_errors
from truepose_paper.reproduce import Reproduction, reproduce


@pytest.fixture(scope="session")
def truth(h4) -> tp.Robot:
    """Return an H4 with geometric errors from the paper's ranges."""
    return with_paper_errors(h4, seed=1)


@pytest.fixture(scope="session")
def table2() -> np.ndarray:
    return article.table2()


@pytest.fixture(scope="session")
def reproduction() -> Reproduction:
    """Return the paper, run end to end with one robot."""
    return reproduce(1, seed=3)
