"""Integrations: other programs' files, machines and viewers, each in a folder of its own.

An integration registers itself by entry points (`truepose.plugins`); nothing else imports it.
"""
