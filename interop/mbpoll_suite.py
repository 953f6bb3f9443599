"""mbpoll against every module with Modbus RTU: one process per request. It reads with FC01 to
FC04, writes one value with FC05 or FC06 and several with FC0F or FC10."""

import re
import subprocess

import pymodbus_suite
from masters import drive
from modbus_cases import DONE, SILENT, Ask, exception

_KINDS = {1: "0", 2: "1", 3: "4", 4: "3", 5: "0", 6: "4", 15: "0", 16: "4"}
_ERRORS = {
    "Illegal function": exception(1),
    "Illegal data address": exception(2),
    "Illegal data value": exception(3),
    "Slave device or server failure": exception(4),
    "Memory parity error": exception(8),
    "Slave device or server is busy": exception(6),
    "Gateway path unavailable": exception(10),
    "Target device failed to respond": exception(11),
    "Connection timed out": SILENT,
}


class Master:
    """mbpoll on a port."""

    def __init__(self, port):
        self.port = port
        self.rate = 9600

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def speed(self, rate):
        """Changes the speed."""
        self.rate = rate

    def where(self):
        """How it reaches the modules: its flags, and what it opens."""
        return ["-m", "rtu", "-P", "none", "-b", str(self.rate)], self.port

    def can(self, unit, step):
        """Whether it can send this."""
        if not isinstance(step, Ask) or not 1 <= unit <= 247:
            return False
        if isinstance(step.arg, int):
            return step.arg <= 125 and step.at + step.arg <= 65536
        return (len(step.arg) == 1) == (step.fc in (5, 6))

    def request(self, unit, step, timeout):
        """Sends a request and returns the outcome."""
        reads = isinstance(step.arg, int)
        count = step.arg if reads else 1
        values = [] if reads else [str(value) for value in step.arg]
        flags, port = self.where()
        run = subprocess.run(
            ["mbpoll", *flags, "-0", "-1",
             "-o", str(timeout), "-a", str(unit), "-t", _KINDS[step.fc], "-r", str(step.at),
             *(["-c", str(count)] if reads else []), port, *values],
            capture_output=True, text=True, timeout=20, check=False,
        )
        for words, meaning in _ERRORS.items():
            if words in run.stderr + run.stdout:
                return meaning
        if reads:
            found = re.findall(r"^\[\d+\]:\s+(\d+)", run.stdout, re.MULTILINE)
            if found:
                return [int(value) for value in found]
        elif f"Written {len(values)} references" in run.stdout:
            return DONE
        return run.stdout[-200:] + run.stderr


SUITES = drive("mbpoll", Master, pymodbus_suite.Master)
