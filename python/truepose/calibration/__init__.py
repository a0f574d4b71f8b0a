"""What do readings tell of the robot, and how far can it be trusted?"""
