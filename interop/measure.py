"""What docs/performance.md has of the gateways, measured with the daemon in RAILBUS:

    RAILBUS=target/release/railbus python3 interop/measure.py line
    RAILBUS=target/release/railbus python3 interop/measure.py replay [COUNT]
    RAILBUS=target/release/railbus python3 interop/measure.py births
    RAILBUS=target/release/railbus python3 interop/measure.py past [COUNT]
    RAILBUS=target/release/railbus python3 interop/measure.py flood
    RAILBUS=target/release/railbus python3 interop/measure.py stale
    RAILBUS=target/release/railbus python3 interop/measure.py writes

`line`: reads of a foreign master through the Modbus gateway to a line, and by itself on the same
line. `replay`: an outage of 72 hours, brought to a receiver of mosquitto (needs paho-mqtt, as all
that follow but `flood`). `births`: 250 modules of a Sparkplug node. `past`: an outage of 72 hours
in Sparkplug. `flood`: 10,000 changes a second, told over MQTT and OPC UA (needs asyncua, as `stale`
and `writes`). `stale`: how soon others are told that a value is too old. `writes`: how long a write
takes over OPC UA, over HTTP, and on the line by itself. MBUSD names mbusd, which is not in Debian,
for `line`."""

import asyncio
import datetime
import json
import os
import random
import sqlite3
import subprocess
import sys
import tempfile
import termios
import threading
import time
import tty

from checksums import crc, total
from modbus_line_suite import Site
from modbus_tcp import Client, PATIENCE, until
from rig import free_port

READS, FLOOR_READS = 300, 150
# Two registers of a module at 9600, which takes 5 ms: 8 and 9 characters of 10 bits.
WIRE_MS = 17 * 10 / 9.6 + 5
UNIT = 5
COUNT = 2_592_000
HOURS = 72

LINE = """
[line.main]
port = "pty:{line}"
baud = 9600

[module.hall]
line = "main"
model = "eda9060a"
address = 1
poll = "1s"
sim = {{ turnaround = "5ms" }}

[module.oven]
line = "main"
model = "erc8"
address = 3
poll = "1s"
sim = {{ turnaround = "5ms" }}

[module.tank]
line = "main"
model = "emd2a2q"
address = 5
poll = "1s"
sim = {{ turnaround = "5ms", inputs = {{ ai1 = 8.71 }} }}

[module.dead]
line = "main"
model = "erc8"
address = 9
poll = "1s"
sim = {{ turnaround = "5ms" }}
"""


class FastSite(Site):
    """A line at 9600 with four modules."""

    def modules(self, line, turnaround):
        return LINE.format(line=line)

    def simulated(self, turnaround):
        plant = os.path.join(self.folder.name, "plant.toml")
        with open(plant, "w", encoding="utf-8") as file:
            file.write(self.modules(os.path.join(self.folder.name, "line"), turnaround))
        return plant


def row(name, times, exceptions=0):
    """A row of the table."""
    times = sorted(each * 1000 for each in times)
    at = lambda part: times[min(int(len(times) * part), len(times) - 1)]
    shown = " | ".join(f"{each:.1f}" for each in (at(0.5), at(0.9), at(0.99), times[-1]))
    print(f"| {name} | {len(times)} | {shown} | {exceptions} |", flush=True)


def apart():
    """A pause as a master has it: not in step with anything."""
    time.sleep(random.uniform(0.02, 0.06))


def through(port):
    """Reads through the gateway; the times, and how many exceptions there were."""
    times, exceptions = [], 0
    with Client(port) as client:
        while len(times) < READS:
            began = time.monotonic()
            client.begin(UNIT, 3, 0, 0, 0, 2)
            _, _, pdu = client.next()
            took = time.monotonic() - began
            if pdu.startswith("83"):
                exceptions += 1
            times.append(took)
            apart()
    return times, exceptions


def beside_dead(port):
    """The same while another client reads a module without power."""
    stop = threading.Event()

    def other():
        with Client(port) as client:
            while not stop.wait(0.005):
                client.begin(9, 3, 0, 0, 0, 2)
                client.next()

    beside = threading.Thread(target=other)
    beside.start()
    told = through(port)
    stop.set()
    beside.join()
    return told


