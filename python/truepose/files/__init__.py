"""What may be read, what may be written, and how nothing is lost?"""
