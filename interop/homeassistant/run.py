"""The daemon's discovery for Home Assistant, judged by a real one: what it finds, what it switches,
and that nothing is left of what is no more.

`cargo xtask test` runs this from the root of the repository, with the Python of the peers, as root:
Home Assistant needs a Debian of its own, which `install.py` makes.
"""

import concurrent.futures
import pathlib
import re
import signal
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import install
import rig
import tables
from home import Home
from judge import daemon
from modbus_tcp import until
from mqtt import Broker, Plant, Watcher

tables.TABLES["Home Assistant"] = """
{device,component,component for an old one}: {devices,entities,units and classes,values}
{device,component,component for an old one}: switched by Home Assistant
{device,component,component for an old one}: on when the relay is on
a button: {with a confirmation,a pulse}
an output that becomes {a button,shown only}: no ghost
a dead module: {unavailable,never on,the others go on,back again}
not known: unknown
Home Assistant restarted: everything again
a broker with an empty store: everything again
a module renamed: no ghost
a module removed: no ghost
another form: {the same entities,nothing of the other is left}
discovery off: nothing is left
the outlet removed: nothing is left
exported for {a new one,an old one}, over {MQTT,Modbus}: {entities,values,switched,a dead module}
exported for {a new one,an old one}: complains of nothing
{a new one,an old one} complains of nothing
"""

# What each module has by kind: the relay k6 is locked, and k7 wants a confirmation.
ENTITIES = {
    "oven": {"switch": ("k1", "k2", "k3", "k4", "k5", "k8"),
             "binary_sensor": ("k6_state", "k7_state"), "button": ("k7_on", "k7_off")},
    "hall": {"switch": ("do0", "do1", "do2", "do3"),
             "binary_sensor": ("di0", "di1", "di2", "di3")},
    "tank": {"switch": ("k1", "k2"), "sensor": ("ai1", "ai2")},
}
PREFIX = "railbus_plant_"
# What is shown as long as nothing is switched.
VALUES = {"tank.ai1": "8.71", "tank.ai2": "2.50", "hall.di0": "on", "hall.di1": "off",
          "oven.k1": "off", "oven.k6_state": "off", "tank.k2": "off"}
# What it says of itself, of a broker that is gone, and of a device whose entities have moved.
USUAL = ("[homeassistant.bootstrap]", "[homeassistant.setup]", "[aiohttp_fast_zlib]",
         "Error returned from MQTT server", "Failed to connect to MQTT server",
         "No device components to cleanup for railbus_plant_")


# How it says that a module does not answer over Modbus.
OVER_MODBUS = ("pymodbus returned isError True",)


class Exported(Plant):
    """The plant with a Modbus TCP server beside MQTT, and what is exported of it."""

    def __init__(self, broker, tally):
        held, self.port = rig.free_port()
        super().__init__(broker, "5", tally=tally, write=["*"])
        self.held.append(held)

    def text(self, **settings):
        """The configuration."""
        plc = f'\n[outlet.plc]\ntype = "modbus_tcp"\nlisten = "127.0.0.1:{self.port}"\n'
        return super().text(**settings) + plc + 'write = ["*"]\n'

    def packages(self):
        """The exports, by outlet."""
        export = lambda outlet: subprocess.run(
            [daemon.program(), "export", "ha", "--config", self.daemon.config, "--outlet", outlet,
             "--site", "plant"],
            check=True, capture_output=True, text=True).stdout
        return {outlet: export(outlet) for outlet in ("scada", "plc")}

    def judged(self, home, entry, prefix):
        """The entities over one way: they are there, show what is so, and switch."""
        entity = lambda point: home.ask("named").get(prefix + point.replace(".", "_"))
        state = lambda point: home.ask("states").get(entity(point), {}).get("state")
        points = ["oven.k1", "oven.k8", "hall.di0", "hall.do3", "tank.ai1", "tank.ai2", "tank.k2"]
        missing = lambda: [point for point in points if not entity(point)]
        until(lambda: not missing())
        self.check(f"{entry}: entities", missing(), [])
        sensor = home.ask("states").get(entity("tank.ai1"), {})
        got = tuple(sensor.get(key) for key in ("unit_of_measurement", "device_class"))
        self.check(f"{entry}: entities", got, ("V", "voltage"), "ai1")

        def shows(what, point, want, why=""):
            until(lambda: state(point) == want)
            self.check(f"{entry}: {what}", state(point), want, f"{point} {why}")

        for point, want in {"tank.ai1": "8.71", "hall.di0": "on", "hall.di1": "off",
                            "oven.k1": "off"}.items():
            shows("values", point, want)
        for way, bit in (("on", 1), ("off", 0)):
            home.ask("call", service=f"switch.turn_{way}", entity=entity("oven.k1"))
            shows("switched", "oven.k1", way)
            self.check(f"{entry}: switched", self.sim.outputs("oven")[0], bit, "the relay")
        self.sim.do("power oven off")
        shows("a dead module", "oven.k1", "unavailable")
        home.ask("call", service="switch.turn_on", entity=entity("oven.k1"))
        shows("a dead module", "oven.k1", "unavailable", "turned on")
        self.check(f"{entry}: a dead module", state("hall.di0"), "on", "another one")
        self.sim.do("power oven on")
        shows("a dead module", "oven.k1", "off", "with power")


