"""What the suite of the Sparkplug edge node needs: a broker that logs, the way there, a host
application by others, the daemon, and the rules that hold for everything that an edge node says."""

import json
import pathlib
import re
import subprocess
import threading
import time

import mqtt
from modbus_tcp import HOST, PATIENCE, until
from outlet_plant import SELDOM, OutletPlant
from proxy import Proxy
from rig import ROOT, Tally

HERE = pathlib.Path(__file__).resolve().parent
# The Python of the host; the folder is fixed, because `xtask` names it too.
PYTHON = ROOT / "target/sparkplug-venv/bin/python"

GROUP, NODE, CLIENT = "works", "line7", "railbus-edge"
# What the host may switch.
WRITE = ["oven.k1", "oven.k2", "hall.do0"]
GOOD, STALE, BAD = 192, 500, 0
# The metrics beside the points.
LAST = {"Last Command/Metric": "STRING", "Last Command/End": "STRING",
        "Last Command/Code": "STRING", "Last Command/Time": "DATETIME"}
# How long something that must not happen is looked for, in seconds.
GRACE = 2.0


def now():
    """The time as Sparkplug has it."""
    return int(time.time() * 1000)


class Broker(mqtt.Broker):
    """mosquitto with a log of what it receives, which is a witness of its own."""

    def start(self):
        """Starts it, with an empty store."""
        self.log = pathlib.Path(self.folder.name) / "said" / "log"
        if not self.log.parent.exists():
            # The broker gives up its rights.
            self.log.parent.mkdir()
            self.log.parent.chmod(0o777)
            with open(self.config, "a", encoding="utf-8") as config:
                config.write(f"log_dest file {self.log}\nlog_type all\nlog_timestamp false\n")
        super().start()

    def said(self):
        """The lines of the log."""
        if not self.log.exists():
            return []
        return self.log.read_text(encoding="utf-8", errors="replace").splitlines()

    def connections(self):
        """What was logged of each connection of the daemon, from when it was accepted."""
        found = []
        for line in self.said():
            if re.match(rf"New client connected from \S+ as {CLIENT} ", line):
                found.append([])
            if found:
                found[-1].append(line)
        return found

    def subscribed(self, topic):
        """How many connections of the daemon have subscribed to a topic."""
        told = re.compile(rf"{CLIENT} \d {re.escape(topic)}")
        return sum(any(told.fullmatch(line) for line in lines) for lines in self.connections())


class Host:
    """The host application: everything that came, over all its connections, with our own time."""

    def __init__(self, broker):
        self.broker, self.got, self.lock = broker, [], threading.Condition()
        self.answers, self.process, self.thread = [], None, None
        self.start()

    def start(self):
        """Starts it, and waits until it hears everything."""
        self.stop()
        command = [PYTHON, HERE / "sparkplug_peer.py", HOST, str(self.broker.port), GROUP]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        text=True)
        self.answers.clear()
        self.thread = threading.Thread(target=self._run, args=[self.process], daemon=True)
        self.thread.start()
        if "ready" not in self._answer():
            raise RuntimeError("the Sparkplug host does not reach the broker")

    def _run(self, process):
        for line in process.stdout:
            said = {**json.loads(line), "at": time.monotonic()}
            with self.lock:
                (self.got if "topic" in said else self.answers).append(said)
                self.lock.notify_all()

    def _answer(self):
        with self.lock:
            self.lock.wait_for(lambda: self.answers, PATIENCE)
            return self.answers.pop(0) if self.answers else {}

    def ask(self, do, **words):
        """Gives it an order."""
        self.process.stdin.write(json.dumps({"do": do, **words}) + "\n")
        self.process.stdin.flush()
        if not self._answer().get("done"):
            raise RuntimeError(f"the Sparkplug host can't do {do} {words}")

    def stop(self):
        """Ends it; what comes after this is another life of the node."""
        if self.process:
            self.process.kill()
            self.process.wait()
            self.thread.join()
            self.process.stdin.close()
            self.process.stdout.close()
            self.process = None
            with self.lock:
                self.got.append({"topic": "", "kind": "AWAY", "at": time.monotonic()})

    def count(self):
        """How many messages came so far."""
        with self.lock:
            return len(self.got)

    def all(self, since=0, kind="", device="", when=lambda message: True):
        """The messages of a kind, and of a device if one is named, after so many messages."""
        with self.lock:
            got = self.got[since:]
        return [message for message in got
                if message.get("kind") == kind and device in ("", message.get("device"))
                and message.get("metrics") is not None and when(message)]

    def place(self, message):
        """At which place a message came."""
        with self.lock:
            return next(nth for nth, each in enumerate(self.got) if each is message)


