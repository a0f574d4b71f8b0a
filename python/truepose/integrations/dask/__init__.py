"""Integration of dask: Monte Carlo studies on a cluster."""
