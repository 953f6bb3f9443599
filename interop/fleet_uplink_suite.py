"""The daemon as a site of a fleet, in front of real servers and of a centre by others: every change
arrives once it is there again, in its order, and nothing is said without a session."""

import shutil
import signal
import time

from fleet import Centre, Fleet, inside, write_creds
from modbus_tcp import HOST, until
from outlet_plant import OutletPlant
from rig import Tally

SITE = "plant7"
# Credentials that are valid for so long expire soon, in seconds: 20 days.
ENDS_SOON = 20 * 86_400
# So long something would have happened, in seconds.
LONG = 12.0
# How often a server dies, and how often a relay is switched before and after that.
DEATHS, SWITCHES = 3, 8


class Plant(OutletPlant):
    """Simulated modules, and a daemon that is a site of a fleet."""

    kind, name = "fleet", "hq"

    def __init__(self, fleet, centre, tally):
        super().__init__(tally, {
            "servers": [f"{HOST}:{port}" for port in fleet.ports],
            "credentials": fleet.creds(SITE), "ca": fleet.hub("ca.pem"),
        })
        self.fleet, self.centre = fleet, centre

    def state(self):
        """How the outlet does, and the code of its last failure."""
        outlet = self.outlet()
        return outlet["state"], outlet.get("last_error", {}).get("problem", {}).get("code")

    def entries(self):
        """What the servers have of this site: each entry by its number, and the numbers in their
        order. They may come in another one."""
        found = {}
        for _, batch in self.centre.stored():
            for seq, entry in enumerate(batch.entries, batch.seq):
                if found.setdefault((batch.epoch, seq), entry) != entry:
                    raise RuntimeError(f"{seq} is {found[batch.epoch, seq]} and {entry}")
        return found, sorted(found)

    def newest(self, path):
        """The newest reading of a point that the servers have: value, quality, reason."""
        found, order = self.entries()
        said = None
        for key in order:
            reading = found[key].reading
            if reading.path == path:
                kind = reading.WhichOneof("value")
                said = (kind and getattr(reading, kind), reading.quality, reading.reason)
        return said

    def is_told(self, path, want):
        """Whether this becomes the newest reading of a point."""
        until(lambda: self.newest(path) == want)
        return self.newest(path)

    def gaps(self):
        """What is missing, or is said to be missing."""
        found, order = self.entries()
        missing = [f"{key} after {before}" for before, key in zip(order, order[1:])
                   if key != (before[0], before[1] + 1)]
        return missing + [str(entry.gap) for entry in found.values() if entry.HasField("gap")]


