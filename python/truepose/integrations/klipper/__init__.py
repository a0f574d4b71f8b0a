"""Integration of Klipper: delta printers by their own configuration and readings."""
