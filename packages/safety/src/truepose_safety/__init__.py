"""Start-up test of a robot's readings. Experimental and uncertified."""

from truepose_safety.start_test import StartTest, start_test

__all__ = ["StartTest", "start_test"]
