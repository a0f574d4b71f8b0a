"""How does a robot get onto a machine's controller? Tables for the C interface."""
