"""Presentation: tables, pages, drawings, the terminal."""
