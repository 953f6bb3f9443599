"""A command to more sites than are commanded at a time: some are left over when it is stopped, and
are never sent it. And how many they are is said at the command line."""

import asyncio
import os
import pty
import signal
import subprocess
import threading
import time

from fleet import PROGRAM, asked, messages
from fleet_bulk_suite import give, told
from fleet_centre import is_so
from fleet_command_suite import centres
from modbus_tcp import PATIENCE, until
from rig import Tally

# So many are commanded at a time.
AT_ONCE = 256
NAMES = [f"site{number:03}" for number in range(AT_ONCE + 14)]


class Crowd:
    """Sites that are there and say nothing about a command until they are to."""

    def __init__(self, fleet):
        self.fleet, self.form = fleet, messages()
        self.clients, self.sessions = {}, {}
        # The sites that were sent a command, by its id.
        self.heard, self.speaks = {}, False
        self.began = time.monotonic()
        self.loop = asyncio.new_event_loop()
        threading.Thread(target=self.loop.run_forever, daemon=True).start()
        self.run(self.connect())
        self.beating = asyncio.run_coroutine_threadsafe(self.beats(), self.loop)

    def run(self, what):
        """Does this on its thread."""
        return asyncio.run_coroutine_threadsafe(what, self.loop).result(4 * PATIENCE)

    async def connect(self):
        """Connects all of them."""
        for name in NAMES:
            await asyncio.to_thread(self.fleet.creds, name)
            client = self.clients[name] = await self.fleet.site(name)
            await client.subscribe(f"rb.down.{name}.*.*", cb=self.note(name))
            hello = self.form.Hello(installation=bytes([1] * 16), boot=bytes([1] * 16), epoch="e",
                                    version="9.9", clock_ms=int(time.time() * 1000))
            answer = await asked(client, f"rb.up.{name}.hello", hello.SerializeToString())
            self.sessions[name] = self.form.Welcome.FromString(answer.data).session

    def note(self, name):
        """What this site does with what it is asked."""
        done = self.form.CommandAnswer(ended={
            "status": 200, "content_type": "application/json",
            "body": b'{"value": true, "confirmed": "reply"}'}).SerializeToString()

        async def hears(message):
            if not message.subject.endswith(".cmd"):
                await message.respond(b"")
                return
            request = self.form.CommandRequest.FromString(message.data)
            if not request.tell:
                self.heard.setdefault(request.id, []).append(name)
            if self.speaks:
                await message.respond(done)

        return hears

    async def beats(self):
        """Says that they are there."""
        while True:
            for name, client in self.clients.items():
                beat = self.form.Beat(
                    boot=bytes([1] * 16), session=self.sessions[name], epoch="e",
                    clock_ms=int(time.time() * 1000),
                    time_ms=int((time.monotonic() - self.began) * 1000))
                await client.publish(f"rb.up.{name}.beat", beat.SerializeToString())
            await asyncio.sleep(5)

    def close(self):
        """Ends them."""
        self.beating.cancel()

        async def leave():
            for client in self.clients.values():
                await client.close()

        self.run(leave())
        self.loop.call_soon_threadsafe(self.loop.stop)


def stopped(s, hub, other, crowd, entry, by):
    """What had not begun when it was stopped is never sent, and both processes say so."""
    crowd.speaks = False
    key = by(s, hub, other, crowd)
    left = set(NAMES) - set(crowd.heard[key])
    for centre in (hub, other):
        got = lambda centre=centre: told(centre, key)
        until(lambda: got()[1] is True)
        states, is_over = got()
        never = {name for name, state in states.items() if state == "never"}
        s.check(entry, (is_over, never == left, len(left)), (True, True, len(NAMES) - AT_ONCE),
                centre.socket)
        s.check(entry, set(states[name] for name in crowd.heard[key]) <= {"sent", "done"}, True,
                "of the others it is not said")
    crowd.speaks = True
    for centre in (hub, other):
        done = lambda centre=centre: list(told(centre, key)[0].values()).count("done")
        until(lambda: done() == AT_ONCE, 3 * PATIENCE)
        s.check(entry, done(), AT_ONCE, "what was sent has its result")
    s.check(entry, len(crowd.heard[key]), AT_ONCE, "nothing was sent since, and nothing twice")


