"""railbus as the master of third-party slaves, with libmodbus and pymodbus."""

import contextlib
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

from rig import target

HERE = pathlib.Path(__file__).parent
PROGRAM = target() / "debug/railbus"

# The commands, in turn: the model that the slave is configured as, the arguments, and the expected
# result.
STEPS = (
    ("erc8", ["get", "erc8.k1"], {"erc8.k1": False}),
    ("erc8", ["set", "erc8.k1", "on"], {"erc8.k1": (True, "readback")}),
    ("erc8", ["get", "erc8.k1", "erc8.k2"], {"erc8.k1": True, "erc8.k2": False}),
    ("erc8", ["set", "erc8", "all=on"], {"erc8.k8": (True, "readback")}),
    ("erc8", ["set", "erc8", "2,3=off"], {"erc8.k2": (False, "readback")}),
    ("erc8", ["get", "erc8"], {"erc8.k1": True, "erc8.k2": False, "erc8.k8": True}),
    ("emd2a2q", ["get", "emd2a2q"], {"emd2a2q.ai1": 8.71, "emd2a2q.ai2": 1.23}),
    ("emd2a2q", ["set", "emd2a2q.k2", "on"], {"emd2a2q.k2": (True, "readback")}),
    ("emd2a2q", ["get", "emd2a2q"], {"emd2a2q.k1": False, "emd2a2q.k2": True}),
)


@contextlib.contextmanager
def cable(folder):
    """Two ends of a wire."""
    ends = [os.path.join(folder, name) for name in ("master", "slave")]
    flags = [f"pty,raw,echo=0,link={end}" for end in ends]
    process = subprocess.Popen(["socat", *flags])
    try:
        for _ in range(100):
            if all(os.path.exists(end) for end in ends):
                break
            time.sleep(0.05)
        yield ends
    finally:
        process.terminate()
        process.wait(5)


def libmodbus(folder):
    """How to start the libmodbus slave."""
    found = subprocess.run(
        ["pkg-config", "--cflags", "--libs", "libmodbus"],
        capture_output=True, text=True, check=True,
    )
    program = os.path.join(folder, "slave-program")
    command = ["gcc", "-Wall", "-Wextra", "-o", program, HERE / "slave.c", *found.stdout.split()]
    subprocess.run(command, check=True)
    return [program]


def pymodbus(_):
    """How to start the pymodbus slave."""
    return [sys.executable, HERE / "slave.py"]


def told(answer):
    """What railbus reports for each point: its value, or value and confirmation of a write."""
    points = {point["path"]: point["value"] for point in answer.get("points", [])}
    writes = answer.get("set", [])
    return points | {write["path"]: (write["value"], write["confirmed"]) for write in writes}


class Tally:
    """One slave and the result of all steps, in the form of the other suites."""

    table, open, covered, inexpressible = "", frozenset(), frozenset(), frozenset()

    def __init__(self, slave):
        self.passed, self.failures = 0, []
        with tempfile.TemporaryDirectory(prefix="railbus-interop-") as folder:
            command = slave(folder)
            with cable(folder) as (master, end):
                process = subprocess.Popen([*command, end], stdout=subprocess.PIPE, text=True)
                try:
                    process.stdout.readline()
                    # pymodbus opens the port of a server after it has printed that it did.
                    time.sleep(1)
                    self.run(master)
                finally:
                    process.kill()
                    process.wait(5)

    def run(self, port):
        """All steps."""
        for model, words, wanted in STEPS:
            flags = ["--direct", "-l", f"pty:{port}", "-m", model, "-a", "3", "-o", "json"]
            ran = subprocess.run(
                [PROGRAM, *flags, *words], capture_output=True, text=True, check=False
            )
            got = told(json.loads(ran.stdout)) if ran.stdout else {}
            for path, value in wanted.items():
                if got.get(path) == value:
                    self.passed += 1
                else:
                    said = " ".join(words)
                    self.failures.append(f"{said}: {path} {got.get(path)!r}, {ran.stderr[-300:]}")


SUITES = [
    (f"railbus, slave of {slave.__name__}", lambda slave=slave: Tally(slave))
    for slave in (libmodbus, pymodbus)
]
