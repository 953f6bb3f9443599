"""The centre of a fleet, `railbus fleet serve`, in front of real servers: a site by railbus, and
sites by others that do what no site should."""

import asyncio
import json
import os
import signal
import time

from fleet import Fleet, asked, messages
from fleet_centre import Hub, Site, is_so
from fleet_uplink_suite import SITE, Plant
from modbus_tcp import PATIENCE, until
from rig import Tally

# A site that is silent for so long is offline, in seconds.
ONLINE = 35.0
# How long the centre is suspended, in seconds.
STILL = 7.0
# The name of a session that nobody gave.
NO_SESSION = "0" * 32


def knows(s, hub):
    """What a site by railbus says is known."""
    entry = "a site and the centre"
    is_so(s, entry, lambda: hub.site(SITE).get("current"), True, "current")
    site = hub.site(SITE)
    s.check(entry, (site["presence"], site["heard_ms"] < 1000 * ONLINE), ("online", True), "there")
    s.check(entry, abs(site["clock_ahead_ms"]) < 2000, True, "its clock")
    for path, want in (("hall.di0", True), ("hall.di1", False), ("oven.k1", False),
                       ("tank.ai1", 8.71)):
        is_so(s, entry, lambda path=path: hub.point(SITE, path), (want, "good", None, True), path)
    s.ask("PUT", "/points/oven/k1", {"value": True})
    is_so(s, entry, lambda: hub.point(SITE, "oven.k1"), (True, "good", None, True), "switched")
    s.sim.do("power hall off")
    is_so(s, entry, lambda: hub.point(SITE, "hall.di0"), (None, "bad", "offline", True), "dead")
    s.sim.do("power hall on")
    is_so(s, entry, lambda: hub.point(SITE, "hall.di0"), (True, "good", None, True), "alive")
    code, said, _ = hub.run("get", SITE, "oven.k1", "-o", "value")
    s.check(entry, (code, said), (0, "on\n"), "railbus fleet get")
    code, said, _ = hub.run("ls", "-o", "json")
    s.check(entry, (code, json.loads(said)["sites"][0]["site"]), (0, SITE), "railbus fleet ls")
    code, _, said = hub.run("get", "nowhere")
    s.check(entry, (code, "E0836" in said), (8, True), "no such site")
    code, _, said = hub.run("get", SITE, "oven.k9")
    s.check(entry, (code, "E0802" in said), (8, True), "no such point")
    s.check(entry, hub.get("/fleet/v1/none")[0], 404, "no such page")
    mode = os.stat(hub.socket).st_mode & 0o777
    s.check(entry, mode, 0o600, "only its owner may open the socket")


