"""The judge around the daemon: the real program on lines whose modules know what they did.

Modules of all families on pseudo-terminals record what each relay did, when, and for which frame.
Clients send `railbus serve` every kind of command and record the answers, each with its window of
the judge's own clock. Lines fail in every way that is known here, the daemon is killed, and then
both records are compared: KINDS in `judge.py` is the list. First come trials that aim at one
moment, then rounds of load with faults.

    interop/judge/run.py [--seconds N] [--seed S] [--only NAME] [--late]

By default it takes two minutes. `--only` runs one trial, by its name, or `soak`; `--late` sends
replies later than is guaranteed to be recognised, and judges how rare false readings are.
"""

import argparse
import collections
import concurrent.futures
import pathlib
import sys
import threading
import time
import unittest

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import daemon
from judge import KINDS
from soak import Soak
from trials import TRIALS

SECONDS = 120.0
# How long the trials take together.
TRIALS_TAKE = 42.0
# Minimums of the soak, per second: a run with fewer has judged too little. A busy machine makes
# some twenty commands.
FLOORS = {"commands": 5.0, "reading": 100.0, "nobody's": 2.0, "readback": 1.5, "left": 1.0}
# Minimum of the soak, per minute.
KILLS_MIN = 6.0
# If replies are later than guaranteed, how many of 100,000 readings may be false.
LATE_MAX = 1.0
BY_READING = ("reading", "history", "before")
# How many failures of a kind are shown.
SHOWN = 3
AROUND = 3.0
ROWS = 40


def clock_lag(lags, stop):
    """Records how late this machine wakes, which shows how busy it is."""
    while not stop.is_set():
        began = time.monotonic()
        time.sleep(0.01)
        lags.append(time.monotonic() - began - 0.01)


def show(failure, plant, base, replay):
    """The claim, and what the relay and its line did around that time."""
    print(f"FALSE {failure.kind} ({KINDS[failure.kind]}): {failure.relay}")
    print(f"  at {failure.when:.3f}: {failure.words}")
    near = [(when, f"{'on' if value else 'off'}, {cause}")
            for when, value, cause in plant.world.changes.get(failure.relay, [])]
    near += [(act.hi, f"told: {act.kind} {'on' if act.value else 'off'}, frame {act.frame}"
              + ("" if act.answered else ", not answered"))
             for act in plant.world.acts.get(failure.relay, [])]
    for when, what in sorted(near):
        if abs(when - failure.when) < AROUND:
            print(f"  {when:12.3f}  {failure.relay} {what}")
    line = plant.line_of.get(failure.relay.split(".")[0])
    rows = [row for row in (line.trace if line else ()) if row[0] < failure.when + 0.05]
    for when, what, data in rows[-ROWS:]:
        print(f"  {when:12.3f}  {what:12} {data.hex(' ')}")
    print(f"  the judge's clock began at {base:.3f}; again: {replay}")


