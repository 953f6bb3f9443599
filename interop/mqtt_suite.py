"""The daemon's MQTT client, with mosquitto and its clients: every topic is told, what is ordered is
done and its true end published, and no value is told that is not known."""

import json
import signal
import time

from modbus_tcp import until
from mqtt import PASSWORD, Broker, OldBroker, Plant, Watcher
from outlet_plant import MAX_AGE
from rig import free_port

ALL = {"write": ["*"]}
OFF = [0] * 8
# After this time others know that the daemon is gone, in seconds.
GONE_MAX = 10.0
# Where it is frozen: one and a half keep-alives, and mosquitto looks every 5 s only.
FROZEN_MAX = 15.0

# How a broker is reached: version, and what it wants.
WAYS = {
    "5": ("5", ()),
    "3.1.1": ("3.1.1", ()),
    "5 with TLS": ("5", ("tls", "password")),
    "3.1.1 with TLS": ("3.1.1", ("tls", "password")),
}


def suite(way):
    """Everything over one way."""
    version, kinds = WAYS[way]

    def run():
        broker = Broker(kinds)
        try:
            with Plant(broker, version, **ALL) as s:
                s.settled()
                topics(s, way)
                switched(s, way)
                together(s, way)
                faults(s, way)
                retained(s, way, version)
                if version == "5":
                    answered(s, way)
            with Plant(broker, version, tally=s.tally, write=["oven.k1"]) as s:
                s.settled()
                rights(s, way)
        finally:
            broker.close()
        return s.tally

    return run


def topics(s, way):
    """What is published."""
    entry = f"{way}: every topic"
    for topic, want in (
        ("oven/availability", "online"), ("oven/k1/state", "OFF"), ("hall/di0/state", "ON"),
        ("hall/di1/state", "OFF"), ("tank/ai1/state", "8.71"), ("bridge/state", "online"),
    ):
        s.told(entry, topic, want)
    attr = json.loads(s.newest("hall/di0/attr"))
    s.check(entry, (attr["quality"], attr["max_age_ms"]), ("good", MAX_AGE * 1000), "attr")
    s.check(entry, attr["time"][:2], "20", "source time")
    info = json.loads(s.newest("bridge/info"))
    s.check(entry, sorted(info["modules"]), ["hall", "oven", "tank"], "bridge/info")
    s.check(entry, (info["groups"], info["scenes"]), (["lamps"], ["night"]), "bridge/info")
    # Whoever comes later gets what is kept, and nothing else.
    late = Watcher(s.broker, s.spoken)
    until(lambda: late.newest("railbus/plant/tank/k2/state") is not None
          and late.newest("railbus/plant/bridge/state") is not None)
    with late.lock:
        kept = {topic for _, is_kept, topic, _ in late.got if is_kept}
        wrong = {topic.rsplit("/", 1)[1] for topic in kept}
    late.close()
    s.check(entry, wrong, {"state", "attr", "availability", "info"}, "kept by the broker:")
    s.sim.do("hall.di1 = 1")
    s.told(entry, "hall/di1/state", "ON", "after a change")
    s.sim.do("hall.di1 = 0")
    s.told(entry, "hall/di1/state", "OFF", "after a change")


