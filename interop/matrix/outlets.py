"""The same faults seen through an outlet of the daemon: what all its observers share.

An observer follows both units all the time. Each value that it is told has to be one that the unit
had since the value could at the earliest have been read; everything else is false, whatever was
asked for at that moment. A read is `right` if the true value is told in the end, and `safe` if none
is told. A write is `right` if the success that it is answered with is true, and `safe` if it is
answered with a failure, or not because the unit is told to be dead.
"""

import contextlib
import datetime
import json
import threading
import time

from injector import Unit

# How old a value may be, in seconds, and how much later it may be told: the daemon says within
# 0.1 s that it is old, but a busy machine may not get round to it.
MAX_AGE = 1.0
LATE = 2.0
# How long after its request a reply may still tell what is so.
EXCHANGE = 1.0
# How long it may take until a fault is met.
MET = 3.0
# How long until a read is `safe`: long enough for a unit that answers to be found again, and for
# what was known of one that does not to be too old.
FOUND, GONE = 10.0, 5.0
# How long an observer waits for an answer.
ANSWER = 15.0
APART = 0.02
# How far a time that is told with a value may be from our own: both are of the same clock.
CLOCK = 0.01
# What the units hold, also with all of their first four outputs switched: never the same.
OUTPUTS = {1: 0x21, 2: 0xDA}
# The outputs that are read.
CHANNELS = range(4)
# The modules of the units in the configuration.
NAMES = {1: "a", 2: "b"}
ALL = 0x0F
# The ends of commands that are done, and of one that may have acted.
DONE, UNKNOWN = ("readback", "reply", "sent"), "unknown"


class Watched(Unit):
    """A unit that remembers when its outputs were what, and what it was told to switch: when, which
    output, and to what."""

    def __init__(self, outputs, inputs=0):
        self.past, self.switched = [], []
        super().__init__(outputs, inputs)

    def put(self, mask, on):
        super().put(mask, on)
        self.switched += [(time.monotonic(), nth, on >> nth & 1)
                          for nth in range(mask.bit_length()) if mask >> nth & 1]

    @property
    def outputs(self):
        """What they are now."""
        return self.past[-1][1]

    @outputs.setter
    def outputs(self, outputs):
        # One tuple at a time: other threads read it.
        self.past = [*self.past, (time.monotonic(), outputs)]

    def _spans(self):
        past = self.past
        ends = [at for at, _ in past[1:]] + [float("inf")]
        return [(at, end, outputs) for (at, outputs), end in zip(past, ends)]

    def had(self, bits, since, mask=ALL, until=float("inf")):
        """Whether these outputs were so at any moment from then until then."""
        return any(end >= since and at <= until and outputs & mask == bits & mask
                   for at, end, outputs in self._spans())

    def was_false(self, bits, since, until, mask, late):
        """Whether who was told this from then until then was told what had not been so for longer
        than a value may be old, and so much later; or what had not been so yet."""
        old_at = float("-inf")
        for at, end, outputs in self._spans():
            if outputs & mask == bits & mask:
                old_at = end + MAX_AGE + late
            elif max(since, at, old_at) <= min(until, end):
                return True
        return False


class Refused(Exception):
    """There is no value, or nothing is done; the reason."""


class Asked:
    """A request in progress, and how it ends; as `Client` of the other columns."""

    def __init__(self, observer, what, work):
        # How long the first answer took.
        self.end, self.took = "WRONG: hangs", ANSWER
        self.case, self.what, self.began = observer.case, what, time.monotonic()
        self.is_answered = False
        self.thread = threading.Thread(target=self._run, args=(observer, work), daemon=True)
        self.thread.start()

    def _run(self, observer, work):
        try:
            with observer.asking() as client:
                self.end = work(self, client)
        except Exception as error:  # Each client has its own.
            self.end = f"WRONG: {type(error).__name__}: {error}"
        self.answered()
        self.case.log.append(f"{self.what}: {self.end} in {self.took:.2f} s")

    def answered(self):
        """There is an answer."""
        if not self.is_answered:
            self.is_answered, self.took = True, time.monotonic() - self.began

    def wait(self):
        """How it ended."""
        self.thread.join(FOUND + ANSWER)
        return self.end


