"""What does a robot file say? Read, checked, filled in."""