def asked_through(s, hub):
    """The API of a site by railbus, through the centre: what is read, and nothing else."""
    entry = "a site asked through the centre"
    far, own = f"/s/{SITE}/api/v1", lambda path: s.ask("GET", path)
    plain = lambda points: [(each["path"], each.get("value"), each["quality"]) for each in points]
    status, headers, text = hub.ask(far + "/points?select=oven,hall")
    want = plain(own("/points?select=oven,hall")["points"])
    s.check(entry, (status, plain(json.loads(text)["points"])), (200, want), "points")
    s.check(entry, headers["railbus-transit-ms"].isdigit(), True, "how long it was on its way")
    s.check(entry, hub.get(far + "/modules")[1]["modules"][0].keys(),
            own("/modules")["modules"][0].keys(), "modules")
    for words, want in ((("get", "-s", SITE, "oven.k1", "-o", "value"), "on\n"),
                        (("get", "-s", SITE, "oven.k1", "--fresh", "-o", "value"), "on\n"),
                        (("ls", "-s", SITE), "oven"),
                        (("ls", "points", "oven", "-s", SITE), "oven.k1"),
                        (("history", "oven.k1", "-s", SITE, "--limit", "1", "-o", "csv"), ",on,")):
        code, said, error = hub.run_any(*words)
        s.check(entry, (code, want in said), (0, True), f"{words}: {said}{error}")
    code, _, error = hub.run_any("get", "-s", "nowhere", "oven.k1")
    s.check(entry, (code, "E0836" in error), (8, True), "no such site")
    code, _, error = hub.run_any("ls", "ports", "-s", SITE)
    s.check(entry, code, 2, f"what is of this machine: {error}")
    code, _, error = hub.run_any("get", "-s", SITE, "oven.k9")
    s.check(entry, (code, "E0802" in error, "try:" in error), (8, True, False), error)
    code, _, error = hub.run_any("get", "-s", SITE, "oven.k1", "-v")
    s.check(entry, (code, "-v" in error), (2, True), "a line that is not here is not followed")
    zh = hub.ask(far + "/points/oven/k9", **{"accept-language": "zh"})[2]
    s.check(entry, any("\u4e00" <= letter <= "\u9fff" for letter in zh), True, zh)
    for path, method, want in (
            ("/points/oven/k2", "PUT", (403, "E0941")), ("/ops", "POST", (403, "E0937")),
            ("/watch", "GET", (403, "E0937")), ("/events/stream", "GET", (403, "E0937")),
            ("/ws", "GET", (403, "E0937")), ("/users", "GET", (403, "E0905")),
            ("/config", "GET", (403, "E0905")), ("/site", "GET", (404, "E0110")),
            ("/../../metrics", "GET", (404, "E0110")), ("/nothing", "GET", (404, "E0110"))):
        s.check(entry, hub.code(far + path, method), want, f"{method} {path}")
    for path in (f"/s/{SITE}/metrics", f"/s/{SITE}/x", f"/s/{SITE}", "/s/"):
        s.check(entry, hub.code(path), (404, "E0110"), path)
    s.check(entry, hub.code("/s/nowhere/api/v1/points"), (404, "E0836"), "no such site")


def asks_itself(s, hub):
    """A site lets nobody switch anything over its API, whatever a centre wants."""
    entry = "a site asked through the centre"
    form = messages()

    async def asks(method, path):
        centre = await s.fleet.connect(s.fleet.hub("hub.creds"), "_INBOX.hub")
        leases = centre.jetstream(timeout=PATIENCE)
        lease = await leases.get_last_msg("FLEET", f"rb.fleet.lease.{SITE}")
        session = form.Lease.FromString(lease.data).session
        request = form.ApiRequest(method=method, path=path, user="mallory")
        answer = await asked(centre, f"rb.down.{SITE}.{session}.api", request.SerializeToString())
        await centre.close()
        return form.ApiAnswer.FromString(answer.data)

    before = s.ask("GET", "/points/oven/k2")["value"]
    for method in ("PUT", "POST", "DELETE", "PATCH", "put", ""):
        answer = asyncio.run(asks(method, "/api/v1/points/oven/k2"))
        s.check(entry, (answer.status, json.loads(answer.body)["code"]), (403, "E0937"), method)
    answer = asyncio.run(asks("GET", "/api/v1/points/oven/k2"))
    s.check(entry, (answer.status, json.loads(answer.body)["value"]), (200, before), "it is read")


