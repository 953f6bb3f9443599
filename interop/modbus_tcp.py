"""What the suite of the Modbus TCP server needs: simulated modules, the daemon in front of them,
and three masters by others."""

import json
import os
import re
import socket
import struct
import subprocess
import tempfile
import time

from pymodbus.client import ModbusTcpClient

import libmodbus_suite
import mbpoll_suite
import pymodbus_suite
from judge.daemon import Daemon
from modbus_cases import SILENT, Ask
from rig import HOST, Tally, free_port, target

PROGRAM = target() / "debug/railbus"
# How long anything may take that must happen, in seconds.
PATIENCE = 60.0
# How long masters wait for an answer; mbpoll takes no more.
ANSWER = 10.0
# How often something that must happen is looked for.
APART = 0.02
# From this age on a value is stale where modules fall silent, in seconds.
MAX_AGE = 2

# The modules by name: unit, and where their outputs begin and how many there are.
UNITS = {
    "hall": (1, 0, 4),
    "gate": (2, 0, 8),
    "oven": (3, 60, 8),
    "yard": (4, 0, 20),
    "tank": (5, 8, 2),
    "door": (6, 0, 8),
}

# Modules that take their time: the daemon waits twice as long for an answer as one took so far, and
# what is left of that is for a machine that does not get round to the simulator.
PLANT = """
[line.main]
port = "pty:{line}"
baud = 19200

[module.hall]
line = "main"
model = "eda9060a"
address = 1
{poll}
[module.hall.sim]
{slow}
inputs = {{ di0 = 1, di1 = 0, di2 = 0, di3 = 1 }}

[module.gate]
line = "main"
model = "eda9050"
address = 2
protocol = "lc02"
{poll}
sim = {{ {slow} }}

[module.oven]
line = "main"
model = "erc8"
address = 3
{poll}
sim = {{ {slow} }}

[module.yard]
line = "main"
model = "r55"
address = 4
baud = 9600
outputs = 20
{poll}
sim = {{ {slow} }}

[module.tank]
line = "main"
model = "emd2a2q"
address = 5
{poll}
[module.tank.sim]
{slow}
inputs = {{ ai1 = 8.71, ai2 = 1.23 }}

[module.tank.point.ai2.range]
signal = "0-10V"
low = 0
high = 16
unit = "bar"
decimals = 1

[module.door]
line = "main"
model = "eda9050"
address = 6
protocol = "rtu"
{poll}
sim = {{ {slow} }}
"""
# How long they take, and how old a value may be; both less where modules fall silent, since one
# that was silent has to answer within 98 ms.
TURNAROUND, QUICK = "100ms", "30ms"
POLL = {
    TURNAROUND: 'poll = "300ms"\nmax_age = "10s"',
    QUICK: f'poll = "300ms"\nmax_age = "{MAX_AGE}s"',
}


def until(done, limit=PATIENCE):
    """Waits until this is true, or for so long; what it said last."""
    end = time.monotonic() + limit
    while not (said := done()) and time.monotonic() < end:
        time.sleep(APART)
    return said


class Simulator:
    """`railbus sim`, and its control socket."""

    def __init__(self, folder, config):
        self.folder, self.config = folder, config
        self.line, self.path = os.path.join(folder, "line"), os.path.join(folder, "control")
        self.process = self.control = self.answers = None

    def start(self):
        """Starts it and waits until its line is there."""
        self.process = subprocess.Popen(
            [PROGRAM, "sim", self.config, "--control", self.path],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL,
            env={**os.environ, "RAILBUS_LANG": "en"},
        )
        if not until(self._reached):
            raise RuntimeError("railbus sim does not start")

    def _reached(self):
        control = socket.socket(socket.AF_UNIX)
        try:
            control.connect(self.path)
        except OSError:
            control.close()
            return False
        control.settimeout(PATIENCE)
        self.control, self.answers = control, control.makefile("r", encoding="utf-8")
        return os.path.exists(self.line)

    def kill(self):
        """Ends it as a power failure would: the line is gone."""
        if self.process:
            self.process.kill()
            self.process.wait()
            self.answers.close()
            self.control.close()
            self.process = None

    def do(self, order):
        """Gives it an order; its answer."""
        self.control.sendall(f"{order}\n".encode())
        answer = self.answers.readline().strip()
        if not answer or answer.startswith("error"):
            raise RuntimeError(f"sim, `{order}`: {answer}")
        return answer

    def outputs(self, module):
        """The relays of a module, whatever it reports."""
        return [int(bit) for bit in re.search(r"outputs ([01]+)", self.do(f"show {module}"))[1]]


