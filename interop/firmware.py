"""Foreign masters against our firmware in QEMU: the steps of `modbus_cases.py`, as pymodbus and
mbpoll say them, to boards whose relays are seen on another way.

`cargo xtask firmware test` runs this. By hand it is
`target/interop-venv/bin/python interop/firmware.py target/firmware [WORD...]`.
"""

import concurrent.futures
import os
import sys
import threading
import time

import masters
import mbpoll_suite
import modbus_cases
import pymodbus_suite
import rig

WORKERS = 6
SHOWN = 10

# Of so many requests one may have to be asked again, and a few in any case.
ONE_IN = 20
A_FEW = 5

# Of all the suites no more may fail once.
AGAIN_MAX = 3

# Tables that try every address and speed before the power goes off. The firmware spares its EEPROM:
# what so many changes come to at power-up is another matter, so that follows on a fresh board.
SPARED = ("ERC-8", "EDA9060A Modbus", "EDA9050 Modbus")


def reachable(steps):
    """The steps that can be taken in QEMU. Its UART has no parity, and nobody there tells when an
    output moved: pulses are left to the trials."""
    moved = [at for at, step in enumerate(steps) if is_done(step, "changes ")
             or isinstance(step, modbus_cases.Pulses)]
    if moved:
        steps = steps[:moved[0]] + steps[moved[-1] + 1:]
    silent = modbus_cases.SILENT
    return [step for step in steps
            if "parity" not in str(getattr(step, "entries", "")) or step.want != silent]


def settled(module, steps):
    """The steps, where a board that is to be silent at its old speed is given the time to change:
    a busy machine may hold it up behind its reply."""
    model = module.split(",")[0].removeprefix("model=")
    for step, following in zip(steps, [*steps[1:], None]):
        if (isinstance(following, modbus_cases.Speed)
                and getattr(step, "want", None) == modbus_cases.SILENT):
            yield modbus_cases.Do(f"runs {model} {following.rate}")
        yield step


def lives(table, module, steps):
    """What happens to one module, or to one until it loses its power and to another one from
    shortly before that."""
    if table not in SPARED:
        return [(table, table, module, steps)]
    before = next(at for at, step in enumerate(steps) if is_done(step, "power "))
    while not getattr(steps[before - 1], "entries", ""):
        before -= 1
    return [(table, table, module, steps[:before]),
            (f"{table}, power", table, module, steps[before:])]


def is_done(step, command):
    """Whether a step does this at the panel."""
    return isinstance(step, modbus_cases.Do) and step.command.startswith(command)


class Board(rig.Rig):
    """A board in QEMU. Time can't be skipped there, so it is waited for."""

    images = None

    @classmethod
    def command(cls):
        return [rig.target() / "debug/railbus-qemu"], ["--images", cls.images]

    def do(self, command):
        if command.startswith("skip "):
            time.sleep(int(command.split()[1]) / 1000)
            return ""
        return super().do(command)


class Patient:
    """A master that asks again where nothing came and something must: a busy machine may hold up
    QEMU in the middle of a frame, which ends a Modbus frame. What then comes must be right, and so
    must what comes to the same question after it; and it must be rare."""

    lock = threading.Lock()
    asked = again = 0

    def __init__(self, master):
        self.master = master

    def __enter__(self):
        self.master.__enter__()
        return self

    def __exit__(self, *what):
        self.master.__exit__(*what)

    def __getattr__(self, name):
        return getattr(self.master, name)

    def request(self, unit, step, timeout):
        """Asks, up to five times."""
        got = self.master.request(unit, step, timeout)
        for again in range(4):
            self._count(again)
            if got == step.want or got != modbus_cases.SILENT:
                return got
            got = self.master.request(unit, step, timeout)
            if got == step.want and isinstance(getattr(step, "arg", None), int):
                # Read anew, it is the same.
                return self.master.request(unit, step, timeout)
        return got

    @classmethod
    def _count(cls, again):
        with cls.lock:
            cls.asked += not again
            cls.again += bool(again)


def suites(words):
    """The suites of both masters, over all tables."""
    masters.Rig = Board
    lines = [life for table, (module, steps) in modbus_cases.LINES.items()
             for life in lives(table, module, list(settled(module, reachable(steps))))]
    both = {"pymodbus": pymodbus_suite.Master, "mbpoll": mbpoll_suite.Master}
    for name, master in both.items():
        helper = None if master is pymodbus_suite.Master else pymodbus_suite.Master
        driven = masters.drive(
            name,
            lambda port, master=master: Patient(master(port)),
            helper and (lambda port, helper=helper: Patient(helper(port))),
            lines,
        )
        for suite in driven:
            if any(word in suite[0] for word in words or [""]):
                yield suite


def judge(suite):
    """Runs a suite; gives back its line and its failures."""
    name, run = suite
    began = time.monotonic()
    try:
        tally = run()
    except rig.GivenUp as given_up:
        tally = given_up.tally
    took = time.monotonic() - began
    line = f"{name:30}{tally.passed:5} passed {len(tally.failures):3} failed {took:5.1f} s"
    return line, [f"FAILED {name}: {failure}" for failure in tally.failures]


def main(images, *words):
    """Gives back the exit code."""
    Board.images = os.path.abspath(images)
    failed, again = 0, []
    chosen = list(suites(words))
    with concurrent.futures.ThreadPoolExecutor(WORKERS) as pool:
        for suite, (line, failures) in zip(chosen, pool.map(judge, chosen)):
            print("\n".join([line, *failures[:SHOWN]]), flush=True)
            if failures:
                again.append(suite)
    # QEMU keeps no time on a busy machine: what failed beside others must be right alone.
    for suite in again[:AGAIN_MAX]:
        line, failures = judge(suite)
        print("\n".join([f"again, alone: {line}", *failures[:SHOWN]]), flush=True)
        failed += len(failures)
    failed += len(again[AGAIN_MAX:])
    print(f"{Patient.asked} requests, {Patient.again} asked again", flush=True)
    if Patient.again > A_FEW + Patient.asked // ONE_IN:
        print(f"FAILED: more than one in {ONE_IN} had to be asked again")
        failed += 1
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
