"""The daemon as a Sparkplug B 3.0 edge node, with mosquitto and a host application by others
(pysparkplug): what it says is born, current and in its order, and a command has its true end."""

import re
import signal

from modbus_tcp import until
from sparkplug import (
    BAD, CLIENT, GOOD, GRACE, GROUP, LAST, NODE, STALE, WRITE, Broker, Plant, metric, now, prop,
    quality, ruled, value,
)

SPOKEN = ("5", "3.1.1")
OFF = [0] * 8
MODULES = ("oven", "hall", "tank", "yard")
DONE = ("readback", "reply")
TYPES = {"output": "BOOLEAN", "input": "BOOLEAN", "analog": "DOUBLE"}
# How far ahead of its time a command is that must not be refused for its age, in milliseconds.
AHEAD = 30_000
OLD = 10_000


def suite(version):
    """Everything in one version."""

    def run():
        broker = Broker()
        try:
            with Plant(broker, version) as s:
                connected(s, version)
                births(s, version)
                changed(s, version)
                stale(s, version)
                switched(s, version)
                refused(s, version)
                ignored(s, version)
                dead(s, version)
                ordered_dead(s, version)
                reborn(s, version)
                lost(s, version)
                ruled(s, f"{version}: the rules of Sparkplug")
                published(s, version)
        finally:
            broker.close()
        return s.tally

    return run


def after(number):
    """The next birth number."""
    return None if number is None else (number + 1) % 256


def connected(s, version):
    """What mosquitto says of the connection."""
    entry = f"{version}: the connection"
    s.born(entry, "at the beginning")
    lines = (s.broker.connections() or [["nothing"]])[0]
    told = lambda *words: next((nth for nth, line in enumerate(lines)
                                if all(word in line for word in words)), None)
    number = {"5": "p5", "3.1.1": "p2"}[version]
    s.check(entry, f"({number}, c1, " in lines[0], True, f"version and clean start: {lines[0]}")
    will = told("Will message specified")
    s.check(entry, will is not None and "(r0, q1)" in lines[will], True, f"will: {lines[:3]}")
    topic = lines[will + 1].strip() if will is not None else ""
    s.check(entry, topic, f"spBv1.0/{GROUP}/NDEATH/{NODE}", "topic of the will")
    born = told("Received PUBLISH", f"/NBIRTH/{NODE}'")
    for kind in ("NCMD", "DCMD"):
        place = told(f"\tspBv1.0/{GROUP}/{kind}/{NODE}", "(QoS 1)")
        is_before = None not in (place, born) and place < born
        s.check(entry, is_before, True, f"{kind} subscribed with QoS 1 before the birth: {lines}")


def published(s, version):
    """What mosquitto says of everything that was published."""
    entry = f"{version}: QoS 0 and not retained"
    form = re.compile(rf"Received PUBLISH from {CLIENT} \(d0, q(\d), r(\d), m\d+, '([^']+)'")
    told = [found.groups() for lines in s.broker.connections() for line in lines
            if (found := form.match(line))]
    data = {(qos, kept) for qos, kept, topic in told if "/NDEATH/" not in topic}
    s.check(entry, data, {("0", "0")}, f"{len(told)} messages,")


def births(s, version):
    """What is born, and as what."""
    entry = f"{version}: NBIRTH"
    birth = s.heard(entry, "the first one", 0, "NBIRTH")
    s.check(entry, birth.get("seq"), 0, "seq")
    types = {each["name"]: each["type"] for each in birth["metrics"]}
    want = {"bdSeq": "INT64", "Node Control/Rebirth": "BOOLEAN", "Properties/Version": "STRING",
            "Properties/Site": "STRING", "Modules/Answering": "INT64"}
    s.check(entry, types, want, "metrics")
    s.check(entry, value(birth, "Node Control/Rebirth"), False, "Node Control/Rebirth")
    for name in ("Properties/Version", "Properties/Site"):
        s.check(entry, bool(value(birth, name)), True, f"{name}: {value(birth, name)!r}")
    number = value(birth, "bdSeq")
    s.check(entry, number in range(256), True, f"bdSeq {number!r}")
    for module in MODULES:
        device(s, version, module)
    entry = f"{version}: the values"
    for point, want in (("hall.di0", True), ("hall.di1", False), ("tank.ai1", 8.71),
                        ("tank.ai2", 2.5), ("oven.k1", False), ("tank.k2", False)):
        s.becomes(entry, *point.split("."), want)