def switched(s, way):
    """A relay, and what is said of it."""
    entry = f"{way}: switched and read back"
    for payload, value in (("ON", 1), ("OFF", 0), ("TOGGLE", 1), ("TOGGLE", 0)):
        result = s.order("oven/k1", payload)
        s.check(entry, (result["end"], result["value"]), ("readback", bool(value)), payload)
        s.check(entry, result["audit"] is not None, True, "a number in the audit log")
        s.check(entry, s.sim.outputs("oven"), [value, *OFF[1:]], f"relays after {payload}")
        s.told(entry, "oven/k1/state", "ON" if value else "OFF", f"after {payload}")
    result = s.order("oven/k2", "PULSE 300")
    s.check(f"{way}: a pulse", (result["end"], result["value"]), ("readback", True), str(result))
    ended = until(lambda: s.sim.outputs("oven") == OFF)
    s.check(f"{way}: a pulse", ended, True, "the relay is released")
    s.told(f"{way}: a pulse", "oven/k2/state", "OFF", "after the pulse")
    result = s.order("oven/k3", json.dumps({"value": "ON", "if": "ON"}))
    s.check(f"{way}: JSON", (result["end"], result["code"]), ("failed", "E0108"), "if ON")
    result = s.order("oven/k7", "ON")
    s.check(f"{way}: JSON", result["code"], "E0450", "without confirm")
    result = s.order("oven/k7", json.dumps({"value": "ON", "confirm": True, "id": f"c{way}"}))
    s.check(f"{way}: JSON", (result["end"], result["id"]), ("readback", f"c{way}"), "confirm")
    result = s.order("oven/k7", json.dumps({"value": False, "confirm": True, "within_ms": 3000}))
    s.check(f"{way}: JSON", result["end"], "readback", "within_ms")
    # The same order under the same id is carried out once.
    once = json.dumps({"value": "TOGGLE", "id": f"once {way}"})
    first, second = s.order("oven/k1", once), s.order("oven/k1", once)
    s.check(f"{way}: once under an id", first, second, "the same result")
    s.check(f"{way}: once under an id", s.sim.outputs("oven")[0], 1, "toggled once")
    other = json.dumps({"value": "OFF", "id": f"once {way}"})
    result = s.order("oven/k1", other)
    s.check(f"{way}: once under an id", result["end"], "failed", "another command")
    s.order("oven/k1", "OFF")
    for payload, code in (("ON", "E0451"),):
        s.order("oven/k5", "ON")
        result = s.order("oven/k4", payload)
        s.check(f"{way}: an interlock", (result["end"], result["code"]), ("failed", code), "k4")
        s.order("oven/k5", "OFF")
    s.check(f"{way}: an interlock", s.sim.outputs("oven"), OFF, "relays")


def together(s, way):
    """A group and a scene."""
    entry = f"{way}: a group and a scene"
    for payload, value in (("ON", 1), ("TOGGLE", 0)):
        result = s.order("group/lamps", payload)
        s.check(entry, (result["end"], len(result["outputs"])), ("readback", 2), payload)
        both = s.sim.outputs("oven")[0], s.sim.outputs("hall")[0]
        s.check(entry, both, (value, value), f"relays after {payload}")
    result = s.order("scene/night", "RUN", verb="run")
    s.check(entry, result["end"], "readback", "scene")
    both = s.sim.outputs("oven")[1], s.sim.outputs("hall")[1]
    s.check(entry, both, (1, 1), "relays after the scene")
    s.order("oven/k2", "OFF")
    s.order("hall/do1", "OFF")
    result = s.order("group/nothing", "ON")
    s.check(entry, (result["end"], result["code"]), ("failed", "E0860"), "unknown group")
    result = s.order("scene/nothing", "RUN", verb="run")
    s.check(entry, (result["end"], result["code"]), ("failed", "E0861"), "unknown scene")


def faults(s, way):
    """What is no command switches nothing."""
    entry = f"{way}: bad payloads switch nothing"
    for payload in ("1", "ONN", "true", "PULSE x", "{", "[]", "null", '{"value": 1}',
                    '{"value": "ON", "what": 1}', '{"value": "ON", "within_ms": 1}',
                    "ON" + " " * 5000):
        result = s.order("oven/k1", payload)
        s.check(entry, (result["end"], result["code"]), ("failed", "E0806"), payload[:40])
        s.check(entry, result["may_have_acted"], False, payload[:40])
    for topic, code in (("oven/k9", "E0802"), ("nothing/k1", "E0801"), ("hall/di0", "E0807"),
                        ("oven/k6", "E0107")):
        result = s.order(topic, "ON")
        s.check(entry, (result["end"], result["code"]), ("failed", code), topic)
    result = s.order("oven/k1", "")
    s.check(entry, (result["end"], result["code"]), ("failed", "E0806"), "nothing")
    s.publish("oven/k1/set/x", "ON")
    s.publish("oven/set", "ON")
    # Its end comes after those, whose effect an OFF would hide.
    s.check(entry, s.order("oven/k2", "what")["end"], "failed", "the last")
    s.check(entry, s.sim.outputs("oven"), OFF, "relays")
    s.check(entry, s.sim.outputs("hall"), [0] * 4, "relays")
    s.check(entry, s.order("oven/k1", "OFF")["end"], "readback", "another command")


def retained(s, way, version):
    """A command that the broker kept is never carried out."""
    entry = f"{way}: a retained command"
    if version == "5":
        result = s.order("oven/k1", "ON", "-r")
        s.check(entry, (result["end"], result["code"]), ("failed", "E0806"), "as it comes")
        s.check(entry, s.sim.outputs("oven"), OFF, "relays")
    else:
        # It can't be told from others while it comes; the broker sends it again at the next time.
        s.order("oven/k1", "ON", "-r")
        s.order("oven/k1", "OFF")
    since = s.watcher.count()
    again(s)
    if version != "5":
        result = "railbus/plant/oven/k1/result"
        until(lambda: s.watcher.all(result, since))
        told = [json.loads(payload)["code"] for payload in s.watcher.all(result, since)]
        s.check(entry, told, ["E0806"], "kept by the broker")
    s.check(entry, s.order("oven/k2", "OFF")["end"], "readback", "another command")
    s.check(entry, s.sim.outputs("oven"), OFF, "relays")
    s.publish("oven/k1/set", "", "-r")