class House(Plant):
    """The plant, and a Home Assistant at its broker."""

    def __init__(self, broker, home, tally, discovery):
        super().__init__(broker, "5", tally=tally, write=["*"], discovery=discovery)
        self.home = home

    def found(self):
        """The registered entities by their unique ids."""
        entities = self.home.ask("registry")["entities"]
        return {each["unique_id"]: {"entity_id": name, **each} for name, each in entities.items()}

    def entity(self, point):
        """The entity of a point, `oven.k1`."""
        return self.found()[PREFIX + point.replace(".", "_")]["entity_id"]

    def state(self, point):
        """What Home Assistant shows of a point."""
        return self.home.ask("states").get(self.entity(point), {}).get("state")

    def shows(self, entries, point, want, what=""):
        """Home Assistant shows this at last."""
        entity = self.entity(point)
        state = lambda: self.home.ask("states").get(entity, {}).get("state")
        until(lambda: state() == want)
        self.check(entries, state(), want, f"{point} {what}")

    def turn(self, way, point):
        """Switches as its user does."""
        self.home.ask("call", service=f"switch.turn_{way}", entity=self.entity(point))

    def press(self, point):
        """Presses a button."""
        self.home.ask("call", service="button.press", entity=self.entity(point))

    def history(self, point):
        """Every state that was shown of a point."""
        return self.home.ask("history", entity=self.entity(point))

    def set(self, **settings):
        """Changes the outlet."""
        self.settings |= settings
        self.ask("PUT", "/outlets/mqtt/scada", self.settings)

    def change(self, module, settings):
        """Changes what a module keeps."""
        path = f"/modules/{module}/settings"
        etag = self.ask("GET", path)["etag"]
        status, said = self.daemon.ask("PATCH", path, settings, {"If-Match": f'"{etag}"'})
        if status >= 300:
            raise RuntimeError(f"{path}: {said}")
        if not until(lambda: self.ask("GET", f"/ops/{said['op']}")["state"] != "running"):
            raise RuntimeError(f"{path} does not end")

    def reload(self, text):
        """Gives the daemon another configuration."""
        self.daemon.config.write_text(text, encoding="utf-8")
        self.daemon.process.send_signal(signal.SIGHUP)

    def values(self, entries):
        """What is read is shown at last."""
        for point, want in VALUES.items():
            self.shows(entries, point, want)

    def there(self, entries, modules, what=""):
        """Exactly the entities of these modules are there at last, each with a state, and exactly
        these devices."""
        want = {(kind, f"{PREFIX}{module}_{key}") for module, kinds in modules.items()
                for kind, keys in kinds.items() for key in keys}
        points = lambda: {(each["domain"], unique) for unique, each in self.found().items()
                          if each["entity_category"] is None}
        until(lambda: points() == want)
        self.check(entries, points() ^ want, set(), f"entities too many or missing {what}")
        devices = lambda: {each for device in self.home.ask("registry")["devices"].values()
                           for each in device["identifiers"]}
        wanted = {PREFIX + module for module in modules}
        until(lambda: devices() == wanted)
        self.check(entries, devices() ^ wanted, set(), f"devices too many or missing {what}")
        lost = lambda: ({each["entity_id"] for each in self.found().values()}
                        - set(self.home.ask("states")))
        until(lambda: not lost())
        self.check(entries, lost(), set(), f"without a state {what}")

    def nothing(self, entries):
        """No entity and no device is left, and nothing at the broker."""
        until(lambda: not any(self.home.ask("registry").values()))
        self.check(entries, self.home.ask("registry"), {"devices": {}, "entities": {}})
        self.check(entries, self.kept(), [], "kept by the broker:")

    def kept(self):
        """The topics of discovery that the broker keeps."""
        # What is kept comes in one piece, and this is the last of it.
        mark = "homeassistant/~"
        self.publish_at(mark, "x", "-r")
        late = Watcher(self.broker, "mqttv5", "homeassistant/#")
        until(lambda: late.newest(mark))
        self.publish_at(mark, "", "-r")
        told = [topic for topic in late.order() if topic.endswith("/config")]
        late.close()
        return told


