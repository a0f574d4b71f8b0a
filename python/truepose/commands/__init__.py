"""What does somebody who types get?"""
