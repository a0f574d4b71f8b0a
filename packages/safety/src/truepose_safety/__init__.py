"""Start-up test and momentum observer. Experimental and uncertified."""

from truepose_safety.forces import MomentumObserver
from truepose_safety.start_test import StartTest, start_test

__all__ = ["MomentumObserver", "StartTest", "start_test"]