class Plant:
    """Simulated modules, and a daemon that serves them. `outlets` are the settings of its Modbus
    TCP servers by name, `more` is appended to the configuration; `tally` is for all checks."""

    table = "Modbus TCP"
    # What all of its outlets have.
    kind = {"type": "modbus_tcp"}

    def __init__(self, more="", turnaround=TURNAROUND, **outlets):
        self.tally = Tally(self.table)
        self.folder = tempfile.TemporaryDirectory(prefix="railbus-interop-")
        self.ports, self.held = {}, []
        line = os.path.join(self.folder.name, "line")
        text = self.modules(line, turnaround) + more
        for name, settings in outlets.items():
            held, self.ports[name] = free_port()
            self.held.append(held)
            text += f"\n[outlet.{name}]\n"
            settings = self.kind | {"listen": f"{HOST}:{self.ports[name]}"} | settings
            text += "".join(f"{key} = {json.dumps(value)}\n" for key, value in settings.items())
        self.daemon = Daemon(self.folder.name, text)
        self.sim = Simulator(self.folder.name, self.simulated(turnaround))

    def modules(self, line, turnaround):
        """The configuration of line and modules."""
        slow = f'turnaround = "{turnaround}"'
        return PLANT.format(line=line, slow=slow, poll=POLL[turnaround])

    def simulated(self, _turnaround):
        """The file with what is simulated: what the daemon has."""
        return self.daemon.config

    def __enter__(self):
        try:
            self.sim.start()
            self.daemon.start()
            self.settle(next(iter(self.ports)))
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        self.daemon.close()
        self.sim.kill()
        for held in self.held:
            held.close()
        self.folder.cleanup()

    def settle(self, outlet):
        """Waits until every point is good, for the API and then also for masters: what happens at
        the site is told them 20 times a second."""
        good = lambda: all(point["quality"] == "good" for point in self.points().values())
        if not until(good):
            raise RuntimeError("the modules are not read")
        # Quality 0, or no such unit.
        known = lambda client, unit: client.ask(unit, 4, 0, 64, 0, 1) in ("04 02 00 00", "84 0a")
        with self.client(outlet) as client:
            if not until(lambda: all(known(client, unit) for unit, _, _ in UNITS.values())):
                raise RuntimeError("masters are not told of the modules")

    def points(self):
        """All points as the API has them."""
        _, answer = self.daemon.ask("GET", "/points")
        return {point["path"]: point for point in answer["points"]}

    def outputs(self, module):
        """The outputs of a module as the API has them."""
        points = self.points().values()
        found = [p for p in points if p["module"] == module and p["kind"] == "output"]
        return [int(p["value"]) for p in sorted(found, key=lambda p: p["index"])]

    def silences(self, module):
        """How often a module did not answer any more, as the daemon has it."""
        _, answer = self.daemon.ask("GET", "/events?limit=500")
        gone = [(item.get("module"), item["code"]) for item in answer["items"]]
        return gone.count((module, "module_offline"))

    def check(self, entries, got, want, what=""):
        """Counts."""
        self.tally.check(entries, got, want, what)

    def relays(self, entries, module, want):
        """The simulator and the API both have these outputs."""
        self.check(entries, self.sim.outputs(module), want, f"{module} in the simulator")
        self.check(entries, self.outputs(module), want, f"{module} in the API")

    def client(self, outlet):
        """A connection of our own."""
        return Client(self.ports[outlet])


class Pymodbus(pymodbus_suite.Master):
    """pymodbus, which itself compares transaction and unit."""

    def open(self, port):
        return ModbusTcpClient(HOST, port=port, retries=0, trace_packet=self._packet)


class Libmodbus(libmodbus_suite.Master):
    """libmodbus."""

    def open(self, _rate):
        said = self._say(f"tcp {HOST} {self.port}")
        if said != "done":
            raise ConnectionError(said)


class Mbpoll(mbpoll_suite.Master):
    """mbpoll."""

    def where(self):
        return ["-m", "tcp", "-p", str(self.port)], HOST


MASTERS = {"pymodbus": Pymodbus, "libmodbus": Libmodbus, "mbpoll": Mbpoll}


def ask(master, unit, fc, at, arg):
    """The outcome of a request: values, `done`, or `exception N`."""
    return master.request(unit, Ask("", fc, at, arg, None), ANSWER)


class Client:
    """A connection of our own, which sends any bytes."""

    def __init__(self, port):
        self.socket = socket.create_connection((HOST, port), PATIENCE)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.rest, self.transaction = b"", 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Closes it."""
        self.socket.close()

    def send(self, data):
        """Sends bytes."""
        self.socket.sendall(data)

    def begin(self, unit, *pdu):
        """Sends a request; its transaction."""
        self.transaction = (self.transaction + 1) % 65536
        self.send(message(self.transaction, unit, *pdu))
        return self.transaction

    def next(self):
        """The next answer: transaction, unit, and what follows; None if the server has closed
        the connection, SILENT if it says nothing."""
        while True:
            if len(self.rest) >= 6:
                transaction, protocol, size = struct.unpack(">HHH", self.rest[:6])
                if protocol or not 2 < size < 255:
                    raise ValueError(f"no Modbus TCP: {self.rest.hex(' ')}")
                if len(self.rest) >= 6 + size:
                    whole, self.rest = self.rest[6:6 + size], self.rest[6 + size:]
                    return transaction, whole[0], whole[1:].hex(" ")
            try:
                more = self.socket.recv(4096)
            except TimeoutError:
                return SILENT
            except ConnectionResetError:
                more = b""
            if not more:
                return None if not self.rest else ("in the middle", self.rest.hex(" "))
            self.rest += more

    def ask(self, unit, *pdu):
        """A request and what its answer says, in hexadecimal. Another request's answer is none."""
        asked = (self.begin(unit, *pdu), unit)
        answer = self.next()
        fits = answer not in (None, SILENT) and answer[:2] == asked
        return answer[2] if fits else f"not for {asked}: {answer}"


def message(transaction, unit, *pdu):
    """A message of Modbus TCP."""
    return struct.pack(">HHHB", transaction, 0, 1 + len(pdu), unit) + bytes(pdu)


def words(*values):
    """Numbers as bytes of a request."""
    return struct.pack(f">{len(values)}H", *values)
