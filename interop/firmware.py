"""Third-party masters against our firmware in QEMU: the steps of `modbus_cases.py`, sent by
pymodbus and mbpoll to boards whose relays are observed independently.

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

WORKERS = 6
SHOWN = 10

# Tables that try every address and speed before the power goes off. The firmware limits EEPROM
# writes, so the result of that many changes at power-up is a different matter; the rest runs on a
# fresh board.
SPARED = ("ERC-8", "EDA9060A Modbus", "EDA9050 Modbus")


def reachable(steps):
    """The steps that are possible in QEMU. Its UART has no parity, and changes of outputs have no
    time stamps: pulses are left to the trials."""
    moved = [at for at, step in enumerate(steps) if is_done(step, "changes ")
             or isinstance(step, modbus_cases.Pulses)]
    if moved:
        steps = steps[:moved[0]] + steps[moved[-1] + 1:]
    silent = modbus_cases.SILENT
    return [step for step in steps
            if "parity" not in str(getattr(step, "entries", "")) or step.want != silent]


def settled(module, steps):
    """The steps, with time for a board to change its speed before it is read at the new one, or
    is expected to be silent at the old one: a busy machine may hold it up after its reply."""
    model = module.split(",")[0].removeprefix("model=")
    waited_for = None
    for step, following in zip(steps, [*steps[1:], None]):
        speed = following if getattr(step, "want", None) == modbus_cases.SILENT else step
        if isinstance(speed, modbus_cases.Speed) and speed is not waited_for:
            waited_for = speed
            yield modbus_cases.Do(f"runs {model} {speed.rate}")
        yield step


def lives(table, module, steps):
    """Splits the steps: those up to a loss of power, and those for a fresh board from shortly
    before."""
    if table not in SPARED:
        return [(table, table, module, steps)]
    before = next(at for at, step in enumerate(steps) if is_done(step, "power "))
    while not getattr(steps[before - 1], "entries", ""):
        before -= 1
    return [(table, table, module, steps[:before]),
            (f"{table}, power", table, module, steps[before:])]


def is_done(step, command):
    """Whether a step runs this command at the panel."""
    return isinstance(step, modbus_cases.Do) and step.command.startswith(command)


class Board(rig.Rig):
    """A board in QEMU. Time can't be skipped there, so it really waits."""

    images = None

    @classmethod
    def command(cls):
        return [rig.target() / "debug/railbus-qemu"], ["--images", cls.images]

    def do(self, command):
        if command.startswith("skip "):
            time.sleep(int(command.split()[1]) / 1000)
            return ""
        return super().do(command)


def suites(words):
    """The suites of both masters, over all tables."""
    masters.Rig = Board
    lines = [life for table, (module, steps) in modbus_cases.LINES.items()
             for life in lives(table, module, list(settled(module, reachable(steps))))]
    both = {"pymodbus": pymodbus_suite.Master, "mbpoll": mbpoll_suite.Master}
    for name, master in both.items():
        helper = None if master is pymodbus_suite.Master else pymodbus_suite.Master
        for suite in masters.drive(name, master, helper, lines):
            if any(word in suite[0] for word in words or [""]):
                yield suite


def judge(suite):
    """Runs a suite; returns its line and its failures."""
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
    """Returns the exit code."""
    Board.images = os.path.abspath(images)
    failed, chosen = 0, list(suites(words))
    with concurrent.futures.ThreadPoolExecutor(WORKERS) as pool:
        for line, failures in pool.map(judge, chosen):
            print("\n".join([line, *failures[:SHOWN]]), flush=True)
            failed += len(failures)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
