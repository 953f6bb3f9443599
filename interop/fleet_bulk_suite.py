"""One command to many sites: each is sent it once, so many at a time, and what is said of each is
so, whichever process of the centre is asked."""

import json
import signal
import threading

from fleet_centre import Site, is_so
from fleet_command_suite import SITE, TAKEN_OVER, Writable, centres, ledger, relays
from modbus_tcp import until
from rig import Tally

PATH = "/api/v1/points/m/k1"
# Sites by others: those that answer, one that never does, one that refuses, one without a
# heartbeat.
GOOD = [f"good{number:02}" for number in range(12)]
OTHERS = ["away", "mute", "wrong"]


def give(hub, sites, key=None, path=PATH, **body):
    """Gives a command to these sites: status and what is said."""
    headers = {"idempotency-key": key} if key else {}
    wanted = {"sites": sites, "method": "PUT", "path": path, "body": {"value": True, **body}}
    status, _, text = hub.order("/fleet/v1/commands", "POST", json.dumps(wanted), headers)
    return status, json.loads(text)


def told(hub, key):
    """What a process of the centre says of it: the state of each site, and whether it has ended."""
    status, said = hub.get(f"/fleet/v1/commands/{key}")
    if status != 200:
        return status, said["code"]
    return {one["site"]: one["state"] for one in said["sites"]}, "ended_at" in said


class Others:
    """Sites by others, each with a thread of heartbeats."""

    def __init__(self, fleet, names):
        self.sites = {name: Site(fleet, name) for name in names}
        form = next(iter(self.sites.values())).form
        self.done = form.CommandAnswer(ended={
            "status": 200, "content_type": "application/json",
            "body": b'{"value": true, "confirmed": "readback"}'})
        self.refused = form.CommandAnswer(ended={
            "status": 422, "content_type": "application/problem+json",
            "body": b'{"code": "E0821", "title": "x", "status": 422}'})
        self.sessions = {name: site.hello(1, 1) for name, site in self.sites.items()}
        self.silent = {"away"}
        self.is_over = threading.Event()
        self.thread = threading.Thread(target=self.beats, daemon=True)
        self.thread.start()

    def beats(self):
        """Says that they are there."""
        while not self.is_over.is_set():
            for name, site in self.sites.items():
                if name not in self.silent:
                    site.beat(self.sessions[name])
            self.is_over.wait(5)

    def answer(self, name, count=1):
        """What this site answers next."""
        if name in GOOD:
            return [self.done] * count
        return [self.refused] * count if name == "wrong" else []

    def ready(self):
        """All have an answer, and have heard nothing."""
        for name, site in self.sites.items():
            site.heard.clear()
            site.commands = self.answer(name)

    def heard(self, name):
        """Which commands a site was sent, those by which it was only asked apart."""
        heard = self.sites[name].heard
        return [each.id for each in heard if not each.tell]

    def rest(self):
        """No more heartbeats."""
        self.is_over.set()
        self.thread.join()

    def close(self):
        """Ends them."""
        self.rest()
        for site in self.sites.values():
            site.close()


