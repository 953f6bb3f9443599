"""What suites of the centre need: processes of it, and sites by others."""

import asyncio
import http.client
import json
import os
import pathlib
import signal
import socket
import subprocess
import tempfile
import threading
import time

from fleet import PROGRAM, asked, flushed, messages
from modbus_tcp import PATIENCE, until

# The keys of sites by others are valid for so long, in seconds.
KEY_ENDS = 5 * 86_400


class SocketConnection(http.client.HTTPConnection):
    """HTTP over a Unix socket."""

    def __init__(self, path):
        super().__init__("localhost", timeout=PATIENCE)
        self.path = path

    def connect(self):
        """Connects."""
        self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.sock.settimeout(PATIENCE)
        self.sock.connect(self.path)


class Hub:
    """A process of the centre."""

    def __init__(self, fleet):
        self.fleet = fleet
        self.place = tempfile.TemporaryDirectory(prefix="railbus-hub-")
        self.socket = os.path.join(self.place.name, "hub.sock")
        self.said = pathlib.Path(self.place.name) / "log"
        self.process = None

    def start(self, *more):
        """Starts it; returns once it tells."""
        words = [PROGRAM, "fleet", "serve", str(self.fleet.folder), "--socket", self.socket, *more]
        with open(self.said, "a", encoding="utf-8") as log:
            self.process = subprocess.Popen(words, stdout=log, stderr=log)
        until(self.is_connected)

    def is_connected(self):
        """Whether it hears what sites say."""
        try:
            return self.sites()["connection"]["connected"]
        except OSError:
            # One that was killed leaves its socket.
            return False

    def end(self, how):
        """Ends it by a signal; its exit code."""
        if not self.process:
            return None
        self.process.send_signal(how)
        code = self.process.wait(PATIENCE)
        self.process = None
        return code

    def ask(self, path, method="GET", **headers):
        """What it says there: status, headers and text."""
        body = None if method == "GET" else '{"value": true}'
        return self.order(path, method, body, headers)

    def order(self, path, method, body, headers):
        """The same for a request with this body."""
        connection = SocketConnection(self.socket)
        try:
            connection.request(method, path, body, headers)
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read().decode()
        finally:
            connection.close()

    def get(self, path):
        """What it says there: status and content."""
        status, _, text = self.ask(path)
        return status, json.loads(text)

    def code(self, path, method="GET"):
        """Status and code of the problem that it says there."""
        status, _, text = self.ask(path, method)
        return status, json.loads(text)["code"]

    def sites(self):
        """All sites, and the connection."""
        return self.get("/fleet/v1/sites")[1]

    def site(self, name):
        """What is said of a site; nothing, where there is none."""
        status, said = self.get(f"/fleet/v1/sites/{name}")
        return said["site"] if status == 200 else {}

    def point(self, name, path):
        """Value, quality and reason of a point, and whether it is current."""
        status, said = self.get(f"/fleet/v1/sites/{name}")
        if status != 200:
            return None
        found = [each for each in said["points"] if each["path"] == path]
        return found and (found[0].get("value"), found[0]["quality"], found[0].get("reason"),
                          said["site"]["current"])

    def run(self, *words):
        """A command of `railbus fleet` that asks it: exit code and what it prints."""
        return self.run_any("fleet", *words)

    def run_any(self, *words):
        """Any command that asks it."""
        ran = subprocess.run([PROGRAM, *words, "--socket", self.socket],
                             capture_output=True, text=True, check=False)
        return ran.returncode, ran.stdout, ran.stderr

    def close(self):
        """Ends it, and leaves nothing."""
        self.end(signal.SIGKILL)
        self.place.cleanup()


class Site:
    """A site by others."""

    def __init__(self, fleet, name):
        self.fleet, self.name, self.form = fleet, name, messages()
        self.loop = asyncio.new_event_loop()
        threading.Thread(target=self.loop.run_forever, daemon=True).start()
        self.client = None
        # What it is asked: the last two words of the subjects.
        self.asked = []
        # What its API answers, and after how many seconds.
        self.api, self.late = None, 0.0
        # The commands that it was sent, and its answers to the next ones; none is no answer.
        self.heard, self.commands = [], []
        self.began = time.monotonic()
        self.key_ends = int(time.time()) + KEY_ENDS
        self.run(self.connect())

    def run(self, what):
        """Does this on its thread."""
        return asyncio.run_coroutine_threadsafe(what, self.loop).result(2 * PATIENCE)

    async def connect(self):
        """Connects."""
        self.client = await self.fleet.site(self.name)

        async def note(message):
            self.asked.append(tuple(message.subject.split(".")[3:]))
            if message.subject.endswith(".cmd"):
                self.heard.append(self.form.CommandRequest.FromString(message.data))
                answer = self.commands.pop(0) if self.commands else None
                if answer:
                    await message.respond(answer.SerializeToString())
            elif message.subject.endswith(".api") and self.api:
                await asyncio.sleep(self.late)
                await message.respond(self.api.SerializeToString())
            elif message.reply:
                await message.respond(b"")

        await self.client.subscribe(f"rb.down.{self.name}.*.*", cb=note)
        await flushed(self.client)

    def hello(self, installation, boot):
        """Asks for a session: its name, or the code and reason of the refusal."""
        hello = self.form.Hello(installation=bytes([installation] * 16), boot=bytes([boot] * 16),
                                epoch="e", newest=0, version="9.9", clock_ms=self.clock(),
                                key_expires_s=self.key_ends)

        async def asks():
            return await asked(self.client, f"rb.up.{self.name}.hello", hello.SerializeToString())

        answer = self.form.Welcome.FromString(self.run(asks()).data)
        if answer.WhichOneof("answer") == "session":
            return answer.session
        return answer.refusal.code, answer.refusal.reason

    def clock(self):
        """Milliseconds since 1970."""
        return int(time.time() * 1000)

    def says(self, what, payload):
        """Publishes something."""
        async def say():
            await self.client.publish(f"rb.up.{self.name}.{what}", payload)
            await flushed(self.client)

        self.run(say())

    def beat(self, session, newest=0, boot=1, **more):
        """A heartbeat."""
        beat = {"boot": bytes([boot] * 16), "session": session, "epoch": "e", "newest": newest,
                "delivered": newest, "clock_ms": self.clock(),
                "time_ms": int((time.monotonic() - self.began) * 1000)}
        self.says("beat", self.form.Beat(**{**beat, **more}).SerializeToString())

    def entry(self, path, value):
        """A point that is on or off, and good."""
        reading = self.form.Reading(path=path, on=value, quality=self.form.Quality.GOOD)
        return self.form.Entry(at_ms=self.clock(), reading=reading)

    def state(self, session, seq, **points):
        """How all points are."""
        entries = [self.entry(f"m.{name}", value) for name, value in points.items()]
        state = self.form.State(session=session, epoch="e", seq=seq, points=entries)
        self.says("state", state.SerializeToString())

    def batch(self, session, seq, *values):
        """Entries of the point m.k1."""
        entries = [self.entry("m.k1", value) for value in values]
        batch = self.form.Batch(session=session, epoch="e", seq=seq, entries=entries)
        self.says("data", batch.SerializeToString())

    def close(self):
        """Ends it."""
        self.run(self.client.close())
        self.loop.call_soon_threadsafe(self.loop.stop)


def is_so(s, entry, got, want, what):
    """Whether this becomes so."""
    until(lambda: got() == want)
    s.check(entry, got(), want, what)
