"""The configuration of far sites through the centre of their fleet: tried, kept or taken back, and
nothing else than what the centre wants for this site is used."""

import asyncio
import base64
import json
import pathlib
import signal
import subprocess
import time

import nacl.signing
from fleet import Fleet, asked, messages, railbus
from fleet_centre import Hub, is_so
from fleet_uplink_suite import Plant
from modbus_tcp import HOST, PATIENCE, PROGRAM, until
from outlet_plant import OutletPlant
from rig import Tally

# How long a configuration is tried, in seconds.
TRIAL = 120.0
# So long something would have happened, in seconds.
LONG = 5.0


class ManagedSite(OutletPlant):
    """Simulated modules, and a daemon whose configuration the centre may say, if it has the key."""

    kind, name = "fleet", "hq"

    def __init__(self, fleet, tally, site, key):
        settings = {
            "servers": [f"{HOST}:{port}" for port in fleet.ports],
            "credentials": fleet.creds(site), "ca": fleet.hub("ca.pem"),
        }
        super().__init__(tally, {**settings, "config_key": key} if key else settings)
        self.called = site

    def problem_code(self):
        """The code of the last failure of its integration."""
        return self.problem().get("code")

    def file(self):
        """What its file says."""
        return pathlib.Path(self.daemon.config).read_text(encoding="utf-8")

    def poll(self):
        """How often the oven is polled, in the configuration in force."""
        return self.ask("GET", "/config/modules/oven")["keys"]["poll"]


class Desk:
    """An engineer at the centre."""

    def __init__(self, tally, fleet, hub):
        self.tally, self.fleet, self.hub = tally, fleet, hub

    def path(self, site):
        """Where he keeps the text for a site."""
        return self.fleet.folder / f"{site}.toml"

    def config(self, site, *words):
        """`railbus fleet config`: exit code and what it prints."""
        return self.hub.run("config", site, *words)

    def begin(self, site, *words):
        """The same for a text that is tried: the process, which waits for its end."""
        words = [PROGRAM, "fleet", "config", site, str(self.path(site)), *words,
                 "--socket", self.hub.socket]
        return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def state(self, site):
        """How far it is: the phase, and of which version."""
        status, told = self.hub.get(f"/fleet/v1/sites/{site}/config")
        state = told.get("state") or {}
        return (state.get("phase"), state.get("version")) if status == 200 else told

    def told(self, site):
        """All that is known of it."""
        return self.hub.get(f"/fleet/v1/sites/{site}/config")[1]

    def hash(self, site):
        """The beginning of the hash of what the site has."""
        return self.told(site)["state"]["hash"][:8]

    def edit(self, site, *changes):
        """Takes the text of the site, and changes it."""
        code, text, error = self.config(site, "--text")
        if code:
            raise RuntimeError(error)
        for old, new in changes:
            if old not in text:
                raise RuntimeError(f"{old!r} is not in {text}")
            text = text.replace(old, new, 1)
        self.path(site).write_text(text, encoding="utf-8")
        return text


def seen(desk, site):
    """What the site has is seen, and replaced only by somebody who says so."""
    entry = "a site's configuration: what it has is not replaced unseen"
    s = desk.tally
    is_so(s, entry, lambda: desk.state(site.called), ("unmanaged", None), "none was wanted so far")
    code, text, error = desk.config(site.called, "--text")
    shown = ["[module.oven]" in text, "[outlet" in text, "credentials" in text]
    s.check(entry, (code, shown), (0, [True, False, False]), text + error)
    desk.edit(site.called)
    before = site.file()
    for words in ((), ("--replace", "00000000")):
        code, said, error = desk.config(site.called, str(desk.path(site.called)), *words)
        s.check(entry, (code != 0, "E0943" in error, said), (True, True, ""), error)
    found = (site.file(), desk.state(site.called))
    s.check(entry, found, (before, ("unmanaged", None)), "as it was")