class Run:
    """The whole run and its results."""

    def __init__(self, args):
        self.args, self.failed = args, []
        self.checked, self.false = collections.Counter(), collections.Counter()
        self.outside = collections.Counter()
        self.began = time.monotonic()

    def take(self, name, plant, judge, floors):
        """Adds the results of one part."""
        self.checked += judge.checked
        self.outside += judge.outside
        shown = collections.Counter()
        tolerated = self.tolerated(judge) if name == "soak" else ()
        for failure in judge.false:
            self.false[failure.kind] += 1
            shown[failure.kind] += 1
            if failure.kind not in tolerated and shown[failure.kind] <= SHOWN:
                show(failure, plant, self.began, self.replay(name))
        false = [kind for kind in shown if kind not in tolerated]
        if false:
            self.failed.append(f"{name}: false: {', '.join(false)}; again: {self.replay(name)}")
        for kind, least in floors.items():
            count = judge.checked[kind] + judge.outside[kind]
            if count < least:
                few = f"{count} of at least {least:.0f} checks of `{kind}`"
                self.failed.append(f"{name}: only {few}")

    def tolerated(self, judge):
        """The kinds of which a few may be false if replies are too late."""
        if not self.args.late:
            return ()
        false = sum(failure.kind in BY_READING for failure in judge.false)
        checked = sum(judge.checked[kind] for kind in BY_READING)
        print(f"late replies: {false} of {checked} readings false")
        return BY_READING if false <= max(checked * LATE_MAX / 100_000, 1) else ()

    def replay(self, name):
        """The command that repeats this run."""
        late = " --late" if self.args.late else ""
        seconds = f" --seconds {self.args.seconds:g}" if name == "soak" else ""
        return (f"python3 interop/judge/run.py --seed {self.args.seed} "
                f"--only '{name}'{seconds}{late}")

    def trials(self):
        """The trials, a few in parallel."""
        wanted = {name: trial for name, trial in TRIALS.items()
                  if self.args.only in (None, name)}
        with concurrent.futures.ThreadPoolExecutor(3) as pool:
            running = {pool.submit(trial, self.args.seed): (name, floors)
                       for name, (trial, floors) in wanted.items()}
            for done in concurrent.futures.as_completed(running):
                name, floors = running[done]
                if error := done.exception():
                    self.failed.append(f"{name}: broke off, {type(error).__name__}: {error}")
                    continue
                plant, judge = done.result()
                print(f"  {name}: {sum(judge.checked.values())} checked, {len(judge.false)} false",
                      flush=True)
                self.take(name, plant, judge, floors)

    def soak(self, seconds):
        """The rounds of load."""
        late = (("late5",), ("late5", "lost_request", "lost_reply"))
        modes = {"modes": late} if self.args.late else {}
        soak = Soak(self.args.seed, **modes)
        try:
            judge = soak.run(seconds)
            commands = sum(claim.answered for claim in soak.plant.book.claims)
            floors = {kind: least * seconds for kind, least in FLOORS.items() if kind in KINDS}
            self.take("soak", soak.plant, judge, floors)
            if commands < FLOORS["commands"] * seconds:
                self.failed.append(f"soak: only {commands} commands in {seconds:.0f} s")
            if soak.kills < KILLS_MIN * seconds / 60:
                self.failed.append(f"soak: only {soak.kills} kills in {seconds:.0f} s")
            print(f"  {soak.rounds} rounds, {commands} commands answered, {soak.kills} kills, "
                  f"{soak.terms} stops, {soak.others} other events; "
                  f"judged in {soak.judging:.1f} s")
        finally:
            soak.plant.__exit__()

    def table(self, lags):
        """A table of all kinds of claims: how many were checked, how many were false."""
        print(f"\n{'claim':12} {'checked':>9} {'false':>6}")
        for kind, what in KINDS.items():
            print(f"{kind:12} {self.checked[kind]:9} {self.false[kind]:6}  {what}")
        slow = sorted(lags)[-len(lags) // 100:] or [0.0]
        print(f"not judged, because this machine was late itself: {sum(self.outside.values())}; "
              f"it woke {1000 * slow[0]:.0f} ms late once in a hundred times")


def self_test():
    """The judge has to detect each kind of false claim before it is trusted."""
    tests = unittest.defaultTestLoader.discover(str(HERE), "test_*.py")
    return unittest.TextTestRunner(verbosity=1).run(tests).wasSuccessful()


def main(words):
    """Runs what the arguments name; returns the exit code."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--seed", default="20261122")
    parser.add_argument("--only", choices=[*TRIALS, "soak"])
    parser.add_argument("--late", action="store_true")
    args = parser.parse_args(words)
    sys.setswitchinterval(0.0005)
    if not self_test():
        print("FAILED the judge does not judge")
        return 1
    daemon.build()
    run, lags, stop = Run(args), [], threading.Event()
    threading.Thread(target=clock_lag, args=(lags, stop), daemon=True).start()
    print(f"seed {args.seed}", flush=True)
    if args.only != "soak" and not args.late:
        run.trials()
    if args.only in (None, "soak"):
        rest = args.seconds if args.only or args.late else args.seconds - TRIALS_TAKE
        run.soak(max(rest, 10.0))
    stop.set()
    run.table(lags)
    if not run.checked:
        run.failed.append("nothing was checked")
    for failure in run.failed:
        print(f"FAILED {failure}")
    print(f"judge: {sum(run.checked.values())} claims checked, {sum(run.false.values())} false, "
          f"{'FAILED' if run.failed else 'passed'}")
    return 1 if run.failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
