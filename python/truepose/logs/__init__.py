"""How do readings come from a file, and go to one?"""