def answers_badly(s, hub, site, session):
    """What a site by others answers is taken for no more than it is."""
    entry = "a site asked through the centre"
    path = f"/s/{site.name}/api/v1/points"
    site.beat(session, boot=2)
    away = lambda what: s.check(entry, hub.code(path), (503, "E0168"), what)
    away("an empty answer")
    site.api = site.form.ApiAnswer(refusal={"code": "E0110", "reason": "x"}, status=200)
    away("a refusal, as of an older version")
    page = {"status": 200, "content_type": "text/html", "body": b"<script>alert(1)</script>"}
    site.api = site.form.ApiAnswer(**page)
    status, headers, _ = hub.ask(path)
    s.check(entry, (status, headers["content-type"]), (200, "application/octet-stream"), "a page")
    point = {"path": "m.k1", "module": "m", "label": "k1", "kind": "output", "index": 0,
             "quality": "good", "value": True, "age_ms": 200}

    def answers(max_age_ms, late, **more):
        body = json.dumps({"schema": 1, "points": [{**point, "max_age_ms": max_age_ms}]})
        site.late = late
        site.api = site.form.ApiAnswer(status=200, content_type="application/json",
                                       body=body.encode(), **more)

    answers(60_000, 0.0)
    code, said, _ = hub.run_any("get", "-s", site.name, "m.k1", "-o", "json")
    told = json.loads(said)["points"][0]
    s.check(entry, (code, told["quality"], told["age_ms"] >= 200), (0, "good", True), "in time")
    # The site says nothing of the time that the answer is on its way, or what can't be.
    for took_ms in (0, 60_000):
        answers(1_000, 1.0, took_ms=took_ms)
        code, said, error = hub.run_any("get", "-s", site.name, "m.k1", "-o", "json")
        # On a busy machine it is later, and then it is not taken at all.
        if code == 1 and "E0168" in error:
            continue
        told = json.loads(said)["points"][0]
        s.check(entry, (code, told["quality"], told["age_ms"] >= 1200), (3, "stale", True), "late")
    answers(60_000, 2.5)
    away("too late for what is so now")
    status, _, _ = hub.ask(f"/s/{site.name}/api/v1/history?point=m.k1")
    s.check(entry, status, 200, "what is past may take its time")
    code, _, error = hub.run_any("ls", "-s", site.name)
    s.check(entry, (code, "E0168" in error), (1, True), "nor are states shown that are too old")
    hostile = json.dumps({"code": "E0802", "title": "x", "status": 404, "module": "\x1b]0;pwn\x07",
                          "reason": "\x1b[31m", "hint": ["rm -rf /"]}).encode()
    site.late = 0.0
    site.api = site.form.ApiAnswer(status=404, content_type="application/problem+json",
                                   body=hostile)
    code, said, error = hub.run_any("get", "-s", site.name, "m.k1")
    shown = [word in said + error for word in ("\x1b", "\x07", "rm -rf", "E0802")]
    s.check(entry, (code, shown), (8, [False, False, False, True]), f"a hostile problem: {error!r}")
    site.api = site.form.ApiAnswer(refusal={"code": "\x1b[1m", "reason": "\x1b]0;pwn\x07 no"})
    code, said, error = hub.run_any("get", "-s", site.name, "m.k1")
    s.check(entry, (code, "\x1b" in said + error, " no" in error), (1, False, True),
            f"a hostile refusal: {error!r}")
    s.check(entry, "\\u001b" in hub.ask(path)[2], False, "for programs, too")
    # What can't be read whole is not read in part.
    body = json.dumps({"schema": 1, "points": [{**point, "path": "m.\x1b[31m"}]})[:-1]
    site.api = site.form.ApiAnswer(status=200, content_type="application/json",
                                   body=f'{body}, "x": 1e999}}'.encode())
    code, said, error = hub.run_any("get", "-s", site.name, "m.k1")
    s.check(entry, (code, "\x1b" in said + error), (1, False), f"hostile JSON: {said!r}{error!r}")
    site.api = None


def dies(s, hub):
    """A centre that was killed knows all again, and also what happened meanwhile. Sites do not
    notice."""
    entry = "a centre that dies"
    session = s.outlet()["since"]
    hub.end(signal.SIGKILL)
    s.ask("PUT", "/points/oven/k1", {"value": False})
    s.ask("PUT", "/points/oven/k2", {"value": True})
    is_so(s, entry, lambda: s.outlet()["queue"], 0, "servers take data without it")
    hub.start()
    site = hub.site(SITE)
    first = (site["presence"], site["current"])
    s.check(entry, first in (("unknown", False), ("online", False)), True, str(first))
    is_so(s, entry, lambda: hub.site(SITE)["current"], True, "current")
    s.check(entry, hub.point(SITE, "oven.k1"), (False, "good", None, True), "switched off")
    s.check(entry, hub.point(SITE, "oven.k2"), (True, "good", None, True), "switched on")
    s.check(entry, (s.state()[0], s.outlet()["since"]), ("running", session), "unnoticed")


