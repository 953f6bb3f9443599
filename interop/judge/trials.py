"""Faults that only show at a certain moment, aimed at."""

import random
import threading
import time

from clients import Client
from modules import EdaAscii, EdaLc02, EdaRtu, Erc8, R55
from plant import Plant

# After this time an end that failed has been retried.
AGAIN = 3.5


def beside(*calls):
    """Runs these in parallel, and waits for all."""
    threads = [threading.Thread(target=call, daemon=True) for call in calls]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(40)


def client(plant, seed, name="trial"):
    """A client that only sends what it is given."""
    return Client(plant, name, seed, plant.outputs())


def four_ovens(world):
    """Four lines with one ERC-8 each."""
    return {f"line{n}": [Erc8(world, f"oven{n}", 1)] for n in range(4)}


def end_of(plant, seconds):
    """Waits, and judges."""
    time.sleep(seconds)
    held = plant.wait_ended(5.0)
    now = plant.settled()
    judge = plant.judged().judge()
    judge.told("held", not held, ",".join(held), now, "in a pulse or lease at the end")
    judge.left(now)
    plant.judge_rest(judge)
    return judge


def beside_a_pulse(seed):
    """A pulse or a lease, and a set of the same output 0 to 5.5 ms apart: it must end off."""
    with Plant(seed, four_ovens) as plant:
        plant.start()

        def races(module):
            rng = random.Random(f"{seed}/{module.name}")
            one, other = client(plant, 1), client(plant, 2)
            for nth, relay in enumerate(module.labels):
                timed = one.lease if nth % 3 == 2 else one.pulse

                def late(relay=relay):
                    time.sleep(rng.uniform(0, 0.0055))
                    other.set(relay, False)

                beside(lambda r=relay, t=timed: t(r, True, 0.3), late)
        beside(*(lambda m=module: races(m) for module in plant.modules))
        return plant, end_of(plant, 1.0)


def contradicted(seed):
    """Relays that acknowledge and do not move; the second reading is lost: never reported as
    done."""
    def lines(world):
        modules = [
            Erc8(world, "erc", 1), EdaRtu(world, "rtu", 1), EdaAscii(world, "ascii", 1, 4),
            EdaAscii(world, "old", 1, 4, is_old=True), EdaAscii(world, "io", 1, 8),
            EdaLc02(world, "lc", 1, 4), EdaLc02(world, "lcio", 1, 8), R55(world, "board", 1),
        ]
        return {f"line_{module.name}": [module] for module in modules}

    tried = []
    with Plant(seed, lines) as plant:
        plant.start()

        def tries(module):
            line, one = plant.line_of[module.name], client(plant, 1)
            for channel, loses in ((0, False), (1, True), (2, False), (3, True)):
                line.break_relay(module, channel, "stuck")
                line.do(lambda _, y=loses: setattr(line, "lose_second",
                                                   {module.name} if y else set()))
                claim = one.set(module.labels[channel], True)
                tried.append((claim, claim.status == 200 and claim.parts[0].told.get("value")))
        beside(*(lambda m=module: tries(m) for module in plant.modules))
        plant.heal()
        judge = end_of(plant, 0.2)
        for claim, lied in tried:
            judge.told("reply value", not lied, claim.parts[0].relay, claim.until, claim.words())
        return plant, judge


def one_echo(seed):
    """One request is echoed, then another master sends the same: the line keeps working."""
    def lines(world):
        return {"rtu": [Erc8(world, "oven", 1), EdaRtu(world, "gate", 2)],
                "mixed": [EdaLc02(world, "hall", 1, 8), R55(world, "yard", 2)]}

    with Plant(seed, lines) as plant:
        plant.start()
        for line in plant.lines:
            line.do(lambda _, line=line: setattr(line, "echo_once", 1))
        time.sleep(1.0)
        plant.wait_back(15.0)
        for line in plant.lines:
            line.faults = {"master"}
        time.sleep(5.0)
        plant.heal()
        plant.wait_back(15.0)
        one = client(plant, 1)
        for relay in plant.outputs()[::3]:
            one.set(relay, True)
        return plant, end_of(plant, 0.1)


def late_echo(seed):
    """The adapter begins to echo, and the module is dead: nothing acknowledges a write."""
    def lines(world):
        return {"a": [Erc8(world, "oven", 1)], "b": [EdaRtu(world, "gate", 1)]}

    with Plant(seed, lines) as plant:
        plant.start()
        for line in plant.lines:
            def change(_, line=line):
                line.echo, line.modules[0].deaf = True, True
            line.do(change)

        def tries(module):
            one = client(plant, 1)
            for relay in module.labels[:2]:
                one.set(relay, True)
                one.set(relay, False, verify=False)
        beside(*(lambda m=module: tries(m) for module in plant.modules))
        lied = [c for c in plant.book.claims if c.status == 200]
        for line in plant.lines:
            line.echo = False
        plant.heal()
        plant.daemon.end("TERM")
        plant.daemon.start()
        plant.wait_back()
        judge = end_of(plant, 0.1)
        for claim in plant.book.claims:
            judge.told("reply", claim not in lied, claim.parts[0].relay, claim.until, claim.words())
        return plant, judge


