"""libmodbus against every module with Modbus RTU, through `libmodbus_suite.c`."""

import pathlib
import subprocess

import pymodbus_suite
from masters import drive
from modbus_cases import Raw, Wire
from rig import target

SOURCE = pathlib.Path(__file__).with_suffix(".c")
PROGRAM = target() / "libmodbus_suite"

# The highest unit that modbus_set_slave accepts; replies from higher ones are not received.
UNIT_MAX = 247


def build():
    """Compiles the program."""
    found = subprocess.run(
        ["pkg-config", "--cflags", "--libs", "libmodbus"],
        capture_output=True, text=True, check=True,
    )
    PROGRAM.parent.mkdir(parents=True, exist_ok=True)
    command = ["gcc", "-Wall", "-Wextra", "-o", PROGRAM, SOURCE, *found.stdout.split()]
    subprocess.run(command, check=True)


class Master:
    """libmodbus on a port."""

    def __init__(self, port):
        self.port = port
        self.timeout = None
        self.process = subprocess.Popen(
            [PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.open(9600)

    def open(self, rate):
        """Opens the port."""
        self._say(f"open {self.port} {rate}")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.stdin.close()
        self.process.wait(5)
        self.process.stdout.close()

    def speed(self, rate):
        """Changes the speed."""
        self._say("close")
        self.open(rate)
        self.timeout = None

    def can(self, unit, step):
        """Whether it can send this: it always sends whole frames with a correct CRC."""
        return unit <= UNIT_MAX and not isinstance(step, Wire)

    def request(self, unit, step, timeout):
        """Sends a request and returns the outcome."""
        if timeout != self.timeout:
            self._say(f"timeout {int(1000 * timeout)}")
            self.timeout = timeout
        answer = self._say(self._request(unit, step))
        word, *values = answer.split()
        return [int(value) for value in values] if word == "values" else answer

    def _request(self, unit, step):
        if isinstance(step, Raw):
            return f"raw {unit} {step.pdu}"
        if isinstance(step.arg, int):
            return f"read {unit} {step.fc} {step.at} {step.arg}"
        return f"write {unit} {step.fc} {step.at} {' '.join(map(str, step.arg))}"

    def _say(self, text):
        self.process.stdin.write(text + "\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().strip()


SUITES = drive("libmodbus", Master, pymodbus_suite.Master)
