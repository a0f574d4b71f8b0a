"""What did the paper do, and what comes out of it here?"""