def talks(s):
    """A site says what it is, that it is there, and how it is."""
    entry = "a site and its centre"
    form = s.centre.form
    until(lambda: s.centre.heard["state"])
    site, hello = s.centre.heard["hello"][0]
    s.check(entry, (site, len(hello.installation), len(hello.boot)), (SITE, 16, 16), "hello")
    until(lambda: s.centre.heard["beat"])
    site, beat = s.centre.heard["beat"][0]
    s.check(entry, (site, beat.session, beat.boot), (SITE, "session-1", hello.boot), "beat")
    s.check(entry, beat.epoch, hello.epoch, "epoch")
    site, state = s.centre.heard["state"][0]
    points = {point.reading.path for point in state.points}
    s.check(entry, {"oven.k1", "hall.di0", "tank.ai1"} <= points, True, str(points))
    s.check(entry, (state.session, state.epoch), ("session-1", hello.epoch), "state")
    good, bad = form.Quality.GOOD, form.Quality.BAD
    for path, want in (("hall.di0", True), ("hall.di1", False), ("oven.k1", False),
                       ("tank.ai1", 8.71)):
        got = s.is_told(path, (want, good, ""))
        s.check(entry, got, (want, good, ""), path)
    s.sim.do("hall.di1 = 1")
    s.check(entry, s.is_told("hall.di1", (True, good, "")), (True, good, ""), "a change")
    s.ask("PUT", "/points/oven/k1", {"value": True})
    s.check(entry, s.is_told("oven.k1", (True, good, "")), (True, good, ""), "switched")
    s.sim.do("power hall off")
    until(lambda: (s.newest("hall.di1") or [None, good])[1] == bad)
    value, quality, reason = s.newest("hall.di1")
    s.check(entry, (value, quality, bool(reason)), (None, bad, True), "a dead module")
    s.sim.do("power hall on")
    s.check(entry, s.is_told("hall.di1", (True, good, "")), (True, good, ""), "alive again")
    s.check(entry, s.gaps(), [], "in their order")
    ids = [headers["Nats-Msg-Id"] for headers, _ in s.centre.stored()]
    s.check(entry, len(ids), len(set(ids)), "every message once")
    s.check(entry, s.state()[0], "running", "how it says it does")
    answer = form.ResendAnswer.FromString(s.centre.ask(f"rb.down.{SITE}.session-1.later"))
    s.check(entry, answer.refusal.code, "E0110", "what this version does not know")
    s.check(entry, s.centre.ask(f"rb.down.{SITE}.session-0.later"), None, "another session")
    tried = s.ask("POST", f"/outlets/fleet/{s.name}/test")
    s.check(entry, tried["answer"].startswith(f"{SITE}, nats-server 2."), True, str(tried))


def servers_away(s):
    """What changes while the servers are away comes afterwards, in its order."""
    entry = "servers that are away"
    good = s.centre.form.Quality.GOOD
    s.fleet.kill(0)
    until(lambda: s.state()[1] == "E0165")
    s.check(entry, s.state()[1], "E0165", "it says so")
    for value in (False, True, False):
        s.ask("PUT", "/points/oven/k1", {"value": value})
    s.sim.do("hall.di1 = 0")
    s.check(entry, until(lambda: s.outlet()["queue"] > 3), True, "changes wait")
    s.fleet.start(0)
    s.centre.again()
    for path in ("oven.k1", "hall.di1"):
        s.check(entry, s.is_told(path, (False, good, "")), (False, good, ""), path)
    found, order = s.entries()
    told = [found[key].reading.on for key in order if found[key].reading.path == "oven.k1"
            and found[key].reading.quality == good]
    s.check(entry, told[-4:], [True, False, True, False], "every change in its order")
    s.check(entry, s.gaps(), [], "none is missing")
    s.check(entry, until(lambda: s.outlet()["queue"] == 0), True, "nothing waits any more")


def servers_forget(s):
    """What servers have acknowledged and lost is asked for again, also after a restart."""
    entry = "servers that lose what they acknowledged"
    form = s.centre.form
    session = f"session-{s.centre.sessions + 1}"
    s.daemon.end("TERM")
    s.daemon.start()
    until(lambda: s.centre.heard["beat"][-1][1].session == session and s.outlet()["queue"] == 0)
    s.check(entry, s.centre.heard["beat"][-1][1].session, session, "a session")
    before, order = s.entries()
    s.centre.forget()
    s.check(entry, s.entries()[1], [], "all is gone")
    ask = f"rb.down.{SITE}.{session}.resend"
    wanted = form.Resend(epoch=order[0][0], first=order[0][1], last=order[-1][1])
    answer = form.ResendAnswer.FromString(s.centre.ask(ask, wanted.SerializeToString()))
    s.check(entry, answer.refusal.code, "", "it is on its way")
    until(lambda: set(before) <= set(s.entries()[0]))
    after, _ = s.entries()
    s.check(entry, {key: after.get(key) for key in before}, before, "all is there again")
    wanted.epoch = "another"
    answer = form.ResendAnswer.FromString(s.centre.ask(ask, wanted.SerializeToString()))
    s.check(entry, answer.refusal.code, "E0166", "of another outbox")
    answer = form.ResendAnswer.FromString(s.centre.ask(ask, b"\xff\xff"))
    s.check(entry, answer.refusal.code, "E0806", "no message")
    s.check(entry, s.outlet()["queue"], 0, "nothing waits")