def again(s):
    """The outlet connects once more."""
    since = s.watcher.count()
    s.ask("PUT", "/outlets/mqtt/scada", {**s.settings, "enabled": False})
    until(lambda: "offline" in s.watcher.all("railbus/plant/bridge/state", since))
    s.ask("PUT", "/outlets/mqtt/scada", s.settings)
    until(lambda: "online" in s.watcher.all("railbus/plant/bridge/state", since))


def answered(s, way):
    """Who asks in version 5 gets the answer at its own topic."""
    entry = f"{way}: an answer to who asked"
    words = ["-D", "publish", "response-topic", "answers/7", "-D", "publish",
             "correlation-data", f"c{time.monotonic()}"]
    result = s.order("oven/k1", "ON", *words)
    s.check(entry, result["end"], "readback", "for all")
    until(lambda: s.watcher.newest("answers/7"))
    s.check(entry, json.loads(s.watcher.newest("answers/7") or "{}"), result, "for who asked")
    # The same data again is another command: only an id makes it the same.
    s.order("oven/k1", "OFF")
    since = len(s.watcher.all("answers/7"))
    again_told = s.order("oven/k1", "ON", *words)
    until(lambda: len(s.watcher.all("answers/7")) > since)
    s.check(entry, json.loads(s.watcher.newest("answers/7") or "{}"), again_told, "its own")
    s.check(entry, again_told["audit"] != result["audit"], True, "not the first result")
    s.check(entry, s.sim.outputs("oven")[0], 1, "carried out")
    words = ["-D", "publish", "response-topic", "railbus/plant/bridge/state"]
    s.order("oven/k1", "OFF", *words)
    s.order("oven/k1", "OFF")
    s.check(entry, s.newest("bridge/state"), "online", "not where the outlet speaks itself")
    result = s.order("oven/k1", "ON", "-D", "publish", "message-expiry-interval", "60")
    s.check(f"{way}: an expiry", result["end"], "readback", "60 s")
    s.order("oven/k1", "OFF")


def rights(s, way):
    """What is not in `write` does not move."""
    entry = f"{way}: rights"
    for topic, end, code in (("oven/k1", "readback", None), ("oven/k2", "failed", "E0906"),
                             ("hall/do0", "failed", "E0906"), ("group/lamps", "failed", "E0906")):
        result = s.order(topic, "ON")
        s.check(entry, (result["end"], result.get("code")), (end, code), topic)
    s.check(entry, s.sim.outputs("oven"), [1, *OFF[1:]], "relays")
    s.check(entry, s.sim.outputs("hall"), [0] * 4, "relays")
    s.order("oven/k1", "OFF")
    settings = {key: value for key, value in s.settings.items() if key != "write"}
    since = s.watcher.count()
    s.ask("PUT", "/outlets/mqtt/scada", settings)
    until(lambda: "online" in s.watcher.all("railbus/plant/bridge/state", since))
    result = s.order("oven/k1", "ON")
    s.check(entry, (result["end"], result["code"]), ("failed", "E0905"), "without `write`")
    s.check(entry, s.sim.outputs("oven"), OFF, "relays")


# The connection ----------------------------------------------------------------------------


def life():
    """The daemon and the broker go and come, and names change."""
    broker = Broker()
    try:
        with Plant(broker, **ALL) as s:
            s.settled()
            order_on_connect(s)
            dead(s)
            names(s)
            renamed(s)
            killed(s)
            restarted(s)
            frozen(s)
            removed(s)
    finally:
        broker.close()
    return s.tally


def order_on_connect(s):
    """First everything else, and then `online`."""
    since = s.watcher.count()
    again(s)
    with s.watcher.lock:
        told = [(topic.removeprefix("railbus/plant/"), payload)
                for _, _, topic, payload in s.watcher.got[since:]]
    last = max(nth for nth, each in enumerate(told) if each == ("bridge/state", "offline"))
    told = told[last + 1:]
    online = told.index(("bridge/state", "online"))
    before = {topic for topic, _ in told[:online]}
    entry = "on connect: info, states, and `online` last"
    s.check(entry, told[0][0], "bridge/info", "the first")
    states = [f"oven/k{nth}/state" for nth in range(1, 9)]
    s.check(entry, [topic for topic in states if topic not in before], [], "not before `online`")
    s.check(entry, "tank/availability" in before, True, "availability")


