"""Ctrl-C during long computations. A signal's handler must be heard while the core computes."""

import os
import signal
from contextlib import contextmanager

import numpy as np
import pytest
from fixtures import drawn_poses

import truepose as tp
from truepose.simulation.plants.dynamic import visit
from truepose.threads import each


@contextmanager
def stopped_by_the_third_alarm():
    """Raise KeyboardInterrupt at the third of many alarms: heard only at the end they are one."""
    heard = 0

    def hear(number, frame):
        nonlocal heard
        heard += 1
        if heard == 3:
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, hear)
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})  # as slow on a machine of many cores
    signal.setitimer(signal.ITIMER_REAL, 0.02, 0.02)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        os.sched_setaffinity(0, cores)


def poses(robot, count):
    return drawn_poses(robot, count, 1)


H4 = tp.load("h4")
TRUE = H4.sample(1)
X = poses(H4, 20_000)
Q_E = TRUE.extended_positions(X)
MANY, MANY_Q_E = np.tile(X, (100, 1)), np.tile(Q_E, (100, 1))

#: Each computes for a tenth of a second at least, on any machine, if nobody stops it.
LONG = {
    "ikm": lambda: H4.ikm(MANY),
    "fkm at the full level": lambda: H4.fkm(MANY_Q_E[:, :4], level="full"),
    "jacobian": lambda: H4.jacobian(MANY),
    "read": lambda: tp._core.spoil(H4.core, np.tile(MANY_Q_E, (3, 1)), 0),
    "estimate": lambda: H4.estimate(MANY_Q_E[:40_000]),
    "settle": lambda: tp.steady_state(H4, TRUE, MANY),
    "simulate": lambda: tp.simulate(H4, TRUE, run=tp.simulation.Run(hold=100.0)),
    "visit": lambda: visit(H4, TRUE, X[:500]),
    "calibrate": lambda: tp.calibrate(H4, MANY_Q_E[:40_000]),
    "after visiting": lambda: tp.accuracy(H4, X[:1], calibrated_on=MANY[:200_000]),
    "online": lambda: tp.OnlineCalibrator(H4).observe(Q_E),
}


@pytest.mark.parametrize("name", LONG)
def test_a_signal_ends_a_long_computation(name):
    with pytest.raises(KeyboardInterrupt), stopped_by_the_third_alarm():
        LONG[name]()


def test_ctrl_c_ends_what_other_threads_compute():
    """A signal reaches the main thread alone, which waits for them."""
    ended = []

    def work(item):
        try:
            LONG["settle"]()
        except KeyboardInterrupt:
            ended.append(item)
            raise

    with pytest.raises(KeyboardInterrupt), stopped_by_the_third_alarm():
        list(each(work, range(5)))
    assert ended == [0]  # on one core, and the others never began
    assert np.isfinite(H4.ikm(X)).all()  # nothing is left of it


def test_a_filter_that_was_stopped_keeps_what_it_learnt():
    online = tp.OnlineCalibrator(H4)
    with pytest.raises(KeyboardInterrupt), stopped_by_the_third_alarm():
        online.observe(Q_E)
    assert 0 < online.lines < len(Q_E)
    sigma = {name: p.sigma for name, p in online.parameters.items()}
    assert sigma["chain1.rod"] < H4.parameters["chain1.rod"].sigma
