"""MQTT and Sparkplug while the network to the broker fails at random moments, from a seed: somebody
switches a unit by hand, a client gives commands to another one, and the way between the daemon and
its broker is cut, frozen, slow, or lost at one end only (`proxy.py`).

Whatever happens, a command acts once and soon or not at all, a value that is told with its time was
so then, and others know within the time of the keep-alive that nothing is told any more. Afterwards
everything that is told is so now, and no change is missing."""

import collections
import functools
import itertools
import json
import os
import random
import subprocess
import threading
import time

import sparkplug
from matrix import run as matrix
from modbus_tcp import until
from mqtt import Watcher
from mqtt_replay_suite import Receiver
from proxy import BROKER, DAEMON, DOWN, UP, Proxy
from rig import ROOT, Tally

# These are found where the matrix is.
from by_mqtt import PREFIX, VALUES, ByMqtt
from by_sparkplug import BySparkplug
from outlets import ANSWER, CHANNELS, DONE, NAMES, UNKNOWN

# Another one by RAILBUS_SEED.
SEED = int(os.environ.get("RAILBUS_SEED", "20261127"))
# Who is commanded, and which of its outputs; who is switched by hand.
COMMANDED, OUTPUTS, BY_HAND = 1, (0, 1), 2
# After this time others know that nothing is told, in seconds: one and a half keep-alives of 3 s,
# mosquitto looks every 5 s only, and a busy machine later.
GONE_MAX = 15.0
# A command acts no later than this after it was given, in seconds: it may be on its way until the
# daemon gives the connection up, and then it has its own time. One of Sparkplug has its time with
# it.
LATE_MAX = {"MQTT": 13.0, "Sparkplug": 7.0}
# How long a freeze is from which that has to be seen.
LONG = 18.0
# How long until the daemon is connected again: it waits longer each time, up to a minute.
BACK_MAX = 90.0
# So many commands have to be carried out, and so many changes made, or it was no test.
ENOUGH = 20


# What is done, for how many seconds, and whether it ends the connection.
Fault = collections.namedtuple("Fault", "what begin seconds breaks", defaults=[False])


def faults(proxy, chance):
    """The faults in their order."""
    ways = itertools.cycle([(), (UP,), (DOWN,)])
    short = lambda: chance.uniform(0.2, 1.4)
    found = []
    for way in itertools.islice(ways, 8):
        late = chance.uniform(0.1, 0.8)
        found += [
            Fault(f"freeze {way}", functools.partial(proxy.freeze, *way), short()),
            Fault(f"delay {way}", functools.partial(proxy.delay, late, *way), short()),
            Fault(f"trickle {way}", functools.partial(proxy.trickle, 1, *way), short()),
        ]
    found += [
        Fault("cut", proxy.cut, 1.0, True),
        # Commands still come, and their results are lost with the connection.
        Fault("no way to the broker", lambda: proxy.freeze(UP), 12.0, True),
        Fault("the broker loses it", lambda: proxy.lose(BROKER), 7.0, True),
        Fault("the daemon loses it", lambda: proxy.lose(DAEMON), 1.0, True),
        Fault("long trickle", lambda: proxy.trickle(1), 8.0, True),
        Fault("long freeze", proxy.freeze, LONG, True),
    ]
    chance.shuffle(found)
    return found


class OverProxy:
    """The daemon reaches the broker over a way that fails."""

    # What it knows of a unit may be as old as nobody knows that the connection is of no use.
    late = GONE_MAX
    # After an outage it is told again what was read before, and has not changed.
    is_steady = False
    version = "auto"

    def __init__(self, case):
        super().__init__(case)
        self.proxy = Proxy(self.broker)

    def settings(self):
        """The settings of the outlet."""
        return {**super().settings(), "port": self.proxy.port, "version": self.version}

    def close(self):
        """Ends it."""
        self.proxy.close()
        super().close()