# The cases --------------------------------------------------------------------------------------


def discovered(s, form):
    """Devices and entities, and what is said of them."""
    s.there(f"{form}: entities", ENTITIES)
    connected = {PREFIX + f"{module}_connection" for module in ENTITIES}
    diagnostics = lambda: {unique for unique, each in s.found().items()
                           if each["entity_category"] == "diagnostic"}
    until(lambda: diagnostics() == connected)
    s.check(f"{form}: entities", diagnostics(), connected, "diagnostics")
    devices = {device["identifiers"][0]: device
               for device in s.home.ask("registry")["devices"].values()}
    for module, model in (("oven", "ERC-8"), ("hall", "EDA9060A"), ("tank", "EMD-2A2Q")):
        told = devices[PREFIX + module]
        s.check(f"{form}: devices", (told["name"], told["model"]), (module, model))
    states = s.home.ask("states")
    sensor = states[s.entity("tank.ai1")]
    got = tuple(sensor.get(key) for key in ("unit_of_measurement", "device_class", "state_class"))
    s.check(f"{form}: units and classes", got, ("V", "voltage", "measurement"), "ai1")
    s.values(f"{form}: values")
    # Home Assistant would mark what it only assumes.
    assumed = [entity for entity, each in s.home.ask("states").items()
               if each.get("assumed_state")]
    s.check(f"{form}: on when the relay is on", assumed, [], "assumed")


def switched(s, form):
    """A relay, and what is sent for that."""
    orders = Watcher(s.broker, "mqttv5", "railbus/plant/+/+/set", "--retain-as-published",
                     "-t", "ready", "-q", "2", "-F", "%r %t %q %p")
    try:
        turned(s, form, orders)
    finally:
        orders.close()


def turned(s, form, orders):
    """The relay is turned on and off; `orders` follows the commands."""
    entry = f"{form}: switched by Home Assistant"
    until(lambda: (s.publish_at("ready", "x"), orders.newest("ready"))[1])
    for way, bit in (("on", 1), ("off", 0)):
        since, before = orders.count(), len(s.history("oven.k1"))
        s.turn(way, "oven.k1")
        s.shows(f"{form}: on when the relay is on", "oven.k1", way, f"turned {way}")
        s.check(entry, s.sim.outputs("oven")[0], bit, f"the relay, turned {way}")
        s.told(entry, "oven/k1/state", way.upper())
        s.check(entry, s.history("oven.k1")[before:], [way], "what was shown")
        sent = lambda since=since: [each[1:] for each in orders.got[since:] if "/set" in each[2]]
        until(sent)
        # Not to be kept, and delivered at least once.
        s.check(entry, sent(), [(False, "railbus/plant/oven/k1/set", f"1 {way.upper()}")], "sent")


def pressed(s):
    """A relay that wants a confirmation has a button for each state."""
    entry = "a button: with a confirmation"
    for way, bit in (("on", 1), ("off", 0)):
        s.press(f"oven.k7_{way}")
        s.shows(entry, "oven.k7_state", way)
        s.check(entry, s.sim.outputs("oven")[6], bit, f"the relay, {way}")


def pulsed(s):
    """The module is told that an output gives pulses, and that it gives none any more."""
    entry = "an output that becomes a button: no ghost"
    s.change("hall", {"do3.mode": "pulse", "pulse_width": "3 s"})
    hall = {"switch": ("do0", "do1", "do2"), "button": ("do3_pulse",),
            "binary_sensor": ("di0", "di1", "di2", "di3", "do3_state")}
    s.there(entry, {**ENTITIES, "hall": hall})
    s.shows(entry, "hall.do3_state", "off")
    before = len(s.history("hall.do3_state"))
    s.press("hall.do3_pulse")
    until(lambda: len(s.history("hall.do3_state")) > before + 1)
    s.check("a button: a pulse", s.history("hall.do3_state")[before:], ["on", "off"], "shown")
    s.change("hall", {"do3.mode": "level"})
    s.there(entry, ENTITIES, "back again")
    s.shows(entry, "hall.do3", "off")


