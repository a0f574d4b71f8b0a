"""Fixtures of the core's tests, for what others build with it."""

from fixtures import *  # noqa: F403