class MqttOverProxy(OverProxy, ByMqtt):
    """A subscriber of everything."""

    kind = "MQTT"

    def command(self, nth, value, name):
        """Gives a command."""
        topic = f"{PREFIX}/{NAMES[COMMANDED]}/{self.case.column.labels[nth]}/set"
        order = {"value": "ON" if value else "OFF", **({"id": name} if name else {})}
        words = ["-q", "1", "-t", topic, "-m", json.dumps(order)]
        subprocess.run(["mosquitto_pub", *self.broker.words(), *words], check=True, timeout=ANSWER,
                       capture_output=True)

    def results(self):
        """The results of commands for each output, each once, in the order in which they began."""
        found = {}
        for nth in OUTPUTS:
            topic = f"{PREFIX}/{NAMES[COMMANDED]}/{self.case.column.labels[nth]}/result"
            told = [json.loads(payload) for payload in self.watcher.all(topic)]
            # One that the broker may not have got comes twice.
            once = {each["audit"]: each for each in told if each.get("audit")}
            found[nth] = [once[number] for number in sorted(once)]
        return found

    def strangers(self):
        """How many outboxes other than its own tell changes here."""
        told = map(json.loads, self.watcher.all(f"{PREFIX}/batch"))
        return len({each["epoch"] for each in told}) - 1

    def is_dead(self, since):
        """Whether it was told after so many messages that nothing is told."""
        return "offline" in self.watcher.all(f"{PREFIX}/bridge/state", since)

    def count(self):
        """How many messages came so far."""
        return self.watcher.count()

    def is_alive(self):
        """Whether the outlet is said to be there."""
        self.hear()
        return self.told.get("bridge/state") == "online"

    def values(self, nth):
        """What an output of the unit that is switched by hand was, by the topic of all changes."""
        got = Receiver()
        got.take(self.watcher.all(f"{PREFIX}/batch"))
        path = f"{NAMES[BY_HAND]}.{self.case.column.labels[nth]}"
        return [int(value) for value in got.values(path) if value is not None]

    def now(self, unit):
        """What somebody who comes now finds at the broker."""
        late = Watcher(self.broker, "mqttv5", f"{PREFIX}/#")
        topics = [f"{PREFIX}/{NAMES[unit]}/{self.case.column.labels[nth]}/state"
                  for nth in CHANNELS]
        until(lambda: all(late.newest(topic) for topic in topics))
        found = [VALUES[late.newest(topic) or "None"] for topic in topics]
        online = [late.newest(f"{PREFIX}/{topic}")
                  for topic in ("bridge/state", f"{NAMES[unit]}/availability")]
        late.close()
        return found, online


class ThreeOneOverProxy(MqttOverProxy):
    """The same in the older version."""

    version = "3.1.1"


class SparkplugOverProxy(OverProxy, BySparkplug):
    """A host."""

    kind = "Sparkplug"

    def command(self, nth, value, _):
        """Gives a command."""
        self.host.ask("command", kind="DCMD", node=sparkplug.NODE, device=NAMES[COMMANDED],
                      metrics=[(self.case.column.labels[nth], "BOOLEAN", bool(value))],
                      timestamp="now")

    def is_dead(self, since):
        """Whether it was told after so many messages that nothing is told."""
        return bool(self.host.all(since, "NDEATH"))

    def count(self):
        """How many messages came so far."""
        return self.host.count()

    def is_alive(self):
        """Whether the node and both devices are alive."""
        self.hear()
        return self.alive == set(NAMES.values())

    def values(self, nth):
        """What an output of the unit that is switched by hand was, by the times that are told."""
        device, label = NAMES[BY_HAND], self.case.column.labels[nth]
        told = {(each["time"], int(each["value"]))
                for kind in ("DBIRTH", "DDATA") for message in self.host.all(0, kind, device)
                for each in message["metrics"]
                if each["name"] == label and sparkplug.quality(each) == sparkplug.GOOD}
        return [value for _, value in sorted(told)]

    def now(self, unit):
        """What the host knows."""
        self.hear()
        return [self.known[unit, nth][0] for nth in CHANNELS], ["online", "online"]


