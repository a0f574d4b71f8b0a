"""Weight of the rooms against the table in docs/architecture.md, by tools/weigh.py."""

import pytest

import weigh

BUDGETS = list(weigh.budgets())


@pytest.mark.parametrize(("folders", "limit", "allowance"), BUDGETS, ids=[b[0] for b in BUDGETS])
def test_a_room_keeps_to_its_budget(folders, limit, allowance):
    assert 0 < weigh.of(folders) <= limit + allowance


def test_rooms_that_are_rebuilt_are_allowed_little_more():
    assert sum(allowance for *_, allowance in BUDGETS) <= 25_000


def test_every_file_has_a_budget():
    assert sum(weigh.files().values()) == weigh.of(" ".join(folders for folders, *_ in BUDGETS))
