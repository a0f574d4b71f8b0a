#!/usr/bin/python3
"""LinuxCNC's headless user interface: home, run job.json, record the results.

Run by LinuxCNC ([DISPLAY]DISPLAY) with the system's Python; does not need truepose.
"""

import itertools
import json
import subprocess
import sys
import time
from pathlib import Path

import hal
import linuxcnc

HERE = Path(__file__).resolve().parent
SETTLES, PATIENCE = 0.4, 20.0  # s: settling in servo cycles, and timeout in wall time
LOOKS = 1.2  # s, window for a step of a drive's command
#: What a job leaves out.
LISTS = ("index", "poses", "circle", "events", "refused", "clocks", "asked", "noted")


class Machine:
    """Command and status of LinuxCNC."""

    def __init__(self, joints):
        self.command, self.state, self.errors = (
            linuxcnc.command(),
            linuxcnc.stat(),
            linuxcnc.error_channel(),
        )
        self.joints = joints
        self.said = []

    def wait(self, holds, what):
        """Wait until `holds` is true, collecting messages."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            self.state.poll()
            self.hear()
            if holds():
                return
            time.sleep(0.005)
        raise TimeoutError(what)

    def hear(self):
        """Collect LinuxCNC's messages."""
        while error := self.errors.poll():
            self.said.append(error[1])

    def start(self):
        """Switch the machine on, and home it."""
        self.become(linuxcnc.STATE_ESTOP_RESET)
        self.become(linuxcnc.STATE_ON)
        self.home()

    def become(self, wanted):
        """Request a state and wait for it."""
        self.command.wait_complete()  # commands that come too early are lost
        self.command.state(wanted)
        self.wait(lambda: self.state.task_state == wanted, f"the machine is not in state {wanted}")

    def off_and_on(self, stopped=False):
        """Switch the machine off, optionally by an emergency stop, and on again."""
        self.command.state(linuxcnc.STATE_ESTOP if stopped else linuxcnc.STATE_OFF)
        self.wait(lambda: self.state.task_state != linuxcnc.STATE_ON, "the machine stays on")
        if stopped:
            self.become(linuxcnc.STATE_ESTOP)
            self.become(linuxcnc.STATE_ESTOP_RESET)
        self.become(linuxcnc.STATE_ON)

    def start_test(self):
        """Run the start-up test with the machine off, and switch it on."""
        self.command.state(linuxcnc.STATE_OFF)
        self.wait(lambda: self.state.task_state != linuxcnc.STATE_ON, "the machine stays on")
        setp("truepose_tej.start-test", 1)
        self.wait(lambda: value("truepose_tej.start-state") in (7, 8), "the start-up test")
        setp("truepose_tej.start-test", 0)
        if not value("truepose_tej.start-reached"):
            raise RuntimeError(f"start-up test: finding {value('truepose_tej.start-finding')}")
        self.become(linuxcnc.STATE_ON)
        self.command.mode(linuxcnc.MODE_MDI)
        self.command.wait_complete()

    def home(self):
        """Home all joints at their positions."""
        self.command.mode(linuxcnc.MODE_MANUAL)
        self.command.wait_complete()
        self.command.teleop_enable(0)
        self.command.wait_complete()
        self.command.home(-1)
        self.wait(lambda: all(self.state.homed[: self.joints]), "is not homed")
        self.command.mode(linuxcnc.MODE_MDI)
        self.command.wait_complete()

    def begin(self, line):
        """Send a line of G-code."""
        self.command.mdi(line)
        time.sleep(0.02)

    def still(self):
        """Return whether the line is done; raise if the machine went off."""
        if self.state.task_state != linuxcnc.STATE_ON:
            raise RuntimeError("the machine went off")
        return self.state.interp_state == linuxcnc.INTERP_IDLE and self.state.inpos

    def go(self, line, each=None):
        """Run a line to its end, calling `each` meanwhile."""
        self.begin(line)
        self.wait(lambda: (each and each(), self.still())[1], line)
        self.settle()

    def settle(self, seconds=SETTLES):
        """Wait until no drive's command moves for some seconds of servo cycles."""
        last, end = None, 0.0

        def rests():
            nonlocal last, end
            told = [value(f"joint.{j}.pos-cmd") for j in range(self.joints)]
            now = value("integ.0.out")
            if told != last:
                last, end = told, now + seconds
            return now >= end

        self.wait(rests, f"{seconds} s of servo cycles at rest")


def value(name):
    """Return a pin's value with all digits."""
    return hal.get_value(name)


def truth(joints):
    """Return the simulated machine's true pose, mm and degrees."""
    return [value(f"truepose_plant.pose.{k}") for k in range(joints)]


def setp(pin, wanted):
    """Set an unconnected pin."""
    halcmd("setp", pin, str(wanted))


def halcmd(*words):
    """Send a command to HAL."""
    subprocess.run(["halcmd", *words], check=True)


def clocks(cycles, names, meanwhile):
    """Return the time of each function in consecutive cycles, by HAL's sampler."""
    with (HERE / "clocks").open("w+") as samples:
        sampler = subprocess.Popen(["halsampler", "-n", str(cycles)], stdout=samples)
        setp("sampler.0.enable", 1)
        meanwhile()
        sampler.wait()
        setp("sampler.0.enable", 0)
        samples.seek(0)
        rows = [row.split() for row in samples if "over" not in row]
    return {name: [int(row[k]) for row in rows] for k, name in enumerate(names)}


