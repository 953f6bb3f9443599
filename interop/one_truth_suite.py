"""One site, and everybody who can be told of it at once: each says the same of a point, with the
source time of the same reading, when it changes, when its module falls silent and comes back, and
when it is read too seldom.

How soon they say so is measured by `measure.py stale`; here nothing is judged by the clock."""

import datetime
import json
import subprocess
import threading

import mqtt
import opcua
import sparkplug
from judge.daemon import Follower, program
from modbus_tcp import HOST, Client, until
from outlet_plant import OutletPlant
from rig import Tally, free_port

SITE, USER = "plant", "li"
GOOD, STALE, BAD = "good", "stale", "bad"
OF_OPCUA = {"Good": GOOD, "UncertainLastUsableValue": STALE}
OF_SPARKPLUG = {sparkplug.GOOD: GOOD, sparkplug.STALE: STALE}
READ_COILS, READ_INPUTS, UNKNOWN = 1, 2, "0b"
# The points that are followed, with the function, unit and address of Modbus: an input of an ASCII
# module, and an output of one that is read too seldom for its age limit.
INPUT, OUTPUT = "hall.di0", "yard.k1"
OF_MODBUS = {INPUT: (READ_INPUTS, 1, 0), OUTPUT: (READ_COILS, 9, 0)}


# A module that is read once, and whose values are soon too old.
ONCE = """
[module.yard]
line = "main"
model = "erc8"
address = 9
poll = "1h"
max_age = "1s"
sim = {{ turnaround = "30ms" }}
"""


def millis(time):
    """A time, or how JSON has it, in milliseconds since 1970, exactly; None without one."""
    if isinstance(time, str):
        time = datetime.datetime.fromisoformat(time.replace("Z", "+00:00"))
    begin = datetime.datetime(1970, 1, 1, tzinfo=datetime.timezone.utc)
    return time and (time - begin) / datetime.timedelta(milliseconds=1)


class Plant(OutletPlant):
    """The modules, a daemon with four outlets, and one who follows each way out of it."""

    kind = "mqtt"

    def __init__(self, tally):
        self.broker = mqtt.Broker()
        modbus, self.modbus_port = free_port()
        ua, self.opcua_port = free_port()
        others = {
            "scada": {"type": "modbus_tcp", "listen": f"{HOST}:{self.modbus_port}",
                      "map": "uniform"},
            "historian": {"type": "sparkplug", **self.broker.settings(), "group": sparkplug.GROUP,
                          "node": sparkplug.NODE},
            "ua": {"type": "opcua", "listen": f"{HOST}:{self.opcua_port}", "anonymous": True},
        }
        more = "".join(f"\n[outlet.{name}]\n" + "".join(
            f"{key} = {json.dumps(value)}\n" for key, value in settings.items())
            for name, settings in others.items())
        super().__init__(tally, {**self.broker.settings(), "site": SITE}, ONCE + more)
        self.held += [modbus, ua]
        self.name = "mq"
        self.daemon.config.write_text(self.text(), encoding="utf-8")
        self.watcher = mqtt.Watcher(self.broker, "mqttv5", f"railbus/{SITE}/#")
        self.host = sparkplug.Host(self.broker)
        self.lock, self.pushed, self.watched = threading.Lock(), {}, {}
        self.socket = self.process = self.session = self.master = None

    def started(self):
        """Begins to follow."""
        self.socket = Follower(self.daemon, ["points/#"], self._pushed)
        command = [program(), "watch", INPUT, OUTPUT, "-o", "ndjson", "--socket",
                   self.daemon.socket]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True,
                                        stderr=subprocess.DEVNULL)
        threading.Thread(target=self._watched, daemon=True).start()
        if not until(self._serves):
            raise RuntimeError(f"it does not serve: {self.ask('GET', '/outlets')}")
        self.session = opcua.Session(self.opcua_port)
        self.told = self.session.watch(INPUT, OUTPUT, interval=0.0, filtered=True)
        self.master = Client(self.modbus_port)

    def _serves(self):
        states = [each["state"] for each in self.ask("GET", "/outlets")["outlets"]]
        return states == ["running"] * 4

    def __exit__(self, *words):
        for each in (self.socket, self.session, self.master):
            if each:
                each.close()
        super().__exit__(*words)
        if self.process:
            self.process.kill()
            self.process.wait()
        self.watcher.close()
        self.host.stop()
        self.broker.close()

    def _pushed(self, _, message):
        with self.lock:
            for each in message.get("data") or message.get("points") or ():
                self.pushed[each["path"]] = each

    def _watched(self):
        for line in self.process.stdout:
            each = json.loads(line)
            if each["ev"] == "point":
                with self.lock:
                    self.watched[each["path"]] = each

    # What each says of a point: its quality, its value where that can be relied upon, and the
    # source time. None for what the way can't say.

    def by_websocket(self, path):
        """The push of the API."""
        with self.lock:
            return as_json(self.pushed.get(path))

    def by_watch(self, path):
        """`railbus watch`."""
        with self.lock:
            return as_json(self.watched.get(path))

    def by_history(self, path):
        """The newest sample. One that is not good has the time at which it became so."""
        samples = self.ask("GET", f"/history?point={path}")["samples"]
        if not samples:
            return None
        newest = samples[-1]
        if newest["q"] != GOOD:
            return newest["q"], None, None
        return GOOD, bool(newest["v"]), newest["t"]

    def by_mqtt(self, path):
        """The topics of the point, and of its module."""
        newest = lambda topic: self.watcher.newest(f"railbus/{SITE}/{topic}")
        module, label = path.split(".")
        state, attr = newest(f"{module}/{label}/state"), newest(f"{module}/{label}/attr")
        if state is None or attr is None:
            return None
        attr = json.loads(attr)
        is_online = newest(f"{module}/availability") == "online"
        if (state != "None") != (attr["quality"] == GOOD) or is_online == (attr["quality"] == BAD):
            return "not of one piece", state, attr
        value = {"ON": True, "OFF": False, "None": None}[state]
        return attr["quality"], value, millis(attr["time"])

    def by_sparkplug(self, path):
        """The metric; that of a device that is dead has no quality of its own. One that is not good
        has the time at which it became so (docs/decisions/0049)."""
        module, label = path.split(".")
        said = BAD, None, None
        with self.host.lock:
            got = list(self.host.got)
        for message in got:
            kind, is_its = message.get("kind"), message.get("device") == module
            if kind in ("NBIRTH", "NDEATH") or (kind == "DDEATH" and is_its):
                said = BAD, None, None
            elif kind in ("DBIRTH", "DDATA") and is_its:
                if one := sparkplug.metric(message, label):
                    quality = OF_SPARKPLUG.get(sparkplug.quality(one), BAD)
                    value = one["value"] if quality == GOOD else None
                    said = quality, value, one["time"] if quality == GOOD else None
        return said

    def by_opcua(self, path):
        """What a subscription was told."""
        with self.told.lock:
            got = list(self.told.got.get(path, ()))
        if not got:
            return None
        status, value, time = got[-1]
        quality = OF_OPCUA.get(status, BAD)
        return (quality, value if quality == GOOD else None,
                millis(time) if quality != BAD else None)

    def by_opcua_history(self, path):
        """The newest that a client reads of the past."""
        now, hour = datetime.datetime.now(datetime.timezone.utc), datetime.timedelta(hours=1)
        kept = self.session.history(path, now - hour, now + hour)
        if not kept:
            return None
        status, value, time = kept[-1]
        quality = OF_OPCUA.get(status, BAD)
        return (quality, value if quality == GOOD else None,
                millis(time) if quality == GOOD else None)

    def by_modbus(self, path):
        """An answer, or an exception, which does not say why."""
        function, unit, first = OF_MODBUS[path]
        told = self.master.ask(unit, function, 0, first, 0, 1).split(" ")
        if told[0] == f"{function | 0x80:02x}":
            return told[1], None, None
        return GOOD, told[2] == "01", None


