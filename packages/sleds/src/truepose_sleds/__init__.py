"""Calibration of sleds that hang on four belts (Maslow)."""
