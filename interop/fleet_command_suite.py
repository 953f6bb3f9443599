"""Commands to a far site through the centre of its fleet: each is carried out at most once, has one
end, and what is said of it is so."""

import asyncio
import contextlib
import http.client
import json
import signal
import ssl
import subprocess
import threading
import time

from fleet import Fleet, asked, messages
from fleet_centre import Hub, Site, is_so
from fleet_uplink_suite import SITE, Plant
from modbus_tcp import HOST, PATIENCE, PROGRAM, until
from rig import Tally, free_port

# What the centre may switch there.
WRITE = ["oven", "hall"]
# How long the daemon is stopped: longer than a command lives, in seconds.
STILL = 8.0
# After this time another process of the centre takes a command over, in seconds.
TAKEN_OVER = 60.0
FAR = f"/s/{SITE}/api/v1"


class Writable(Plant):
    """The site, where outputs may be switched from afar."""

    def text(self, **settings):
        """The configuration."""
        return super().text(write=WRITE, **settings)


def relays(s, module="oven"):
    """The relays of a module, whatever anybody says."""
    return s.sim.outputs(module)


def put(hub, path, body, key=None, method="PUT"):
    """Gives a command: status and what is said."""
    headers = {"idempotency-key": key} if key else {}
    status, _, text = hub.order(path, method, json.dumps(body), headers)
    return status, json.loads(text)


def ledger(fleet, site=None):
    """The records of commands: by site and id, in their order."""
    form = messages()

    async def reads():
        centre = await fleet.connect(fleet.hub("hub.creds"), "_INBOX.hub")
        streams = centre.jetstream(timeout=PATIENCE)
        state = (await streams.stream_info("LEDGER")).state
        found = {}
        for seq in range(state.first_seq, state.last_seq + 1) if state.messages else ():
            message = await streams.get_msg("LEDGER", seq)
            _, _, its, name = message.subject.split(".")
            if its == "BULK":
                continue
            record = form.CommandRecord.FromString(message.data)
            found.setdefault((its, name), []).append(record)
        await centre.close()
        return found

    records = asyncio.run(reads())
    return {name: each for (its, name), each in records.items() if site in (None, its)}


def end_of(fleet, key):
    """What came of a command: how, and the code of the problem or the status."""
    records = ledger(fleet).get(key, [])
    if [each.WhichOneof("record") for each in records] != ["intent", "end"]:
        return [each.WhichOneof("record") for each in records]
    end = records[1].end
    how = end.WhichOneof("end")
    if how != "ended":
        return how, getattr(end, how).code
    body = json.loads(end.ended.body)
    return how, body.get("code", end.ended.status)


def switched(s, hub):
    """As near ones, with the command line."""
    entry = lambda what: f"a far output: {what}"
    code, said, error = hub.run_any("set", "-s", SITE, "oven.k1", "on", "-o", "json")
    told = json.loads(said)["set"][0] if said else error
    s.check(entry("switched"), (code, told["value"], told["confirmed"]), (0, True, "readback"))
    s.check(entry("switched"), relays(s)[0], 1, "the relay")
    audit = s.ask("GET", "/audit?limit=1")["items"][0]
    who = (audit.get("who"), audit.get("via"))
    s.check(entry("the audit log of the site says who"), who,
            (f"outlet:{s.name}:owner", f"outlet:{s.name}"), str(audit))
    code, _, error = hub.run_any("set", "-s", SITE, "oven.k1", "toggle")
    s.check(entry("over"), (code, relays(s)[0]), (0, 0), error)
    code, _, error = hub.run_any("set", "-s", SITE, "oven", "k1=on", "k2=on", "k3=off")
    s.check(entry("several"), (code, relays(s)[:3]), (0, [1, 1, 0]), error)
    code, _, error = hub.run_any("set", "-s", SITE, "@lamps", "off")
    s.check(entry("a group"), (code, relays(s)[0]), (0, 0), error)
    code, _, error = hub.run_any("scene", "run", "night", "-s", SITE)
    s.check(entry("a scene"), (code, relays(s)[1], relays(s, "hall")[1]), (0, 1, 1), error)
    code, said, error = hub.run_any("pulse", "-s", SITE, "oven.k8", "1s", "-o", "value")
    s.check(entry("a pulse"), (code, said), (0, "1000\n"), error)
    is_so(s, entry("a pulse"), lambda: relays(s)[7], 0, "it ends")
    code, said, error = hub.run("commands", SITE)
    shown = [word in said for word in ("oven.k1 on", "oven k1=on", "@lamps off", "scene night",
                                       "oven.k8 pulse", "owner", "done")]
    s.check(entry("switched"), (code, all(shown)), (0, True), f"{said}{error}")


