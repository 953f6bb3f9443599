"""A line of modules on a pseudo-terminal, and everything that may go wrong with it."""

import heapq
import itertools
import os
import random
import select
import threading
import time
import tty

from modules import Reply

# A module's usual turnaround.
TURNAROUND = 0.004
# Late replies are guaranteed to be recognised within this time; those made here come well before
# it.
PROMISED = 0.5
LATE_MAX = 0.44
# A second copy of a reply is guaranteed to be recognised within this time after the first; those
# made here come well before it.
AGAIN_PROMISED = 0.1
AGAIN_MAX = 0.07
# Bytes that make no request are dropped after this time.
FORGOTTEN = 0.05
# How often to check whether the terminal has been opened.
LOOK_AGAIN = 0.002
# How often to note the time, so that the arrival of a request is known.
TICK = 0.015

# The faults that are drawn for each request, with their odds. After each the line has to be careful
# for a while: more of them would only mean fewer commands.
ODDS = {"late": 0.05, "late5": 0.01, "lost_request": 0.02, "lost_reply": 0.02, "twice": 0.05,
        "garbled": 0.03, "master": 0.03, "pieces": 0.05}
# Those that may only slow a line down.
INSIDE = ("late", "lost_request", "lost_reply", "twice", "garbled", "pieces")


def is_order(world, module, frame):
    """Whether a frame commanded something of a module."""
    return any(acts[-1].frame == frame for acts in map(world.acts.get, module.labels) if acts)