def device(s, version, module):
    """One module."""
    entry = f"{version}: DBIRTH of {module}"
    birth = s.heard(entry, "the first one", 0, "DBIRTH", module)
    points = s.points(module)
    want = {label: (TYPES.get(each["kind"], "INT64"), f"{module}.{label}" not in WRITE,
                    each.get("unit")) for label, each in points.items()}
    got = {each["name"]: (each["type"], prop(each, "readOnly"), prop(each, "engUnit"))
           for each in birth["metrics"] if each["name"] not in LAST}
    s.check(entry, got, want, "type, readOnly, engUnit:")
    types = {each["name"]: each["type"] for each in birth["metrics"] if each["name"] in LAST}
    s.check(entry, types, LAST, "the last command")
    known = [name for name in LAST if not (metric(birth, name) or {}).get("null")]
    s.check(entry, known, [], "not null before the first command:")
    kinds = {tuple(each["properties"].get(name, [missing])[0] for name, missing in
                   (("Quality", "INT32"), ("readOnly", None), ("engUnit", None)))
             for each in birth["metrics"] if each["name"] in points}
    units = {None if unit is None else "STRING" for _, _, unit in want.values()}
    s.check(entry, kinds, {("INT32", "BOOLEAN", unit) for unit in units}, "types of properties")
    odd = [each["name"] for each in birth["metrics"] if each["name"] in points
           and (quality(each) not in (GOOD, STALE, BAD) or each["null"] != (quality(each) == BAD)
                or not each["time"] or each["historical"])]
    s.check(entry, odd, [], "not null just where it is bad, or without a time:")


def changed(s, version):
    """An input is another one, and an analog one."""
    entry = f"{version}: a change"
    for point, word, want in (("hall.di1", "1", True), ("tank.ai1", "5.00", 5.0),
                              ("tank.ai1", "8.71", 8.71), ("hall.di1", "0", False)):
        module, label = point.split(".")
        since, began = s.host.count(), now()
        s.sim.do(f"{point} = {word}")
        told = s.heard(entry, f"{point} = {word}", since, "DDATA", module,
                       lambda told, label=label, want=want: value(told, label) == want)
        one = metric(told, label) or {}
        s.check(entry, (quality(one), one.get("historical")), (GOOD, False), f"{point}, quality")
        times = [began, one.get("time"), told.get("timestamp"), now()]
        in_order = None not in times and times == sorted(times)
        s.check(entry, in_order, True, f"changed, read, told and received at {times}")


def stale(s, version):
    """A value is too old while its module answers."""
    entry = f"{version}: stale"
    since = s.host.count()
    is_stale = lambda told: quality(metric(told, "k1")) == STALE
    told = s.heard(entry, "too old", since, "DDATA", "yard", is_stale)
    one = metric(told, "k1") or {}
    s.check(entry, (one.get("value"), one.get("null")), (False, False), "the last value")
    place = s.host.place(told) if one else since
    is_good = lambda told: quality(metric(told, "k1")) == GOOD
    again = metric(s.heard(entry, "read again", place, "DDATA", "yard", is_good), "k1") or {}
    later = None not in (one.get("time"), again.get("time")) and one["time"] < again["time"]
    s.check(entry, later, True, f"read at {one.get('time')}, and then at {again.get('time')}")


def ended(s, entry, answer, name, what):
    """A command was done, and its answer says so."""
    s.check(entry, (answer["metric"], answer["code"]), (name, ""), f"{what}: metric and code")
    s.check(entry, answer["end"] in DONE, True, f"{what}: end {answer['end']!r}")
    one = metric(answer["message"], name) or {}
    s.check(entry, (one.get("value"), quality(one)), (what, GOOD), f"{what}: in the answer")


def switched(s, version):
    """A relay, and what is said of it."""
    entry = f"{version}: switched and read back"
    for what, typed in ((True, False), (False, True)):
        began = now()
        answer = s.order("oven", "k1", what, typed=typed)
        ended(s, entry, answer, "k1", what)
        times = [began, answer["time"], now()]
        in_order = None not in times and times == sorted(times)
        s.check(entry, in_order, True, f"sent, ended and received at {times}")
        s.relays(entry, "oven", [int(what), *OFF[1:]], f"after {what}")
        s.becomes(entry, "oven", "k1", what, "afterwards")
    ended(s, entry, s.order("hall", "do0", True), "do0", True)
    s.relays(entry, "hall", [1, 0, 0, 0])
    ended(s, entry, s.order("hall", "do0", False), "do0", False)
    entry = f"{version}: each metric is a command"
    for what in (True, False):
        since = s.host.count()
        s.send("oven", ("k1", "BOOLEAN", what), ("k3", "BOOLEAN", what), ("k2", "BOOLEAN", what))
        until(lambda since=since: len(s.answers("oven", since)) >= 3)
        told = {each["metric"]: each["end"] in DONE for each in s.answers("oven", since)}
        s.check(entry, told, {"k1": True, "k2": True, "k3": False}, f"done, {what}")
        s.relays(entry, "oven", [int(what)] * 2 + OFF[2:], f"after {what}")
    s.check(entry, len(s.answers("oven", since)), 3, "answers")