def wrong(desk, site):
    """What can't be a configuration is refused at the centre, with its place."""
    entry = lambda what: f"a site's configuration: {what}"
    s = desk.tally
    text = desk.edit(site.called)
    misspelt = "a wrong one is refused with its line"
    line = text.split("\n").index("[module.oven]") + 1
    for change, what, codes, shown in (
            ((('model = "erc8"', 'model = "erc88"'),), misspelt, ("E0815",), f"{line + 2}"),
            ((("[module.oven]", "[module.oven"),), misspelt, ("E0811",), f"{line}"),
            ((("[module.oven]", "[outlet.other]\ntype = \"mqtt\"\n[module.oven]"),),
             "the site's own tables are refused", ("E0947",), "outlet")):
        desk.edit(site.called, *change)
        code, said, error = desk.config(site.called, str(desk.path(site.called)), "--replace",
                                        desk.hash(site.called))
        found = (code != 0, said, any(each in error for each in codes), shown in error)
        s.check(entry(what), found, (True, "", True, True), error)
    s.check(entry(misspelt), "wanted" in desk.told(site.called), False, "nothing is wanted")


def refused(desk, site):
    """What the site does not let an engineer say is refused there."""
    entry = "a site's configuration: refused at the site"
    s = desk.tally
    before = site.file()
    text = desk.edit(site.called)
    old = text.split('port = "')[1].split('"')[0]
    desk.edit(site.called, (f'port = "{old}"', 'port = "/srv/modem"'))
    waits = desk.begin(site.called, "--replace", desk.hash(site.called))
    said, error = waits.communicate(timeout=2 * PATIENCE)
    s.check(entry, (waits.returncode != 0, "E0924" in error), (True, True), said + error)
    s.check(entry, (desk.state(site.called), site.file()), (("refused", 1), before), "as it was")
    attention = desk.hub.site(site.called).get("attention")
    s.check(entry, attention, ["config"], "it needs attention")
    s.check(entry, site.problem_code(), "E0924", "the site says it, too")


def foreign(desk, site, key):
    """Documents of others, by somebody who has the servers' trust but not the key."""
    entry = lambda what: f"a site's configuration: {what}"
    s, form = desk.tally, messages()
    own = signer(desk.fleet.hub("config-signing.nk"))
    other = nacl.signing.SigningKey.generate()
    before = site.file()
    was = desk.state(site.called)

    def document(by, named, version):
        document = form.ConfigDocument(site=named, version=version, text="# Empty.\n", user="eve",
                                       at_ms=1, replaces=bytes.fromhex(hash_of(desk, site)))
        body = document.SerializeToString()
        sign = by.sign(b"railbus configuration 1\0" + body).signature
        return form.SignedConfig(document=body, signature=sign).SerializeToString()

    async def say(payload):
        centre = await desk.fleet.connect(desk.fleet.hub("hub.creds"), "_INBOX.hub")
        # Published, and not stored: what is wanted is as it was.
        await centre.publish(f"rb.desired.{site.called}.config", payload)
        await centre.flush()
        await centre.close()

    for by, named, version, what in (
            (other, site.called, 90, "signed by another key"),
            (own, "plant99", 91, "of another site")):
        asyncio.run(say(document(by, named, version)))
        why = {"signed by another key": "signature", "of another site": "another site"}[what]
        is_so(s, entry(what), lambda why=why: why in site.problem().get("reason", ""), True,
              "said at the site")
        s.check(entry(what), site.problem_code(), "E0945", "said at the site")
        s.check(entry(what), (site.file(), desk.state(site.called)), (before, was), "not used")
    asyncio.run(say(document(own, site.called, 1)))
    time.sleep(LONG)
    s.check(entry("an old version"), (site.file(), desk.state(site.called)), (before, was),
            "not used again")