WAYS = {
    "WebSocket": Plant.by_websocket, "watch": Plant.by_watch, "history": Plant.by_history,
    "MQTT": Plant.by_mqtt, "Sparkplug": Plant.by_sparkplug, "OPC UA": Plant.by_opcua,
    "OPC UA history": Plant.by_opcua_history, "Modbus TCP": Plant.by_modbus,
}
# Those that say of a value that is too old when it was read; others say since when it is so.
OF_READING = ("WebSocket", "watch", "MQTT", "OPC UA")


def as_json(told):
    """What the API and `watch` say."""
    if told is None:
        return None
    quality = told["quality"]
    return (quality, told.get("value") if quality == GOOD else None,
            millis(told.get("time")) if quality != BAD else None)


def agreed(s, what, path, quality, value=None, since=None):
    """Each says this of a point, at last; with one source time, if it is a reading after the time
    that is named. Its time."""
    pushed = lambda: s.by_websocket(path) or (None, None, None)
    time = lambda: pushed()[2]
    until(lambda: pushed()[:2] == (quality, value) and (since is None or time() > since))
    for way, its in WAYS.items():
        has_time = way in OF_READING or (quality == GOOD and way != "Modbus TCP")
        want = (UNKNOWN if way == "Modbus TCP" and quality != GOOD else quality, value,
                time() if has_time and since is not None else None)

        def said(its=its):
            found = its(s, path)
            return found and (*found[:2], found[2] if since is not None else None)

        until(lambda: said() == want)
        s.check(f"{what}: {way}", said(), want, path)
    return time()


def suite():
    """Everything."""
    with Plant(Tally("one truth")) as s:
        # Each has the time of the reading after which it began to follow.
        began = agreed(s, "known", INPUT, GOOD, True)
        s.sim.do("hall.di0 = 0")
        changed = agreed(s, "a change", INPUT, GOOD, False, began)
        s.sim.do("power hall off")
        agreed(s, "a silent module", INPUT, BAD)
        s.sim.do("hall.di0 = 1")
        s.sim.do("power hall on")
        agreed(s, "it is back", INPUT, GOOD, True, changed)
        agreed(s, "read too seldom", OUTPUT, STALE, since=0)
    return s.tally


SUITES = [("one truth", suite)]