def refused(s, version):
    """What is no command that may be carried out is answered, and nothing moves."""
    begin = s.host.count()
    cases = [
        ("no right", "oven", ("k3", True), {}),
        ("an input", "hall", ("di1", True), {}),
        ("unknown metric", "oven", ("k9", True), {}),
        ("wrong type", "oven", ("k1", 1, "INT32"), {}),
        ("wrong type", "oven", ("k1", "true", "STRING"), {}),
        ("wrong type", "oven", ("k1", 1, "INT32"), {"typed": False}),
        ("wrong type", "oven", ("k1", None), {}),
        ("old", "oven", ("k1", True), {"timestamp": now() - OLD}),
        ("no timestamp", "oven", ("k1", True), {"timestamp": None}),
    ]
    # Only there is a retained message told from others while it comes.
    if version == "5":
        cases.append(("retained", "oven", ("k1", True), {"retain": True}))
    for name, module, what, more in cases:
        entry = f"{version}: refused: {name}"
        answer = s.order(module, *what, **more)
        s.check(entry, (answer["metric"], answer["end"]), (what[0], "failed"), f"{what} {more}")
        code = answer["code"] or ""
        right = code == "E0906" if name == "no right" else re.fullmatch(r"E\d{4}", code)
        s.check(entry, bool(right), True, f"{what} {more}: code {answer['code']!r}")
        s.relays(entry, "oven", OFF)
    clear(s)
    entry = f"{version}: refused: the next one is done"
    for what in (True, False):
        ended(s, entry, s.order("oven", "k1", what), "k1", what)
    told = len(s.answers("oven", begin)) + len(s.answers("hall", begin))
    s.check(entry, told, len(cases) + 2, "answers")


def clear(s):
    """The broker keeps no command any more."""
    s.host.ask("raw", topic=f"spBv1.0/{GROUP}/DCMD/{NODE}/oven", data="", retain=True)


def ignored(s, version):
    """What is for nobody, or says nothing, has no answer, and nothing moves."""
    entry = f"{version}: ignored"
    since, base = s.host.count(), f"spBv1.0/{GROUP}"
    before = s.outlet()
    # No field of protobuf, one that goes on after the end, and a text.
    for data in ("ff" * 40, "0801128080808008", "6b31203d206f6e"):
        for topic in (f"{base}/DCMD/{NODE}/oven", f"{base}/NCMD/{NODE}"):
            s.host.ask("raw", topic=topic, data=data)
    counted = lambda: (s.outlet()["failed"] > before["failed"], "last_error" in s.outlet())
    until(lambda: counted() == (True, True))
    s.check(entry, counted(), (True, True), "counted and noted")
    s.send("vat", ("k1", "BOOLEAN", True))
    s.send("oven", ("k1", "BOOLEAN", True), node="line8")
    s.send(None, ("k1", "BOOLEAN", True))
    s.host.ask("raw", topic=f"{base}/DCMD/{NODE}/oven/k1", data="")
    for what in (True, False):
        ended(s, entry, s.order("oven", "k2", what), "k2", what)
    s.relays(entry, "oven", OFF)
    s.check(entry, len(s.answers("oven", since)), 2, "answers")
    others = {each.get("device") for each in s.host.all(since, "DDATA")} - set(MODULES)
    s.check(entry, others, set(), "data of others")
    s.check(entry, s.lives(since), [], "births and deaths of the node")


def dead(s, version):
    """A module without power, and with it again."""
    entry = f"{version}: a dead module"
    since = s.host.count()
    s.sim.do("power oven off")
    s.heard(f"{entry}: DDEATH", "without power", since, "DDEATH", "oven")
    ended(s, f"{entry}: the others go on", s.order("hall", "do0", True), "do0", True)
    ended(s, f"{entry}: the others go on", s.order("hall", "do0", False), "do0", False)
    entry = f"{version}: a dead module: not born by a rebirth"
    since = s.host.count()
    s.rebirth()
    s.born(entry, "meanwhile", since, ("hall", "tank", "yard"))
    # By its answer everything before it has come.
    ended(s, entry, s.order("hall", "do0", False), "do0", False)
    s.check(entry, "DBIRTH oven" in s.kinds(since), False, "its birth")
    entry = f"{version}: a dead module: DBIRTH"
    since = s.host.count()
    s.sim.do("power oven on")
    s.heard(entry, "with power", since, "DBIRTH", "oven")
    s.becomes(entry, "oven", "k1", False, "with power")


