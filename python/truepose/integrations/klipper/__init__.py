"""Integration of Klipper: calibration of delta printers from their configuration and readings."""
