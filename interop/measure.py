"""What docs/performance.md has of the gateways, measured with the daemon in RAILBUS:

    RAILBUS=target/release/railbus python3 interop/measure.py line
    RAILBUS=target/release/railbus python3 interop/measure.py replay [COUNT]
    RAILBUS=target/release/railbus python3 interop/measure.py births
    RAILBUS=target/release/railbus python3 interop/measure.py past [COUNT]

`line`: reads of a foreign master through the Modbus gateway to a line, and by itself on the same
line. `replay`: an outage of 72 hours, brought to a receiver of mosquitto (needs paho-mqtt, as all
that follow). `births`: 250 modules of a Sparkplug node. `past`: an outage of 72 hours in
Sparkplug."""

import json
import os
import random
import sqlite3
import sys
import tempfile
import termios
import threading
import time
import tty

from checksums import crc
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
    if sys.argv[1:2] == ["line"]:
        measure_line()
    elif sys.argv[1:2] == ["replay"]:
        measure_replay(int(sys.argv[2]) if sys.argv[2:] else COUNT)
    elif sys.argv[1:2] == ["births"]:
        measure_births()
    elif sys.argv[1:2] == ["past"]:
        measure_past(int(sys.argv[2]) if sys.argv[2:] else COUNT)
    else:
        sys.exit(__doc__)