def ordered_dead(s, version):
    """A command to a module whose power is off, before and after that is known."""
    entry = f"{version}: a command to a dead module"
    begin = s.host.count()
    records = lambda: s.ask("GET", "/audit?point=oven.k1&limit=500")["items"]
    s.sim.do("power oven off")
    for place in ("before that is known", "after that is known"):
        before = len(records())
        s.send("oven", ("k1", "BOOLEAN", True))
        over = lambda before=before: len(records()) > before and records()[0].get("end")
        if place.startswith("before"):
            end = until(over)
            s.check(entry, bool(end) and end not in DONE, True, f"{place}, audit log: {end!r}; not")
            s.heard(entry, place, begin, "DDEATH", "oven")
        else:
            # A command that is not even begun may be in no log.
            until(over, GRACE)
            ended(s, entry, s.order("hall", "do0", False), "do0", False)
    ends = [each["end"] for each in s.answers("oven", begin)]
    s.check(entry, set(ends) <= {"unknown", "failed"}, True, f"ends {ends}")
    begin_power = s.host.count()
    s.sim.do("power oven on")
    s.heard(entry, "with power", begin_power, "DBIRTH", "oven")
    s.becomes(entry, "oven", "k1", False, "with power")
    ended(s, entry, s.order("oven", "k2", False), "k2", False)
    s.relays(entry, "oven", OFF, "at the end")
    moved = [metric(each, "k1") for kind in ("DBIRTH", "DDATA")
             for each in s.host.all(begin, kind, "oven") if value(each, "k1")]
    s.check(entry, moved, [], "messages that say that it moved")


def reborn(s, version):
    """The host wants everything anew."""
    entry = f"{version}: rebirth"
    answer = s.order("oven", "k3", True)
    number = s.host.all(0, "NBIRTH")[-1:]
    since = s.host.count()
    s.rebirth()
    again = s.born(entry, "wanted", since)
    s.check(entry, [again], [value(each, "bdSeq") for each in number], "bdSeq")
    birth = s.heard(entry, "wanted", since, "NBIRTH")
    s.check(entry, birth.get("seq"), 0, "seq")
    s.check(entry, s.lives(since), ["NBIRTH"], "births and deaths of the node")
    oven = s.heard(entry, "wanted", since, "DBIRTH", "oven")
    last = [value(oven, name) for name in LAST]
    want = [answer[key] for key in ("metric", "end", "code", "time")]
    s.check(entry, last, want, "the last command in the birth")


def lost(s, version):
    """The connection is lost, and a command waits at the broker when it is there again."""
    entry = f"{version}: the will has the number of the birth"
    number, since = bdseq(s), s.host.count()
    s.gate.cut()
    death = s.heard(entry, "no connection", since, "NDEATH")
    s.check(entry, value(death, "bdSeq"), number, "bdSeq")
    s.check(entry, [each["name"] for each in death["metrics"]], ["bdSeq"], "metrics")
    s.check(entry, death.get("seq"), None, "seq")
    s.send("oven", ("k1", "BOOLEAN", True), timestamp=now() + AHEAD, retain=True, qos=1)
    entry = f"{version}: refused: retained"
    since = s.host.count()
    s.gate.open()
    s.check(entry, s.born(entry, "connected again", since), after(number), "bdSeq")
    # In version 5 the broker is told to leave it out.
    if version == "3.1.1":
        ends = lambda: [(s.current("oven", name) or {}).get("value")
                        for name in ("Last Command/Metric", "Last Command/End")]
        until(lambda: ends() == ["k1", "failed"])
        s.check(entry, ends(), ["k1", "failed"], "as the connection begins")
    clear(s)
    ended(s, entry, s.order("oven", "k2", False), "k2", False)
    s.relays(entry, "oven", OFF)


# Lives -------------------------------------------------------------------------------------------


def bdseq(s):
    """The number of the newest birth."""
    return value((s.host.all(0, "NBIRTH") or [None])[-1], "bdSeq")