def dead(s):
    """A module without power: nobody is told that its relay is on."""
    entry = "a dead module: None and offline, never ON"
    s.order("oven/k1", "ON")
    s.told(entry, "oven/k1/state", "ON", "before")
    s.sim.do("power oven off")
    began = time.monotonic()
    s.told(entry, "oven/availability", "offline", "without power")
    s.told(entry, "oven/k1/state", "None", "without power")
    took = time.monotonic() - began
    s.check(entry, took < MAX_AGE + 3, True, f"told after {took:.1f} s")
    attr = json.loads(s.newest("oven/k1/attr"))
    s.check(entry, (attr["quality"], attr["reason"]), ("bad", "offline"), "attr")
    result = s.order("oven/k1", "ON")
    known = result["end"], result["may_have_acted"], result["value"]
    s.check(entry, known, ("unknown", True, None), "a command")
    s.check(entry, s.newest("oven/k1/state"), "None", "after a command")
    s.told("a dead module: the others go on", "hall/availability", "online")
    s.check("a dead module: the others go on", s.order("hall/do0", "ON")["end"], "readback", "hall")
    s.order("hall/do0", "OFF")
    s.sim.do("power oven on")
    s.told("a dead module: back again", "oven/availability", "online", "with power")
    s.told("a dead module: back again", "oven/k1/state", "OFF", "with power")


def names(s):
    """What has another name leaves nothing at the broker."""
    entry = "another name: nothing is left"
    text = s.text().replace("[module.tank", "[module.vat")
    s.daemon.config.write_text(text, encoding="utf-8")
    s.daemon.process.send_signal(signal.SIGHUP)
    s.told(entry, "vat/ai1/state", "8.71", "under its new name")
    s.told(entry, "tank/ai1/state", "", "under its old name")
    s.told(entry, "tank/availability", "", "under its old name")
    late = Watcher(s.broker, s.spoken)
    until(lambda: late.newest("railbus/plant/bridge/state"))
    until(lambda: late.newest("railbus/plant/vat/k2/state"))
    left = [topic for topic in late.order() if "/tank/" in topic]
    late.close()
    s.check(entry, left, [], "kept by the broker:")
    entry = "another site: nothing is left"
    s.ask("PUT", "/outlets/mqtt/scada", {**s.settings, "site": "works"})
    until(lambda: s.watcher.newest("railbus/works/bridge/state") == "online")
    for topic in ("oven/k1/state", "hall/availability", "bridge/info", "bridge/state"):
        s.told(entry, topic, "", "under its old name")
    s.ask("PUT", "/outlets/mqtt/scada", s.settings)
    s.told(entry, "bridge/state", "online", "back again")
    until(lambda: s.watcher.newest("railbus/works/bridge/state") == "")
    s.check(entry, s.watcher.newest("railbus/works/bridge/state"), "", "the other site")


# How long an outlet that ends may still publish, in seconds.
LINGERS = 1.5


def renamed(s):
    """An outlet of another name has the same topics: the old one takes nothing away from it."""
    entry = "a renamed outlet keeps its values"
    topics = ("oven/k1/state", "hall/availability", "bridge/info")
    text = s.daemon.config.read_text(encoding="utf-8")
    for name in ("again", "scada"):
        since = s.watcher.count()
        s.daemon.config.write_text(text.replace("[outlet.scada]", f"[outlet.{name}]"),
                                   encoding="utf-8")
        s.daemon.process.send_signal(signal.SIGHUP)
        online = until(lambda: "online" in s.watcher.all("railbus/plant/bridge/state", since))
        s.check(entry, online, True, f"{name} is online")
        # Nothing more is to come.
        until(lambda: "offline" in s.watcher.all("railbus/plant/bridge/state", since)[1:], LINGERS)
        s.check(entry, s.newest("bridge/state"), "online", f"{name}, bridge/state")
        # Not even for a moment: whoever comes then would find nothing.
        told = {topic: s.watcher.all(f"railbus/plant/{topic}", since) for topic in topics}
        gone = [topic for topic, payloads in told.items() if "" in payloads]
        s.check(entry, gone, [], f"{name}, cleared:")
    # What the other one does not tell is cleared, not left as if it were so.
    entry = "a renamed outlet with fewer modules leaves nothing"
    since = s.watcher.count()
    fewer = text.replace("[outlet.scada]", "[outlet.fewer]") + 'modules = ["oven"]\n'
    s.daemon.config.write_text(fewer, encoding="utf-8")
    s.daemon.process.send_signal(signal.SIGHUP)
    for topic in ("hall/availability", "hall/di1/state", "tank/ai1/attr"):
        s.told(entry, topic, "", "not told any more")
    until(lambda: s.newest("bridge/state") == "online")
    s.check(entry, "" in s.watcher.all("railbus/plant/oven/k1/state", since), False, "oven")
    s.daemon.config.write_text(text, encoding="utf-8")
    s.daemon.process.send_signal(signal.SIGHUP)
    s.told(entry, "hall/availability", "online", "all modules again")


