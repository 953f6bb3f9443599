"""`railbus sim --demo` itself: all third-party masters in turn, and all protocols on one wire."""

import os
import re
import signal
import subprocess
import tempfile
import time

import libmodbus_suite
import mbpoll_suite
import pymodbus_suite
from masters import PATIENCE
from modbus_cases import DONE, Ask
from plain import Port, Script, lc02, lc02_reply, r55, r55_reply, rtu, text
from rig import Tally, target

BINARY = target() / "debug/railbus"
MASTERS = {
    "pymodbus": pymodbus_suite.Master,
    "libmodbus": libmodbus_suite.Master,
    "mbpoll": mbpoll_suite.Master,
}
# Unit, first coil and outputs of the two modules that speak Modbus.
MODBUS = {"oven": (3, 60, 8), "tank": (5, 8, 2)}


# The longest silence that a module of the line needs before a request, the ERC-8's. Without it a
# Modbus module takes a request together with the previous reply of another module for one frame; a
# master that addresses one module after another has to leave that gap, and libmodbus does not.
GAP = 0.02
# How long nothing may arrive where nothing is allowed to.
SILENCE = 0.4


class Demo(Script):
    """The demo line, without a panel."""

    def __init__(self, folder):
        self.tally = Tally("demo line")
        self.path = os.path.join(folder, "line")
        if not BINARY.exists():
            raise FileNotFoundError("no railbus; run `cargo build`")
        self.process = subprocess.Popen(
            [BINARY, "sim", "--demo", "--pty", self.path, "--tcp", "127.0.0.1:0"],
            stdout=subprocess.DEVNULL,
        )
        deadline = time.monotonic() + 10
        while not os.path.exists(self.path):
            if self.process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError("railbus sim --demo does not start")
            time.sleep(0.02)
        self.port = Port(self.path)

    def __exit__(self, *_):
        self.port.close()
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(5)

    def ask(self, entries, request, reply=b""):
        """As in the base class, after the gap."""
        time.sleep(GAP)
        super().ask(entries, request, reply)

    def unwanted(self):
        """Without a panel, silence is decided by the clock. Bytes that arrive later are reported
        with the next reply, in front of it."""
        return self.port.hear(1, SILENCE)

    def shape(self, entries, request, count, pattern):
        """The reply must have this length and match this pattern: inputs move by themselves."""
        time.sleep(GAP)
        self.port.send(request)
        got = self.port.hear(count, PATIENCE)
        self.check(entries, bool(re.fullmatch(pattern, got, re.DOTALL)), True, got.hex(" "))


def demo():
    """The whole line."""
    with tempfile.TemporaryDirectory(prefix="railbus-interop-") as folder:
        with Demo(folder) as s:
            plainly(s)
            by_the_masters(s)
        s.check("a link that goes with the program", os.path.lexists(s.path), False, "the link")
    return s.tally


def plainly(s):
    """What the plain script sends."""
    s.ask("pump answers", text("$01M"), text("!019060"))
    s.shape("pump answers", text("$016"), 8, rb"!000[0-9A-F]00\r")
    s.ask("pump obeys", text("#010005"), text(">"))
    s.shape("pump obeys", text("$016"), 8, rb"!050[0-9A-F]00\r")
    s.ask("gate answers", lc02(2, 1), lc02_reply(2, 6, 0x90, 0x50, 0))
    s.ask("gate obeys", lc02(2, 4, 0xFF, 0xA5), lc02_reply(2))
    s.shape("gate obeys", lc02(2, 3), 7, rb"\x6C\x63\x02\xA5[\x00-\x7F].\x0D")
    s.ask("yard answers", r55(4, 0x10), r55_reply(4, 0x10))
    s.ask("yard obeys", r55(4, 0x13, 0x81), r55_reply(4, 0x13, 0x81))
    s.ask("oven answers", rtu(3, 1, 0, 60, 0, 8), rtu(3, 1, 1, 0))
    s.ask("oven obeys", rtu(3, 5, 0, 60, 0xFF, 0), rtu(3, 5, 0, 60, 0xFF, 0))
    s.ask("oven obeys", rtu(3, 1, 0, 60, 0, 8), rtu(3, 1, 1, 1))
    s.ask("tank answers", rtu(5, 1, 0, 8, 0, 2), rtu(5, 1, 1, 0))
    s.ask("tank obeys", rtu(5, 5, 0, 9, 0xFF, 0), rtu(5, 5, 0, 9, 0xFF, 0))
    s.ask("tank obeys", rtu(5, 1, 0, 8, 0, 2), rtu(5, 1, 1, 2))
    for word, request in {"ascii": text("$06M"), "lc02": lc02(6, 1), "r55": r55(6, 0x10),
                          "rtu": rtu(6, 1, 0, 0, 0, 8)}.items():
        s.ask(f"a module that is not there: silent in {word}", request)
    request, reply = r55(4, 0x10), r55_reply(4, 0x10, 0x81)
    began = time.monotonic()
    s.ask("no reply before the wire has carried it", request, reply)
    took, wire = time.monotonic() - began - GAP, 16 * 10 / 9600
    s.check("no reply before the wire has carried it", took >= wire, True, f"{took:.4f} s")
    s.port.speed(4800)
    s.port.send(r55(4, 0x10))
    s.check("another speed: silent", s.unwanted(), b"")
    s.port.speed(9600)
    s.ask("another speed: silent", request, reply)
    # The others were not affected by any of it.
    s.shape("pump obeys", text("$016"), 8, rb"!050[0-9A-F]00\r")


def by_the_masters(s):
    """Each master switches every output of the Modbus modules on and off."""
    for name, open_master in MASTERS.items():
        with open_master(s.path) as master:
            for module, (unit, first, count) in MODBUS.items():
                entry = f"{module} by {name}"
                time.sleep(GAP)
                for value in (1, 0):
                    for step in (
                        Ask(entry, 15, first, [value] * count, DONE),
                        Ask(entry, 1, first, count, [value] * count),
                    ):
                        s.check(entry, master.request(unit, step, PATIENCE), step.want, name)


SUITES = [("all, demo line", demo)]
