"""Calibration of delta printers from the text of their firmware."""
