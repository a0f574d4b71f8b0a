"""Causes of a disagreement between a log and a robot, and the search for them."""