def by_itself(path, speed, exchanges):
    """The times of exchanges on the line itself, without railbus. An exchange is its requests, each
    as the silence before it in milliseconds, its bytes, and the length of the reply."""
    line = os.open(path, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(line)
    attributes = termios.tcgetattr(line)
    attributes[4] = attributes[5] = speed
    termios.tcsetattr(line, termios.TCSANOW, attributes)
    times = []
    for exchange in exchanges:
        began = time.monotonic()
        for silence_ms, request, length in exchange:
            time.sleep(silence_ms / 1000)
            os.write(line, request + crc(request))
            got = b""
            while len(got) < length:
                got += os.read(line, 256)
        times.append(time.monotonic() - began)
        apart()
    os.close(line)
    return times


def measure_line():
    """The Modbus gateway to a line."""
    print(f"the wire takes {WIRE_MS:.1f} ms")
    print("| reads | number | median, ms | p90 | p99 | most | exceptions |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    with FastSite(scada={}) as site:
        [port] = site.ports.values()
        site.settle()
        row("gateway", *through(port))
        site.sim.do("power dead off")
        row("gateway, beside a dead unit", *beside_dead(port))
        site.daemon.close()
        site.sim.do("power dead on")
        line = os.path.join(site.folder.name, "line")
        read = [(0, bytes([UNIT, 3, 0, 0, 0, 2]), 9)]
        row("floor", by_itself(line, termios.B9600, [read] * FLOOR_READS))
        if os.environ.get("MBUSD"):
            by_mbusd(site, line)


def by_mbusd(site, line):
    """The same through mbusd, which has the line for itself, tuned for few retries."""
    held, port = free_port()
    mbusd = subprocess.Popen([os.environ["MBUSD"], "-d", "-L", "-", "-v", "0", "-p", line, "-s",
                              "9600", "-m", "8n1", "-A", "127.0.0.1", "-P", str(port), "-N", "0",
                              "-W", "100", "-R", "5"])
    time.sleep(1)
    row("mbusd", *through(port))
    site.sim.do("power dead off")
    row("mbusd, beside a dead unit", *beside_dead(port))
    mbusd.kill()
    mbusd.wait()


def measure_replay(count):
    """An outage of 72 hours."""
    import paho.mqtt.client as paho
    from mqtt import Broker, Plant

    broker = Broker()
    # The receiver below is one process with the same two cores.
    with open(broker.config, "a", encoding="utf-8") as config:
        config.write("max_queued_messages 0\n")
    broker.kill()
    broker.start()
    site = Plant(broker, "5", replay_days=90)
    site.sim.start()
    site.daemon.start()
    file = site.daemon.folder / "state" / "mqtt-scada.outbox.db"
    if not until(lambda: file.exists() and site.outlet()["queue"] > 0):
        raise RuntimeError("nothing is kept")
    site.daemon.process.terminate()
    site.daemon.process.wait()
    fill(file, count)
    size = file.stat().st_size
    got = {"number": 0, "next": None, "lost": 0, "doubled": 0}

    def take(_client, _data, message):
        told = json.loads(message.payload)
        first, length = told["seq"], len(told["readings"])
        if got["next"] is None:
            got["next"], got["began"] = first, time.monotonic()
        got["lost"] += max(first - got["next"], 0)
        got["doubled"] += max(got["next"] - first, 0)
        got["number"] += length
        got["next"], got["ended"] = first + length, time.monotonic()

    receiver = paho.Client(paho.CallbackAPIVersion.VERSION2, protocol=paho.MQTTv5)
    receiver.on_message = take
    receiver.connect("127.0.0.1", broker.port)
    receiver.subscribe("railbus/plant/batch", qos=1)
    receiver.loop_start()
    site.daemon.start()
    end = time.monotonic() + 10 * PATIENCE
    while got["number"] < count and time.monotonic() < end:
        time.sleep(0.1)
    used = cpu(site.daemon.process.pid)
    took = got["ended"] - got["began"]
    print(f"{got['number']} changes in {took:.1f} s, {got['lost']} lost, {got['doubled']} doubled; "
          f"{used:.1f} s of a core; {size / count:.0f} bytes each on the disk")
    receiver.loop_stop()
    site.daemon.close()
    site.sim.kill()
    broker.close()


class Node:
    """A Sparkplug node with modules on several lines, and a receiver of all that it publishes."""

    def __init__(self, lines, each, **settings):
        import paho.mqtt.client as paho
        from judge.daemon import Daemon
        from modbus_tcp import Simulator
        from mqtt import Broker

        self.folder = tempfile.TemporaryDirectory(prefix="railbus-measure-")
        self.broker = Broker()
        with open(self.broker.config, "a", encoding="utf-8") as config:
            config.write("max_queued_messages 0\n")
        self.broker.kill()
        self.broker.start()
        name = lambda nth: "line" if nth == 0 else f"line{nth}"
        text = "".join(f'[line.{name(nth)}]\nport = "pty:{self.folder.name}/{name(nth)}"\n'
                       "baud = 9600\n" for nth in range(lines))
        text += "".join(f'[module.m{nth}x{address}]\nline = "{name(nth)}"\nmodel = "erc8"\n'
                        f'address = {address}\npoll = "5s"\nmax_age = "60s"\n'
                        for nth in range(lines) for address in range(1, each + 1))
        told = {"type": "sparkplug", "port": self.broker.port, "node": "n", **settings}
        text += "[outlet.plant]\n"
        text += "".join(f"{key} = {json.dumps(value)}\n" for key, value in told.items())
        self.daemon = Daemon(self.folder.name, text)
        self.sim = Simulator(self.folder.name, self.daemon.config)
        self.sim.start()
        self.got, self.receiver = [], paho.Client(paho.CallbackAPIVersion.VERSION2)
        self.receiver.on_message = lambda _client, _data, message: self.take(message)
        # Also after it has lost the broker.
        self.receiver.on_connect = lambda client, *_: client.subscribe("spBv1.0/railbus/#", qos=0)
        self.receiver.reconnect_delay_set(0.1, 0.2)
        self.receiver.connect("127.0.0.1", self.broker.port)
        self.receiver.loop_start()
        self.daemon.start()

    def take(self, message):
        """A message came."""
        self.got.append((time.monotonic(), message.topic.split("/")[2], len(message.payload)))

    def outlet(self):
        """How the outlet does."""
        _, answer = self.daemon.ask("GET", "/outlets")
        [found] = [each for each in answer["outlets"] if each["outlet"] == "plant"]
        return found

    def births(self, since):
        """When births of modules came."""
        return [at for at, kind, _ in self.got if kind == "DBIRTH" and at > since]

    def close(self):
        """Ends all."""
        self.receiver.loop_stop()
        self.daemon.close()
        self.sim.kill()
        self.broker.close()


def measure_births():
    """250 modules, asked for again and connected again."""
    lines, each = 10, 25
    node = Node(lines, each)
    count = lines * each
    if not until(lambda: len(node.births(0)) >= count):
        raise RuntimeError(f"{len(node.births(0))} modules are born")
    # `Node Control/Rebirth` = true.
    name = b"Node Control/Rebirth"
    metric = b"\x0a" + bytes([len(name)]) + name + b"\x20\x0b\x70\x01"
    rebirth = b"\x12" + bytes([len(metric)]) + metric
    for what in ("rebirth",) * 3 + ("connection",) * 3:
        time.sleep(1)
        began = time.monotonic()
        if what == "rebirth":
            node.receiver.publish("spBv1.0/railbus/NCMD/n", rebirth)
        else:
            node.broker.kill()
            node.broker.start()
        if not until(lambda: len(node.births(began)) >= count):
            raise RuntimeError(f"{what}: {len(node.births(began))} births")
        births = node.births(began)
        nbirth = next(at for at, kind, _ in node.got if kind == "NBIRTH" and at > began)
        size = sum(size for at, _, size in node.got if at >= nbirth)
        print(f"{what}: {count} births {(births[count - 1] - began) * 1000:.0f} ms after it was "
              f"asked for, {(births[count - 1] - nbirth) * 1000:.0f} ms after NBIRTH; "
              f"{size // 1000} kB")
    node.close()


def measure_past(count):
    """An outage of 72 hours in Sparkplug."""
    node = Node(1, 3, replay_days=90)
    file = node.daemon.folder / "state" / "sparkplug-plant.outbox.db"
    if not until(lambda: file.exists() and len(node.births(0)) >= 3):
        raise RuntimeError("nothing is kept")
    time.sleep(3)
    node.daemon.process.terminate()
    node.daemon.process.wait()
    fill(file, count)
    began = time.monotonic()
    node.daemon.start()
    end = began + 10 * PATIENCE
    while time.monotonic() < end:
        time.sleep(0.1)
        if len(node.births(began)) >= 3 and node.outlet()["queue"] == 0:
            break
    data = [(at, size) for at, kind, size in node.got if kind == "DDATA" and at > began]
    took = data[-1][0] - node.births(began)[0]
    print(f"{count} changes in {len(data)} messages, {sum(size for _, size in data) // 1_000_000} "
          f"MB, {took:.1f} s; {cpu(node.daemon.process.pid):.1f} s of a core; "
          f"{node.outlet()['queue']} wait")
    node.close()


# Boards on lines of their own, with 32 relays each that are all switched before every poll.
BOARDS, RELAYS, POLLS_S = 32, 32, 10
FLOOD_S, WARM_UP_S = 20, 5


class Flood:
    """Boards behind TCP whose relays are all other ones each time that they are read."""

    def __init__(self):
        self.ports, self.reads = [], 0
        self.is_there = threading.Event()
        threading.Thread(target=lambda: asyncio.run(self._run()), daemon=True).start()
        self.is_there.wait()

    async def _run(self):
        servers = [await asyncio.start_server(self._serve, "127.0.0.1", 0) for _ in range(BOARDS)]
        self.ports = [server.sockets[0].getsockname()[1] for server in servers]
        self.is_there.set()
        await asyncio.Event().wait()

    async def _serve(self, reader, writer):
        relays = 0
        try:
            while True:
                request = await reader.readexactly(8)
                relays ^= 0xFFFFFFFF
                self.reads += 1
                reply = bytes([0x22, *request[1:3]]) + relays.to_bytes(4, "big")
                writer.write(reply + bytes([total(reply)]))
        except (asyncio.IncompleteReadError, OSError):
            writer.close()

    def site(self):
        """The configuration of its boards."""
        return "".join(
            f'[line.l{nth}]\nport = "tcp:127.0.0.1:{port}"\n[module.b{nth}]\nline = "l{nth}"\n'
            f'model = "r55"\naddress = 1\noutputs = {RELAYS}\ninputs = 0\n'
            f'poll = "{1000 // POLLS_S}ms"\nmax_age = "10s"\n'
            for nth, port in enumerate(self.ports))


class Counted:
    """A subscriber of mosquitto that only counts its messages."""

    def __init__(self, broker, topic):
        command = ["mosquitto_sub", *broker.words(), "-V", "mqttv5", "-q", "1", "-t", topic]
        self.process = subprocess.Popen([*command, "-F", "."], stdout=subprocess.PIPE)
        self.count = 0
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self):
        while data := os.read(self.process.stdout.fileno(), 1 << 16):
            self.count += data.count(b"\n")

    def close(self):
        """Ends it."""
        self.process.kill()
        self.process.wait()


class OverNothing:
    """Nobody who is told of the flood."""

    settings, pid, values = None, None, 0

    def begin(self, names):
        """The daemon serves these points."""

    def close(self):
        """Ends it."""


class OverMqtt:
    """A broker and subscribers that are told of it."""

    def __init__(self, **more):
        from mqtt import Broker

        self.broker = Broker()
        self.broker.kill()
        with open(self.broker.config, "a", encoding="utf-8") as config:
            config.write("max_queued_messages 0\n")
        self.broker.start()
        self.settings = {"type": "mqtt", **self.broker.settings(), "version": "5", "site": "plant",
                         **more}
        self.states, self.batches = (Counted(self.broker, f"railbus/plant/{topic}")
                                     for topic in ("+/+/state", "batch"))

    def begin(self, names):
        """The daemon serves these points."""

    @property
    def pid(self):
        """The process that takes the messages."""
        return self.broker.process.pid

    @property
    def values(self):
        """How many values came."""
        return self.states.count

    def close(self):
        """Ends it."""
        print(f"batches: {self.batches.count}")
        self.states.close()
        self.batches.close()
        self.broker.close()


class OverOpcua:
    """A client with 1,000 monitored items, sampled and published every 100 ms."""

    ITEMS, PERIOD_MS = 1000, 100

    def __init__(self):
        self.held, self.port = free_port()
        self.settings = {"type": "opcua", "listen": f"127.0.0.1:{self.port}", "anonymous": True}
        self.pid, self.values, self.session = os.getpid(), 0, None

    def begin(self, names):
        """The daemon serves these points."""
        import opcua

        self.session = opcua.Session(self.port, timeout=PATIENCE)
        told = self.session.watch(*names[:self.ITEMS], interval=float(self.PERIOD_MS),
                                  period=self.PERIOD_MS, filtered=True, told=self)
        if told.refused:
            raise RuntimeError(f"refused: {told.refused}")

    def datachange_notification(self, _node, _value, _data):
        """Called by asyncua."""
        self.values += 1

    def status_change_notification(self, status):
        """Called by asyncua."""
        raise RuntimeError(f"the subscription has ended: {status}")

    def close(self):
        """Ends it."""
        self.session.close()


class BarePublisher:
    """`mosquitto_pub` with as many messages a second as there are changes, which is not more than
    a client of MQTT that publishes."""

    def __init__(self):
        self.over = OverMqtt()
        self.process = subprocess.Popen(
            ["mosquitto_pub", *self.over.broker.words(), "-V", "mqttv5", "-q", "1", "-l", "-t",
             "railbus/plant/b0/k1/state"], stdin=subprocess.PIPE)
        self.is_over = False
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self):
        began, sent, a_second = time.monotonic(), 0, BOARDS * RELAYS * POLLS_S
        while not self.is_over:
            due = int((time.monotonic() - began) * a_second)
            self.process.stdin.write(b"ON\n" * (due - sent))
            self.process.stdin.flush()
            sent = due
            time.sleep(1 / POLLS_S)

    def measure(self):
        """A row."""
        time.sleep(WARM_UP_S)
        look = lambda: (time.monotonic(), self.over.values, cpu(self.process.pid),
                        cpu(self.over.pid))
        before = look()
        time.sleep(FLOOD_S)
        took, values, used, of_broker = (b - a for a, b in zip(before, look()))
        print(f"| `mosquitto_pub -l`, no railbus | 0 | 0 | {values / took:,.0f} | "
              f"{100 * used / took:.1f} % | {100 * of_broker / took:.1f} % |", flush=True)
        self.is_over = True
        self.process.kill()
        self.process.wait()
        self.over.close()


