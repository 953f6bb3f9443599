"""The Sparkplug edge node and its primary host application: no births without it, and every change
of the time without it or without a broker afterwards, once, with its time and in its order."""

from modbus_tcp import until
from sparkplug import GOOD, Broker, Plant, metric, now, quality, ruled, value
from sparkplug_suite import after, bdseq, broker_away, broker_back, ended

ID = "scada"
# How much older than the newest one a message of the host is, in milliseconds.
OLDER = 1000


def primary():
    """The host is absent, there, and gone."""
    broker = Broker()
    try:
        with Plant(broker, primary_host=ID) as s:
            online = absent(s)
            older(s, online)
            gone(s, online)
            ruled(s, "primary host: the rules of Sparkplug")
    finally:
        broker.close()
    return s.tally


def listens(s, entry, connections):
    """The node has been connected so many times, and follows the host."""
    topic = f"spBv1.0/STATE/{ID}"
    until(lambda: s.broker.subscribed(topic) >= connections)
    s.check(entry, s.broker.subscribed(topic), connections, f"connections that follow {topic}")


def absent(s):
    """Nobody has said that the host is there, then it says that it is not, and at last it is.
    When that was."""
    entry = "primary host: no births while it is absent"
    since = s.host.count()
    listens(s, entry, 1)
    s.silent(entry, "nothing is said of it", since)
    began = now()
    s.state(False, began)
    s.state(True, began, "another")
    s.silent(entry, "it is offline, and another is there", since)
    code = lambda: ((s.outlet().get("last_error") or {}).get("problem") or {}).get("code")
    until(lambda: code() == "E0833")
    s.check(entry, (code(), s.outlet()["state"]), ("E0833", "waiting"), "the outlet")
    entry = "primary host: births when it is there"
    # Later than the one before, whatever the clock shows.
    online = max(now(), began + 1)
    since = s.host.count()
    s.state(True, online)
    s.born(entry, "online", since)
    # The state came to all in the order of the broker.
    with s.host.lock:
        kinds = [(each.get("kind"), each.get("online")) for each in s.host.got]
    came = kinds.index(("STATE", True), since) < kinds.index(("NBIRTH", None))
    s.check(entry, came, True, f"the state before the birth: {kinds[:12]}")
    until(lambda: s.outlet()["state"] == "running")
    s.check(entry, s.outlet()["state"], "running", "the outlet")
    return online


def older(s, online):
    """The host said that it goes before it said that it is there."""
    entry = "primary host: an older offline is ignored"
    since = s.host.count()
    s.state(False, online - OLDER)
    # What comes after it is answered in the same life.
    for what in (True, False):
        ended(s, entry, s.order("oven", "k1", what), "k1", what)
    s.check(entry, s.lives(since), [], "births and deaths of the node")
    # It is what the broker keeps.
    s.state(True, online)


def gone(s, online):
    """The host goes and comes, with the time at which it came and with a later one."""
    for later in (0, OLDER):
        entry = "primary host: NDEATH when it goes, births when it is back"
        number, since = bdseq(s), s.host.count()
        connections = len(s.broker.connections())
        s.state(False, online + later)
        death = s.heard(entry, "offline", since, "NDEATH")
        s.check(entry, value(death, "bdSeq"), number, "bdSeq of the death")
        listens(s, entry, connections + 1)
        s.silent(entry, "offline", s.host.place(death) if death["metrics"] else since)
        online += later + 1
        since = s.host.count()
        s.state(True, online)
        s.check(entry, s.born(entry, "online", since), after(number), "bdSeq of the birth")
        ended(s, entry, s.order("oven", "k2", False), "k2", False)
        s.becomes(entry, "hall", "di0", True)


# Every change ------------------------------------------------------------------------------------

VALUES = [True, False] * 3
POINTS = ("hall.di1", "oven.k1")


def replay():
    """Everything that was not told live."""
    broker = Broker()
    try:
        with Plant(broker, primary_host=ID, replay_days=1) as s:
            s.state(True, now())
            s.born("every change: without a broker", "at the beginning")
            for point in POINTS:
                s.becomes("every change: without a broker", *point.split("."), False)
            without_broker(s)
            without_host(s)
            not_again(s)
            ruled(s, "every change: the rules of Sparkplug")
    finally:
        broker.close()
    return s.tally


def change(s, point, what):
    """A point is another one: an input in the simulator, an output over the API. Between which
    times the daemon has read it."""
    path, began = "/points/" + point.replace(".", "/"), now()
    if point == "oven.k1":
        s.ask("PUT", path, {"value": what})
    else:
        s.sim.do(f"{point} = {int(what)}")
    if not until(lambda: s.ask("GET", path)["value"] is what):
        raise RuntimeError(f"{point} does not become {what}")
    return began, now()