def refused(s, hub):
    """What is not done is not said to be."""
    entry = lambda what: f"a far output: {what}"
    code, _, error = hub.run_any("set", "-s", SITE, "tank.k1", "on")
    s.check(entry("not among those allowed"), (code, "E0906" in error, relays(s, "tank")[0]),
            (9, True, 0), error)
    code, _, error = hub.run_any("set", "-s", SITE, "oven.k6", "on")
    s.check(entry("locked"), (code != 0, relays(s)[5], "try:" in error), (True, 0, False), error)
    s.sim.do("power oven off")
    status, said = put(hub, FAR + "/points/oven/k3", {"value": True}, "dead")
    s.check(entry("of a dead module"), (status, said["code"], said.get("may_have_acted", False)),
            (504, said["code"], True), str(said))
    s.check(entry("of a dead module"), end_of(s.fleet, "dead"), ("ended", said["code"]), "the end")
    code, _, _ = hub.run_any("scene", "run", "night", "-s", SITE)
    _, said, _ = hub.run("commands", SITE, "--limit", "1", "-o", "json")
    [last] = json.loads(said)["commands"]
    s.check(entry("of a dead module"), (code != 0, last["how"], last.get("code", "")[:2]),
            (True, "answered", "E0"), f"a scene: {last}")
    s.sim.do("power oven on")
    is_so(s, entry("of a dead module"),
          lambda: s.ask("GET", "/points/oven/k3")["quality"], "good", "alive")


def once(s, hub, other):
    """A key stands for one command."""
    entry = "a key: once, whoever repeats it"
    path = FAR + "/points/oven/k4/toggle"
    before = relays(s)[3]
    first = put(hub, path, {}, "key-1", "POST")
    again = put(hub, path, {}, "key-1", "POST")
    s.check(entry, (first[0], again), (200, first), "the same answer")
    s.check(entry, relays(s)[3], 1 - before, "the relay")
    elsewhere = put(other, path, {}, "key-1", "POST")
    s.check(entry, (elsewhere, relays(s)[3]), (first, 1 - before), "at another process")
    status, said = put(hub, path, {"within_ms": 900}, "key-1", "POST")
    s.check("a key: not for another command", (status, said["code"]), (422, "E0806"), str(said))
    for wrong in ("a.b", "*", "x" * 65):
        status, said = put(hub, path, {}, wrong, "POST")
        s.check("a key: not for another command", (status, said["code"]), (422, "E0806"), wrong)
    records = ledger(s.fleet, SITE)
    kinds = {tuple(each.WhichOneof("record") for each in found) for found in records.values()}
    s.check("a command: written down, then its end, and nothing else", kinds, {("intent", "end")},
            "all records")


