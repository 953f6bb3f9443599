"""Eight clients that use every command there is, a reader and a WebSocket follower."""

import random
import threading
import time

from claims import Claim, Part, Reading, take_answer
from daemon import Follower

CLIENTS = 8
# How often each kind of command is given.
WEIGHTS = {"set": 30, "unverified": 6, "if": 6, "toggle": 8, "raw": 8, "pulse": 10, "jog": 6,
           "lease": 8, "unlease": 4, "batch": 8, "all_or_nothing": 6, "outputs": 4, "group": 3,
           "scene": 3, "silent": 2, "keyed": 4}
# A read that began this long before it was reported may have been in flight.
AGE_TOLERANCE = 0.015


class Client(threading.Thread):
    """One client. `outputs` are those that it switches, alone or together with other clients."""

    def __init__(self, plant, name, seed, outputs, pause=0.01):
        super().__init__(daemon=True)
        self.plant, self.who, self.outputs, self.pause = plant, name, outputs, pause
        self.random = random.Random(seed)
        self.go = threading.Event()
        self.idle = threading.Event()
        self.idle.set()
        self.over = False
        self.leases = {}

    def run(self):
        while not self.over:
            if not self.go.wait(0.1):
                continue
            self.idle.clear()
            if self.go.is_set():
                self.step()
            self.idle.set()
            time.sleep(self.random.uniform(0, 2 * self.pause))

    def step(self):
        """One command."""
        if self.leases and self.random.random() < 0.15:
            relay = self.random.choice(sorted(self.leases))
            value, seconds = self.leases[relay]
            if self.random.random() < 0.3:
                self.leases.pop(relay)
            self.lease(relay, value, self.random.choice((seconds, self.random.uniform(0.2, 2.0))))
            return
        kind = self.random.choices(list(WEIGHTS), WEIGHTS.values())[0]
        getattr(self, "do_" + kind)(self.random.choice(self.outputs))

    def send(self, claim, method, path, body, key=None):
        """Sends a command and records the answer."""
        claim.who = self.who
        self.plant.book.begin(claim)
        headers = {"Idempotency-Key": key} if key else {}
        claim.key = key or ""
        try:
            status, answer = self.plant.daemon.ask(method, path, body, headers)
        except OSError:
            claim.until = time.monotonic()
            time.sleep(0.05)
            return claim
        claim.until = time.monotonic()
        take_answer(claim, status, answer or {})
        return claim

    def one(self, kind, relay, want, method, tail, body, **more):
        """A command for one output."""
        claim = Claim(kind, [Part(relay, want)], time.monotonic(), **more)
        module, label = relay.split(".")
        return self.send(claim, method, f"/points/{module}/{label}{tail}", body, more.get("key"))

    def set(self, relay, want, **body):
        """Switches an output."""
        verify = body.get("verify", True)
        return self.one("set", relay, want, "PUT", "", {"value": want, **body}, verify=verify)

    def pulse(self, relay, want, seconds, by="host", kind="pulse"):
        """Switches an output for a time."""
        body = {"ms": round(seconds * 1000), "by": by, **({} if want else {"off": True})}
        more = {"seconds": round(seconds * 1000) / 1000, "by": by}
        return self.one(kind, relay, want, "POST", "/pulse", body, **more)

    def lease(self, relay, want, seconds):
        """Leases an output."""
        body = {"value": want, "ttl_ms": round(seconds * 1000)}
        more = {"seconds": round(seconds * 1000) / 1000, "by": "host"}
        return self.one("lease", relay, want, "PUT", "/lease", body, **more)

    def toggle(self, relay, raw, key=None):
        """Toggles an output."""
        more = {"is_raw": raw, **({"key": key} if key else {})}
        return self.one("toggle", relay, None, "POST", "/toggle", {"raw": raw}, **more)

    def coin(self):
        """On or off."""
        return self.random.random() < 0.5

    def do_set(self, relay):
        self.set(relay, self.coin())

    def do_unverified(self, relay):
        self.set(relay, self.coin(), verify=False)

    def do_if(self, relay):
        self.set(relay, self.coin(), **{"if": self.coin()})

    def do_silent(self, _relay):
        self.set(self.random.choice(self.plant.boards), self.coin(), no_reply=True)

    def do_toggle(self, relay):
        if relay not in self.plant.pulsing:
            self.toggle(relay, False)

    def do_raw(self, _relay):
        self.toggle(self.random.choice(self.plant.boards), True)

    def do_keyed(self, _relay):
        relay, key = self.random.choice(self.plant.boards), f"{self.random.getrandbits(64):016x}"
        for _ in range(self.random.choice((2, 3))):
            self.toggle(relay, True, key)

    def do_pulse(self, relay):
        relay = relay if relay not in self.plant.pulsing else self.random.choice(self.plant.timed)
        self.pulse(relay, self.random.random() < 0.8, self.random.uniform(0.05, 1.2))

    def do_jog(self, _relay):
        if self.plant.pulsing and self.coin():
            relay = self.random.choice(sorted(self.plant.pulsing))
            seconds = self.plant.pulsing[relay]
            self.one("jog", relay, True, "POST", "/pulse", {"by": "device"}, seconds=seconds,
                     by="device")
        else:
            seconds = self.random.uniform(0.05, 1.0)
            self.pulse(self.random.choice(self.plant.boards), self.coin(), seconds, "device", "jog")

    def do_lease(self, relay):
        if relay in self.plant.pulsing:
            return
        value, seconds = self.random.random() < 0.8, self.random.uniform(0.2, 2.0)
        claim = self.lease(relay, value, seconds)
        if claim.status == 200:
            self.leases[relay] = value, seconds

    def do_unlease(self, relay):
        relay = self.random.choice(sorted(self.leases)) if self.leases else relay
        self.leases.pop(relay, None)
        # Another client may have leased it since: whose lease this ends, only the answer says.
        self.one("unlease", relay, None, "DELETE", "/lease", None)

    def several(self, count):
        """Outputs of any modules, each with its new state."""
        chosen = self.random.sample(self.outputs, min(count, len(self.outputs)))
        return [Part(relay, self.coin()) for relay in chosen]

    def do_batch(self, _relay, together=False):
        parts = self.several(self.random.randint(2, 5))
        body = {"set": [{"path": part.relay, "value": part.want} for part in parts]}
        body |= {"all_or_nothing": True} if together else {}
        claim = Claim("batch", parts, time.monotonic(), all_or_nothing=together)
        self.send(claim, "POST", "/batch", body)

    def do_all_or_nothing(self, relay):
        self.do_batch(relay, True)

    def do_outputs(self, relay):
        module = relay.split(".")[0]
        own = [other for other in self.plant.world_labels[module] if other in self.outputs]
        parts = [Part(one, self.coin()) for one in self.random.sample(own, min(3, len(own)))]
        body = {"set": {part.relay.split(".")[1]: part.want for part in parts}}
        claim = Claim("outputs", parts, time.monotonic())
        self.send(claim, "PUT", f"/modules/{module}/outputs", body)

    def do_group(self, _relay):
        if not self.plant.groups:
            return
        name, members = self.random.choice(self.plant.groups)
        value = self.random.choice((True, False, "toggle"))
        want = None if value == "toggle" else value
        parts = [Part(member, want) for member in members]
        together = self.random.random() < 0.3
        body = {"value": value} | ({"all_or_nothing": True} if together else {})
        claim = Claim("group", parts, time.monotonic(), all_or_nothing=together)
        self.send(claim, "POST", f"/groups/{name}/set", body)

    def do_scene(self, _relay):
        if not self.plant.scenes:
            return
        name, steps = self.random.choice(self.plant.scenes)
        claim = Claim("scene", [Part(path, to) for path, to in steps], time.monotonic())
        self.send(claim, "POST", f"/scenes/{name}/run", None)