def centre_away(s):
    """Without a session nothing is said."""
    entry = "a centre that is away or refuses"
    good = s.centre.form.Quality.GOOD
    s.centre.leave()
    # It asks for a session when it starts.
    s.daemon.end("KILL")
    s.daemon.start()
    until(lambda: s.state()[1] == "E0163")
    s.check(entry, s.state()[1], "E0163", "it says so")
    count = len(s.centre.stored())
    beats = len(s.centre.heard["beat"])
    s.ask("PUT", "/points/oven/k1", {"value": True})
    s.check(entry, until(lambda: s.outlet()["queue"] > 0), True, "changes wait")
    s.centre.refusal = ("E0935", "another machine is this site")
    s.centre.listen()
    until(lambda: s.state()[1] == "E0935")
    s.check(entry, s.state()[1], "E0935", "refused")
    s.check(entry, len(s.centre.stored()), count, "no data without a session")
    s.check(entry, len(s.centre.heard["beat"]), beats, "no beat without a session")
    s.centre.refusal = None
    s.daemon.end("TERM")
    s.daemon.start()
    s.check(entry, s.is_told("oven.k1", (True, good, "")), (True, good, ""), "with one")
    missing = [text for text in s.gaps() if "stopped" not in text]
    s.check(entry, missing, [], "none is missing, but what its restarts are said to be")
    hellos = [hello for _, hello in s.centre.heard["hello"]]
    s.check(entry, len({hello.installation for hello in hellos}), 1, "one installation")
    s.check(entry, len({hello.epoch for hello in hellos}), 1, "numbers go on")
    s.check(entry, len({hello.boot for hello in hellos}), 4, "four runs")

    entry = "a session that the centre ends"
    session = f"session-{s.centre.sessions}"
    until(lambda: s.centre.heard["beat"][-1][1].session == session)
    until(lambda: s.outlet()["queue"] == 0)
    s.check(entry, s.centre.ask(f"rb.down.{SITE}.{session}.end"), b"", "it is answered")
    until(lambda: s.state()[1] == "E0935")
    count, beats = len(s.centre.stored()), len(s.centre.heard["beat"])
    s.ask("PUT", "/points/oven/k1", {"value": False})
    s.check(entry, until(lambda: s.outlet()["queue"] > 0), True, "changes wait")
    # Longer than it takes where it goes on: a beat comes every 10 s, a change within 2 s.
    time.sleep(LONG)
    s.check(entry, len(s.centre.stored()), count, "no data after it")
    s.check(entry, len(s.centre.heard["beat"]), beats, "no beat after it")
    s.check(entry, s.centre.ask(f"rb.down.{SITE}.{session}.resend"), None, "it does not listen")


def keys(s, other):
    """What is said where it can't connect."""
    entry = "a site that is not let in"
    folder = s.fleet.folder
    token, _ = inside(s.fleet.creds(SITE))
    _, foreign = inside(other)
    wrong = write_creds(folder / "wrong.creds", token, foreign)
    empty = folder / "empty.creds"
    empty.write_text("nothing", encoding="utf-8")
    before = s.settings
    for settings, code, what in (
        ({"credentials": wrong}, "E0934", "the key of another"),
        ({"credentials": str(empty)}, "E0160", "no credentials"),
        ({"credentials": str(folder / "none")}, "E0160", "no file"),
        ({"ca": None}, "E0162", "another authority"),
        ({"servers": [f"localhost:{s.fleet.ports[0]}"]}, "E0162", "a server by another name"),
        ({"servers": [f"{HOST}:1"]}, "E0161", "nobody there"),
    ):
        kept = {**before, **settings}
        s.settings = {key: value for key, value in kept.items() if value is not None}
        s.daemon.config.write_text(s.text(), encoding="utf-8")
        s.daemon.process.send_signal(signal.SIGHUP)
        until(lambda code=code: s.state()[1] == code)
        s.check(entry, s.state()[1], code, what)
    s.settings = before