def each(s, fleet, hub, other, others):
    """Each site has its own result, at both processes."""
    entry = "many sites: each has its own result"
    others.ready()
    names = GOOD + OTHERS + ["never-there"]
    status, said = give(hub, names, "all", within_ms=200)
    s.check(entry, (status, said.get("id"), said.get("counts", {}).get("all")),
            (200, "all", len(names)), str(said)[:300])
    want = {**{name: "done" for name in GOOD}, "away": "never", "mute": "sent", "wrong": "failed",
            "never-there": "never"}
    for centre in (hub, other):
        is_so(s, entry, lambda centre=centre: told(centre, "all"), (want, True), centre.socket)
    s.check(entry, {name: others.heard(name) for name in GOOD + ["mute", "wrong"]},
            {name: ["all"] for name in GOOD + ["mute", "wrong"]}, "sent once")
    s.check(entry, others.heard("away"), [], "not sent")
    records = ledger(fleet, "good00")
    s.check(entry, len(records), 1, str(records)[:200])
    s.check(entry, ledger(fleet, "away"), {}, "nothing is recorded of what was not sent")
    _, said = hub.get("/fleet/v1/commands/all?state=never")
    codes = {one["site"]: one.get("code") for one in said["sites"]}
    s.check(entry, codes, {"away": "E0168", "never-there": "E0836"}, str(said)[:300])
    # Whatever comes later is told, too.
    others.sites["mute"].commands = [others.done] * 3
    for centre in (hub, other):
        is_so(s, entry, lambda centre=centre: told(centre, "all")[0]["mute"], "done", "late")
    s.check(entry, others.heard("mute"), ["all"], "only asked since")
    entry = "many sites: once, whoever repeats it"
    others.ready()
    for centre in (hub, other):
        status, said = give(centre, names, "all", within_ms=200)
        s.check(entry, (status, said.get("id")), (200, "all"), str(said)[:200])
        status, said = give(centre, names[1:], "all", within_ms=200)
        s.check(entry, (status, said.get("code")), (422, "E0806"), "another one of the same key")
    s.check(entry, {tuple(others.heard(name)) for name in GOOD}, {()}, "nothing is sent again")
    _, said = hub.get("/fleet/v1/commands")
    s.check(entry, ([one["id"] for one in said["bulk"]], said["commands"]), (["all"], []),
            "one line of the record")