def suspended(s, hub):
    """Messages queued while the centre was suspended are not taken for fresh ones."""
    entry = "a centre that is suspended"
    hub.process.send_signal(signal.SIGSTOP)
    time.sleep(STILL)
    hub.process.send_signal(signal.SIGCONT)
    told = lambda: "was suspended" in hub.said.read_text(encoding="utf-8")
    s.check(entry, until(told), True, "it says so")
    is_so(s, entry, lambda: hub.site(SITE)["current"], True, "it begins anew")


def copied(s, hub, site):
    """One machine is the site, and others are told so."""
    entry = "machines with one key"
    taken = ("E0935", "another machine reports as this site")
    first = site.hello(1, 1)
    s.check(entry, len(first), 32, "a session")
    site.beat(first)
    is_so(s, entry, lambda: hub.site(site.name)["presence"], "online", "there")
    s.check(entry, site.hello(2, 7), taken, "another installation")
    s.check(entry, "duplicate_ms" in hub.site(site.name), True, "it is said")
    again = site.hello(1, 1)
    s.check(entry, (len(again), again != first), (32, True), "the same run again")
    site.beat(again)
    restarted = site.hello(1, 2)
    s.check(entry, len(restarted), 32, "a restart")
    is_so(s, entry, lambda: (again, "end") in site.asked, True, "the other session has ended")
    site.beat(restarted, boot=2)
    site.asked.clear()
    site.beat(again)
    is_so(s, entry, lambda: (again, "end") in site.asked, True, "it is told again")
    s.check(entry, site.hello(1, 1), taken, "no run comes back after a restart")
    site.beat(NO_SESSION)
    # What it says at once to that comes before this answer.
    s.check(entry, site.hello(2, 7), taken, "another installation again")
    s.check(entry, (NO_SESSION, "end") in site.asked, False, "its document may be on its way")
    s.check(entry, (restarted, "end") in site.asked, False, "the present session")
    _, said, _ = hub.run("ls", "-o", "json")
    shown = next(each for each in json.loads(said)["sites"] if each["site"] == site.name)
    s.check(entry, "duplicate_ms" in shown, True, "railbus fleet ls")
    day = time.strftime("%Y-%m-%d", time.gmtime(site.key_ends))
    s.check(entry, shown["key_until"][:10], day, "until when its key is valid")
    _, said, _ = hub.run("ls")
    for note in ("another machine has its key", "key valid until"):
        s.check(entry, note in said, True, said)
    return restarted


def incomplete(s, hub, site, session):
    """What is not all is not shown as if it were so."""
    entry = "not all has arrived"
    name = site.name
    site.state(session, 5, k1=True, k2=False)
    site.beat(session, newest=7, boot=2)
    old = (True, "stale", "incomplete", False)
    is_so(s, entry, lambda: hub.point(name, "m.k1"), old, "an entry is missing")
    code, said, error = hub.run("get", name)
    s.check(entry, (code, "incomplete" in said or "not all" in said, "E0304" in error),
            (3, True, True), "railbus fleet get")
    code, said, _ = hub.run("get", name, "m.k1", "-o", "value")
    s.check(entry, (code, said), (3, "?\n"), "no value without its quality")
    site.batch(session, 7, False)
    is_so(s, entry, lambda: hub.point(name, "m.k1")[0], False, "the last entry")
    s.check(entry, hub.site(name)["current"], False, "the one before is missing")

    def asks():
        site.beat(session, newest=7, boot=2)
        time.sleep(0.5)
        return (session, "state") in site.asked

    s.check(entry, until(asks), True, "it is asked how all is")
    site.batch(session, 6, True)
    new = (False, "good", None, True)
    is_so(s, entry, lambda: hub.point(name, "m.k1"), new, "all is there")
    site.asked.clear()

    def strays():
        site.beat(NO_SESSION)
        time.sleep(1)
        return (NO_SESSION, "end") in site.asked

    s.check(entry, until(strays), True, "a session that nobody gave has ended")
    site.state(session, 4, k1=True)
    site.batch(NO_SESSION, 8, True)
    site.state(NO_SESSION, 9, k1=True)
    site.beat(session, newest=7, boot=2)
    s.check(entry, hub.point(name, "m.k1"), new, "what is older, or of another session")
    before = hub.sites()["connection"]["unreadable"]
    for what in ("beat", "data", "state", "hello"):
        site.says(what, b"\xff\xff")
    # A hello that is no request is none.
    is_so(s, entry, lambda: hub.sites()["connection"]["unreadable"], before + 3, "no message")
    s.check(entry, hub.point(name, "m.k1"), new, "nothing is changed by it")


