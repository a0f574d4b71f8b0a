"""Start-up test, safety shell and momentum observer. Experimental and uncertified."""

from truepose_safety.forces import MomentumObserver
from truepose_safety.shell import STATES, SafetyShell
from truepose_safety.start_test import StartTest, start_test

__all__ = ["STATES", "MomentumObserver", "SafetyShell", "StartTest", "start_test"]