def killed(s):
    """The daemon is killed; the broker says that it is gone."""
    entry = "kill -9: offline within 10 s"
    since, began = s.watcher.count(), time.monotonic()
    s.daemon.end("KILL")
    told = until(lambda: "offline" in s.watcher.all("railbus/plant/bridge/state", since), 30)
    took = time.monotonic() - began
    s.check(entry, (told, took < GONE_MAX), (True, True), f"after {took:.1f} s")
    s.daemon.start()
    s.told(entry, "bridge/state", "online", "after the restart")
    # A frozen daemon does not close its connection.
    entry = "SIGSTOP: offline within 15 s"
    since, began = s.watcher.count(), time.monotonic()
    s.daemon.process.send_signal(signal.SIGSTOP)
    told = until(lambda: "offline" in s.watcher.all("railbus/plant/bridge/state", since), 30)
    took = time.monotonic() - began
    s.daemon.process.send_signal(signal.SIGCONT)
    s.check(entry, (told, took < FROZEN_MAX), (True, True), f"after {took:.1f} s")
    s.told(entry, "bridge/state", "online", "after it goes on")


def restarted(s):
    """The broker comes back with an empty store, and is told everything."""
    entry = "a broker with an empty store"
    s.broker.kill()
    waits = until(lambda: s.outlet()["state"] == "waiting")
    s.check(entry, waits, True, "waiting")
    s.check(entry, until(lambda: s.code() == "E0896"), True, "unreached")
    s.broker.start()
    s.watch()
    s.told(entry, "bridge/state", "online")
    for topic, want in (("oven/k1/state", "OFF"), ("hall/di0/state", "ON"),
                        ("vat/ai1/state", "8.71"), ("oven/availability", "online")):
        s.told(entry, topic, want)
    s.check(entry, s.order("oven/k1", "ON")["end"], "readback", "a command")
    s.order("oven/k1", "OFF")
    s.check(entry, until(lambda: s.outlet()["state"] == "running"), True, "running")


def frozen(s):
    """The broker does not answer any more, and then does: nothing old is told."""
    entry = "a frozen broker: the newest value afterwards"
    s.broker.process.send_signal(signal.SIGSTOP)
    for value in (1, 0, 1):
        s.sim.do(f"hall.di1 = {value}")
        read = until(lambda value=value: s.ask("GET", "/points/hall/di1")["value"] == bool(value))
        s.check(entry, read, True, "read meanwhile")
    waits = until(lambda: s.outlet()["state"] == "waiting")
    s.check(entry, waits, True, "the outlet notices")
    since = s.watcher.count()
    s.broker.process.send_signal(signal.SIGCONT)
    online = until(lambda: "online" in s.watcher.all("railbus/plant/bridge/state", since))
    s.check(entry, online, True, "online again")
    s.told(entry, "hall/di1/state", "ON")
    s.check(entry, s.order("oven/k1", "OFF")["end"], "readback", "a command")
    s.sim.do("hall.di1 = 0")
    s.told(entry, "hall/di1/state", "OFF", "afterwards")


def removed(s):
    """An outlet that is removed leaves nothing."""
    entry = "a removed outlet leaves nothing"
    s.ask("DELETE", "/outlets/mqtt/scada")
    s.told(entry, "bridge/state", "")
    s.told(entry, "oven/k1/state", "")
    # What is kept comes in one piece, and this is the last of it.
    s.publish("~", "x", "-r")
    late = Watcher(s.broker, s.spoken, "railbus/#")
    until(lambda: late.newest("railbus/plant/~"))
    left = [topic for topic in late.order() if topic != "railbus/plant/~"]
    late.close()
    s.check(entry, left, [], "kept by the broker:")


# Home Assistant ----------------------------------------------------------------------------

HOME = "homeassistant"
# Home Assistant is told all again within this time after it has come back, in seconds.
TOLD_AGAIN = 5.0