def silent(s, hub, site):
    """A site that is silent is offline, and its values are no longer good."""
    entry = "a site that is silent"
    said = time.monotonic()
    is_so(s, entry, lambda: hub.site(site.name)["presence"], "offline", "offline")
    # It was heard a moment before that was noted here.
    s.check(entry, time.monotonic() - said < 2 * ONLINE, True, "soon")
    old = (False, "stale", "site_offline", False)
    s.check(entry, hub.point(site.name, "m.k1"), old, "what was so")
    s.check(entry, hub.site(site.name)["known_ms"] > 1000 * (ONLINE - 1), True, "how long ago")
    s.check(entry, hub.site(SITE)["current"], True, "the other site")
    site.run(site.client.close())
    path = f"/s/{site.name}/api/v1/points"
    s.check("a site asked through the centre", hub.code(path), (503, "E0168"), "it is away")


def two(s, hub, other):
    """Two processes are one centre."""
    entry = "two processes of the centre"
    other.start()
    is_so(s, entry, lambda: other.site(SITE).get("current"), True, "both know")
    site = Site(s.fleet, "plant9")
    try:
        sessions = [site.hello(1, 1) for _ in range(8)]
        s.check(entry, len(set(sessions)), 8, "each is another")
        site.state(sessions[-1], 0, k1=True)
        site.beat(sessions[-1])
        for each in (hub, other):
            is_so(s, entry, lambda each=each: each.point("plant9", "m.k1"),
                  (True, "good", None, True), "both know the last one")
        s.check(entry, site.hello(2, 2)[0], "E0935", "another machine")
        s.check(entry, hub.end(signal.SIGTERM), 0, "one ends")
        session = site.hello(1, 2)
        site.state(session, 0, k1=False)
        site.beat(session, boot=2)
        is_so(s, entry, lambda: other.point("plant9", "m.k1"), (False, "good", None, True),
              "the other goes on")
    finally:
        site.close()
    hub.start()
    s.check(entry, hub.point("plant9", "m.k1")[0], False, "it is there again")
    other.end(signal.SIGKILL)


def held(s, name):
    """How many messages of a site each stream holds."""
    async def counts():
        centre = await s.fleet.connect(s.fleet.hub("hub.creds"), "_INBOX.hub")
        streams, found = centre.jetstream(timeout=PATIENCE), {}
        for stream, subject in (("STATE", f"rb.up.{name}.*"), ("DATA", f"rb.up.{name}.*"),
                                ("FLEET", f"rb.fleet.site.{name}")):
            info = await streams.stream_info(stream, subjects_filter=subject)
            found[stream] = sum((info.state.subjects or {}).values())
        await centre.close()
        return found

    return asyncio.run(counts())


