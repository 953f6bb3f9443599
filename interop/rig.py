"""Simulated modules on a pseudo-terminal, and the tally of a suite's checks."""

import os
import pathlib
import socket
import subprocess
import tempfile

import tables
from modbus_cases import SILENT

ROOT = pathlib.Path(__file__).resolve().parent.parent
HOST = "127.0.0.1"


def target():
    """Cargo's target folder."""
    return ROOT / os.environ.get("CARGO_TARGET_DIR", "target")


def free_port():
    """A port that nobody else is given: the socket that stays bound to it without listening, and
    its number."""
    held = socket.socket()
    held.bind((HOST, 0))
    # A server that sets this as well can listen there.
    held.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    return held, held.getsockname()[1]


class Rig:
    """One line with modules on it: `Rig("name=oven,model=erc8,addr=3")`."""

    def __init__(self, *modules):
        self.folder = tempfile.TemporaryDirectory(prefix="railbus-interop-")
        self.port = os.path.join(self.folder.name, "line")
        program, options = self.command()
        flags = [word for module in modules for word in ("--module", module)]
        self.process = subprocess.Popen(
            [*program, self.port, *options, *flags],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        if self.process.stdout.readline() != "ok\n":
            raise RuntimeError(f"the rig does not start with {modules}")

    @classmethod
    def command(cls):
        """The program that serves the modules, and its arguments after the link's path."""
        return [target() / "interop-rig/debug/railbus-interop-rig"], []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.stdin.close()
        self.process.wait(5)
        self.process.stdout.close()
        self.folder.cleanup()

    def do(self, command):
        """Runs a command at a module, such as `power oven cycle`; returns the answer."""
        self.process.stdin.write(command + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline().split(None, 1)
        if not answer or answer[0] != "ok":
            raise RuntimeError(f"rig, `{command}`: {' '.join(answer).strip()}")
        return answer[1].strip() if len(answer) > 1 else ""

    def silence(self):
        """How many bytes come for what was sent last, after all its effects: it has arrived at
        the modules by then, and by their clock they had the time to answer."""
        return int(self.do("silence"))

    def after(self, got):
        """The outcome of a request. A master decides silence by its own clock; on a busy machine
        a request may still be on its way to a module then, and the next one would come right
        behind it."""
        if got != SILENT:
            return got
        said = self.silence()
        return f"{said} bytes, too late" if said else got

    def outputs(self, name):
        """The real state of a module's outputs, whatever it reports."""
        return int(self.do(f"outputs {name}"), 16)

    def pulses(self, name):
        """The pulses that have ended since the last call: (channel, milliseconds) each, in
        virtual time and exact."""
        began, ended = {}, []
        for change in self.do(f"changes {name}").split():
            at, channel, on = (int(word) for word in change.split(":"))
            if channel in began:
                ended.append((channel, (at - began.pop(channel)) / 1000))
            else:
                began[channel] = at
        return ended


# After this many failures a suite stops: each may cost a reply's timeout.
ENOUGH = 20


class GivenUp(Exception):
    """A suite has had too many failures to go on; its tally shows them."""

    def __init__(self, tally):
        super().__init__(f"gave up after {ENOUGH} failures")
        self.tally = tally


class Tally:
    """What one suite has checked against one table."""

    def __init__(self, table):
        self.table = table
        self.open = set(tables.entries(table))
        self.covered = set()
        self.inexpressible = set()
        self.passed = 0
        self.failures = []

    def check(self, entries, got, want, what=""):
        """One check that covers these entries, given as a line of the table or several."""
        entries = self._known(entries)
        self.covered |= entries
        if got == want:
            self.passed += 1
        else:
            names = " / ".join(sorted(entries)) or "on the way"
            self.failures.append(f"{names}: {what} gave {got!r}, not {want!r}")
            if len(self.failures) == ENOUGH:
                raise GivenUp(self)

    def cannot(self, entries):
        """The master has no way to send this."""
        self.inexpressible |= self._known(entries)

    def _known(self, lines):
        lines = [lines] if isinstance(lines, str) else lines
        entries = {entry for line in lines for entry in tables.expand(line) if entry}
        if not entries <= self.open:
            raise KeyError(f"no entries of {self.table}: {sorted(entries - self.open)}")
        return entries