def home(form):
    """What Home Assistant is told, in this form, and what it would do with that."""

    def run():
        broker = Broker()
        try:
            with Plant(broker, **ALL, discovery=form) as s:
                s.settled()
                told_home(s, form)
                if form == "device":
                    order_home(s)
                by_home(s, form)
                back(s, form)
                other_form(s, form)
                no_ghosts(s, form)
        finally:
            broker.close()
        return s.tally

    return run


def entities(s, form):
    """The entities of every module as (module, kind, key), with what is said of them; and those
    that are to be removed."""
    found, gone = {}, set()
    with s.watcher.lock:
        newest = {topic: payload for _, _, topic, payload in s.watcher.got
                  if topic.startswith(f"{HOME}/") and topic.endswith("/config")}
    for topic, payload in newest.items():
        if not payload:
            continue
        _, kind, device, *key = topic.split("/")[:-1]
        module = device.removeprefix("railbus_plant_")
        config = json.loads(payload)
        # A daemon that was killed may have to let go of the other form once more.
        if config == {"migrate_discovery": True}:
            continue
        if form == "component":
            found[module, kind, key[0]] = config
            continue
        for key, entity in config["cmps"].items():
            kind = entity.pop("p")
            if entity:
                found[module, kind, key] = {**config, **entity}
            else:
                gone.add((module, kind, key))
    return found, gone


def told_home(s, form):
    """Every point is told as what it is."""
    entry = f"{form}: every point is an entity"
    # The outputs of this module are told when it has said which of them give pulses.
    until(lambda: ("hall", "switch", "do3") in entities(s, form)[0])
    found, _ = entities(s, form)
    for which in (("oven", "switch", "k1"), ("oven", "binary_sensor", "k6_state"),
                  ("oven", "button", "k7_on"), ("oven", "button", "k7_off"),
                  ("oven", "binary_sensor", "k7_state"), ("hall", "binary_sensor", "di0"),
                  ("tank", "sensor", "ai1"), ("tank", "binary_sensor", "connection")):
        s.check(entry, which in found, True, str(which))
    for which in (("oven", "switch", "k6"), ("oven", "switch", "k7")):
        s.check(entry, which in found, False, str(which))
    ids = [config["unique_id"] for config in found.values()]
    s.check(entry, len(set(ids)), len(ids), "unique")
    for (module, kind, key), config in found.items():
        s.check(entry, config["unique_id"], f"railbus_plant_{module}_{key}", "unique_id")
        s.check(entry, config["dev"]["ids"], [f"railbus_plant_{module}"], "its device")
        # Where it listens, something is kept.
        if kind != "button":
            topic = config["state_topic"].removeprefix("railbus/plant/")
            s.check(entry, s.newest(topic) is not None, True, topic)
        for each in config["avty"]:
            topic = each["t"].removeprefix("railbus/plant/")
            s.check(entry, s.newest(topic), "online", topic)


def order_home(s):
    """After the values, and before `online`."""
    entry = "discovery: after the values and before `online`"
    since = s.watcher.count()
    again(s)
    topics = s.watcher.order(since)
    online = max(nth for nth, topic in enumerate(topics) if topic == "railbus/plant/bridge/state")
    places = {module: topics.index(f"{HOME}/device/railbus_plant_{module}/config")
              for module in ("oven", "hall", "tank")}
    values = [nth for nth, topic in enumerate(topics[:online]) if topic.endswith("k1/state")]
    there = topics.index("railbus/plant/oven/availability")
    first, last = min(places.values()), max(places.values())
    s.check(entry, max(values) < first and last < there < online, True, str(places))


def by_home(s, form):
    """What was told is used as Home Assistant does."""
    entry = f"{form}: commands as they were told"
    found, _ = entities(s, form)

    def use(which, word, value):
        config = found[which]
        topic = config["command_topic"].removeprefix("railbus/plant/")
        s.publish(topic, config[word], *(["-r"] if config["retain"] else []))
        state = topic.removesuffix("/set") + "/state"
        s.told(entry, state, "ON" if value else "OFF", f"{which} {word}")
        label = int(state.split("/")[1][1:]) - 1
        s.check(entry, s.sim.outputs("oven")[label], value, f"{which} {word}")

    use(("oven", "switch", "k1"), "payload_on", 1)
    use(("oven", "switch", "k1"), "payload_off", 0)
    use(("oven", "button", "k7_on"), "payload_press", 1)
    use(("oven", "button", "k7_off"), "payload_press", 0)