def signer(path):
    """The key in a file."""
    seed = pathlib.Path(path).read_text(encoding="utf-8").strip()
    raw = base64.b32decode(seed + "=" * (-len(seed) % 8))
    return nacl.signing.SigningKey(raw[2:34])


def hash_of(desk, site):
    """The hash of what the site says."""
    return desk.told(site.called)["state"]["hash"]


def killed(desk, site):
    """A site that is killed during a trial has the text before when it starts."""
    entry = "a site's configuration: kill -9 during the trial"
    s = desk.tally
    before = site.file()
    desk.edit(site.called, ('poll = "300ms"', 'poll = "350ms"'))
    code, said, error = desk.config(site.called, str(desk.path(site.called)), "--replace",
                                    desk.hash(site.called), "--no-wait")
    s.check(entry, code, 0, said + error)
    is_so(s, entry, lambda: desk.state(site.called)[0], "trying", "it is tried")
    s.check(entry, (site.poll(), site.file() != before), ("350ms", True), "it is in force")
    site.daemon.end("KILL")
    site.daemon.start()
    s.check(entry, (site.file(), site.poll()), (before, "300ms"), "the text before")
    is_so(s, entry, lambda: desk.state(site.called)[0], "rolled_back", "and says so")
    problem = desk.told(site.called)["state"].get("problem", {"code": "none", "reason": ""})
    s.check(entry, (problem["code"], "restarted" in problem["reason"]), ("E0944", True),
            str(problem))


def away(desk, site):
    """One that is away takes part when it comes. Its next trial is ended by a stop."""
    entry = "a site's configuration: one that is away takes part when it comes"
    s = desk.tally
    site.daemon.end("TERM")
    is_so(s, entry, lambda: desk.hub.site(site.called)["presence"], "offline", "away")
    desk.path(site.called).write_text(
        desk.path(site.called).read_text(encoding="utf-8").replace("350ms", "400ms"),
        encoding="utf-8")
    code, said, error = desk.config(site.called, str(desk.path(site.called)), "--replace",
                                    desk.hash(site.called))
    s.check(entry, (code, "offline" in said + error or "away" in said + error), (0, True),
            said + error)
    site.daemon.start()
    is_so(s, entry, lambda: desk.state(site.called)[0], "trying", "it is tried")
    s.check(entry, site.poll(), "400ms", "it is in force")


def at_the_site(desk, site):
    """A change at the site is told, and not overwritten unseen."""
    entry = "a site's configuration: a change at the site"
    s = desk.tally
    kept = desk.state(site.called)[1]
    site.ask("PATCH", "/config/modules/oven", {"poll": "450ms"})
    is_so(s, entry, lambda: desk.state(site.called), ("local_change", kept), "told")
    attention = desk.hub.site(site.called).get("attention")
    s.check(entry, attention, ["config"], "it needs attention")
    code, said, error = desk.config(site.called, str(desk.path(site.called)))
    s.check(entry, (code != 0, "E0943" in error, said), (True, True, ""), error)
    s.check(entry, site.poll(), "450ms", "as it was")
    # Back to what was kept: what was wanted is the same.
    site.ask("PATCH", "/config/modules/oven", {"poll": "350ms"})
    is_so(s, entry, lambda: desk.state(site.called), ("current", kept), "back")
    # An integration is the site's own.
    text = site.file() + '\n[outlet.other]\ntype = "mqtt"\nbroker = "127.0.0.1"\nenabled = false\n'
    pathlib.Path(site.daemon.config).write_text(text, encoding="utf-8")
    site.daemon.process.send_signal(signal.SIGHUP)
    until(lambda: len(site.ask("GET", "/outlets")["outlets"]) == 2)
    time.sleep(LONG)
    s.check(entry, desk.state(site.called), ("current", kept), "an integration is no change of it")


