"""Deployment of a robot through the C interface."""
