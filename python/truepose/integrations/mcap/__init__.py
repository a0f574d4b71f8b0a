"""Integration of MCAP: logs that Foxglove and PlotJuggler read."""
