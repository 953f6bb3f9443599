"""A site joins a fleet by an invitation, its key is renewed, and both end with a revocation: the
daemon and the centre by railbus in front of real servers, and others who have an invitation."""

import asyncio
import json
import os
import pathlib
import signal
import time

from fleet import (
    Fleet, claims_of, forbidden, inside, messages, railbus, signed, write_creds)
from fleet_centre import Hub
from fleet_suite import FOREIGN, PATTERNS
from modbus_tcp import PATIENCE, until
from outlet_plant import OutletPlant
from rig import Tally

SITE, OTHER = "plant7", "plant8"
DAY = 86_400
# How long a key is valid.
VALID = 90 * DAY


class Plant(OutletPlant):
    """Simulated modules, and a daemon that is in no fleet yet."""

    kind, name = "fleet", "fleet"

    def __init__(self, fleet, tally):
        super().__init__(tally, {})
        self.fleet, self.creds_path = fleet, None

    def text(self, **_):
        """Without an integration."""
        return self.site

    def log(self):
        """What the daemon said."""
        path = pathlib.Path(self.folder.name) / "log"
        return path.read_text(encoding="utf-8")

    def state(self):
        """How the outlet does, and the code of its last failure."""
        outlet = self.outlet()
        return outlet["state"], outlet.get("last_error", {}).get("problem", {}).get("code")

    def join(self, path, *words):
        """Takes up an invitation by the command line: exit code and what it says."""
        return railbus("fleet", "join", str(path), "--socket", self.daemon.socket, *words)

    def creds(self):
        """The file with its credentials."""
        return self.outlet()["settings"]["credentials"]

    def claims(self):
        """What they say."""
        return claims_of(inside(self.creds())[0])


def enrol(fleet, site, nth="", *words):
    """The path of an invitation of this site."""
    path = fleet.folder / f"{site}{nth}.invitation"
    code, said = railbus("fleet", "enrol", str(fleet.folder), site, str(path), *words)
    if code:
        raise RuntimeError(said)
    return path


def joins(s, hub):
    """An invitation lets a site in, once."""
    entry = "a site joins by an invitation"
    path = enrol(s.fleet, SITE)
    code, said = s.join(path)
    s.check(entry, (code, "E0163" in said), (1, True), f"no centre: {said}")
    hub.start()
    code, said = s.join(path, "-o", "json")
    s.check(entry, code, 0, f"railbus fleet join: {said}")
    told = json.loads(said.splitlines()[0])
    s.check(entry, (told["site"], told["outlet"]), (SITE, "fleet"), "what it says")
    s.check(entry, until(lambda: s.state() == ("running", None)), True, f"{s.outlet()}")
    online = lambda: hub.site(SITE).get("presence") == "online"
    s.check(entry, until(online), True, "the centre has it")
    claims = s.claims()
    s.check(entry, (claims["name"], claims["exp"] - claims["iat"]), (SITE, VALID), "its claims")
    s.check(entry, os.stat(s.creds()).st_mode & 0o777, 0o600, "nobody else reads its key")
    seed = inside(s.creds())[1]
    s.check(entry, seed in path.read_text(encoding="utf-8"), False, "no key was in the invitation")
    s.check(entry, inside(path)[1] in (s.log() + said), False, "nor is it told")
    folder = os.path.dirname(s.creds())
    left = [name for name in os.listdir(folder) if name.endswith((".key", ".new"))]
    s.check(entry, left, [], "nothing is left of it")
    s.check(entry, s.outlet()["settings"].get("write"), None, "the centre may switch nothing")
    first = s.creds()
    code, said = s.join(path, "--name", "second")
    s.check(entry, (code, "E0938" in said, "used before" in said), (9, True, True),
            f"the invitation once more: {said}")
    # The key is issued, and then the configuration is not changed: the invitation is not lost.
    other = enrol(s.fleet, SITE, "-other")
    body = {"invitation": other.read_text(encoding="utf-8")}
    status, _ = s.daemon.ask("POST", "/outlets/fleet/fleet/join", body, {"If-Match": '"older"'})
    s.check(entry, (status, s.creds()), (412, first), "with an older configuration")
    # Another one replaces the key, and that can be undone.
    code, said = s.join(other)
    s.check(entry, (code, s.creds() != first), (0, True), f"another one: {said}")
    s.check(entry, until(lambda: s.outlet()["state"] == "running"), True, f"{s.outlet()}")
    s.ask("POST", "/config/undo")
    s.check(entry, s.creds(), first, "undone")
    s.check(entry, until(lambda: s.outlet()["state"] == "running"), True, f"{s.outlet()}")
    s.check(entry, until(online), True, "the centre has it by the first key")
    code, said = s.join(path, "--name", "../x")
    s.check(entry, (code, "E0806" in said), (8, True), f"what can't be a name: {said}")
    s.check(entry, [o["outlet"] for o in s.ask("GET", "/outlets")["outlets"]], ["fleet"],
            "nothing was added")