def grouped(s, hub, other, away):
    """Sites are in groups, which all processes know; also before they join."""
    entry = "groups of sites"
    other.start()
    code, said, _ = hub.run("group", SITE, "pumps", "north", "-o", "json")
    s.check(entry, (code, json.loads(said)["groups"]), (0, ["north", "pumps"]), "they are set")
    s.check(entry, hub.run("group", away, "north")[0], 0, "of a site that is away")
    note = "no site named plant6 has reported yet\n"
    s.check(entry, other.run("group", "plant6", "west", "-o", "value"), (0, "west\n", note),
            "of one that never reported")
    groups = [{"group": "north", "sites": 2}, {"group": "pumps", "sites": 1}]
    for each in (hub, other):
        is_so(s, entry, lambda each=each: each.sites().get("groups"), groups, "both know them")
        s.check(entry, each.site(SITE)["groups"], ["north", "pumps"], "of a site")
        listed = [site["site"] for site in each.get("/fleet/v1/sites?group=pumps")[1]["sites"]]
        s.check(entry, listed, [SITE], "the sites of a group")
        code, said, _ = each.run("ls", "--group", "north", "-o", "value")
        s.check(entry, (code, sorted(said.split())), (0, sorted([SITE, away])), "fleet ls --group")
        s.check(entry, each.site("plant6"), {}, "one that never reported is not listed")
    _, _, text = hub.ask("/fleet/v1/sites?search=pum")
    s.check(entry, json.loads(text)["total"], 1, "a search finds them")
    many = json.dumps({"groups": [f"g{number}" for number in range(17)]})
    for body in ('{"groups":["A b"]}', many, "[]"):
        status, _, text = hub.order(f"/fleet/v1/sites/{SITE}/groups", "PUT", body, {})
        s.check(entry, (status, json.loads(text)["code"]), (422, "E0806"), body)
    form = messages()

    async def document():
        centre = await s.fleet.connect(s.fleet.hub("hub.creds"), "_INBOX.hub")
        last = await centre.jetstream(timeout=PATIENCE).get_last_msg(
            "FLEET", f"rb.fleet.site.{SITE}")
        await centre.close()
        return list(form.SiteDocument.FromString(last.data).groups)

    s.check(entry, asyncio.run(document()), ["north", "pumps"], "what the servers hold")
    site = Site(s.fleet, "plant6")
    try:
        site.beat(site.hello(1, 1))
        for each in (hub, other):
            is_so(s, entry, lambda each=each: each.site("plant6").get("groups"), ["west"],
                  "it joins, and is in its group")
    finally:
        site.close()
    s.check(entry, hub.run("group", SITE)[0], 0, "in none")
    is_so(s, entry, lambda: "groups" in other.site(SITE), False, "which the other one hears")
    told = "sites: groups_set " + SITE + " pumps north by owner via socket"
    s.check(entry, told in hub.said.read_text(encoding="utf-8"), True, "who did it is printed")
    hub.end(signal.SIGTERM)
    hub.start()
    s.check(entry, (hub.site(away)["groups"], "groups" in hub.site(SITE)), (["north"], False),
            "one that starts anew knows them")
    other.end(signal.SIGKILL)