def takeover(seed):
    """A pulse is taken over by a set that is answered, then kill -9."""
    rng = random.Random(seed)
    with Plant(seed, four_ovens) as plant:
        plant.start()
        for channel in range(8):
            told = threading.Event()

            def taken(module, channel=channel, told=told):
                one, relay = client(plant, 1), module.labels[channel]
                one.pulse(relay, True, 1.5)
                if one.set(relay, True).status == 200:
                    told.set()

            killer = threading.Thread(target=lambda t=told, d=rng.uniform(0, 0.01): (
                t.wait(10), plant.daemon.send_signal_at(time.monotonic() + d, "KILL")))
            killer.start()
            beside(*(lambda m=module: taken(m) for module in plant.modules))
            killer.join()
            plant.daemon.start()
            plant.wait_back()
        return plant, end_of(plant, 2.0)


def lease_over_a_kill(seed):
    """A renewed lease holds as long as reported, over a kill, and no longer in a loop of kills."""
    with Plant(seed, four_ovens) as plant:
        plant.start()
        one = client(plant, 1)
        renewed = [module.labels[0] for module in plant.modules[:2]]
        endless = plant.modules[2].labels[0]
        for relay in renewed:
            one.lease(relay, True, 0.4)
            one.lease(relay, True, 2.5)
        plant.daemon.end("KILL")
        plant.daemon.start()
        time.sleep(3.0)
        claim = one.lease(endless, True, 2.0)
        due = claim.until + 2.0
        until = due + 2.0 + AGAIN
        while time.monotonic() < until:
            time.sleep(0.5)
            plant.daemon.end("KILL")
            plant.daemon.start()
            time.sleep(0.4)
        plant.wait_back()
        judge = end_of(plant, 0.5)
        good = judge.held(endless, due, until, False)
        judge.told("end", good, endless, until, f"{claim.words()}; kills all the while")
        return plant, judge


def keys(seed):
    """The same Idempotency-Key acts once: concurrently, repeated, and after a kill -9."""
    def lines(world):
        return {"a": [R55(world, "yard", 1)]}

    with Plant(seed, lines) as plant:
        plant.start()
        one = client(plant, 1)
        for relay in plant.boards[:6]:
            key = f"{seed}-{relay}"
            beside(*(lambda r=relay, k=key: one.toggle(r, True, k) for _ in range(3)))
            one.toggle(relay, True, key)
        for relay in plant.boards[6:]:
            key = f"{seed}-{relay}"
            one.toggle(relay, True, key)
            plant.daemon.end("KILL")
            plant.daemon.start()
            plant.wait_back()
            one.toggle(relay, True, key)
        return plant, end_of(plant, 0.1)


def welded(seed):
    """A relay is welded when its pulse ends, and a reading is lost: the end is retried."""
    with Plant(seed, four_ovens) as plant:
        plant.start()
        one, relays = client(plant, 1), [module.labels[0] for module in plant.modules]
        for module, relay in zip(plant.modules, relays, strict=True):
            one.pulse(relay, True, 0.6)
            line = plant.line_of[module.name]
            line.break_relay(module, 0, "welded")
            line.do(lambda _, line=line, m=module: setattr(line, "lose_second", {m.name}))
        time.sleep(2.5)
        plant.heal()
        since = time.monotonic()
        time.sleep(AGAIN)
        judge = end_of(plant, 0.1)
        for claim in plant.book.claims:
            relay = claim.parts[0].relay
            good = judge.held(relay, since, since + AGAIN + 1, False)
            judge.told("end", good, relay, since, claim.words() + "; welded for a while")
        return plant, judge


# By name: the trial, and the check that must have run, with its minimum count.
TRIALS = {
    "beside a pulse": (beside_a_pulse, {"left": 30}),
    "contradicted": (contradicted, {"reply value": 30}),
    "one echo": (one_echo, {"back": 3}),
    "late echo": (late_echo, {"reply": 8}),
    "takeover": (takeover, {"left": 15}),
    "lease over a kill": (lease_over_a_kill, {"end": 1, "nobody's": 3}),
    "keys": (keys, {"twice": 18}),
    "welded": (welded, {"end": 4}),
}
