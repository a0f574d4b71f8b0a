"""Speed-up of a Monte Carlo study by two processes, and what a dask cluster costs.

study.py [--robots 200]        # two minutes on two cores

Self-calibrations of an H4: ratio of the time of one process to two; processor time per robot in
one process and on a cluster, of workers, and of client and scheduler together. The overhead is the
additional processor time as a share of the former; unlike clock times it holds on a busy machine.
"""

import argparse
import time

import psutil

import truepose as tp


def seconds(**how) -> float:
    """Time one study."""
    begun = time.perf_counter()
    tp.monte_carlo("calibration", "h4", seed=1, **how)
    return time.perf_counter() - begun


def processor(pids: list[int]) -> float:
    """Return the processor time of some processes, s."""
    return sum(sum(psutil.Process(pid).cpu_times()[:2]) for pid in pids)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--robots", type=int, default=200)
    count = parser.parse_args().robots
    one, two = (seconds(count=count, workers=k) for k in (1, 2))
    print(f"processes: two are {one / two:.2f} times as fast as one")
    begun = time.process_time()
    seconds(count=count, workers=0)
    alone = (time.process_time() - begun) / count
    from distributed import LocalCluster

    print("workers  alone  workers  client, scheduler (ms per robot)  overhead")
    for workers in (1, 2):
        with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as here:
            seconds(count=4 * workers, cluster=here)  # imports
            pids = [worker.pid for worker in here.workers.values()]
            before = processor(pids), time.process_time()
            seconds(count=count, cluster=here)
            theirs = (processor(pids) - before[0]) / count
            ours = (time.process_time() - before[1]) / count
        extra = (theirs + ours) / alone - 1
        print(
            f"{workers:7} {1e3 * alone:6.1f} {1e3 * theirs:8.1f} {1e3 * ours:33.2f} {extra:9.1%}",
            flush=True,
        )


if __name__ == "__main__":
    main()