def back(s, form):
    """Home Assistant has come back."""
    entry = f"{form}: told again when Home Assistant is back"
    configs = lambda since: [topic for topic in s.watcher.order(since)
                             if topic.startswith(f"{HOME}/") and topic.endswith("/config")]
    want = sorted(set(configs(0)) & {topic for topic in set(configs(0)) if s.watcher.newest(topic)})
    since, began = s.watcher.count(), time.monotonic()
    s.publish_at(f"{HOME}/status", "offline")
    s.publish_at(f"{HOME}/status", "online")
    until(lambda: sorted(configs(since)) == want)
    took = time.monotonic() - began
    s.check(entry, sorted(configs(since)), want, "each of them once")
    s.check(entry, took < TOLD_AGAIN + 3, True, f"after {took:.1f} s")


def other_form(s, form):
    """The other form takes over, and back again: Home Assistant lets go of each entity first."""
    entry = f"{form}: the other form takes over"
    moves = '{"migrate_discovery":true}'
    counts = {"device": 3, "component": len(entities(s, form)[0])}
    for now in ("component" if form == "device" else "device", form):
        since = s.watcher.count()
        is_new = lambda topic, now=now: topic.startswith(f"{HOME}/device/") == (now == "device")
        s.ask("PUT", "/outlets/mqtt/scada", {**s.settings, "discovery": now})

        def known():
            """What Home Assistant was told since the form before was first asked to let go: until
            then that one may be told again."""
            told = [(topic, payload) for _, _, topic, payload in s.watcher.got[since:]
                    if topic.startswith(f"{HOME}/")]
            first = next((nth for nth, (_, payload) in enumerate(told) if payload == moves), None)
            return [] if first is None else told[first:]

        until(lambda: len({topic for topic, _ in known() if is_new(topic)}) == counts[now])
        told = known()
        old = {topic for topic, _ in told if not is_new(topic)}
        before = counts["component" if now == "device" else "device"]
        s.check(entry, len(old), before, f"{now}: topics of before")
        s.check(entry, len({topic for topic, _ in told} - old), counts[now], f"{now}: topics")
        for topic in old:
            s.check(entry, [payload for each, payload in told if each == topic], [moves, ""], topic)
        new = [nth for nth, (topic, _) in enumerate(told) if is_new(topic)]
        asked = [nth for nth, (_, payload) in enumerate(told) if payload == moves]
        cleared = [nth for nth, (_, payload) in enumerate(told) if payload == ""]
        s.check(entry, max(asked) < min(cleared) and max(cleared) < min(new), True, f"{now}: order")
        s.told(entry, "bridge/state", "online", f"{now}")


def no_ghosts(s, form):
    """What is no more is taken away."""
    entry = f"{form}: nothing is left of what is no more"
    text = s.text().replace("k4 = {", "k1 = { locked = true }\nk2 = { hidden = true }\nk4 = {")
    text = text.replace("[module.tank", "[module.vat")
    s.daemon.config.write_text(text, encoding="utf-8")
    s.daemon.process.send_signal(signal.SIGHUP)
    until(lambda: ("vat", "sensor", "ai1") in entities(s, form)[0])
    until(lambda: not any(module == "tank" for module, *_ in entities(s, form)[0]))
    found, gone = entities(s, form)
    s.check(entry, any(module == "tank" for module, *_ in found), False, "another name")
    s.check(entry, ("oven", "binary_sensor", "k1_state") in found, True, "locked")
    for which in (("oven", "switch", "k1"), ("oven", "switch", "k2")):
        s.check(entry, which in found, False, str(which))
        s.check(entry, which in gone, form == "device", f"{which} removed by name")
    # It is the same after a restart, and also with the rights gone meanwhile.
    s.daemon.end("KILL")
    text = text.replace('write = ["*"]', 'write = ["hall"]')
    s.daemon.config.write_text(text, encoding="utf-8")
    s.daemon.start()
    until(lambda: ("oven", "binary_sensor", "k8_state") in entities(s, form)[0])
    until(lambda: ("oven", "switch", "k8") not in entities(s, form)[0])
    found, gone = entities(s, form)
    s.check(entry, [which for which in found if which[:2] == ("oven", "switch")], [], "rights")
    if form == "device":
        for key in ("k1", "k2", "k8"):
            s.check(entry, ("oven", "switch", key) in gone, True, f"{key} after a restart")
    s.check(entry, ("hall", "switch", "do0") in found, True, "rights that are left")
    s.ask("PUT", "/outlets/mqtt/scada", {**s.settings, "discovery": "off"})
    until(lambda: not entities(s, form)[0])
    s.publish_at(f"{HOME}/~", "x", "-r")
    late = Watcher(s.broker, s.spoken, f"{HOME}/#")
    until(lambda: late.newest(f"{HOME}/~"))
    left = [topic for topic in late.order() if topic != f"{HOME}/~"]
    late.close()
    s.check(entry, left, [], "kept by the broker:")