def both(s, hub, other):
    """The same command at two processes at the same time."""
    entry = "two processes of the centre: one end"
    path = FAR + "/points/oven/k8/toggle"
    for number in range(4):
        before, told = relays(s)[7], []
        gives = lambda at, number=number, told=told: told.append(
            put(at, path, {}, f"both-{number}", "POST"))
        threads = [threading.Thread(target=gives, args=(at,)) for at in (hub, other)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        s.check(entry, (told[0], told[0][0]), (told[1], 200), "both are told the same")
        s.check(entry, relays(s)[7], 1 - before, "the relay")
        s.check(entry, end_of(s.fleet, f"both-{number}"), ("ended", 200), "the end")


async def session_of(fleet, centre, form, site):
    """The session of a site."""
    leases = centre.jetstream(timeout=PATIENCE)
    lease = await leases.get_last_msg("FLEET", f"rb.fleet.lease.{site}")
    return form.Lease.FromString(lease.data)


def foreign(s):
    """A centre by others, which sends a command twice, late, and only asks."""
    form = messages()
    body = json.dumps({}).encode()

    async def sends(*commands):
        centre = await s.fleet.connect(s.fleet.hub("hub.creds"), "_INBOX.hub")
        lease = await session_of(s.fleet, centre, form, SITE)
        heard = asyncio.get_running_loop().create_future()

        async def beat(message):
            if not heard.done():
                heard.set_result(form.Beat.FromString(message.data))

        await centre.subscribe(f"rb.up.{SITE}.beat", cb=beat)
        now = (await asyncio.wait_for(heard, PATIENCE)).time_ms
        answers = []
        for more in commands:
            until_ms = now + more.pop("within_ms", 5_000)
            command = form.CommandRequest(**{
                "method": "POST", "path": "/api/v1/points/oven/k3/toggle", "body": body,
                "user": "mallory", "boot": lease.boot, "valid_until_ms": max(0, until_ms), **more})
            answer = await asked(centre, f"rb.down.{SITE}.{lease.session}.cmd",
                                 command.SerializeToString())
            answers.append(form.CommandAnswer.FromString(answer.data))
        await centre.close()
        return answers

    def given(*commands):
        answers = asyncio.run(sends(*commands))
        return [each.WhichOneof("answer") for each in answers], answers

    entry, before = "what was sent twice: carried out once", relays(s)[2]
    how, (first, again) = given({"id": "twice"}, {"id": "twice"})
    s.check(entry, (how, first.ended.body), (["ended"] * 2, again.ended.body), str(first))
    s.check(entry, (first.ended.status, relays(s)[2]), (200, 1 - before), "the relay")
    entry, before = "what is only asked: not carried out", relays(s)[2]
    how, _ = given({"id": "twice", "tell": True}, {"id": "none", "tell": True},
                   {"id": "none", "tell": True, "within_ms": -1_000},
                   {"id": "none", "tell": True, "boot": bytes(16)})
    s.check(entry, how, ["ended", "later", "never", "lost"], "asked")
    s.check(entry, relays(s)[2], before, "the relay")
    entry = "a command that is late: not carried out"
    how, _ = given({"id": "late-1", "within_ms": -1_000}, {"id": "late-2", "boot": bytes(16)},
                   {"id": "late-3", "within_ms": -10_000_000})
    # Of another run it is not known whether it came before.
    s.check(entry, (how, relays(s)[2]), (["never", "later", "never"], before), "sent too late")
    how, answers = given({"id": "zh-1", "path": "/api/v1/points/oven/k9/toggle"},
                         {"id": "zh-2", "within_ms": -1_000, "language": "zh"},
                         {"id": "zh-3", "tell": True, "boot": bytes(16), "language": "zh"},
                         {"id": "zh-4", "path": "/api/v1/points/tank/k1/toggle", "tell": True,
                          "within_ms": -1_000, "language": "zh"})
    s.check(entry, how, ["ended", "never", "lost", "never"], "in words, and without rights")
    places = (("/api/v1/config", "PUT"), ("/api/v1/ops", "POST"), ("/metrics", "PUT"),
              ("/api/v1/points/oven/k3/lease", "PUT"), ("/api/v1/points/oven/k3", "DELETE"))
    how, answers = given(*({"id": f"x-{number}", "path": path, "method": method}
                           for number, (path, method) in enumerate(places)), {"id": ""})
    codes = [json.loads(answer.ended.body)["code"] for answer in answers]
    s.check("a command: refused", (how, codes), (
        ["ended"] * 6, ["E0905", "E0110", "E0110", "E0937", "E0937", "E0806"]), "by the site")
    s.check("a command: refused", relays(s)[2], before, "the relay")


def late(s, hub):
    """A command that waits on its way is not carried out after its time."""
    entry = "a command that is late: not carried out"
    before = relays(s)[0]
    s.daemon.process.send_signal(signal.SIGSTOP)
    told = []
    gives = lambda: told.append(put(hub, FAR + "/points/oven/k1", {"value": not before}, "late"))
    thread = threading.Thread(target=gives)
    thread.start()
    until(lambda: "late" in ledger(s.fleet, SITE))
    time.sleep(STILL)
    s.daemon.process.send_signal(signal.SIGCONT)
    thread.join()
    status, said = told[0]
    s.check(entry, (status, said["code"], said.get("may_have_acted", False)),
            (503, "E0106", False), str(said))
    s.check(entry, (end_of(s.fleet, "late"), relays(s)[0]), (("never", "E0106"), before), "the end")


def site_killed(s, hub):
    """The site's daemon is killed while it is at a command; what is said of it is held against what
    the relay did."""
    entry = "a site that is killed meanwhile: what is said of it is so"
    # What may be said where it acted, and where it did not.
    not_known = {("ended", "E0303"), ("unknown", "E0169"), ("unknown", "E0106")}
    if_on = {("ended", 200), *not_known}
    if_off = {("never", "E0168"), ("never", "E0106"), ("ended", "E0106"), *not_known}
    for number, wait in enumerate((0.0, 0.03, 0.1)):
        key = f"killed-{number}"
        s.ask("PUT", "/points/oven/k2", {"value": False})
        told = []

        def gives(key=key, told=told):
            told.append(put(hub, FAR + "/points/oven/k2", {"value": True}, key))

        thread = threading.Thread(target=gives)
        thread.start()
        until(lambda key=key: key in ledger(s.fleet, SITE))
        time.sleep(wait)
        s.daemon.end("KILL")
        # Whatever was on its way to the module has arrived.
        time.sleep(0.5)
        acted = relays(s)[1]
        s.daemon.start()
        thread.join()
        # The centre waits for an answer of the run before, and asks after that.
        until(lambda key=key: isinstance(end_of(s.fleet, key), tuple), 3 * PATIENCE)
        end = end_of(s.fleet, key)
        s.check(entry, end in (if_on if acted else if_off), True, f"{end}, relay {acted}")
        # Its caller was told the same, or that it is not known.
        status, said = told[0]
        is_true = acted if status == 200 else said.get("may_have_acted", False) or not acted
        s.check(entry, bool(is_true), True, f"{told[0]}, relay {acted}")
        settled(s, hub, entry)


def settled(s, hub, entry):
    """All is as usual."""
    is_so(s, entry, lambda: s.ask("GET", "/points/oven/k2")["quality"], "good", "alive")
    is_so(s, entry, lambda: hub.site(SITE)["presence"], "online", "there again")


def by_others(s, fleet, hub, other):
    """A site by others, which answers as no site should."""
    site = Site(fleet, "plant8")
    path = f"/s/{site.name}/api/v1/points/m/k1"
    try:
        status, said = put(hub, path, {"value": True}, "nobody")
        s.check("a command: nobody there",
                (status, said["code"], said.get("may_have_acted", False)), (404, "E0836", False),
                str(said))
        session = site.hello(1, 1)
        status, said = put(hub, path, {"value": True}, "nobody")
        s.check("a command: nobody there", (status, said["code"]), (503, "E0168"), "no heartbeat")
        s.check("a command: nobody there", ledger(fleet, site.name), {}, "nothing is sent")
        site.beat(session)
        is_so(s, "a command: nobody there", lambda: hub.site(site.name)["presence"], "online", "")
        # No answer, then "later", then what came of it.
        form = site.form
        done = form.CommandAnswer(ended={"status": 200, "content_type": "application/json",
                                         "body": b'{"value": true}'})
        site.commands = [None, form.CommandAnswer(later={"code": "E0105"}), done]
        status, said = put(hub, path, {"value": True, "within_ms": 200}, "open")
        # It may be that the second answer comes first on a busy machine.
        s.check("a command: no answer", (status, said.get("may_have_acted", False)) in (
            (504, True), (200, False)), True, str(said))
        is_so(s, "a command: no answer", lambda: end_of(fleet, "open"), ("ended", 200), "the end")
        first, *again = site.heard
        s.check("a command: no answer", (first.tell, all(each.tell for each in again), len(again)),
                (False, True, 2), "sent once, then asked")
        for answer, want, shown in (
                ({"never": {"code": "E0105", "reason": "\x1b[31m"}}, ("never", "E0105"),
                 (503, "E0168", False)),
                ({"ended": {"status": 422, "content_type": "application/problem+json",
                            "body": b'{"code": "E0821", "title": "x", "status": 422}'}},
                 ("ended", "E0821"), (422, "E0821", False))):
            site.commands = [form.CommandAnswer(**answer)]
            key = f"refused-{want[1]}"
            site.beat(session)
            status, said = put(hub, path, {"value": True}, key)
            got = (status, said["code"], said.get("may_have_acted", False))
            s.check("a command: refused", (got, "\x1b" in str(said)), (shown, False), str(said))
            s.check("a command: refused", end_of(fleet, key), want, "the end")
        site.commands = [None, form.CommandAnswer(lost={"code": "E0106"})]
        site.beat(session)
        put(hub, path, {"value": True, "within_ms": 200}, "lost")
        is_so(s, "a command: not known for ever", lambda: end_of(fleet, "lost"),
              ("unknown", "E0106"), "the end")
        status, said = put(hub, path, {"value": True, "within_ms": 200}, "lost")
        s.check("a command: not known for ever",
                (status, said["code"], said.get("may_have_acted", False)), (504, "E0169", True),
                str(said))
        # Given again while it is away: the first end, and not that nothing was sent.
        site.run(site.client.close())
        given_again(s, fleet, hub, site, path)
        site.run(site.connect())
        site.beat(session)
        is_so(s, "a key: once, whoever repeats it",
              lambda: hub.site(site.name)["presence"], "online", "there")
        killed(s, fleet, hub, other, site, session, done)
    finally:
        site.close()


def given_again(s, fleet, hub, site, path):
    """A command is given again when its site is away."""
    entry = "a key: once, whoever repeats it"
    is_so(s, entry, lambda: hub.site(site.name)["presence"], "offline", "away")
    status, said = put(hub, path, {"value": True, "within_ms": 200}, "open")
    s.check(entry, (status, said), (200, {"value": True}), "given again while it is away")
    status, said = put(hub, path, {"value": True}, "new-1")
    s.check(entry, (status, said["code"], said.get("may_have_acted", False)),
            (503, "E0168", False), "one that was never given")
    s.check(entry, ("new-1" in ledger(fleet, site.name)), False, "nothing is written down")


def killed(s, fleet, hub, other, site, session, done):
    """The centre is killed once it has sent a command: another process asks what came of it."""
    entry = "a centre that is killed meanwhile: another one ends it"
    site.commands, site.heard = [None], []
    site.beat(session)
    path = f"/s/{site.name}/api/v1/points/m/k1"

    def gives():
        try:
            put(hub, path, {"value": True}, "orphan")
        except (OSError, http.client.HTTPException):
            # It is killed.
            pass

    thread = threading.Thread(target=gives)
    thread.start()
    until(lambda: site.heard)
    hub.end(signal.SIGKILL)
    thread.join()
    site.commands = [done]
    deadline = time.monotonic() + 2 * TAKEN_OVER
    while end_of(fleet, "orphan") != ("ended", 200) and time.monotonic() < deadline:
        site.beat(session)
        time.sleep(1.0)
    s.check(entry, end_of(fleet, "orphan"), ("ended", 200), "the end")
    first, *again = site.heard
    s.check(entry, (first.tell, {each.tell for each in again}), (False, {True}), "it only asks")

    def shown():
        told = other.get("/fleet/v1/commands")[1]["commands"]
        return [each.get("how") for each in told if each["id"] == "orphan"]

    is_so(s, entry, shown, ["answered"], "it is shown")
    # Whoever gives it again is told that.
    status, said = put(other, path, {"value": True}, "orphan")
    s.check(entry, (status, said), (200, {"value": True}), "given again")
    # Also once the site is removed: it was carried out all the same.
    entry = "a key: once, whoever repeats it"
    site.run(site.client.close())
    is_so(s, entry, lambda: other.site(site.name)["presence"], "offline", "away for good")
    status, said = put(other, f"/fleet/v1/sites/{site.name}", {}, method="DELETE")
    s.check(entry, (status, said.get("removed")), (200, site.name), "the site is removed")
    status, said = put(other, path, {"value": True}, "orphan")
    s.check(entry, (status, said), (200, {"value": True}), "given again, of a site of before")
    status, said = put(other, path, {"value": True})
    s.check(entry, (status, said["code"]), (404, "E0836"), "a new one has nobody to go to")


def account(fleet, socket, *words, password=None):
    """`railbus token` or `railbus user` for the centre; exit code and what it says."""
    command = [PROGRAM, *words, "--fleet", str(fleet.folder)]
    if socket:
        command += ["--socket", socket]
    ran = subprocess.run(command, input=password, capture_output=True, text=True, check=False)
    return ran.returncode, ran.stdout.strip(), ran.stderr


def networked(s, hub):
    """Over TCP, by the accounts of the centre."""
    entry = lambda what: f"over the network: {what}"
    # It is no centre that listens yet: its accounts are a file.
    code, viewer, error = account(s.fleet, None, "token", "create", "look", "--role", "viewer")
    s.check(entry("each by its role"), code, 0, f"a token: {error}")
    held, port = free_port()
    hub.end(signal.SIGTERM)
    hub.start("--listen", f"{HOST}:{port}", "--tls", "auto")
    other = f"{hub.socket}.none"
    code, _, error = account(s.fleet, other, "token", "list")
    s.check(entry("each by its role"), (code != 0, "E0917" in error), (True, True), error)
    code, _, error = account(s.fleet, s.daemon.socket, "token", "list")
    s.check(entry("each by its role"), (code != 0, "E0917" in error), (True, True),
            f"a site is not asked instead: {error}")
    code, operator, error = account(s.fleet, hub.socket, "token", "create", "ops",
                                    "--role", "operator")
    s.check(entry("each by its role"), code, 0, f"through its socket: {error}")
    code, _, error = account(s.fleet, hub.socket, "user", "add", "li", "--role", "admin",
                             "--password-file", "-", password="correct horse battery\n")
    s.check(entry("a session"), code, 0, error)
    trusts = ssl.create_default_context(cafile=s.fleet.hub("tls.pem"))

    def ask(method, path, headers=(), body=None):
        connection = http.client.HTTPSConnection("localhost", port, timeout=PATIENCE,
                                                 context=trusts)
        try:
            text = None if body is None else json.dumps(body)
            connection.request(method, path, text, dict(headers))
            answer = connection.getresponse()
            return answer.status, answer.headers, json.loads(answer.read())
        finally:
            connection.close()

    bearer = lambda token: {"authorization": f"Bearer {token}"}
    point, on = f"{FAR}/points/oven/k6", {"value": True}
    # k6 is locked, so that the site's own answer tells it from the centre's.
    for who, headers, read, wrote in (
            ("nobody", {}, "E0902", "E0902"), ("a wrong token", bearer("rb_x"), "E0902", "E0902"),
            ("a viewer", bearer(viewer), None, "E0905")):
        what = entry("each by its role" if read is None else "nobody without an account")
        for path in ("/fleet/v1/sites", f"{FAR}/points/oven/k1"):
            s.check(what, ask("GET", path, headers)[2].get("code"), read, f"{who} reads {path}")
        s.check(what, ask("PUT", point, headers, on)[2].get("code"), wrote, f"{who} switches")
        s.check(what, ask("GET", "/api/v1/users", headers)[2].get("code"),
                "E0905" if read is None else "E0902", f"{who} asks for the users")
    is_so(s, entry("TLS"), lambda: hub.site(SITE).get("current"), True, "")
    before = relays(s)[2]
    body = {"value": not before}
    status, _, told = ask("PUT", f"{FAR}/points/oven/k3", bearer(operator), body)
    s.check(entry("each by its role"), (status, told.get("value"), relays(s)[2]),
            (200, not before, int(not before)), f"an operator: {told}")
    newest = hub.get("/fleet/v1/commands")[1]["commands"][-1]
    s.check(entry("the record says who"), newest["user"], "token:ops", f"{newest}")
    audit = s.ask("GET", "/audit?limit=1")["items"][0]
    s.check(entry("the record says who"), audit.get("who"), f"outlet:{s.name}:token:ops", "a site")
    login = {"name": "li", "password": "correct horse battery"}
    status, headers, told = ask("POST", "/api/v1/login", body=login)
    role = told.get("user", {}).get("role")
    s.check(entry("a session"), (status, role), (200, "admin"), f"{told}")
    cookie = {"cookie": headers["set-cookie"].split(";")[0]}
    s.check(entry("a session"), "Secure" in headers["set-cookie"], True, "its cookie")
    body, path = {"value": bool(before)}, f"{FAR}/points/oven/k3"
    s.check(entry("a session"), ask("PUT", path, cookie, body)[2].get("code"), "E0908",
            "from a page of others")
    own = {**cookie, "x-csrf-token": told["csrf"]}
    s.check(entry("a session"), (ask("PUT", path, own, body)[0], relays(s)[2]), (200, before),
            "from our own")
    code, _, error = account(s.fleet, hub.socket, "token", "revoke", "look")
    s.check(entry("each by its role"), code, 0, error)
    s.check(entry("each by its role"), ask("GET", "/fleet/v1/sites", bearer(viewer))[0], 401,
            "revoked")
    said = hub.said.read_text(encoding="utf-8")
    secrets = (viewer, operator, "correct horse battery", told["csrf"],
               cookie["cookie"].split("=", 1)[1])
    s.check(entry("the record says who"), [word in said for word in secrets], [False] * 5,
            "no secret is printed")
    s.check(entry("the record says who"), "accounts: token_created ops" in said, True, said)
    wide = subprocess.run([PROGRAM, "fleet", "serve", str(s.fleet.folder), "--socket",
                           f"{hub.socket}.2", "--listen", "0.0.0.0:0"],
                          capture_output=True, text=True, check=False)
    s.check(entry("TLS"), (wide.returncode != 0, "E0903" in wide.stderr), (True, True),
            wide.stderr)
    held.close()


@contextlib.contextmanager
def centres():
    """A fleet, and two processes of its centre."""
    with Fleet(1) as fleet:
        hub, other = Hub(fleet), Hub(fleet)
        try:
            hub.start()
            other.start()
            yield fleet, hub, other
        finally:
            hub.close()
            other.close()


def suite():
    """Commands to a site by railbus."""
    tally = Tally("fleet, commands")
    with centres() as (fleet, hub, other), Writable(fleet, None, tally) as s:
        for centre in (hub, other):
            current = lambda centre=centre: centre.site(SITE).get("current")
            is_so(s, "a far output: switched", current, True, centre.socket)
        switched(s, hub)
        refused(s, hub)
        once(s, hub, other)
        both(s, hub, other)
        foreign(s)
        late(s, hub)
        site_killed(s, hub)
        networked(s, hub)
    return tally


def suite_by_others():
    """Commands to a site by others."""
    tally = Tally("fleet, commands")
    with centres() as (fleet, hub, other):
        by_others(tally, fleet, hub, other)
    return tally


SUITES = [("fleet: commands", suite), ("fleet: commands, a site by others", suite_by_others)]