def renewed(s):
    """Credentials that are replaced while it runs are read without a restart."""
    entry = "credentials that are replaced"
    s.settings = {**s.settings, "credentials": str(s.fleet.folder / "replaced.creds")}
    shutil.copy(s.fleet.creds(SITE), s.settings["credentials"])
    s.centre.refusal = None
    s.daemon.config.write_text(s.text(), encoding="utf-8")
    s.daemon.process.send_signal(signal.SIGHUP)
    count = len(s.centre.heard["hello"])
    until(lambda: len(s.centre.heard["hello"]) > count)
    s.check(entry, s.centre.heard["hello"][-1][0], SITE, "before")
    error = lambda: s.outlet().get("last_error", {})
    before = error().get("at")
    s.fleet.kill(0)
    # It has tried with all that it had.
    until(lambda: error().get("at") != before and s.state()[1] == "E0161")
    s.check(entry, s.state()[1], "E0161", "nobody is there")
    ends = int(time.time()) + ENDS_SOON
    shutil.copy(s.fleet.expiring("plant8", ends), s.settings["credentials"])
    s.fleet.start(0)
    s.centre.again()
    until(lambda: s.centre.heard["hello"][-1][0] == "plant8")
    site, hello = s.centre.heard["hello"][-1]
    s.check(entry, (site, hello.key_expires_s), ("plant8", ends), "afterwards")
    until(lambda: s.state() == ("running", "E0936"))
    s.check(entry, s.state(), ("running", "E0936"), "it says that they expire soon")


def suite():
    """Everything."""
    tally = Tally("fleet, a site")
    with Fleet(1) as fleet:
        centre = Centre(fleet)
        try:
            with Plant(fleet, centre, tally) as s:
                talks(s)
                servers_away(s)
                servers_forget(s)
                centre_away(s)
                keys(s, fleet.creds("plant8"))
                renewed(s)
        finally:
            centre.close()
    return tally


def leaders():
    """Three servers, of which the one that takes the data dies, again and again, while relays are
    switched: every change is there in the end, and none is there twice with another value."""
    tally, entry = Tally("fleet, leaders"), "leaders that die"
    with Fleet(3) as fleet:
        centre = Centre(fleet)
        try:
            with Plant(fleet, centre, tally) as s:
                until(lambda: s.newest("oven.k1"))
                switched = [False]
                for _ in range(DEATHS):
                    leader = centre.leader_elsewhere()
                    s.check(entry, leader > 0, True, "it is not the one of the centre")
                    switched += switch(s, switched[-1])
                    fleet.kill(leader)
                    switched += switch(s, switched[-1])
                    fleet.start(leader)
                until(lambda: s.outlet()["queue"] == 0 and told(s) == switched)
                s.check(entry, told(s), switched, "every change in its order")
                s.check(entry, s.gaps(), [], "none is missing")
        finally:
            centre.close()
    return tally


def switch(s, before):
    """Switches a relay to and fro; the values that it had."""
    values = [not before if nth % 2 == 0 else before for nth in range(SWITCHES)]
    for value in values:
        answer = s.ask("PUT", "/points/oven/k1", {"value": value})
        s.check("leaders that die", answer["value"], value, "switched")
    return values


def told(s):
    """The values of the relay that the servers have, in the order of their numbers."""
    found, order = s.entries()
    readings = [found[key].reading for key in order]
    good = s.centre.form.Quality.GOOD
    values = [each.on for each in readings if each.path == "oven.k1" and each.quality == good]
    # On a busy machine it was stale in between, and is told once more.
    return [value for at, value in enumerate(values) if at == 0 or value != values[at - 1]]


SUITES = [("fleet: a site and its centre", suite), ("fleet: leaders that die", leaders)]