def metric(message, name):
    """The newest metric of a name that a message has, other than old ones."""
    found = [each for each in (message or {}).get("metrics", ())
             if each["name"] == name and not each["historical"]]
    return found[-1] if found else None


def value(message, name):
    """Its value."""
    return (metric(message, name) or {}).get("value")


def prop(one, name):
    """The value of a property of a metric."""
    return ((one or {}).get("properties", {}).get(name) or [None, None])[1]


def quality(one):
    """The quality of a metric: good where nothing is said of it."""
    said = prop(one, "Quality")
    return GOOD if said is None else said


def is_answer(message):
    """Whether data answer a command."""
    return metric(message, "Last Command/End") is not None


class Plant(OutletPlant):
    """Simulated modules, a daemon that is an edge node at a broker, and a host by others."""

    kind, name = "sparkplug", "plant"

    def __init__(self, broker, version="auto", tally=None, **settings):
        self.broker, self.gate, self.host = broker, Proxy(broker), Host(broker)
        settings = {"host": HOST, "port": self.gate.port, "version": version, "group": GROUP,
                    "node": NODE, "client_id": CLIENT, "write": WRITE, **settings}
        super().__init__(tally or Tally("Sparkplug"), settings, SELDOM)

    def __exit__(self, *words):
        super().__exit__(*words)
        self.host.stop()
        self.gate.close()

    def points(self, module):
        """The points of a module by their labels, as the API has them."""
        return {each["label"]: each for each in self.ask("GET", "/points")["points"]
                if each["module"] == module}

    # What the node says -----------------------------------------------------------------------

    def heard(self, entries, what, since, kind, device="", when=lambda message: True):
        """Waits for a message, and counts; an empty message if it does not come."""
        until(lambda: self.host.all(since, kind, device, when))
        found = self.host.all(since, kind, device, when)
        whose = f"{kind} {device}".strip()
        self.check(entries, bool(found), True, f"{what}: {whose} in {self.kinds(since)[-12:]}")
        return found[0] if found else {"metrics": []}

    def kinds(self, since):
        """What came: `DDATA oven` and so on."""
        with self.host.lock:
            got = self.host.got[since:]
        return [f"{each.get('kind')} {each.get('device') or ''}".strip() for each in got]

    def lives(self, since):
        """The births and deaths of the node, in short."""
        return [each for each in self.kinds(since) if each in ("NBIRTH", "NDEATH")]

    def silent(self, entries, what, since, kinds=("NBIRTH", "DBIRTH", "NDATA", "DDATA")):
        """Nothing of this came, and nothing comes for a while."""
        came = lambda: [each for each in self.kinds(since) if each.split(" ")[0] in kinds]
        until(came, GRACE)
        self.check(entries, came(), [], f"{what}: what came")

    def born(self, entries, what, since=0, modules=("oven", "hall", "tank", "yard")):
        """Waits for the births of node and modules; the node's birth number."""
        birth = self.heard(entries, what, since, "NBIRTH")
        for module in modules:
            self.heard(entries, what, since, "DBIRTH", module)
        return value(birth, "bdSeq")

    def current(self, device, name):
        """What a metric is, by the newest birth and the data since."""
        found = None
        with self.host.lock:
            got = list(self.host.got)
        for message in got:
            kind, is_its = message.get("kind"), message.get("device") == device
            if kind in ("NBIRTH", "NDEATH", "AWAY") or (kind == "DDEATH" and is_its):
                found = None
            elif kind in ("DBIRTH", "DDATA") and is_its:
                found = metric(message, name) or found
        return found

    def becomes(self, entries, device, name, want, what=""):
        """This is the value of a metric at last, and it is good."""
        told = lambda: ((one := self.current(device, name) or {}).get("value"), quality(one))
        until(lambda: told() == (want, GOOD))
        self.check(entries, told(), (want, GOOD), f"{device}.{name} {what}")

    # What the host says -----------------------------------------------------------------------

    def send(self, device, *metrics, node=NODE, timestamp="now", **more):
        """Gives a command: name, type and value of each metric. Its time is the one at which it is
        sent, if no other is named; None leaves it out."""
        self.host.ask("command", kind="DCMD", node=node, device=device, metrics=metrics,
                      timestamp=timestamp, **more)

    def answers(self, device, since):
        """The answers to commands, in their order: metric, end, code, time and the message."""
        return [{"metric": value(each, "Last Command/Metric"),
                 "end": value(each, "Last Command/End"), "code": value(each, "Last Command/Code"),
                 "time": value(each, "Last Command/Time"), "message": each}
                for each in self.host.all(since, "DDATA", device, is_answer)]

    def order(self, device, name, what, kind="BOOLEAN", **more):
        """Gives one command; its answer, or an empty one."""
        since = self.host.count()
        self.send(device, (name, kind, what), **more)
        until(lambda: self.answers(device, since))
        found = self.answers(device, since)
        return found[0] if found else {"end": "no answer", "code": None, "metric": None,
                                       "time": None, "message": None}

    def rebirth(self):
        """Wants everything anew."""
        self.host.ask("command", kind="NCMD", node=NODE, device=None, timestamp="now",
                      metrics=[("Node Control/Rebirth", "BOOLEAN", True)])

    def state(self, online, timestamp, host="scada"):
        """Says whether the host application is there."""
        self.host.ask("state", host=host, online=online, timestamp=timestamp)

    def relays(self, entries, module, want, what=""):
        """The simulator has these outputs."""
        self.check(entries, self.sim.outputs(module), want, f"relays of {module} {what}")