def measure_flood():
    """10,000 changes a second, told to nobody and over each outlet."""
    print("| outlet | reads/s | changes/s | values told/s | daemon, of a core | broker or client |")
    print("| --- | --- | --- | --- | --- | --- |")
    flooded("none", OverNothing())
    flooded("MQTT", OverMqtt())
    flooded("MQTT, `replay_days`", OverMqtt(replay_days=1))
    flooded("OPC UA", OverOpcua())
    BarePublisher().measure()


def flooded(name, over):
    """One row of it."""
    from judge.daemon import Daemon

    flood = Flood()
    text = flood.site()
    if over.settings:
        text += "[outlet.scada]\n"
        text += "".join(f"{key} = {json.dumps(value)}\n" for key, value in over.settings.items())
    folder = tempfile.TemporaryDirectory(prefix="railbus-measure-")
    daemon = Daemon(folder.name, text)
    daemon.start()
    over.begin([f"b{nth}.k{relay}" for nth in range(BOARDS) for relay in range(1, RELAYS + 1)])
    time.sleep(WARM_UP_S)
    look = lambda: (time.monotonic(), flood.reads, over.values, cpu(daemon.process.pid),
                    cpu(over.pid) if over.pid else 0)
    before = look()
    time.sleep(FLOOD_S)
    after = look()
    took, reads, values, used, of_other = (b - a for a, b in zip(before, after))
    _, answer = daemon.ask("GET", "/outlets")
    waiting = [each["queue"] for each in answer["outlets"] if each.get("queue")]
    print(f"| {name} | {reads / took:.0f} | {reads * RELAYS / took:,.0f} | {values / took:,.0f} | "
          f"{100 * used / took:.1f} % | {100 * of_other / took:.1f} % |"
          + (f" {waiting} wait" if waiting else ""), flush=True)
    over.close()
    daemon.close()


