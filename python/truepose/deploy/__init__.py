"""Deployment of a robot by the C interface."""