def at_another(s, hub, other, crowd):
    """Given at one process, and stopped at another one; its id."""
    key = "crowd"
    status, said = give(hub, NAMES, key, within_ms=20_000)
    s.check("many sites: so many at a time", status, 200, str(said)[:200])
    is_so(s, "many sites: so many at a time", lambda: len(crowd.heard.get(key, [])), AT_ONCE,
          "the others wait")
    waiting = hub.get(f"/fleet/v1/commands/{key}?limit=0")[1]["counts"]["waiting"]
    s.check("many sites: so many at a time", waiting, len(NAMES) - AT_ONCE, "they are shown to")
    status, _, text = other.order(f"/fleet/v1/commands/{key}/stop", "POST", "", {})
    s.check("many sites: stopped at another process", status, 200, text[:200])
    return key


def by_ctrl_c(s, hub, _, crowd):
    """Given at the command line, and stopped by Ctrl-C; its id."""
    entry = "many sites: stopped by Ctrl-C"
    words = [PROGRAM, "fleet", "set", "m.k1", "on", "--all", "--count", str(len(NAMES)),
             "--socket", hub.socket, "-o", "json"]
    before = set(crowd.heard)
    ran = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    new = lambda: [key for key in crowd.heard if key not in before]
    until(lambda: new() and len(crowd.heard[new()[0]]) == AT_ONCE)
    ran.send_signal(signal.SIGINT)
    out, error = ran.communicate(timeout=4 * PATIENCE)
    s.check(entry, (ran.returncode, out.count('"never"') >= len(NAMES) - AT_ONCE), (130, True),
            error)
    [key] = new()
    s.check(entry, key in error, True, "how it is found again")
    return key


def number_said(s, hub, crowd):
    """From ten sites on, their number is to be said."""
    entry = "many sites: their number is said"
    before = dict(crowd.heard)
    for more in ((), ("--count", "12")):
        code, out, error = hub.run("set", "m.k1", "on", "--all", *more)
        s.check(entry, (code, out, str(len(NAMES)) in error), (2, "", True), error)
    ten = NAMES[:10]
    code, out, error = hub.run("set", "m.k1", "on", *ten)
    s.check(entry, (code, out), (2, ""), error)
    for number, want in (("11", 2), ("", 2), ("10", 0)):
        crowd.speaks = True
        child, terminal = pty.openpty()
        ran = subprocess.Popen(
            [PROGRAM, "fleet", "set", "m.k1", "on", *ten, "--socket", hub.socket, "-o", "csv"],
            stdin=terminal, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        os.write(child, f"{number}\n".encode())
        out, error = ran.communicate(timeout=PATIENCE)
        os.close(child)
        os.close(terminal)
        s.check(entry, (ran.returncode, out.count(",done,")), (want, 10 if want == 0 else 0), error)
    new = [sites for key, sites in crowd.heard.items() if key not in before]
    s.check(entry, [sorted(sites) for sites in new], [ten], "sent once, to these")


def suite():
    """More sites than are commanded at a time."""
    tally = Tally("fleet, commands to many sites")
    with centres() as (fleet, hub, other):
        crowd = Crowd(fleet)
        try:
            for centre in (hub, other):
                online = lambda centre=centre: centre.sites()["counts"]["online"]
                is_so(tally, "many sites: so many at a time", online, len(NAMES), centre.socket)
            number_said(tally, hub, crowd)
            stopped(tally, hub, other, crowd, "many sites: stopped at another process", at_another)
            stopped(tally, hub, other, crowd, "many sites: stopped by Ctrl-C", by_ctrl_c)
        finally:
            crowd.close()
    return tally


SUITES = [("fleet: commands to many sites, a crowd", suite)]
