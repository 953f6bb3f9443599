"""Rounds of load with faults, each followed by an idle time in which everything must be as
reported."""

import itertools
import random
import time

from clients import CLIENTS, Client, Reader
from plant import Plant, whole_site

# The faults of the lines in a round.
MODES = (("late",), ("lost_request", "lost_reply"), ("twice",), ("garbled", "pieces"),
         ("late", "lost_request", "lost_reply", "twice", "garbled", "pieces"), (),
         ("echo",), ("master", "lost_reply"), ("once", "late"))
# What happens during a round.
EVENTS = ("kill", "kill", "kill", "kill", "kill", "kill_loop", "kill_loop", "term", "reload",
          "unplug", "power", "exchange", "stuck", "welded", "babble", "inputs")
# How many of them in each round, and how many kills in a loop of them.
EVENTS_EACH, LOOP = 3, 4
GROUPS = (("wide", ("oven.k1", "hall.do1", "yard.k1", "pump.do0")),
          ("near", ("oven.k2", "oven.k3")))
SCENES = (("dusk", (("oven.k4", True), ("yard.k2", False), ("shed.do0", True))),)
# How long a round loads the lines, in seconds.
ROUND = 7.0


class Soak:
    """A run."""

    def __init__(self, seed, modes=MODES, pause=0.01, say=print):
        self.seed, self.random, self.say, self.modes = seed, random.Random(seed), say, modes
        self.kills = self.terms = self.rounds = self.others = 0
        # How many seconds the judging took.
        self.judging = 0.0
        self.plant = Plant(seed, whole_site, GROUPS, SCENES, pulsing={"gate.do3": 0.5})
        # The pulses and leases at the end of each round, and when the rounds were.
        self.lefts, self.quiet = [], []
        outputs = self.plant.outputs()
        shared = self.random.sample(outputs, 14) + ["oven.k1", "yard.k1"]
        own = [relay for relay in outputs if relay not in shared]
        self.clients = [
            Client(self.plant, f"client {nth}", f"{seed}/{nth}", shared + own[nth::CLIENTS], pause)
            for nth in range(CLIENTS)
        ]
        self.reader = Reader(self.plant, f"{seed}/reader")

    def run(self, seconds):
        """Runs rounds for this long; returns the judge of all of them."""
        plant = self.plant
        end = time.monotonic() + seconds
        plant.start()
        for thread in [*self.clients, self.reader]:
            thread.start()
        mode_of = itertools.cycle(self.random.sample(self.modes, len(self.modes)))
        event_of = itertools.cycle(self.random.sample(EVENTS, len(EVENTS)))
        while time.monotonic() < end:
            self.round(next(mode_of), *itertools.islice(event_of, EVENTS_EACH))
        for client in self.clients:
            client.over = True
        self.reader.over = True
        self.reader.join(5)
        began = time.monotonic()
        judge = plant.judged().judge()
        for when, words in self.lefts:
            judge.told("held", not words, words, when, "in a pulse or lease at the end")
        for now in self.quiet:
            judge.left(now)
        plant.judge_rest(judge)
        self.judging = time.monotonic() - began
        return judge

    def round(self, mode, *events):
        """Load, faults and events, then idle time."""
        plant, since = self.plant, time.monotonic()
        self.rounds += 1
        words = "+".join(mode) or "nothing"
        self.say(f"  {since:10.3f} round {self.rounds}: {words}; {', '.join(events)}")
        if "echo" in mode:
            self.restart("TERM", lambda: self.set_echo(True))
        if "twice" in mode:
            self.restart("TERM", self.double)
        if "once" in mode:
            for line in plant.lines:
                line.echo_once = 1
        for line in plant.lines:
            line.faults = {fault for fault in mode if fault not in ("echo", "once")}
        for client in self.clients:
            client.go.set()
        for event in events:
            time.sleep(self.random.uniform(0.2, ROUND / EVENTS_EACH - 0.5))
            getattr(self, event)()
        time.sleep(max(since + ROUND - time.monotonic(), 0))
        self.silence("echo" in mode)

    def silence(self, echoes):
        """Without faults and commands, until what was begun has ended."""
        plant = self.plant
        for client in self.clients:
            client.go.clear()
        plant.heal()
        for client in self.clients:
            client.idle.wait(25)
            client.leases.clear()
        if echoes:
            self.restart("TERM", lambda: self.set_echo(False))
        plant.wait_back()
        held = plant.wait_ended(8.0)
        self.lefts.append((time.monotonic(), ",".join(held)))
        # Until nothing is left in a terminal or a reply.
        time.sleep(0.6)
        self.quiet.append(plant.settled())

    def set_echo(self, on):
        """Makes the adapters echo from now on, or not; the lines are closed."""
        for line in self.plant.lines:
            line.echo = on

    def double(self):
        """An adapter that duplicates replies shows that early."""
        for line in self.plant.lines:
            line.twice_first = 3

    def restart(self, how, between=None):
        """Ends the daemon and starts it again."""
        self.kills += how == "KILL"
        self.terms += how == "TERM"
        self.plant.daemon.end(how)
        if between:
            between()
        elif any("twice" in line.faults for line in self.plant.lines):
            self.double()
        self.plant.daemon.start()

    # Events --------------------------------------------------------------------------------

    def kill(self):
        self.restart("KILL")

    def kill_loop(self):
        for _ in range(LOOP):
            self.restart("KILL")
            time.sleep(self.random.uniform(0.0, 0.4))

    def term(self):
        self.restart("TERM")

    def reload(self):
        """Changes the configuration a little, while everything else goes on."""
        _, shown = self.plant.daemon.ask("GET", "/config")
        text = self.plant.text + f"# {self.random.random()}\n"
        headers = {"If-Match": f'"{shown["etag"]}"'}
        self.plant.daemon.ask("PUT", "/config", {"text": text}, headers)
        self.others += 1

    def unplug(self):
        line = self.random.choice(self.plant.lines)
        line.unplug()
        time.sleep(self.random.uniform(0.1, 1.0))
        if "twice" in line.faults:
            line.twice_first = 3
        line.plug()
        self.others += 1

    def power(self):
        module = self.random.choice(self.plant.modules)
        line = self.plant.line_of[module.name]
        line.do(lambda now: module.set_power(False, now))
        time.sleep(self.random.uniform(0.05, 1.0))
        line.do(lambda now: module.set_power(True, now))
        self.others += 1

    def exchange(self):
        module = self.random.choice(self.plant.modules)
        self.plant.line_of[module.name].do(module.exchange)
        self.others += 1

    def broken(self, how):
        module = self.random.choice(self.plant.modules)
        channel = self.random.randrange(len(module.labels))
        self.plant.line_of[module.name].break_relay(module, channel, how)
        self.others += 1

    def stuck(self):
        self.broken("stuck")

    def welded(self):
        self.broken("welded")

    def babble(self):
        line = self.random.choice(self.plant.lines)
        line.start_babble()
        time.sleep(self.random.uniform(0.2, 0.8))

        def quiet(now):
            line.babble = False
            self.plant.world.trouble_ends(line.name, now)
        line.do(quiet)
        self.others += 1

    def inputs(self):
        for module in self.plant.modules:
            if module.inputs:
                levels = self.random.getrandbits(len(module.inputs))
                line = self.plant.line_of[module.name]
                line.do(lambda now, m=module, l=levels: m.set_levels(l, now))
