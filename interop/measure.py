"""What docs/performance.md has of the gateways, measured with the daemon in RAILBUS:

    RAILBUS=target/release/railbus python3 interop/measure.py line
    RAILBUS=target/release/railbus python3 interop/measure.py replay [COUNT]
    RAILBUS=target/release/railbus python3 interop/measure.py births
    RAILBUS=target/release/railbus python3 interop/measure.py past [COUNT]
    RAILBUS=target/release/railbus python3 interop/measure.py flood
    RAILBUS=target/release/railbus python3 interop/measure.py stale

`line`: reads of a foreign master through the Modbus gateway to a line, and by itself on the same
line. `replay`: an outage of 72 hours, brought to a receiver of mosquitto (needs paho-mqtt, as all
that follow but `flood`). `births`: 250 modules of a Sparkplug node. `past`: an outage of 72 hours
in Sparkplug. `flood`: 10,000 changes a second, published over MQTT. `stale`: how soon others are
told that a value is too old."""

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


def floor(path):
    """The same requests on the line itself, without railbus."""
    line = os.open(path, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(line)
    attributes = termios.tcgetattr(line)
    attributes[4] = attributes[5] = termios.B9600
    termios.tcsetattr(line, termios.TCSANOW, attributes)
    request = bytes([UNIT, 3, 0, 0, 0, 2])
    request += crc(request)
    times = []
    for _ in range(FLOOR_READS):
        began = time.monotonic()
        os.write(line, request)
        got = b""
        while len(got) < 9:
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
        stop = threading.Event()

        def other():
            with Client(port) as client:
                while not stop.wait(0.005):
                    client.begin(9, 3, 0, 0, 0, 2)
                    client.next()

        beside = threading.Thread(target=other)
        beside.start()
        row("gateway, beside a dead unit", *through(port))
        stop.set()
        beside.join()
        site.daemon.close()
        row("floor", floor(os.path.join(site.folder.name, "line")))


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


def measure_flood():
    """10,000 changes a second, without MQTT and with it."""
    print("| outlet | reads/s | changes/s | values published/s | daemon, of a core | broker |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name, more in (("none", None), ("MQTT", {}), ("MQTT, `replay_days`", {"replay_days": 1})):
        flooded(name, more)


def flooded(name, more):
    """One row of it."""
    from judge.daemon import Daemon
    from mqtt import Broker

    broker, flood = Broker(), Flood()
    broker.kill()
    with open(broker.config, "a", encoding="utf-8") as config:
        config.write("max_queued_messages 0\n")
    broker.start()
    text = flood.site()
    if more is not None:
        settings = {"type": "mqtt", **broker.settings(), "version": "5", "site": "plant", **more}
        text += "[outlet.scada]\n"
        text += "".join(f"{key} = {json.dumps(value)}\n" for key, value in settings.items())
    folder = tempfile.TemporaryDirectory(prefix="railbus-measure-")
    daemon = Daemon(folder.name, text)
    counted = [Counted(broker, f"railbus/plant/{topic}") for topic in ("+/+/state", "batch")]
    daemon.start()
    time.sleep(WARM_UP_S)
    look = lambda: (time.monotonic(), flood.reads, counted[0].count, cpu(daemon.process.pid),
                    cpu(broker.process.pid), counted[1].count)
    before = look()
    time.sleep(FLOOD_S)
    after = look()
    took, reads, values, used, of_broker, batches = (b - a for a, b in zip(before, after))
    if "replay_days" in (more or {}):
        _, answer = daemon.ask("GET", "/outlets")
        print(f"batches/s: {batches / took:.0f}; waiting: {answer['outlets'][0]['queue']}")
    print(f"| {name} | {reads / took:.0f} | {reads * RELAYS / took:,.0f} | {values / took:,.0f} | "
          f"{100 * used / took:.1f} % | {100 * of_broker / took:.1f} % |", flush=True)
    for each in counted:
        each.close()
    daemon.close()
    broker.close()


# How often a value becomes too old, and from which age on it is.
ROUNDS, OLD_S = 40, 1.0
STALE = """
[line.main]
port = "pty:{line}"
baud = 19200

[module.yard]
line = "main"
model = "erc8"
address = 9
poll = "{poll}"
max_age = "1s"
sim = {{ turnaround = "5ms" }}
"""


def measure_stale():
    """When it is told that a value is too old: of a module that is read too seldom, and of one that
    falls silent."""
    print("| told by | the module | number | median, ms | p99 | most |")
    print("| --- | --- | --- | --- | --- | --- |")
    for kind in ("mqtt", "sparkplug"):
        for what, poll in (("is read every 2 s", "2s"), ("falls silent", "300ms")):
            late = sorted(1000 * each for each in aged(kind, poll))
            at = lambda part: late[min(int(len(late) * part), len(late) - 1)]
            print(f"| {kind} | {what} | {len(late)} | {at(0.5):.1f} | {at(0.99):.1f} | "
                  f"{late[-1]:.1f} |", flush=True)


def aged(kind, poll):
    """How much later than it was too old it was told of a value, in seconds."""
    import paho.mqtt.client as paho
    from judge.daemon import Daemon
    from modbus_tcp import Simulator
    from mqtt import Broker

    broker = Broker()
    folder = tempfile.TemporaryDirectory(prefix="railbus-measure-")
    settings = {"type": kind, **broker.settings(), **({"site": "plant"} if kind == "mqtt" else
                                                      {"group": "plant", "node": "n"})}
    text = STALE.format(line=os.path.join(folder.name, "line"), poll=poll) + "[outlet.scada]\n"
    text += "".join(f"{key} = {json.dumps(value)}\n" for key, value in settings.items())
    daemon = Daemon(folder.name, text)
    sim = Simulator(folder.name, daemon.config)
    sim.start()
    got, receiver = [], paho.Client(paho.CallbackAPIVersion.VERSION2)
    receiver.on_message = lambda _client, _data, message: got.append((time.time(), message))
    receiver.connect("127.0.0.1", broker.port)
    receiver.subscribe("railbus/plant/yard/k1/state" if kind == "mqtt" else "spBv1.0/plant/#")
    receiver.loop_start()
    # In Sparkplug a death, or `Quality` 500, which is stale, as protobuf has it.
    is_old = lambda message: (message.payload == b"None" or b"\x18\xf4\x03" in message.payload
                              or "/DDEATH/" in message.topic)
    point = lambda: daemon.ask("GET", "/points/yard/k1")[1]
    daemon.start()
    until(lambda: point()["quality"] == "good" and got)
    late = []
    while len(late) < ROUNDS:
        until(lambda: point()["quality"] == "good")
        time.sleep(random.uniform(0, 0.3))
        since = len(got)
        if poll != "2s":
            sim.do("power yard off")
        olds = lambda: [at for at, message in got[since:] if is_old(message)]
        if not until(olds):
            raise RuntimeError(f"nothing is told: {point()}, {got[since:]}")
        read = datetime.datetime.fromisoformat(point()["time"].replace("Z", "+00:00")).timestamp()
        # Unless it was read again meanwhile.
        if read < olds()[0]:
            late.append(olds()[0] - read - OLD_S)
        if poll != "2s":
            sim.do("power yard on")
    receiver.loop_stop()
    daemon.close()
    sim.kill()
    broker.close()
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
            "past": measure_past, "flood": measure_flood, "stale": measure_stale}
    if sys.argv[1:2] and sys.argv[1] in WAYS:
        counted = [int(sys.argv[2]) if sys.argv[2:] else COUNT]
        WAYS[sys.argv[1]](*(counted if sys.argv[1] in ("replay", "past") else ()))
    else:
        sys.exit(__doc__)
