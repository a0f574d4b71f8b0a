"""Integration of viser: a workbench in the browser."""