def allowed(s):
    """What may not be switched any more is shown, and nothing else."""
    entry = "an output that becomes shown only: no ghost"
    s.set(write=["oven.k1"])
    oven = [f"k{nth}_state" for nth in range(2, 9)]
    hall = (*ENTITIES["hall"]["binary_sensor"], *(f"do{nth}_state" for nth in range(4)))
    s.there(entry, {
        "oven": {"switch": ("k1",), "binary_sensor": oven},
        "hall": {"binary_sensor": hall},
        "tank": {"binary_sensor": ("k1_state", "k2_state"), "sensor": ("ai1", "ai2")},
    })
    s.shows(entry, "oven.k2_state", "off")
    s.set(write=["*"])
    s.there(entry, ENTITIES, "back again")
    s.values(entry)


def dead(s):
    """A module without power, which may be switched from Home Assistant all the same."""
    entry = "a dead module: never on"
    before = len(s.history("oven.k1"))
    # Nobody knows yet.
    s.sim.do("power oven off")
    s.turn("on", "oven.k1")
    for keys in ENTITIES["oven"].values():
        for key in keys:
            s.shows("a dead module: unavailable", f"oven.{key}", "unavailable")
    s.shows("a dead module: unavailable", "oven.connection", "off")
    result = s.order("oven/k1", "ON")
    s.check(entry, result["end"], "unknown", "an order")
    s.check(entry, s.state("oven.k1"), "unavailable", "after an order")
    s.check("a dead module: the others go on", s.state("hall.di0"), "on", "hall.di0")
    s.turn("on", "hall.do0")
    s.shows("a dead module: the others go on", "hall.do0", "on", "switched")
    s.turn("off", "hall.do0")
    s.sim.do("power oven on")
    s.shows("a dead module: back again", "oven.k1", "off", "with power")
    told = s.history("oven.k1")[before:]
    s.check(entry, "on" in told, False, f"shown: {told}")


def unknown(s):
    """What the outlet says while a value is not good."""
    entry = "not known: unknown"
    for topic, known in (("oven/k2", "OFF"), ("hall/di0", "ON"),
                         ("tank/ai1", "8.71")):
        s.publish(f"{topic}/state", "None", "-r")
        s.shows(entry, topic.replace("/", "."), "unknown")
        s.publish(f"{topic}/state", known, "-r")
        s.shows(entry, topic.replace("/", "."), known.lower(), "again")


def restarted(s):
    """Home Assistant is stopped and started."""
    entry = "Home Assistant restarted: everything again"
    since = s.watcher.count()
    s.home.stop()
    s.home.start()
    s.there(entry, ENTITIES)
    s.values(entry)
    online = until(lambda: "online" in s.watcher.all("homeassistant/status", since))
    s.check(entry, online, True, "it says that it is there")


def emptied(s):
    """The broker comes back with an empty store."""
    entry = "a broker with an empty store: everything again"
    s.broker.kill()
    s.shows(entry, "oven.k1", "unavailable", "without a broker")
    s.broker.start()
    s.watch()
    # Until then it has what it knew before, and hears of nothing.
    until(lambda: s.watcher.newest("homeassistant/status") == "online")
    s.there(entry, ENTITIES)
    s.values(entry)
    s.check(entry, len(s.kept()), len(ENTITIES), "messages at the broker")


def renamed(s):
    """A module gets another name, and is removed."""
    entry = "a module renamed: no ghost"
    text = s.text()
    others = {name: kinds for name, kinds in ENTITIES.items() if name != "tank"}
    s.reload(text.replace("[module.tank", "[module.vat"))
    s.there(entry, {**others, "vat": ENTITIES["tank"]})
    s.shows(entry, "vat.ai1", "8.71")
    left = [topic for topic in s.kept() if "tank" in topic]
    s.check(entry, left, [], "kept by the broker:")
    entry = "a module removed: no ghost"
    s.reload(re.sub(r"\[module\.tank\].*?(?=\n\[)", "", text, flags=re.DOTALL))
    s.there(entry, others)
    left = [topic for topic in s.kept() if "tank" in topic or "vat" in topic]
    s.check(entry, left, [], "kept by the broker:")
    s.reload(text)
    s.there(entry, ENTITIES, "afterwards")
    s.values(entry)


