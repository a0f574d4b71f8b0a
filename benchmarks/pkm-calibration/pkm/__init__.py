"""Benchmark of calibrations of parallel robots: generator, scorer, baselines."""