class Line:
    """The line. `faults` are the present ones."""

    def __init__(self, world, name, path, modules, seed):
        self.world, self.name, self.path, self.modules = world, name, path, modules
        self.random = random.Random(seed)
        self.faults, self.echo, self.echo_once, self.babble = set(), False, 0, False
        # This many replies are duplicated at the start: a duplicating adapter shows itself early.
        self.twice_first = 0
        # Modules whose second reading after a command is lost.
        self.lose_second = set()
        self._lose_reads = {}
        self.trace = []
        self.asked = {module.name: 0 for module in modules}
        self._queue, self._order = [], itertools.count()
        # When the last of the held-up bytes arrive, if the line keeps its order.
        self._last = 0.0
        self._wake, self._stop = os.pipe(), False
        self._fd = None
        self._lock = threading.RLock()
        world.lines[name] = self
        self.plug()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def plug(self):
        """Makes the port appear."""
        with self._lock:
            self._fd, terminal = os.openpty()
            tty.setraw(terminal)
            os.symlink(os.ttyname(terminal), self.path)
            # Only the program has it open, so it is free once the program has gone.
            os.close(terminal)
            self.world.trouble_ends(self.name, time.monotonic())
        os.write(self._wake[1], b"\0")

    def unplug(self):
        """Makes the port disappear."""
        with self._lock:
            self.world.trouble(self.name, time.monotonic())
            os.unlink(self.path)
            fd, self._fd = self._fd, None
            self._queue.clear()
            self._last = 0.0
            for module in self.modules:
                module.busy_until = 0.0
            os.close(fd)
        os.write(self._wake[1], b"\0")

    def close(self):
        """Ends the line."""
        self._stop = True
        os.write(self._wake[1], b"\0")
        self._thread.join()
        if self._fd is not None:
            self.unplug()
        for fd in self._wake:
            os.close(fd)

    def do(self, change):
        """Changes something between two frames; `change` gets the time."""
        with self._lock:
            now = time.monotonic()
            for module in self.modules:
                module.settle(now)
            return change(now)

    def heal(self):
        """Ends all faults."""
        def change(now):
            self.faults, self.babble, self.echo_once = set(), False, 0
            self.lose_second.clear()
            self._lose_reads.clear()
            self.world.trouble_ends(self.name, now)
            for module in self.modules:
                if not module.powered:
                    module.set_power(True, now)
                module.deaf = False
                if module.stuck or module.welded:
                    module.stuck = module.welded = 0
                for relay in module.labels:
                    self.world.trouble_ends(relay, now)
        if self._fd is None:
            self.plug()
        self.do(change)

    def start_babble(self):
        """A device on it never stops sending."""
        def change(now):
            self.babble = True
            self.world.trouble(self.name, now)
        self.do(change)
        os.write(self._wake[1], b"\0")

    def break_relay(self, module, channel, how):
        """A relay is `stuck`, or `welded` while it is on."""
        def change(now):
            setattr(module, how, getattr(module, how) | 1 << channel)
            self.world.trouble(module.labels[channel], now)
        self.do(change)

    def _note(self, when, what, data):
        if len(self.trace) > 200_000:
            del self.trace[:100_000]
        self.trace.append((when, what, bytes(data)))

    def _send(self, data, what="<"):
        if self._fd is not None and self._is_open():
            self._note(time.monotonic(), what, data)
            os.write(self._fd, data)

    def _is_open(self):
        """Whether the terminal is open: what is sent at other times is lost."""
        poll = select.poll()
        poll.register(self._fd, select.POLLIN)
        return not any(what & select.POLLHUP for _, what in poll.poll(0))

    def _run(self):
        heard, babbled, last, looked = b"", 0.0, 0.0, time.monotonic()
        while not self._stop:
            with self._lock:
                now = time.monotonic()
                while self._queue and self._queue[0][0] <= now:
                    _, _, data, sent = heapq.heappop(self._queue)
                    self._send(data if not self.babble else self.random.randbytes(len(data)))
                    sent(time.monotonic())
                if self.babble and now >= babbled:
                    self._send(self.random.randbytes(5), "< babble")
                    babbled = now + 0.004
                wait = [due[0] - now for due in self._queue[:1]]
                wait += [babbled - now] if self.babble else []
                ports = [self._wake[0]]
                if self._fd is not None and self._is_open():
                    ports.append(self._fd)
                elif self._fd is not None:
                    wait.append(LOOK_AGAIN)
            now = time.monotonic()
            ready = select.select(ports, [], [], 0)[0]
            if self._fd not in ready:
                # Nothing had arrived at that moment; what is found later came after it.
                looked = now
                ready = ready or select.select(ports, [], [], max(min([*wait, TICK]), 0))[0]
            with self._lock:
                if self._wake[0] in ready:
                    os.read(self._wake[0], 64)
                if self._fd is None or self._fd not in ready:
                    continue
                lo, looked = looked, time.monotonic()
                try:
                    data = os.read(self._fd, 600)
                except OSError:
                    # The program that had it open has just gone.
                    continue
                hi = time.monotonic()
                self._note(hi, ">", data)
                if self.echo or self.echo_once:
                    self.echo_once = max(self.echo_once - 1, 0)
                    self._send(data, "< echo")
                heard = (heard if hi - last < FORGOTTEN else b"") + data
                last = hi
                heard = self._hear(heard, lo, hi)

    def _hear(self, heard, lo, hi):
        at = 0
        while at < len(heard):
            lengths = (module.take(heard[at:]) for module in self.modules)
            length = next((length for length in lengths if length), 0)
            if not length:
                at += 1
                continue
            self._answer_all(heard[at:at + length], lo, hi)
            heard, at = heard[at + length:], 0
        return heard[-300:]

    def _answer_all(self, frame, lo, hi, strange=False):
        for module in self.modules:
            if module.take(frame) == len(frame) and module.is_for(frame):
                self._answer(module, frame, lo, hi, strange)

    def _draw(self, fault):
        return fault in self.faults and self.random.random() < ODDS[fault]

    def _answer(self, module, frame, lo, hi, strange):
        module.settle(hi)
        if not module.powered or module.deaf or self.babble and self.random.random() < 0.8:
            return
        if not strange and self._draw("lost_request"):
            self._note(hi, "lost request", frame)
            return
        with self.world.lock:
            self.world.frames += 1
            number = self.world.frames
        self._note(hi, f"frame {number}", frame)
        self.asked[module.name] += 1
        reply, tells = module.act(frame, (lo, hi, number))
        if reply is None:
            return
        self._fate(module, reply, tells, (lo, hi, number), frame, strange)

    def _fate(self, module, reply, tells, seen, frame, strange):
        """Decides what happens to a reply."""
        lo, hi, number = seen
        delay, clean = TURNAROUND if not strange else 0.0, True
        states = module.told() if tells else {}
        if not tells and module.name in self.lose_second and is_order(self.world, module, number):
            self._lose_reads[module.name] = 2
        if tells and self._lose_reads.get(module.name):
            self._lose_reads[module.name] -= 1
            if self._lose_reads[module.name] == 0:
                self._note(hi, "lost reply", reply)
                self.world.replies[module.name].append(Reply(lo, hi, states, False))
                return
        if not strange and self._draw("lost_reply"):
            module.unanswered(number)
            self._note(hi, "lost reply", reply)
            if tells:
                self.world.replies[module.name].append(Reply(lo, hi, states, False))
            return
        if self._draw("late"):
            delay = self.random.uniform(0.02, LATE_MAX)
        if self._draw("late5"):
            delay = self.random.uniform(0.5, 5.0)
        # A module answers one request after the other, whatever delays its replies.
        delay = max(delay, module.busy_until - hi)
        module.busy_until = hi + delay
        if module.has_checksum and self._draw("garbled"):
            at = self.random.randrange(len(reply) - 1)
            spoilt = reply[at] ^ 1 << self.random.randrange(7)
            reply, clean = reply[:at] + bytes([spoilt]) + reply[at + 1:], False
        is_held = delay > LATE_MAX or self._last > hi
        is_late = is_held or delay > 0.02

        first = []

        def sent(when):
            if not is_held and when - lo > PROMISED:
                self.world.overdue[self.name].append(when)
            first.append(when)
            if tells:
                good = clean and not is_late and when - lo < 0.05
                self.world.replies[module.name].append(Reply(lo, when, states, good))

        copies = [(delay, reply, sent)]
        if self._draw("pieces") and len(reply) > 3:
            cut = self.random.randrange(1, len(reply))
            copies = [(delay, reply[:cut], lambda _: None), (delay + 0.01, reply[cut:], sent)]
            module.busy_until += 0.01
        if self.twice_first or self._draw("twice"):
            self.twice_first = max(self.twice_first - 1, 0)
            again = delay + self.random.uniform(0.004, AGAIN_MAX)

            def repeated(when):
                if first and when - first[0] > AGAIN_PROMISED:
                    self.world.overdue[self.name].append(when)
            copies.append((again, reply, repeated))
        for after, data, done in copies:
            self._put(hi + after, data, done)
        if not strange and self._draw("master") and tells and module.names_itself:
            # Another master sends the same request a little later.
            def ask(_when, frame=frame):
                self._answer_all(frame, time.monotonic(), time.monotonic(), strange=True)
            later = hi + delay + self.random.uniform(0.001, 0.1)
            heapq.heappush(self._queue, (later, next(self._order), frame, ask))

    def _put(self, due, data, done):
        """Sends this at that time. Bytes that are later than guaranteed delay everything behind
        them, as in an adapter or on TCP: the order is kept."""
        now = time.monotonic()
        if "late5" in self.faults or self._last > now:
            due = self._last = max(due, self._last)
            if due - now > PROMISED:
                self.world.stall(self.name, now, due)
        heapq.heappush(self._queue, (due, next(self._order), data, done))