def life():
    """The daemon, the broker and modules go and come."""
    broker = Broker()
    try:
        with Plant(broker) as s:
            s.born("kill -9: NDEATH, and the next number", "at the beginning")
            killed(s)
            stopped(s)
            disabled(s)
            restarted(s)
            removed(s)
            ruled(s, "lives: the rules of Sparkplug")
    finally:
        broker.close()
    return s.tally


def killed(s):
    """The daemon is killed; the broker says so."""
    entry = "kill -9: NDEATH, and the next number"
    number, since = bdseq(s), s.host.count()
    s.daemon.end("KILL")
    death = s.heard(entry, "killed", since, "NDEATH")
    s.check(entry, value(death, "bdSeq"), number, "bdSeq of the death")
    since = s.host.count()
    s.daemon.start()
    s.check(entry, s.born(entry, "started again", since), after(number), "bdSeq of the birth")


def departed(s, entry, number, since):
    """The node has said itself that it goes. In version 5 its will says so, too."""
    s.heard(entry, "its own", since, "NDEATH")
    until(lambda: len(s.host.all(since, "NDEATH")) > 2, GRACE)
    deaths = [value(death, "bdSeq") for death in s.host.all(since, "NDEATH")]
    s.check(entry, deaths in ([number], [number] * 2), True, f"{number} in deaths: {deaths}")
    told = [line.split(" ")[:2] for line in s.broker.connections()[-1]
            if re.match(rf"Received (PUBLISH from {CLIENT} .*/NDEATH/|DISCONNECT from {CLIENT})",
                        line)]
    want = [["Received", "PUBLISH"], ["Received", "DISCONNECT"]]
    s.check(entry, told, want, "death and end, as the broker has it")


def stopped(s):
    """The daemon ends as it should."""
    entry = "SIGTERM: NDEATH by the node, and the next number"
    number, since = bdseq(s), s.host.count()
    s.daemon.end("TERM")
    departed(s, entry, number, since)
    since = s.host.count()
    s.daemon.start()
    s.check(entry, s.born(entry, "started again", since), after(number), "bdSeq of the birth")


def disabled(s):
    """The outlet is switched off, and on again."""
    entry = "an outlet that is disabled: NDEATH by the node, and the next number"
    number, since = bdseq(s), s.host.count()
    s.ask("PUT", "/outlets/sparkplug/plant", {**s.settings, "enabled": False})
    departed(s, entry, number, since)
    since = s.host.count()
    s.ask("PUT", "/outlets/sparkplug/plant", s.settings)
    s.check(entry, s.born(entry, "enabled", since), after(number), "bdSeq of the birth")


def broker_away(s):
    """The broker is killed, and the daemon knows it."""
    s.broker.kill()
    # Where it comes back, the host is there first.
    s.gate.cut()
    until(lambda: s.outlet()["state"] != "running")
    return s.outlet()["state"]


def broker_back(s):
    """The broker is there again, with an empty store, and the host."""
    s.broker.start()
    s.host.start()


def restarted(s):
    """The broker is killed and comes back with an empty store."""
    entry = "a broker with an empty store: births with the next number"
    number = bdseq(s)
    s.check(entry, broker_away(s), "waiting", "without a broker")
    broker_back(s)
    since = s.host.count()
    s.gate.open()
    s.check(entry, s.born(entry, "connected again", since), after(number), "bdSeq")
    s.becomes(entry, "hall", "di0", True)
    ended(s, entry, s.order("oven", "k1", True), "k1", True)
    ended(s, entry, s.order("oven", "k1", False), "k1", False)
    running = until(lambda: s.outlet()["state"] == "running")
    s.check(entry, running, True, "the outlet runs")


def removed(s):
    """A module is taken out of the configuration, and put in again."""
    entry = "a module that is removed: DDEATH"
    text = s.daemon.config.read_text(encoding="utf-8")
    without = re.sub(r"\[module\.tank\].*?(?=\n\[)", "", text, flags=re.DOTALL)
    since = s.host.count()
    for config, kind in ((without, "DDEATH"), (text, "DBIRTH")):
        s.daemon.config.write_text(config, encoding="utf-8")
        s.daemon.process.send_signal(signal.SIGHUP)
        s.heard(entry, "of another configuration", since, kind, "tank")
    s.becomes(entry, "tank", "ai1", 8.71, "again")
    s.check(entry, s.lives(since), [], "births and deaths of the node")


SUITES = [(f"Sparkplug {version}", suite(version)) for version in SPOKEN]
SUITES.append(("Sparkplug, lives", life))