def changes(s):
    """Several changes of both points, in turns: value and times of each."""
    made = {point: [] for point in POINTS}
    for what in VALUES:
        for point in POINTS:
            made[point].append((what, *change(s, point, what)))
    return made


def old(s, since):
    """The metrics of the past in the order in which they came: point, value, time, quality, and the
    place of the message."""
    with s.host.lock:
        got = list(enumerate(s.host.got))[since:]
    return [(f"{told['device']}.{each['name']}", each["value"], each["time"], quality(each), nth)
            for nth, told in got if told.get("kind") == "DDATA"
            for each in told.get("metrics", ()) if each["historical"]]


def runs(found, point, first):
    """Each change of the value of a point, beginning with another one than the first: value and
    time. A value that is read again after it was not known is none."""
    kept = []
    for name, what, at, _, _ in found:
        if name == point and what is not None and what != (kept[-1][0] if kept else first):
            kept.append((what, at))
    return kept


def followed(s, entry, since, made):
    """All these changes have come, and nothing else of these points."""
    whole = lambda point: [what for what, *_ in made[point]]
    told = lambda point: [what for what, _ in runs(old(s, since), point, not whole(point)[0])]
    for point in POINTS:
        until(lambda point=point: told(point) == whole(point))
    until(lambda: s.outlet()["queue"] == 0)
    found = old(s, since)
    for point in POINTS:
        s.check(entry, told(point), whole(point), f"{point}, values")
        late = [(what, at, began, end)
                for (_, at), (what, began, end) in zip(runs(found, point, not whole(point)[0]),
                                                       made[point])
                if at is None or not began <= at <= end]
        s.check(entry, late, [], f"{point}, not at their times (value, at, after, before):")
    # Of each point: of two requests to a module that has just come back, the reply to the first one
    # may be withheld until its model is known, and that to the second one not.
    for point in {name for name, *_ in found}:
        times = [at for name, _, at, of, _ in found if of == GOOD and name == point]
        s.check(entry, times, sorted(times, key=lambda at: at or 0), f"the order of {point}")
    same = [each[:4] for each in found]
    s.check(entry, [each for each in same if same.count(each) > 1], [], "told twice")
    births = [s.host.place(each) for kind in ("NBIRTH", "DBIRTH")
              for each in s.host.all(since, kind)]
    first = min((each[4] for each in found), default=None)
    s.check(entry, first is not None and max(births) < first, True,
            f"births at {births}, and then the past from {first} on")
    for point in POINTS:
        s.becomes(entry, *point.split("."), made[point][-1][0], "beside it")
    live = {point: [each["value"] for told in s.host.all(since, "DDATA", point.split(".")[0])
                    if (each := metric(told, point.split(".")[1]))] for point in POINTS}
    others = {point: values for point, values in live.items()
              if any(each is not made[point][-1][0] for each in values)}
    s.check(entry, others, {}, "told as if it were now")


def without_broker(s):
    """The broker is away."""
    entry = "every change: without a broker"
    s.check(entry, broker_away(s), "waiting", "the outlet")
    made = changes(s)
    broker_back(s)
    s.state(True, now())
    since = s.host.count()
    s.gate.open()
    s.born(entry, "connected again", since)
    followed(s, entry, since, made)


def without_host(s):
    """The primary host is away."""
    entry = "every change: without the primary host"
    since = s.host.count()
    s.state(False, now())
    s.heard(entry, "offline", since, "NDEATH")
    made = changes(s)
    since = s.host.count()
    s.state(True, now())
    s.born(entry, "online", since)
    followed(s, entry, since, made)


def not_again(s):
    """What was told does not come again with the next connection, and what is told live does not
    come as the past."""
    entry = "every change: never again"
    since = s.host.count()
    for what in VALUES[:2]:
        place = s.host.count()
        change(s, "hall.di1", what)
        s.heard(entry, f"live, {what}", place, "DDATA", "hall",
                lambda told, what=what: value(told, "di1") is what)
    # By then it knows that it was told.
    until(lambda: s.outlet()["queue"] == 0)
    again = s.host.count()
    s.gate.cut()
    s.heard(entry, "no connection", again, "NDEATH")
    again = s.host.count()
    s.gate.open()
    s.born(entry, "connected again", again)
    change(s, "hall.di1", True)
    s.heard(entry, "live", again, "DDATA", "hall", lambda told: value(told, "di1") is True)
    change(s, "hall.di1", False)
    s.becomes(entry, "hall", "di1", False, "at the end")
    until(lambda: s.outlet()["queue"] == 0)
    s.check(entry, [(what, at) for point in POINTS
                    for what, at in runs(old(s, since), point, False)], [], "the past")


SUITES = [("Sparkplug, primary host", primary), ("Sparkplug, every change", replay)]