def steps(events, machine, looks):
    """Return the largest change per cycle of a drive's command; call `looks` after each event."""
    with (HERE / "samples").open("w+") as samples:
        sampler = subprocess.Popen(["halsampler", "-t"], stdout=samples)
        setp("sampler.0.enable", 1)
        for k, (_, pins) in enumerate(events):
            halcmd("sets", "event", str(k))
            for pin in pins:
                setp(*pin) if pin else machine.off_and_on()
            time.sleep(LOOKS)
            machine.hear()
            looks()
        sampler.terminate()
        sampler.wait()
        samples.seek(0)
        whole = [row.split() for row in samples if row.endswith("\n") and "over" not in row]
    rows = [[float(word) for word in row] for row in whole]
    found = {name: 0.0 for name, _ in events}
    for one, other in itertools.pairwise(rows):
        number, event, *told = other
        if number == one[0] + 1:
            changes = [abs(a - b) for a, b in zip(told, one[2:], strict=True)]
            name = events[int(event)][0]
            found[name] = max(found[name], *changes)
    return found


def switched(wanted, machine, joints):
    """Return true and displayed poses at rest, at first and after each switching off and on.

    Every second time by an emergency stop. Then the machine is homed at a wrong pose.
    """
    found = {"true": [], "shown": []}
    for counts in wanted["counts"]:
        setp("truepose_plant.counts", counts)
        machine.command.mode(linuxcnc.MODE_MDI)
        machine.command.wait_complete()
        for line in wanted["lines"]:
            machine.go(line)
        true, shown = [], []
        for k in range(wanted["times"] + 1):
            if k > 0:
                machine.off_and_on(stopped=k % 2 == 0)
            machine.settle()
            true.append(truth(joints))
            shown.append(list(machine.state.actual_position))
        found["true"].append(true)
        found["shown"].append(shown)
    machine.command.mode(linuxcnc.MODE_MDI)
    machine.command.wait_complete()
    machine.go(wanted["away"])
    machine.home()
    for wait in (0.0, SETTLES):
        machine.settle(wait)
        found["true"].append([truth(joints)])
    found["asked"] = [value(name) for name in wanted["asked"]]
    setp("truepose_tej.reset", 1)
    machine.settle()
    found["acknowledged"] = [value(name) for name in wanted["asked"]]
    return found


def run(job, machine):
    """Do the job; return the results."""
    joints, true = job["joints"], job["true"]
    found = {"rest": [], "path": [], "shown": [], "noted": []}
    for pin, wanted in job["pins"].items():
        setp(pin, wanted)
    machine.start()
    if job["start_test"]:
        machine.start_test()
    for line in job["index"]:
        machine.go(line)
    began = time.monotonic()

    def look():
        found["noted"].append([value(name) for name in job["noted"]])

    def visit():
        for line in job["poses"]:
            if line.startswith("setp "):
                setp(*line.split()[1:])
                continue
            if line.startswith("sh "):
                subprocess.Popen(line[3:], shell=True, cwd=HERE)
                continue
            if line.startswith("wait "):
                _, name, least = line.split()
                end = int(least) + (value(name) if least[0] == "+" else 0)
                machine.wait(lambda: value(name) >= end, line)  # noqa: B023
                continue
            machine.go(line)
            found["shown"].append(list(machine.state.actual_position))
            look()
            if true:
                found["rest"].append(truth(joints))

    if job["circle"] or not job["clocks"]:
        visit()
    else:
        found["times"] = clocks(job["cycles"], job["clocks"], visit)
    if job["circle"]:
        *there, circle = job["circle"]
        for line in there:
            machine.go(line)
        found["times"] = clocks(
            job["cycles"],
            job["clocks"],
            lambda: machine.go(circle, lambda: found["path"].append(truth(joints))),
        )
        while time.monotonic() - began < job["lasts"]:
            machine.go(circle)
    found["lasted"] = time.monotonic() - began
    found["pins"] = {name: value(name) for name in job["asked"]}
    for line in job["refused"]:
        machine.begin(line)
        machine.wait(machine.still, line)
        time.sleep(0.1)
        machine.hear()
    if "switched" in job:
        found["switched"] = switched(job["switched"], machine, joints)
    found["steps"] = steps(job["events"], machine, look) if job["events"] else {}
    found["said"] = machine.said
    return found


def main():
    """Do the job of job.json, and write found.json."""
    job = {name: [] for name in LISTS} | {"true": True, "pins": {}, "start_test": False}
    job |= json.loads((HERE / "job.json").read_text())
    own = hal.component("truepose_ui")  # only a component can read pins
    own.ready()
    halcmd("loadrt", "integ")  # integrates 1: time in servo cycles, s
    halcmd("addf", "integ.0", "servo-thread")
    setp("integ.0.in", 1)
    machine = Machine(job["joints"])
    try:
        found = run(job, machine)
    except Exception as error:
        machine.state.poll()
        found = {"error": f"{type(error).__name__}: {error}", "said": machine.said}
    (HERE / "found.json").write_text(json.dumps(found))
    machine.command.state(linuxcnc.STATE_ESTOP)
    return "error" in found


if __name__ == "__main__":
    sys.exit(main())