def removed(s, hub, other, silent_site):
    """A site that is gone is removed, from all processes and from the streams. If it comes back, it
    is a new one."""
    entry, name = "a site that is removed", silent_site.name
    other.start()
    for each in (hub, other):
        is_so(s, entry, lambda each=each: each.site(name).get("presence"), "offline", "known")
    s.check(entry, {stream: count > 0 for stream, count in held(s, name).items()},
            {"STATE": True, "DATA": True, "FLEET": True}, "the servers hold something of it")
    kept = held(s, SITE)
    code, _, said = hub.run("remove", SITE)
    s.check(entry, (code, "E0179" in said), (1, True), f"one that is online: {said}")
    code, _, said = hub.run("remove", "nowhere")
    s.check(entry, (code, "E0836" in said), (8, True), "one that never was")
    code, said, note = hub.run("remove", name)
    s.check(entry, (code, said, "railbus fleet revoke" in note), (0, f"{name} removed\n", True),
            f"railbus fleet remove: {note}")
    for each in (hub, other):
        is_so(s, entry, lambda each=each: each.site(name), {}, "no process knows it")
        listed = [site["site"] for site in each.sites()["sites"]]
        s.check(entry, (name in listed, SITE in listed), (False, True), "nor lists it")
        code, _, said = each.run("get", name)
        s.check(entry, (code, "E0836" in said), (8, True), "railbus fleet get")
    s.check(entry, held(s, name), {"STATE": 0, "DATA": 0, "FLEET": 0},
            "the servers hold nothing of it")
    now = held(s, SITE)
    s.check(entry, (now["STATE"], now["DATA"] >= kept["DATA"]), (1, True), "of others they do")
    code, _, said = other.run("remove", name)
    s.check(entry, (code, "E0836" in said), (8, True), "removed twice")
    hub.end(signal.SIGTERM)
    hub.start()
    s.check(entry, hub.site(name), {}, "nor does one that starts anew")
    site = Site(s.fleet, name)
    try:
        # A late state of before is of no session, and is not shown.
        site.state(NO_SESSION, 9, k1=True)
        # The run that it was, which none but a new site could be again.
        session = site.hello(1, 1)
        s.check(entry, len(session), 32, "it is admitted")
        for each in (hub, other):
            # The session may be heard after the heartbeat.
            def presence(each=each):
                site.beat(session)
                return each.site(name).get("presence")
            is_so(s, entry, presence, "online", "there")
            s.check(entry, each.point(name, "m.k1"), [], "nothing is known of its points")
            s.check(entry, "groups" in each.site(name), False, "nor of its groups")
        site.state(session, 0, k2=True)
        site.beat(session)
        for each in (hub, other):
            is_so(s, entry, lambda each=each: each.point(name, "m.k2"),
                  (True, "good", None, True), "but what it says now")
            s.check(entry, each.point(name, "m.k1"), [], "and nothing else")
    finally:
        site.close()
    other.end(signal.SIGKILL)


def servers_away(s, hub):
    """Without servers nothing is known, and nothing is said to be offline."""
    entry = "a centre without servers"
    s.fleet.kill(0)
    is_so(s, entry, lambda: hub.sites()["connection"]["connected"], False, "it says so")
    is_so(s, entry, lambda: hub.site(SITE)["presence"], "unknown", "not known")
    s.check(entry, hub.point(SITE, "oven.k2"), (True, "stale", "site_unknown", False), "was so")
    is_so(s, entry, lambda: hub.sites()["connection"]["error"]["code"], "E0161", "why")
    code, _, said = hub.run("ls")
    s.check(entry, (code, "E0161" in said), (1, True), "railbus fleet ls")
    s.ask("PUT", "/points/oven/k2", {"value": False})
    s.fleet.start(0)
    is_so(s, entry, lambda: hub.point(SITE, "oven.k2"), (False, "good", None, True), "all is known")
    s.check(entry, "error" in hub.sites()["connection"], False, "nothing is wrong")


def suite():
    """Runs it."""
    tally = Tally("fleet, the centre")
    with Fleet(1) as fleet:
        hub, other = Hub(fleet), Hub(fleet)
        site = None
        try:
            hub.start()
            with Plant(fleet, None, tally) as s:
                knows(s, hub)
                asked_through(s, hub)
                asks_itself(s, hub)
                dies(s, hub)
                suspended(s, hub)
                site = Site(fleet, "plant8")
                session = copied(s, hub, site)
                incomplete(s, hub, site, session)
                answers_badly(s, hub, site, session)
                silent(s, hub, site)
                grouped(s, hub, other, site.name)
                removed(s, hub, other, site)
                two(s, hub, other)
                servers_away(s, hub)
        finally:
            if site:
                site.close()
            hub.close()
            other.close()
    return tally


SUITES = [("fleet: the centre", suite)]