def both(s, hub, other, others):
    """Given to both processes at the same moment: one carries it out."""
    entry = "many sites: at two processes at once"
    for number in range(5):
        others.ready()
        key, answers = f"both-{number}", []
        threads = [threading.Thread(target=lambda centre=centre: answers.append(
            give(centre, GOOD, key))) for centre in (hub, other)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        s.check(entry, [(status, said.get("id")) for status, said in answers], [(200, key)] * 2,
                str(answers)[:300])
        want = {name: "done" for name in GOOD}, True
        for centre in (hub, other):
            is_so(s, entry, lambda centre=centre: told(centre, key), want, centre.socket)
        s.check(entry, [others.heard(name) for name in GOOD], [[key]] * len(GOOD), "sent once")


def stopped(s, hub, other, others):
    """What was sent when it is stopped, or when its process is killed, has its result."""
    entry = "many sites: stop"
    status, said = hub.order("/fleet/v1/commands/nothing/stop", "POST", "", {})[0::2]
    s.check(entry, (status, json.loads(said)["code"]), (404, "E0837"), said)
    for name in ("stop", "kill"):
        entry = f"many sites: {name}"
        others.ready()
        status, said = give(hub, ["mute", *GOOD], f"{name}-1", within_ms=60_000)
        s.check(entry, status, 200, str(said)[:200])
        if name == "stop":
            status, _, text = other.order(f"/fleet/v1/commands/{name}-1/stop", "POST", "", {})
            s.check(entry, status, 200, text[:200])
            is_so(s, entry, lambda: hub.get("/fleet/v1/commands/stop-1")[1].get("stopped_by"),
                  "owner", "the one that carries it out hears it")
        else:
            is_so(s, entry, lambda: told(other, "kill-1")[0].get("good00"), "done", "at the other")
            hub.end(signal.SIGKILL)
            hub.start()
        states, is_over = told(other, f"{name}-1")
        s.check(entry, (states["mute"], is_over), ("sent", False), "no answer yet")
        others.sites["mute"].commands = [others.done] * 3
        # Another process asks for it only after a minute.
        for centre in (hub, other):
            got = lambda centre=centre: told(centre, f"{name}-1")[0]["mute"]
            until(lambda: got() == "done", 3 * TAKEN_OVER)
            s.check(entry, got(), "done", "the result of what was sent is told")
        s.check(entry, others.heard("mute"), [f"{name}-1"], "sent once")


def cut_off(s, fleet, hub, other, others):
    """Without its servers nothing is sent, and that is said; also of what is not known."""
    entry = "many sites: the servers are away"
    others.ready()
    others.rest()
    fleet.kill(0)
    is_so(s, entry, hub.is_connected, False, "cut off")
    status, said = give(hub, GOOD)
    s.check(entry, (status, said["code"], said.get("may_have_acted", False)),
            (503, "E0164", False), str(said))
    status, said = give(hub, GOOD, "again")
    s.check(entry, (status, said["code"], said.get("may_have_acted", False)),
            (504, "E0169", True), "it may have been given before")
    fleet.start(0)
    for centre in (hub, other):
        is_so(s, entry, centre.is_connected, True, centre.socket)
    # They would hear it now.
    for name in GOOD:
        site = others.sites[name]
        site.run(site.connect())
        site.beat(others.sessions[name])
    is_so(s, entry, lambda: {hub.site(name)["presence"] for name in GOOD}, {"online"}, "there")
    # What comes after them has come: they would have.
    status, said = give(hub, GOOD, "after")
    is_so(s, entry, lambda: told(hub, "after")[1], True, str(said)[:200])
    s.check(entry, [others.heard(name) for name in GOOD], [["after"]] * len(GOOD),
            "not sent later")
    s.check(entry, told(hub, "again"), (404, "E0837"), "it is not known")


def suite():
    """Commands to many sites by others."""
    tally = Tally("fleet, commands to many sites")
    with centres() as (fleet, hub, other):
        others = Others(fleet, GOOD + OTHERS)
        try:
            for centre in (hub, other):
                there = lambda centre=centre: [
                    centre.site(name).get("presence") for name in GOOD + ["mute", "wrong"]]
                is_so(tally, "many sites: each has its own result", there,
                      ["online"] * (len(GOOD) + 2), centre.socket)
            each(tally, fleet, hub, other, others)
            both(tally, hub, other, others)
            stopped(tally, hub, other, others)
            cut_off(tally, fleet, hub, other, others)
        finally:
            others.close()
    return tally


def suite_real():
    """A real site, by the command line."""
    tally = Tally("fleet, commands to many sites")
    with centres() as (fleet, hub, other), Writable(fleet, None, tally) as s:
        entry = "many sites: by the command line"
        for centre in (hub, other):
            is_so(s, entry, lambda centre=centre: centre.site(SITE).get("current"), True, "there")
        code, said, error = hub.run("set", "oven.k1", "on", "--all", "-n", "-o", "json")
        [shown] = json.loads(said)["sites"]
        s.check(entry, (code, shown["point"]["value"], relays(s)[0]), (0, False, 0), error)
        code, said, error = hub.run("set", "oven.k1", "on", "--all", "-o", "json")
        [done] = json.loads(said)["sites"]
        s.check(entry, (code, done["state"], done["confirmed"], relays(s)[0]),
                (0, "done", "readback", 1), error)
        code, said, error = hub.run("set", "@lamps", "off", SITE)
        s.check(entry, (code, relays(s)[0]), (0, 0), said + error)
        code, said, error = hub.run("set", "tank.k1", "on", SITE)
        s.check(entry, (code, "E0906" in said, relays(s, "tank")[0]), (11, True, 0), said + error)
        for words, what in ((("--all", "--count", "2"), "another number"),
                            (("plant9",), "no such site"), ((), "no site"),
                            (("--search", " "), "a search without words"),
                            (("--group", "none"), "a group without sites")):
            code, said, error = hub.run("set", "oven.k1", "on", *words)
            s.check(entry, (code != 0, said, relays(s)[0]), (True, "", 0), f"{what}: {error}")
        audit = s.ask("GET", "/audit?limit=3")["items"]
        who = {each.get("who") for each in audit}
        s.check(entry, who, {f"outlet:{s.name}:owner"}, str(audit))
        code, said, _ = other.run("commands")
        s.check(entry, (code, said.count("1 site"), "oven.k1 on" in said), (0, 3, True), said)
        s.sim.do("power oven off")
        code, said, error = hub.run("set", "oven.k3", "on", SITE, "-o", "json")
        [dead] = json.loads(said)["sites"]
        s.check(entry, (code, dead["state"]), (11, "failed"), f"of a dead module: {said}{error}")
        s.sim.do("power oven on")
    return tally


SUITES = [("fleet: commands to many sites", suite),
          ("fleet: commands to many sites, a real one", suite_real)]
