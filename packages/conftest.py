"""Fixtures of the core's tests, for those of the packages."""

from fixtures import *  # noqa: F403
