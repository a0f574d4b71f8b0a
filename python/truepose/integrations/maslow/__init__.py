"""Integration of Maslow: sleds that hang on four belts."""