class Yard:
    """A line at 19200 with one simulated ERC-8 that takes 5 ms, and an outlet of the daemon."""

    TEXT = """
[line.main]
port = "pty:{line}"
baud = 19200

[module.yard]
line = "main"
model = "erc8"
address = 9
{polled}
sim = {{ turnaround = "5ms" }}

[outlet.scada]
"""

    def __init__(self, polled, outlet):
        from judge.daemon import Daemon
        from modbus_tcp import Simulator

        self.folder = tempfile.TemporaryDirectory(prefix="railbus-measure-")
        self.line = os.path.join(self.folder.name, "line")
        text = self.TEXT.format(line=self.line, polled=polled)
        text += "".join(f"{key} = {json.dumps(value)}\n" for key, value in outlet.items())
        self.daemon = Daemon(self.folder.name, text)
        self.sim = Simulator(self.folder.name, self.daemon.config)
        self.sim.start()
        self.daemon.start()
        self.wait_good()

    def point(self):
        """What is said of the first relay."""
        return self.daemon.ask("GET", "/points/yard/k1")[1]

    def wait_good(self):
        """Until it has been read."""
        until(lambda: self.point()["quality"] == "good")

    def close(self):
        """Ends both."""
        self.daemon.close()
        self.sim.kill()


WRITES = 200
# A write of one coil and the read of it, with their replies, of the ERC-8, which needs a gap
# between them.
CHARACTERS, TURNAROUNDS_MS, GAP_MS = 8 + 8 + 8 + 6, 2 * 5, 20