def wrong(s):
    """What is no invitation, or none any more."""
    entry = "what is no invitation is refused"
    folder = s.fleet.folder
    whole = enrol(s.fleet, OTHER).read_text(encoding="utf-8")
    path = folder / "try.invitation"
    lines = whole.splitlines()

    def refused(text, name, *words):
        path.write_text(text, encoding="utf-8")
        code, said = s.join(path, "--name", "second")
        s.check(entry, (code, all(word in said for word in ("E0938", *words))), (9, True),
                f"{name}: {said}")

    refused("", "nothing")
    refused(whole[:len(whole) // 2], "half of it")
    refused(whole.replace(lines[1], "servers:"), "no server")
    token, seed = inside(folder / f"{OTHER}.invitation")
    claims = claims_of(token)
    signing = (folder / "hub/join-signing.nk").read_text(encoding="utf-8").strip()
    site_signing = (folder / "hub/site-signing.nk").read_text(encoding="utf-8").strip()
    expired = signed({**claims, "iat": 1, "exp": int(time.time()) - 60}, signing)
    refused(whole.replace(token, expired), "expired", "do not accept")
    code, said = s.join(folder / f"{OTHER}.invitation")
    s.check(entry, (code, "E0940" in said), (9, True), f"of another site: {said}")
    # Somebody who has the key of a site has no invitation by that.
    as_site = signed(claims, site_signing)
    path.write_text(whole.replace(token, as_site), encoding="utf-8")
    code, said = s.join(path, "--name", "second")
    s.check(entry, (code, "E0938" in said), (9, True), f"signed as a site: {said}")
    with Fleet(1) as stranger:
        before = s.outlet()["settings"]
        code, said = s.join(enrol(stranger, SITE))
        s.check(entry, (code, "E0940" in said), (9, True), f"its own name elsewhere: {said}")
        s.check(entry, s.outlet()["settings"], before, "the integration is as it was")
        foreign = enrol(stranger, OTHER).read_text(encoding="utf-8")
        own = next(line for line in lines if line.startswith("servers:"))
        its = next(line for line in foreign.splitlines() if line.startswith("servers:"))
        path.write_text(foreign.replace(its, own), encoding="utf-8")
        code, said = s.join(path, "--name", "second")
        s.check(entry, (code, "E0162" in said), (1, True), f"of another fleet: {said}")


def races(s, hubs):
    """Of two that take up one invitation at the same moment, one gets in, whatever centre they
    ask."""
    entry = "an invitation counts once"
    form = messages()
    invitation = enrol(s.fleet, OTHER, "-race")
    token, _ = inside(invitation)
    keys = [claims_of(inside(s.fleet.creds("nobody", f"-{nth}"))[0])["sub"] for nth in range(6)]

    async def tries():
        clients = [await s.fleet.connect(str(invitation), f"_JOIN.{OTHER}") for _ in keys]
        request = lambda key: form.KeyRequest(token=token, key=key).SerializeToString()
        asks = [client.request(f"rb.join.{OTHER}", request(key), timeout=PATIENCE)
                for client, key in zip(clients, keys)]
        ends = await asyncio.gather(*asks, return_exceptions=True)
        return [form.KeyAnswer.FromString(end.data) for end in ends
                if not isinstance(end, Exception)]

    answers = asyncio.run(tries())
    given = [answer for answer in answers if answer.token]
    s.check(entry, len(given), 1, f"{len(answers)} answers of {len(hubs)} centres")
    # The others were decided, too, by the document and not for asking too often.
    refused = {answer.refusal.reason for answer in answers if not answer.token}
    s.check(entry, refused, {"it was used before"}, "why not the others")

    async def floods():
        client = await s.fleet.connect(str(invitation), f"_JOIN.{OTHER}")
        ask = form.KeyRequest(token=token, key=keys[0]).SerializeToString()
        ends = [form.KeyAnswer.FromString(
            (await client.request(f"rb.join.{OTHER}", ask, timeout=PATIENCE)).data)
            for _ in range(40)]
        await client.close()
        return {end.refusal.code for end in ends}

    s.check(entry, "E0939" in asyncio.run(floods()), True, "who asks all the time is put off")
    fresh, won = enrol(s.fleet, OTHER, "-fresh"), claims_of(given[0].token)
    # Any of them may have been the first one, and no key is issued by two invitations.
    other = next(key for key in keys if key != won["sub"])

    async def one(key):
        client = await s.fleet.connect(str(fresh), f"_JOIN.{OTHER}")
        ask = form.KeyRequest(token=inside(fresh)[0], key=key).SerializeToString()
        end = await client.request(f"rb.join.{OTHER}", ask, timeout=PATIENCE)
        await client.close()
        answer = form.KeyAnswer.FromString(end.data)
        return bool(answer.token), answer.refusal.reason

    s.check(entry, asyncio.run(one(won["sub"])), (False, "the key is there already"), "its key")
    s.check(entry, asyncio.run(one(other)), (True, ""), "and who has another invitation is not")
    s.check(entry, won["name"], OTHER, "for its site")

    async def may_nothing():
        client = await s.fleet.connect(str(invitation), f"_JOIN.{OTHER}")
        subjects = {*FOREIGN, f"rb.up.{OTHER}.hello", f"rb.up.{OTHER}.renew", f"rb.join.{SITE}",
                    "rb.join", f"rb.join.{OTHER}.x", f"rb.fleet.key.{OTHER}", "_JOIN.x"}
        for subject in sorted(subjects):
            said = await forbidden(
                client, lambda subject=subject: client.publish(subject, b"x"), subject)
            s.check("an invited key may only ask", said, 1, f"publishes {subject}")
        patterns = {*PATTERNS, f"_JOIN.{SITE}.>", "_JOIN.>", f"rb.join.{OTHER}", "rb.join.*",
                    f"rb.down.{OTHER}.*.*", f"_INBOX.{OTHER}.>"}
        for subject in sorted(patterns):
            said = await forbidden(
                client, lambda subject=subject: client.subscribe(subject), subject)
            s.check("an invited key may only ask", said, 1, f"hears {subject}")

    asyncio.run(may_nothing())


def renews(s, hub):
    """A key is renewed before it expires, and the site goes on."""
    entry = "a key is renewed"
    token, seed = inside(s.creds())
    signing = (s.fleet.folder / "hub/site-signing.nk").read_text(encoding="utf-8").strip()
    now = int(time.time())
    old = {**claims_of(token), "iat": now - 61 * DAY, "exp": now + 29 * DAY}
    s.daemon.end("TERM")
    write_creds(s.creds_path, signed(old, signing), seed)
    s.daemon.start()
    fresh = lambda: s.claims()["exp"] > now + 89 * DAY
    s.check(entry, until(fresh), True, f"{s.claims()}")
    claims = s.claims()
    s.check(entry, (claims["name"], claims["sub"]), (SITE, old["sub"]), "for the same key")
    s.check(entry, os.stat(s.creds_path).st_mode & 0o777, 0o600, "nobody else reads it")
    known = lambda: (hub.site(SITE).get("key_until") or "") > time.strftime(
        "%Y-%m-%d", time.gmtime(now + 88 * DAY))
    s.check(entry, until(known), True, f"the centre knows: {hub.site(SITE)}")
    s.check(entry, until(lambda: s.state() == ("running", None)), True,
            f"it goes on, and no connection was lost: {s.outlet()}")
    form = messages()

    async def others():
        site = await s.fleet.connect(s.creds_path, f"_INBOX.{SITE}")
        ask = lambda token, subject=f"rb.up.{SITE}.renew": site.request(
            subject, form.KeyRequest(token=token).SerializeToString(), timeout=PATIENCE)
        foreign, _ = inside(s.fleet.creds(OTHER))
        for name, tried in (("of another site", foreign), ("of nobody", "ey.ey.ey"),
                            ("an invitation", inside(enrol(s.fleet, SITE, "-no"))[0])):
            answer = form.KeyAnswer.FromString((await ask(tried)).data)
            s.check(entry, (answer.token, answer.refusal.code), ("", "E0934"), name)
        await site.close()

    asyncio.run(others())


def revoked(s, hub):
    """A key that the centre issued is revoked like any other, and an invitation of before counts
    no more; another one lets the site in again."""
    entry = "what was issued can be revoked"
    folder = str(s.fleet.folder)
    before = enrol(s.fleet, SITE, "-before")
    # As if it had been made in another copy of the folder: nobody noted it.
    (s.fleet.folder / f"hub/sites/{SITE}.keys").unlink()
    key = s.claims()["sub"]
    code, said = railbus("fleet", "revoke", folder, SITE, "-o", "json")
    s.check(entry, (code, key in said), (0, True), f"railbus fleet revoke: {said}")
    # It tries again at a random moment of 20 s, then of a minute.
    out = lambda: s.state()[1] == "E0934"
    s.check(entry, until(out) or until(out) or until(out), True, f"it is out: {s.state()}")
    code, said = s.join(before)
    s.check(entry, (code, "E0938" in said), (9, True), f"an invitation of before: {said}")
    code, said = railbus("fleet", "revoke", folder, SITE)
    s.check(entry, (code, "E0836" in said), (8, True), f"once more: {said}")
    code, said = s.join(enrol(s.fleet, SITE, "-again"))
    s.check(entry, code, 0, f"another invitation: {said}")
    s.check(entry, until(lambda: s.outlet()["state"] == "running"), True, f"{s.outlet()}")
    s.check(entry, s.claims()["sub"] != key, True, "with another key")
    online = lambda: hub.site(SITE).get("presence") == "online"
    s.check(entry, until(online), True, "the centre has it again")
    s.check(entry, len(s.ask("GET", "/outlets")["outlets"]), 1, "as the same integration")


def suite():
    """Everything, with three servers and two centres."""
    tally = Tally("fleet, keys")
    with Fleet() as fleet, Plant(fleet, tally) as s:
        hubs = [Hub(fleet), Hub(fleet)]
        try:
            joins(s, hubs[0])
            s.creds_path = s.creds()
            wrong(s)
            hubs[1].start()
            races(s, hubs)
            renews(s, hubs[0])
            revoked(s, hubs[0])
        finally:
            for hub in hubs:
                hub.end(signal.SIGKILL)
    return tally


SUITES = [("fleet: sites join and renew their keys", suite)]