def judged(messages):
    """What is wrong with everything that a node said, by the rules of Sparkplug alone."""
    wrong, bdseq, following, born = [], None, None, {}
    for nth, told in enumerate(messages):
        kind, device = told.get("kind"), told.get("device")
        here = f"message {nth}, {kind} {device or ''}".rstrip()
        if kind == "AWAY":
            bdseq, following, born = None, None, {}
        if "error" in told:
            wrong.append(f"{here}: {told['error']}")
        if kind in ("AWAY", "STATE", "NCMD", "DCMD") or told.get("metrics") is None:
            continue
        if told["node"] != NODE:
            wrong.append(f"{here}: of {told['node']}")
        wrong += [f"{here}: {each['name']} has an alias"
                  for each in told["metrics"] if each["alias"] is not None]
        if kind == "NDEATH":
            if bdseq is not None and value(told, "bdSeq") != bdseq:
                wrong.append(f"{here}: bdSeq {value(told, 'bdSeq')} after a birth with {bdseq}")
            bdseq, following, born = None, None, {}
            continue
        if told["timestamp"] is None:
            wrong.append(f"{here}: no time")
        if kind == "NBIRTH":
            bdseq, following, born = value(told, "bdSeq"), 0, {}
        if told["seq"] != following:
            wrong.append(f"{here}: seq {told['seq']}, not {following}")
        following = None if told["seq"] is None else (told["seq"] + 1) % 256
        names = {each["name"] for each in told["metrics"]}
        if kind == "DBIRTH":
            born[device] = names
        elif kind in ("DDATA", "DDEATH") and device not in born:
            wrong.append(f"{here}: it is not born")
        elif kind == "DDATA" and names - born[device]:
            wrong.append(f"{here}: not in its birth: {sorted(names - born[device])}")
        if kind == "DDEATH":
            born.pop(device, None)
    return wrong


def unqualified(messages):
    """The metrics of points without a proper quality, value or time."""
    return [(told["kind"], told["device"], each) for told in messages
            if told.get("kind") in ("DBIRTH", "DDATA") for each in told.get("metrics", ())
            if each["name"] not in LAST and (
                each["properties"].get("Quality", ["INT32"])[0] != "INT32" or not each["time"]
                or quality(each) not in (GOOD, STALE, BAD) or each["null"] != (quality(each) == BAD)
                or each["null"] != (each["value"] is None))]


def ruled(s, entries):
    """Judges everything that came until now."""
    with s.host.lock:
        got = list(s.host.got)
    s.check(entries, judged(got)[:8], [], f"{len(got)} messages,")
    s.check(entries, unqualified(got)[:3], [], f"{len(got)} messages, quality, value and time:")
