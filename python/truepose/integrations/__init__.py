"""Integrations: other programs' files, machines and viewers, one folder each.

Each registers itself by entry points (`truepose.plugins`); nothing else imports it.
"""