class Trial:
    """One run with all faults."""

    def __init__(self, case, name, tally):
        self.case, self.o, self.name, self.tally = case, case.observer, name, tally
        self.is_over = threading.Event()
        # The changes by hand, by output, and the commands: when, output, value, id.
        self.made = {nth: [] for nth in CHANNELS}
        self.given, self.broken = [], []

    def check(self, what, got, want, more=""):
        """Counts."""
        self.tally.check(f"{self.name}: {what}", got, want, more)

    def run(self):
        """Everything."""
        chance = random.Random(SEED)
        until(lambda: self.o.is_alive() and all(map(self.o.values, CHANNELS)))
        workers = [threading.Thread(target=self._worker, args=[work, random.Random(SEED + nth)])
                   for nth, work in enumerate((self.changes, self.commands))]
        for worker in workers:
            worker.start()
        try:
            for fault in faults(self.o.proxy, chance):
                time.sleep(chance.uniform(0.1, 0.8))
                self.fault(fault)
        finally:
            self.is_over.set()
            for worker in workers:
                worker.join()
        self.check("was a test", self.broken, [], "workers")
        self.afterwards()

    def _worker(self, work, chance):
        try:
            while not self.is_over.is_set():
                work(chance)
        except Exception as error:  # It is shown with the checks.
            self.broken.append(f"{type(error).__name__}: {error}")

    def fault(self, fault):
        """One fault, and how it ends."""
        if fault.breaks:
            # Also after a fault that was not to end the connection, on a busy machine.
            self.check("alive again", until(self.o.is_alive, BACK_MAX), True, "before the next")
        since, began = self.o.count(), time.monotonic()
        fault.begin()
        if fault.seconds == LONG:
            until(lambda: self.o.is_dead(since), LONG)
            took = time.monotonic() - began
            self.check("dead within the keep-alive", took < GONE_MAX, True, f"after {took:.1f} s")
        time.sleep(max(began + fault.seconds - time.monotonic(), 0))
        self.o.proxy.heal()
        if fault.breaks:
            self.check("alive again", until(self.o.is_alive, BACK_MAX), True, fault.what)

    def changed(self, nth):
        """Somebody switches an output by hand, and the daemon has read it."""
        unit = self.case.line.units[BY_HAND]
        unit.outputs ^= 1 << nth
        value = bool(unit.outputs >> nth & 1)
        path = f"/points/{NAMES[BY_HAND]}/{self.case.column.labels[nth]}"
        read = lambda: (said := self.case.ask("GET", path)[1])["quality"] == "good" and (
            said["value"] is value)
        if not until(read):
            raise RuntimeError(f"{path} does not become {value}")
        self.made[nth].append(int(value))

    def changes(self, chance):
        """One change by hand."""
        self.changed(chance.choice(CHANNELS))
        self.is_over.wait(chance.uniform(0, 0.3))

    def commands(self, chance):
        """One command; every other one has an id."""
        nth, value = chance.choice(OUTPUTS), chance.randrange(2)
        name = f"c{len(self.given)}" if len(self.given) % 2 else None
        self.given.append((time.monotonic(), nth, value, name))
        self.o.command(nth, value, name)
        self.is_over.wait(chance.uniform(0.1, 0.6))

    def afterwards(self):
        """What has to be so once all faults are over."""
        self.check("alive again", until(self.o.is_alive, BACK_MAX), True, "at the end")
        outlet = lambda: self.case.ask("GET", "/outlets")[1]["outlets"][0]
        self.check("no change is missing", until(lambda: outlet()["queue"] == 0), True, "queue")
        self.check("was a test", all(len(made) >= ENOUGH / 4 for made in self.made.values()), True,
                   f"changes: {self.made}")
        for nth, made in self.made.items():
            whole = [1 - made[0], *made] if made else []
            told = lambda nth=nth: runs(self.o.values(nth))
            until(lambda: told() == whole)
            self.check("no change is missing", told(), whole, f"output {nth}")
        for unit, watched in self.case.line.units.items():
            want = [watched.outputs >> nth & 1 for nth in CHANNELS]
            until(lambda: self.o.now(unit)[0] == want)
            self.check("what is so now", self.o.now(unit), (want, ["online"] * 2), f"unit {unit}")
        self.acted()
        self.check("what was true", self.o.lies(), [], "told")

    def acted(self):
        """Every time that an output was switched is of one command, and soon after it."""
        switched = self.case.line.units[COMMANDED].switched
        self.check("was a test", len(switched) >= ENOUGH, True, f"{len(switched)} of "
                   f"{len(self.given)} commands were carried out")
        left, late = list(self.given), []
        for at, nth, value in switched:
            owner = next((each for each in left if each[1:3] == (nth, value)
                          and each[0] <= at <= each[0] + LATE_MAX[self.o.kind]), None)
            if owner:
                left.remove(owner)
            else:
                late.append((at, nth, value))
        self.check("commands act once and soon", late, [], "of no command")
        if self.o.kind == "MQTT":
            self.check("was a test", self.o.strangers(), 0, "other daemons at this broker")
            self.answered(switched)

    def answered(self, switched):
        """Every command that acted has its result, and only that."""
        for nth, results in self.o.results().items():
            ends = [int(told["value"]) for told in results if told["end"] in DONE]
            self.check("every command that acted has its result", ends,
                       [value for _, of, value in switched if of == nth], f"output {nth}")
            unknown = [told for told in results if told["end"] == UNKNOWN]
            self.check("commands act once and soon", unknown, [], "unknown ends on a good line")
            names = [told["id"] for told in results if told["id"]]
            self.check("commands act once and soon", sorted(names), sorted(set(names)), "ids")


def runs(values):
    """Values without those that are as before."""
    return [value for nth, value in enumerate(values) if nth == 0 or value != values[nth - 1]]


def suite(by, name):
    """Everything in one protocol and version."""

    def run():
        tally = Tally(by.kind)
        column = matrix.COLUMNS["ascii, EDA9060A"]._replace(by=by)
        with matrix.Case(column, matrix.ROWS["S0"]) as case:
            Trial(case, name, tally).run()
        if tally.failures:
            # What was on the line, and what was told.
            told = [repr(message) for message in case.observer.messages()]
            log = ROOT / f"target/{name.replace(', ', '-')}.log"
            log.write_text("\n".join([*case.line.trace, *map(str, case.log), *told]) + "\n")
        return tally

    return run


SUITES = [
    ("MQTT faults, 5", suite(MqttOverProxy, "faults, 5")),
    ("MQTT faults, 3.1.1", suite(ThreeOneOverProxy, "faults, 3.1.1")),
    ("Sparkplug faults", suite(SparkplugOverProxy, "faults")),
]