def versions():
    """A broker that knows 3.1.1 only."""
    broker = Broker()
    old = OldBroker(broker)
    try:
        with Plant(broker, port=old.port, **ALL) as s:
            s.settled()
            entry = "auto: 3.1.1 where 5 is refused"
            s.check(entry, old.refused > 0, True, f"{old.refused} refused")
            s.check(entry, s.order("oven/k1", "ON")["end"], "readback", "a command")
            s.order("oven/k1", "OFF")
            said = s.ask("POST", "/outlets/mqtt/scada/test")
            s.check(entry, (said["ok"], said["answer"][:10]), (True, "MQTT 3.1.1"), str(said))
            s.ask("PUT", "/outlets/mqtt/scada", {**s.settings, "port": broker.port})
            s.told(entry, "bridge/state", "online")
            said = s.ask("POST", "/outlets/mqtt/scada/test")
            good = said["ok"] and said["answer"].startswith("MQTT 5, mosquitto version ")
            s.check("the test says what the broker is", good, True, str(said))
            s.ask("PUT", "/outlets/mqtt/scada", {**s.settings, "version": "5"})
            s.check("version 5 only", until(lambda: s.code() == "E0899"), True, str(s.code()))
    finally:
        old.close()
        broker.close()
    return s.tally


def reasons():
    """Why there is no connection."""
    broker = Broker(("tls", "password", "client"))
    other = Broker(("tls",), "elsewhere")
    plain, reader = Broker(), Broker(("reader",))
    try:
        with Plant(broker, **ALL) as s:
            s.settled()
            s.check("a certificate of one's own", s.order("oven/k1", "OFF")["end"], "readback")
            base = s.settings
            nobody, closed = free_port()
            for entry, settings, code in (
                ("no broker", {"port": closed}, "E0896"),
                ("a wrong authority", {"ca": other.certificates["ca.pem"]}, "E0897"),
                ("a certificate for another name", {
                    "port": other.port, "ca": other.certificates["ca.pem"]}, "E0897"),
                ("TLS where there is none", {"port": plain.port}, "E0897"),
                ("no TLS where it is wanted", {"tls": "off"}, "E0899"),
                ("no certificate of one's own", {"cert": None, "key": None}, "E0897"),
                ("a wrong user", {"username": "nobody"}, "E0898"),
                ("a file that is not there", {"ca": "/nowhere.pem"}, "E0856"),
            ):
                wanted = {**base, **settings}
                wanted = {key: value for key, value in wanted.items() if value is not None}
                s.ask("PUT", "/outlets/mqtt/scada", wanted)
                found = until(lambda code=code: s.code() == code)
                s.check(f"why not: {entry}", found, True, f"{s.code()}, not {code}")
                said = s.ask("POST", "/outlets/mqtt/scada/test")
                told = said["ok"], said.get("error", {}).get("code")
                s.check(f"why not: {entry}", told, (False, code), "tested")
            nobody.close()
            allowed = {**reader.settings(), "version": "5", "site": "plant"}
            s.ask("PUT", "/outlets/mqtt/scada", allowed)
            found = until(lambda: s.code() == "E0932")
            s.check("why not: a topic that is not allowed", found, True, str(s.code()))
            s.ask("PUT", "/outlets/mqtt/scada", base)
            s.ask("PUT", "/outlets/mqtt/scada/secret", {"secret": PASSWORD + "!"})
            again_with = {**base, "client_id": "another"}
            s.ask("PUT", "/outlets/mqtt/scada", again_with)
            found = until(lambda: s.code() == "E0898")
            s.check("why not: a wrong password", found, True, str(s.code()))
            text = json.dumps(s.ask("GET", "/outlets"))
            s.check("the password is never shown", PASSWORD in text, False, "in /outlets")
    finally:
        for each in (broker, other, plain, reader):
            each.close()
    return s.tally


SUITES = [(f"MQTT {way}", suite(way)) for way in WAYS]
SUITES += [
    ("MQTT, the connection", life),
    ("MQTT, Home Assistant, device", home("device")),
    ("MQTT, Home Assistant, component", home("component")),
    ("MQTT, versions", versions),
    ("MQTT, why there is none", reasons),
]