def measure_writes():
    """How long a write takes until it is answered: the relay has moved, and was read back."""
    import opcua
    from asyncua import ua

    held, port = free_port()
    yard = Yard('poll = "60s"', {"type": "opcua", "listen": f"127.0.0.1:{port}"})
    yard.daemon.ask("POST", "/users", {"name": "li", "role": "admin", "points": [],
                                       "password": opcua.PASSWORD})
    session = opcua.Session(port, "li")
    node, states = session.node("yard.k1"), [ua.DataValue(ua.Variant(on)) for on in (False, True)]

    def over_opcua(on):
        session.do(node.write_value(states[on]))

    def over_http(on):
        status, answer = yard.daemon.ask("PUT", "/points/yard/k1", {"value": on})
        if status != 200:
            raise RuntimeError(answer)

    print(f"the wire takes {CHARACTERS * 10 / 19.2 + TURNAROUNDS_MS + GAP_MS:.1f} ms")
    print("| writes | number | median, ms | p90 | p99 | most | exceptions |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    times = {over_opcua: [], over_http: []}
    # In turn, so that both meet the same machine.
    for nth in range(WRITES):
        for way, took in times.items():
            began = time.monotonic()
            way(nth & 1 == (way is over_opcua))
            took.append(time.monotonic() - began)
            apart()
    row("OPC UA", times[over_opcua])
    row("HTTP", times[over_http])
    session.close()
    yard.daemon.close()
    exchanges = ([(0, bytes([9, 5, 0, 0x3C, 0xFF * (nth & 1), 0]), 8),
                  (GAP_MS, bytes([9, 1, 0, 0x3C, 0, 8]), 6)] for nth in range(WRITES))
    row("the line by itself", by_itself(yard.line, termios.B19200, exchanges))
    yard.close()


# How often a value becomes too old, and from which age on it is.
ROUNDS, OLD_S = 40, 1.0


def measure_stale():
    """When it is told that a value is too old: of a module that is read too seldom, and of one that
    falls silent."""
    print("| told by | the module | number | median, ms | p99 | most |")
    print("| --- | --- | --- | --- | --- | --- |")
    for kind in ("mqtt", "sparkplug", "opcua"):
        for what, poll in (("is read every 2 s", "2s"), ("falls silent", "300ms")):
            late = sorted(1000 * each for each in aged(kind, poll))
            at = lambda part: late[min(int(len(late) * part), len(late) - 1)]
            print(f"| {kind} | {what} | {len(late)} | {at(0.5):.1f} | {at(0.99):.1f} | "
                  f"{late[-1]:.1f} |", flush=True)


class HeardAtBroker:
    """What is told over MQTT or Sparkplug: when, and whether it says that a value is too old."""

    def __init__(self, kind):
        import paho.mqtt.client as paho
        from mqtt import Broker

        self.kind, self.broker, self.got = kind, Broker(), []
        names = {"site": "plant"} if kind == "mqtt" else {"group": "plant", "node": "n"}
        self.settings = {"type": kind, **self.broker.settings(), **names}
        self.receiver = paho.Client(paho.CallbackAPIVersion.VERSION2)
        self.receiver.on_message = lambda _client, _data, message: self.got.append(
            (time.time(), self.is_old(message)))

    def begin(self):
        """When the daemon serves."""
        self.receiver.connect("127.0.0.1", self.broker.port)
        topic = "railbus/plant/yard/k1/state" if self.kind == "mqtt" else "spBv1.0/plant/#"
        self.receiver.subscribe(topic)
        self.receiver.loop_start()

    @staticmethod
    def is_old(message):
        """In Sparkplug a death, or `Quality` 500, which is stale, as protobuf has it."""
        return (message.payload == b"None" or b"\x18\xf4\x03" in message.payload
                or "/DDEATH/" in message.topic)

    def close(self):
        """Ends it."""
        self.receiver.loop_stop()
        self.broker.close()


class HeardByOpcua:
    """The same of a subscription of OPC UA, published every 50 ms."""

    def __init__(self):
        self.held, self.port = free_port()
        self.settings = {"type": "opcua", "listen": f"127.0.0.1:{self.port}", "anonymous": True}
        self.got, self.session, self.refused = [], None, []

    def begin(self):
        """When the daemon serves."""
        import opcua

        self.session = opcua.Session(self.port, timeout=PATIENCE)
        self.session.watch("yard.k1", told=self)

    def datachange_notification(self, _node, _value, data):
        """Called by asyncua."""
        self.got.append((time.time(), data.monitored_item.Value.StatusCode.value != 0))

    def status_change_notification(self, status):
        """Called by asyncua."""
        raise RuntimeError(f"the subscription has ended: {status}")

    def close(self):
        """Ends it."""
        self.session.close()


def aged(kind, poll):
    """How much later than it was too old it was told of a value, in seconds."""
    heard = HeardByOpcua() if kind == "opcua" else HeardAtBroker(kind)
    yard = Yard(f'poll = "{poll}"\nmax_age = "{OLD_S:.0f}s"', heard.settings)
    heard.begin()
    until(lambda: heard.got)
    late = []
    while len(late) < ROUNDS:
        yard.wait_good()
        time.sleep(random.uniform(0, 0.3))
        since = len(heard.got)
        if poll != "2s":
            yard.sim.do("power yard off")
        olds = lambda: [at for at, is_old in heard.got[since:] if is_old]
        if not until(olds):
            raise RuntimeError(f"nothing is told: {yard.point()}, {heard.got[since:]}")
        stamp = yard.point()["time"].replace("Z", "+00:00")
        read = datetime.datetime.fromisoformat(stamp).timestamp()
        # Unless it was read again meanwhile.
        if read < olds()[0]:
            late.append(olds()[0] - read - OLD_S)
        if poll != "2s":
            yard.sim.do("power yard on")
    heard.close()
    yard.close()
    return late


def fill(file, count):
    """What would have been written in so long an outage."""
    data = sqlite3.connect(file)
    paths = [path for path, in data.execute("SELECT id FROM paths")]
    began = int(time.time() * 1000) - HOURS * 3_600_000
    step = HOURS * 3_600_000 // count
    rows = ((began + nth * step, paths[nth % len(paths)], "true" if nth & 1 else "false", "good",
             began + nth * step - 20) for nth in range(count))
    data.executemany("INSERT INTO entries (at, path, value, quality, time) VALUES (?, ?, ?, ?, ?)",
                     rows)
    data.commit()
    data.close()


def cpu(pid):
    """The seconds that a process has used."""
    with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    WAYS = {"line": measure_line, "replay": measure_replay, "births": measure_births,
            "past": measure_past, "flood": measure_flood, "stale": measure_stale,
            "writes": measure_writes}
    if sys.argv[1:2] and sys.argv[1] in WAYS:
        counted = [int(sys.argv[2]) if sys.argv[2:] else COUNT]
        WAYS[sys.argv[1]](*(counted if sys.argv[1] in ("replay", "past") else ()))
    else:
        sys.exit(__doc__)
