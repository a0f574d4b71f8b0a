"""Speed-up of a Monte Carlo study by two processes, locally and on a dask cluster.

study.py [--robots 200]        # two minutes on two cores

Ratios of the time of one process to two, and core seconds per robot: self-calibration of an H4.
"""

import argparse
import time

import truepose as tp


def seconds(**how) -> float:
    """Time one study."""
    begun = time.perf_counter()
    tp.monte_carlo("calibration", "h4", seed=1, chunk=4, **how)
    return time.perf_counter() - begun


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--robots", type=int, default=200)
    count = parser.parse_args().robots
    one, two = (seconds(count=count, workers=k) for k in (1, 2))
    print(f"processes: two are {one / two:.2f} times as fast as one; {one / count:.2f} s per robot")
    from distributed import LocalCluster

    times = []
    for workers in (1, 2):
        with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as here:
            seconds(count=4 * workers, cluster=here)  # imports
            times.append(seconds(count=count, cluster=here))
    print(f"dask: two workers are {times[0] / times[1]:.2f} times as fast as one")


if __name__ == "__main__":
    main()