def unmanaged(desk, site):
    """A site without the key takes none."""
    entry = "a site's configuration: one without the key takes none"
    s = desk.tally
    is_so(s, entry, lambda: desk.hub.site(site.called).get("presence"), "online", "there")
    desk.path(site.called).write_text("# Nothing.\n", encoding="utf-8")
    before = site.file()
    for words in ((str(desk.path(site.called)),), ("--text",)):
        code, said, error = desk.config(site.called, *words)
        s.check(entry, (code != 0, "E0942" in error, said), (True, True, ""), error)
    s.check(entry, site.file(), before, "as it was")


def tried(desk, keeps, loses):
    """One is kept, and one that loses a module is taken back; both while everything goes on."""
    s = desk.tally
    kept, lost = (f"a site's configuration: {what}" for what in
                  ("kept where the site works with it", "taken back where a module is lost"))
    before = loses.file()
    desk.edit(keeps.called, ('poll = "300ms"', 'poll = "350ms"'))
    desk.edit(loses.called, ("address = 3", "address = 9"))
    began = time.monotonic()
    waits = [desk.begin(site.called, "--replace", desk.hash(site.called))
             for site in (keeps, loses)]
    for entry, site in ((kept, keeps), (lost, loses)):
        is_so(s, entry, lambda site=site: desk.state(site.called)[0], "trying", "it is tried")
    s.check(kept, keeps.poll(), "350ms", "it is in force")
    is_so(s, lost, lambda: loses.ask("GET", "/points/oven/k1")["quality"] != "good", True,
          "the module is lost")
    yield
    (said, error), (lost_said, lost_error) = (
        wait.communicate(timeout=TRIAL + 3 * PATIENCE) for wait in waits)
    took = time.monotonic() - began
    s.check(kept, (waits[0].returncode, took >= TRIAL), (0, True), f"{took} s: {said}{error}")
    s.check(kept, (desk.state(keeps.called)[0], keeps.poll()), ("current", "350ms"), "kept")
    s.check(kept, ("[outlet.hq]" in keeps.file(), keeps.problem_code()), (True, None),
            "what is the site's own stays")
    s.check(lost, (waits[1].returncode != 0, "E0944" in lost_error, "oven" in lost_error),
            (True, True, True), lost_said + lost_error)
    s.check(lost, (desk.state(loses.called)[0], loses.file()), ("rolled_back", before), "back")
    is_so(s, lost, lambda: loses.ask("GET", "/points/oven/k1")["quality"], "good",
          "the module is there again")
    s.check(lost, loses.problem_code(), "E0944", "the site says it, too")
    who = [each["who"] for each in keeps.ask("GET", "/config/generations")["generations"]]
    s.check(kept, "outlet:hq:owner" in who, True, f"who did it: {who}")


def suite():
    """Runs all of it."""
    tally = Tally("fleet, configuration")
    with Fleet() as fleet:
        hub = Hub(fleet)
        try:
            code, key = railbus("fleet", "config-key", str(fleet.folder))
            key = key.strip()
            tally.check("a site's configuration: the key of the centre",
                        (code, key[:1], len(key)), (0, "V", 56), key)
            hub.start()
            desk = Desk(tally, fleet, hub)
            names = [("keeps", key), ("loses", key), ("killed", key), ("plain", None)]
            sites = [ManagedSite(fleet, tally, f"plant-{name}", its) for name, its in names]
            keeps, loses, killed_one, plain = sites
            with keeps, loses, killed_one, plain:
                for site in sites:
                    until(lambda site=site: hub.site(site.called).get("presence") == "online")
                seen(desk, keeps)
                wrong(desk, keeps)
                refused(desk, loses)
                trial = tried(desk, keeps, loses)
                next(trial)
                unmanaged(desk, plain)
                killed(desk, killed_one)
                foreign(desk, killed_one, key)
                away(desk, killed_one)
                next(trial, None)
                at_the_site(desk, keeps)
        finally:
            hub.close()
    return tally


SUITES = [("fleet: the configuration of sites", suite)]
