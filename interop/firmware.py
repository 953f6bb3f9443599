"""Foreign masters against our firmware in QEMU: the steps of `modbus_cases.py`, as pymodbus and
mbpoll say them, to boards whose relays are seen on another way.

`cargo xtask firmware test` runs this. By hand it is
`target/interop-venv/bin/python interop/firmware.py target/firmware [WORD...]`.
"""

import concurrent.futures
import os
import sys
import time

import masters
import mbpoll_suite
import modbus_cases
import pymodbus_suite
import rig

# QEMU paces no characters, so that the EDA9060A and its pulses are left to the trial's cases.
TABLES = ("ERC-8", "EMD-2A2Q", "EDA9050 Modbus")
WORKERS = 4
SHOWN = 10


def reachable(steps):
    """The steps that can be taken in QEMU. Its UART has no parity; and the firmware spares its
    EEPROM, so that what the many changes before it come to at power-up is another matter."""
    for step in steps:
        if isinstance(step, modbus_cases.Do) and step.command.startswith("power "):
            return
        if "parity: silent" not in str(getattr(step, "entries", "")):
            yield step


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
    QEMU in the middle of a frame, which ends a Modbus frame."""

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
        for _ in range(5):
            got = self.master.request(unit, step, timeout)
            if got == step.want or got != modbus_cases.SILENT:
                break
        return got


def suites(words):
    """The suites of both masters, over the tables that need no exact time."""
    masters.Rig = Board
    lines = {table: modbus_cases.LINES[table] for table in TABLES}
    masters.LINES = {table: (module, [*reachable(steps)])
                     for table, (module, steps) in lines.items()}
    both = {"pymodbus": pymodbus_suite.Master, "mbpoll": mbpoll_suite.Master}
    for name, master in both.items():
        helper = None if master is pymodbus_suite.Master else pymodbus_suite.Master
        driven = masters.drive(
            name,
            lambda port, master=master: Patient(master(port)),
            helper and (lambda port, helper=helper: Patient(helper(port))),
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
    failed = 0
    with concurrent.futures.ThreadPoolExecutor(WORKERS) as pool:
        for line, failures in pool.map(judge, suites(words)):
            print("\n".join([line, *failures[:SHOWN]]), flush=True)
            failed += len(failures)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
