"""Fixtures and options of the tests."""

from fixtures import *  # noqa: F403