class Observer:
    """Who follows the units of a case through an outlet, from before the daemon starts.

    A kind of outlet has `settings`, `asking` and `close`. What `asking` gives has `outputs(unit)`,
    the first four as bits, and `switch_on(unit, nth)`; both raise `Refused`.
    """

    # The outputs of a unit that are told at once, and have to have been so at once.
    together = (ALL,)

    def __init__(self, case):
        self.case = case
        # What it was told that was false.
        self.false = []

    def settings(self):
        """What the outlet is set to, by the keys of the configuration."""
        raise NotImplementedError

    def text(self):
        """The outlet in the configuration of the daemon."""
        lines = [f"{key} = {json.dumps(value)}\n" for key, value in self.settings().items()]
        return "[outlet.scada]\n" + "".join(lines)

    def is_there(self):
        """Whether it can ask for something; OSError if not."""
        raise NotImplementedError

    def begin(self):
        """The daemon serves."""

    def asking(self):
        """A connection to ask over, as a context."""
        return contextlib.nullcontext(self)

    def close(self):
        """Ends it."""
        raise NotImplementedError

    def lies(self):
        """Ends it; what it was told that was false."""
        self.close()
        return self.false

    def is_on(self, unit, nth):
        """Whether an output really is on."""
        return bool(self.case.line.units[unit].outputs >> nth & 1)

    def is_false(self, unit, bits, asked):
        """Whether a unit had not had these outputs for too long when it was asked for them."""
        watched, since = self.case.line.units[unit], asked - MAX_AGE - LATE
        return not all(watched.had(bits, since, mask) for mask in self.together)

    def patience(self, unit):
        """How long a unit is waited for that is not known."""
        return FOUND if self.case.line.is_readable(unit) else GONE

    def read(self, unit):
        """Starts a read of the outputs of a unit, which does not end before its fault is met: the
        daemon knows them already."""
        line, watched = self.case.line, self.case.line.units[unit]

        def work(asked, client):
            last = "none"
            while (now := time.monotonic()) < asked.began + self.patience(unit):
                try:
                    bits = client.outputs(unit)
                except Refused as refused:
                    last = f"safe {refused}"
                else:
                    if self.is_false(unit, bits, now):
                        return f"WRONG: told {bits:04b}"
                    last = "right" if watched.had(bits, now) else "WRONG: an old value"
                asked.answered()
                if last == "right" and (line.is_met(unit) or now > asked.began + MET):
                    break
                time.sleep(APART)
            return last

        return Asked(self, f"read of unit {unit}", work)

    def write(self, unit):
        """Starts a write that switches on the first output that is off."""
        nth = min(nth for nth in CHANNELS if not self.is_on(unit, nth))

        def work(_, client):
            # A unit of which nothing is known yet can be commanded, too.
            try:
                client.switch_on(unit, nth)
            except Refused as refused:
                return f"safe {refused}"
            is_on = self.is_on(unit, nth)
            return "right" if is_on else "WRONG: success, but nothing was switched"

        return Asked(self, f"write to unit {unit}", work)


class Follower(Observer):
    """One who is told by itself what changes, and has to be told in time what holds no longer.

    A kind of outlet has `messages`, all that came so far, and `take`, which calls `knows` and
    `was_so` for what is in a message.
    """

    together = tuple(1 << nth for nth in CHANNELS)
    # How much later than it may be old a value may be taken back.
    late = LATE
    # How much later than it was read the time of a value may be.
    later = 0.0
    # Whether the way to the daemon works all the time: then what is told is new.
    is_steady = True

    def __init__(self, case):
        super().__init__(case)
        self.taken, self.lock = 0, threading.Lock()
        # What it knows of each output, since when, and what it knew before: unit, output, value,
        # since and until.
        self.known, self.knew = {}, []

    def messages(self):
        """All that came so far, in their order."""
        raise NotImplementedError

    def take(self, message):
        """Takes one of them."""
        raise NotImplementedError

    def hear(self):
        """Takes what came since the last time."""
        with self.lock:
            for message in self.messages()[self.taken:]:
                self.taken += 1
                self.take(message)

    def knows(self, unit, nth, value, at):
        """From now on this is the value of an output, or none is known."""
        before, since = self.known.get((unit, nth), (None, at))
        if before == value:
            return
        if before is not None:
            self.knew.append((unit, nth, before, since, at))
        self.known[unit, nth] = value, at

    def was_so(self, unit, nth, value, at, told_at, is_new=True):
        """It is told then that an output was so when it was read at this time, in seconds since
        1970; that is no longer ago than a value may be old, if it is no news of the past."""
        at += time.monotonic() - time.time()
        watched = self.case.line.units[unit]
        was = watched.had(value << nth, at - CLOCK - self.later, 1 << nth, at + EXCHANGE)
        is_late = self.is_steady and is_new and told_at > at + MAX_AGE + self.late
        is_in_time = at <= told_at + CLOCK and not is_late
        if not (was and is_in_time) and not self.case.line.is_upset(at):
            self.false.append(f"output {nth} of unit {unit} was {value} at {at:.3f}, told at "
                              f"{told_at:.3f}")

    def outputs(self, unit):
        """The first four outputs of a unit, as it knows them."""
        self.hear()
        values = [self.known.get((unit, nth), (None, 0))[0] for nth in CHANNELS]
        if None in values:
            raise Refused("not known")
        return sum(value << nth for nth, value in enumerate(values))

    def ended(self, unit, nth, end, code, value):
        """A command to switch an output on has ended so, by what it was answered, and the output
        is this afterwards, or not known."""
        self.case.log.append(f"output {nth} of unit {unit}: {end} {code} {value}")
        if end in DONE:
            must(value is not False, "success, and it is off")
            return
        must(code, "no code")
        must(end == UNKNOWN or not self.is_on(unit, nth), "not done, and it is on")
        raise Refused(f"{end} {code}")

    def lies(self):
        self.hear()
        self.close()
        now = time.monotonic()
        still = [(*which, value, since, now) for which, (value, since) in self.known.items()
                 if value is not None]
        for unit, nth, value, since, until in [*self.knew, *still]:
            watched = self.case.line.units[unit]
            if watched.was_false(value << nth, since, until, 1 << nth, self.late):
                self.false.append(f"output {nth} of unit {unit} is {value}, "
                                  f"for {until - since:.3f} s")
        return self.false


def must(holds, what):
    """An answer is wrong if this does not hold."""
    if not holds:
        raise AssertionError(what)


def wall(text):
    """A time as the daemon writes it, in seconds since 1970."""
    return datetime.datetime.fromisoformat(text.replace("Z", "+00:00")).timestamp()