def book_points(book, points, since, until, how):
    """Records all good values among these points."""
    for point in points:
        if point.get("quality") != "good" or not isinstance(point.get("value"), bool):
            continue
        if how == "ws":
            begun = book.mono(point["time"])[0]
        else:
            begun = since - point["age_ms"] / 1000 - 0.001
        book.readings.append(
            Reading(point["path"], point["value"], begun - AGE_TOLERANCE, until, how))


class Reader(threading.Thread):
    """Reads all points repeatedly, some of them fresh, and follows the WebSocket."""

    def __init__(self, plant, seed, pause=0.05):
        super().__init__(daemon=True)
        self.plant, self.random, self.pause = plant, random.Random(seed), pause
        self.over, self.follower, self.life = False, None, None

    def follow(self):
        """One WebSocket per life of the daemon."""
        life = len(self.plant.daemon.lives)
        if self.life == life:
            return
        if self.follower:
            self.follower.close()

        def take(when, message):
            points = message.get("points") or message.get("data") or []
            if str(message.get("topic", "")).startswith("points"):
                book_points(self.plant.book, points, when, when, "ws")

        self.follower = Follower(self.plant.daemon, ["points/#"], take)
        self.life = life

    def run(self):
        while not self.over:
            try:
                self.follow()
                fresh = self.random.random() < 0.1
                path = "/points"
                if fresh:
                    path += f"?fresh=1&select={self.random.choice(self.plant.modules).name}"
                since = time.monotonic()
                status, answer = self.plant.daemon.ask("GET", path)
                until = time.monotonic()
                if status == 200:
                    book_points(self.plant.book, answer["points"], since, until, "get")
            except OSError:
                time.sleep(0.02)
            self.plant.book.mark_clock()
            time.sleep(self.pause)
        if self.follower:
            self.follower.close()