def changed(s, form):
    """The other form of discovery."""
    entry = "another form: the same entities"
    s.home.ask("rename", entity=s.entity("oven.k1"), name=f"before {form}")
    what = lambda: {unique: (each["entity_id"], each["id"], each["name"])
                    for unique, each in s.found().items()}
    before = what()
    s.set(discovery=form)
    right = lambda topic: ("/device/" in topic) == (form == "device")
    until(lambda: (kept := s.kept()) and all(right(topic) for topic in kept))
    wrong = [topic for topic in s.kept() if not right(topic)]
    s.check("another form: nothing of the other is left", wrong, [], form)
    s.there(entry, ENTITIES, form)
    s.values(entry)
    s.check(entry, what(), before, form)


def removed(s):
    """Nobody wants discovery any more, and then no outlet."""
    entry = "discovery off: nothing is left"
    s.set(discovery="off")
    s.nothing(entry)
    s.set(discovery="device")
    s.there(entry, ENTITIES, "on again")
    s.ask("DELETE", "/outlets/mqtt/scada")
    s.nothing("the outlet removed: nothing is left")


def complains(s, who):
    """What it warns of, it says to its user too."""
    complaints = [line for line in s.home.said().splitlines()
                  if (" WARNING " in line or " ERROR " in line)
                  and not any(usual in line for usual in USUAL)]
    s.check(f"{who} complains of nothing", complaints, [])


def new(s):
    """Everything with a new one."""
    discovered(s, "device")
    switched(s, "device")
    pressed(s)
    pulsed(s)
    allowed(s)
    dead(s)
    unknown(s)
    restarted(s)
    emptied(s)
    renamed(s)
    changed(s, "component")
    discovered(s, "component")
    switched(s, "component")
    changed(s, "device")
    removed(s)
    complains(s, "a new one")


def old(s):
    """One that knows no messages for whole devices."""
    discovered(s, "component for an old one")
    switched(s, "component for an old one")
    complains(s, "an old one")


def exported(tally, version, who):
    """What `railbus export ha` writes, over MQTT and over Modbus, in one Home Assistant."""
    began = time.monotonic()
    broker = Broker()
    try:
        with Exported(broker, tally) as s:
            s.settled()
            home = Home(broker, version, s.packages())
            try:
                home.start()
                for way, prefix in (("MQTT", PREFIX), ("Modbus", PREFIX + "plc_")):
                    s.judged(home, f"exported for {who}, over {way}", prefix)
                complaints = [line for line in home.said().splitlines()
                              if (" WARNING " in line or " ERROR " in line)
                              and not any(usual in line for usual in (*USUAL, *OVER_MODBUS))]
                s.check(f"exported for {who}: complains of nothing", complaints, [])
            finally:
                home.close()
    finally:
        broker.close()
    print(f"Home Assistant {version}, exported: {time.monotonic() - began:.0f} s", flush=True)


def run(tally, version, discovery, cases):
    """Runs these cases with this Home Assistant."""
    began = time.monotonic()
    broker = Broker()
    try:
        home = Home(broker, version)
        try:
            home.start()
            with House(broker, home, tally, discovery) as s:
                cases(s.settled())
        finally:
            home.close()
    finally:
        broker.close()
    print(f"Home Assistant {version}: {time.monotonic() - began:.0f} s", flush=True)


def judged(version, who, discovery, cases):
    """The tally of one Home Assistant."""
    tally = rig.Tally("Home Assistant")
    try:
        run(tally, version, discovery, cases)
        exported(tally, version, who)
    except rig.GivenUp as given_up:
        print(given_up)
    return tally


def main(words):
    """Runs everything, or with `--install` only makes sure that both are installed; returns the
    exit code."""
    install.clear()
    if words == ["--install"]:
        with concurrent.futures.ThreadPoolExecutor() as pool:
            list(pool.map(install.root, install.SUITES))
        return 0
    daemon.build()
    # At the same time: they mostly wait, and one is installed while the other runs.
    with concurrent.futures.ThreadPoolExecutor() as pool:
        running = [pool.submit(judged, "2026.2.3", "a new one", "device", new),
                   pool.submit(judged, "2024.3.3", "an old one", "component", old)]
        tallies = [future.result() for future in running]
    failures = [failure for tally in tallies for failure in tally.failures]
    for failure in failures:
        print(f"FAILED {failure}")
    entries = tallies[0].open
    without = entries - set().union(*(tally.covered for tally in tallies))
    for entry in sorted(without):
        print(f"FAILED nothing exercises `{entry}`")
    print(f"{len(entries - without)} of {len(entries)} entries exercised")
    failed = len(failures) + len(without)
    print(f"{sum(tally.passed for tally in tallies)} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
