"""Two scripted modules at the far end of a pseudo-terminal, which answer correctly until told to
misbehave. Only the standard library is used; the frames are made here and nowhere else."""

import collections
import copy
import fcntl
import heapq
import itertools
import os
import random
import select
import socket
import termios
import threading
import time
import tty

from checksums import crc, total

# The delay of a late reply: after any timeout, and before its request is forgotten.
LATE = 0.75
# How much later than nominal a late or duplicated reply may be: for later ones nothing is
# guaranteed. What a busy machine has held up for longer is not sent, as if the line had lost it.
SPARE = 0.13
# How often the line is checked at least: what is found was not there at the previous check, which
# bounds when it was sent.
LOOK = 0.02
# For this long after the machine did not get round to the line, the host may still be at what that
# has upset.
UPSET = 6.0
# The delay up to which a late reply is recognised in any case, also without a daemon.
WITHIN = 0.45
# How long after the next request a late or duplicated reply comes, and how much later the reply to
# that request.
STRAY = 0.005
BEHIND = 0.015
# How long after the first the second copy of a reply comes.
AGAIN = 0.02
# A module's usual turnaround, and a slow one: long enough that another client's request waits
# behind it, and that a host which adapts to a module's speed uses its longest timeout.
TURNAROUND = 0.01
SLOW = 0.16
# The turnaround of a module that is slower than the initial timeout.
SLOW_MODULE = 0.4

# The faults with which a module can be read all the same.
READABLE = (None, "glitch_after", "glitch_before", "noise", "pieces", "slow", "stuck", "twice")

# Bytes that make no request are dropped after this time.
FORGOTTEN = 0.05

Request = collections.namedtuple("Request", "unit kind detail")
Request.__doc__ = "A request to a unit: `read`, `write` or `other`, and what its protocol needs."


class Unit:
    """A module: its outputs and inputs, the writes that it carried out, and how often it was read
    since its last fault was set."""

    def __init__(self, outputs, inputs=0):
        self.outputs, self.inputs, self.writes, self.reads = outputs, inputs, 0, 0

    def put(self, mask, on):
        """Switches the outputs of the mask."""
        self.outputs = self.outputs & ~mask | on & mask
        self.writes += 1


def word(data):
    """Two bytes as a number."""
    return data[0] << 8 | data[1]


class Rtu:
    """Modbus RTU. `first` is the number of the first coil, `count` how many there are; `registers`
    gives those of a unit."""

    def __init__(self, first, count, registers):
        self.first, self.count, self.registers = first, count, registers

    def take(self, data):
        """The first request in these bytes, and how many of them are consumed."""
        if len(data) < 8:
            return None, 0
        long = data[1] in (0x0F, 0x10)
        length = 9 + data[6] if long else 8
        if len(data) < length:
            return None, 0
        frame = data[:length]
        if crc(frame[:-2]) != frame[-2:]:
            return None, 1
        kind = {1: "read", 5: "write", 15: "write"}.get(frame[1], "other")
        return Request(frame[0], kind, frame[1:-2]), length

    def act(self, request, unit):
        """Carries out a write."""
        at = word(request.detail[1:]) - self.first
        if request.detail[0] == 5:
            unit.put(1 << at, (request.detail[3] == 0xFF) << at)
        else:
            mask = (1 << word(request.detail[3:])) - 1
            unit.put(mask << at, int.from_bytes(request.detail[6:], "little") << at)

    def body(self, request, unit):
        """The reply without its checksum."""
        head, function = [request.unit, request.detail[0]], request.detail[0]
        at, count = word(request.detail[1:]), word(request.detail[3:])
        if function == 1 and at < self.first:
            return bytes([head[0], function | 0x80, 2])
        if function in (1, 2):
            levels = unit.outputs >> at - self.first if function == 1 else unit.inputs >> at
            size = (count + 7) // 8
            return bytes([*head, size]) + (levels & (1 << count) - 1).to_bytes(size, "little")
        if function == 3:
            values = self.registers(request.unit)[at:at + count]
            if len(values) < count:
                return bytes([head[0], function | 0x80, 2])
            return bytes([*head, 2 * count]) + b"".join(v.to_bytes(2, "big") for v in values)
        return bytes(head[:1]) + request.detail[:5]

    @staticmethod
    def seal(body):
        """The frame."""
        return body + crc(body)

    @staticmethod
    def resize(body, step):
        """A reply with one data byte more or less."""
        data = body[3:-1] if step < 0 else body[3:] + b"\x01"
        return bytes([*body[:2], len(data)]) + data

    @staticmethod
    def other_value(body):
        """The reply to a write with another value, or another number of coils."""
        change = bytes([body[4] ^ 0xFF, body[5]]) if body[1] == 5 else bytes([0, body[5] + 1])
        return body[:4] + change

    @staticmethod
    def other_address(body):
        """The reply to a write of the next coil."""
        return body[:3] + bytes([body[3] + 1]) + body[4:]

    @staticmethod
    def refusal(request):
        """Illegal data address."""
        return bytes([request.unit, request.detail[0] | 0x80, 2])

    @staticmethod
    def other_command(body):
        """Inputs, not coils."""
        return bytes([body[0], 2, body[2]]) + bytes(byte ^ 0x0F for byte in body[3:])


class Ascii:
    """The ASCII protocol of the EDA modules, with or without its checksum."""

    def __init__(self, checksum=False):
        self.checksum = checksum

    def take(self, data):
        """The first request in these bytes, and how many of them are consumed."""
        end = data.find(b"\r") + 1
        frame = data[:end].rstrip(b"\r")
        if self.checksum:
            frame, tail = frame[:-2], frame[-2:]
            if tail != b"%02X" % total(frame):
                return None, end
        text = frame.decode("latin-1")
        if len(text) < 4 or text[0] not in "$#%":
            return None, end
        kind = "read" if text[0] == "$" and text[3:] == "6" else "other"
        kind = "write" if text[0] == "#" and len(text) == 7 else kind
        return Request(int(text[1:3], 16), kind, text), end

    @staticmethod
    def act(request, unit):
        """Carries out a write."""
        order, data = int(request.detail[3:5], 16), int(request.detail[5:], 16)
        if order:
            unit.put(1 << (order & 15), data << (order & 15))
        else:
            unit.put(0xFF, data)

    @staticmethod
    def body(request, unit):
        """The reply without its checksum."""
        if request.kind == "read":
            return b"!%02X%02X00" % (unit.outputs, unit.inputs)
        if request.kind == "write":
            return b">"
        data = {"M": "9060", "2": "400600", "3": "000A"}[request.detail[3]]
        return f"!{request.unit:02X}{data}".encode()

    def seal(self, body):
        """The frame."""
        return body + (b"%02X" % total(body) if self.checksum else b"") + b"\r"

    @staticmethod
    def resize(body, step):
        """A reply with two digits more or less."""
        return body[:-2] if step < 0 else b"!00" + body[1:]

    @staticmethod
    def refusal(request):
        """What other makers' modules reply."""
        return b"?%02X" % request.unit

    @staticmethod
    def other_command(_):
        """The name, which is as long as the data."""
        return b"!019060"


class Lc02:
    """LC-02."""

    LENGTHS = {1: 6, 2: 9, 3: 6, 4: 8, 5: 8, 6: 6}

    def take(self, data):
        """The first request in these bytes, and how many of them are consumed."""
        if len(data) < 6:
            return None, 0
        length = self.LENGTHS.get(data[3], 6)
        if len(data) < length:
            return None, 0
        frame = data[:length]
        if frame[:2] != b"\x4C\x57" or total(frame[2:-2]) != frame[-2] or frame[-1] != 0x0D:
            return None, 1
        kind = {3: "read", 4: "write"}.get(frame[3], "other")
        return Request(frame[2], kind, frame[3:-2]), length

    @staticmethod
    def act(request, unit):
        """Carries out a write."""
        _, channel, value = request.detail
        if channel == 0xFF:
            unit.put(0xFF, value)
        else:
            unit.put(1 << channel, value << channel)

    @staticmethod
    def body(request, unit):
        """The reply without its checksum."""
        data = {1: [6, 0x90, 0x50, 0], 3: [unit.outputs, unit.inputs], 6: [0, 10]}
        return bytes([request.unit, *data.get(request.detail[0], [])])

    @staticmethod
    def seal(body):
        """The frame."""
        return b"\x6C\x63" + body + bytes([total(body), 0x0D])

    @staticmethod
    def resize(body, step):
        """A reply with one data byte more or less."""
        return body[:-1] if step < 0 else body[:1] + b"\x00" + body[1:]

    @staticmethod
    def other_address(body):
        """The reply of the other module."""
        return bytes([body[0] ^ 3]) + body[1:]

    @staticmethod
    def other_command(body):
        """The configuration."""
        return bytes([body[0], 6, 0x90, 0x50, 0])


class R55:
    """0x55 boards."""

    @staticmethod
    def take(data):
        """The first request in these bytes, and how many of them are consumed."""
        if len(data) < 8:
            return None, 0
        frame = data[:8]
        if frame[0] != 0x55 or total(frame[:7]) != frame[7]:
            return None, 1
        kind = "read" if frame[2] == 0x10 else "write" if 0x11 <= frame[2] <= 0x15 else "other"
        return Request(frame[1], kind, frame[2:7]), 8

    @staticmethod
    def act(request, unit):
        """Carries out a write."""
        function, data = request.detail[0], int.from_bytes(request.detail[1:], "big")
        one = 1 << data - 1 if function in (0x11, 0x12) else 0
        mask = {0x13: 0xFFFFFFFF, 0x14: data, 0x15: data}.get(function, one)
        unit.put(mask, {0x11: 0, 0x12: one, 0x14: 0}.get(function, data))

    @staticmethod
    def body(request, unit):
        """The reply without its checksum: the state of all outputs."""
        return bytes([0x22, request.unit, request.detail[0]]) + unit.outputs.to_bytes(4, "big")

    @staticmethod
    def seal(body):
        """The frame."""
        return body + bytes([total(body)])

    @staticmethod
    def resize(body, step):
        """A reply with one data byte more or less."""
        return body[:3] + (body[4:] if step < 0 else b"\x00" + body[3:])

    @staticmethod
    def other_value(body):
        """The state without what was written."""
        return body

    @staticmethod
    def other_address(body):
        """The reply of the other board."""
        return body[:1] + bytes([body[1] ^ 3]) + body[2:]

    @staticmethod
    def other_command(body):
        """The reply to 13, set all."""
        return body[:2] + b"\x13" + body[3:-1] + bytes([body[-1] ^ 0x0F])


class TcpPort:
    """A serial server: a TCP port in front of a terminal. `number` is that of the port."""

    def __init__(self, path):
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.number = self._listener.getsockname()[1]
        self._terminal = os.open(path, os.O_RDWR | os.O_NOCTTY)
        self._stop = os.pipe()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        master = None
        while True:
            ends = [self._stop[0], self._listener, self._terminal, *([master] if master else [])]
            ready = select.select(ends, [], [])[0]
            if self._stop[0] in ready:
                break
            if self._listener in ready:
                if master:
                    master.close()
                master = self._listener.accept()[0]
                master.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                continue
            if self._terminal in ready:
                data = os.read(self._terminal, 300)
                if master:
                    master.sendall(data)
            if master in ready:
                data = master.recv(300)
                if data:
                    os.write(self._terminal, data)
                else:
                    master.close()
                    master = None
        if master:
            master.close()

    def close(self):
        """Ends it."""
        os.write(self._stop[1], b"\0")
        self._thread.join()
        self._listener.close()
        for end in (self._terminal, *self._stop):
            os.close(end)


def noise(seed, length):
    """Random bytes, always the same ones."""
    return random.Random(seed).randbytes(length)


class Line:
    """A pseudo-terminal, the modules behind it, and what happens to their replies.

    `play(unit, fault, kind)` sets the fault of the next requests of a kind; see `_answers`.
    """

    def __init__(self, codec, path):
        self.codec, self.path = codec, path
        self.units = {}
        self.echo = False
        # How many more requests are echoed.
        self.echoes = 0
        # A second master sends the same at the same moment, every 0.3 to 0.7 s.
        self.second_master = False
        self._second_at = 0.0
        self.babble = False
        self.trace = []
        self._began = time.monotonic()
        self._faults = {}
        # How many requests each fault was met by.
        self._met = collections.Counter()
        self._strays = []
        # When the line was checked before the last bytes were received.
        self._looked = self._began
        # When the machine got round to it too late.
        self._held_up = []
        # Until then nothing reaches the master, and after it the next request ends that.
        self._held_until, self._held_for = 0.0, 0.0
        self._queue, self._order = [], itertools.count()
        self._lock = threading.Lock()
        self._seen = threading.Condition(self._lock)
        self._counts = collections.Counter()
        self._master = self._slave = None
        self._random = random.Random(path)
        self._stop, self._wake = False, os.pipe()
        self.plug()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def plug(self):
        """Makes the port, and the symlink to it."""
        with self._lock:
            self._master, self._slave = os.openpty()
            tty.setraw(self._slave)
            os.symlink(os.ttyname(self._slave), self.path)
            self._note("plugged in")
        self._nudge()

    def free(self):
        """The program that had the port was killed: it stays locked while we have it open."""
        with self._lock:
            fcntl.ioctl(self._slave, termios.TIOCNXCL)

    def unplug(self):
        """Removes the port."""
        with self._lock:
            os.unlink(self.path)
            master, slave, self._master = self._master, self._slave, None
            os.close(slave)
            os.close(master)
            self._note("unplugged")
        # The port is gone once nothing waits for it.
        self._nudge()

    def close(self):
        """Ends the modules."""
        with self._lock:
            self._stop = True
        self._nudge()
        self._thread.join()
        if self._master is not None:
            self.unplug()
        for end in self._wake:
            os.close(end)

    def play(self, unit, fault, kinds=("read",), times=None):
        """From now on requests of these kinds have this fault, so many times or always."""
        with self._lock:
            for kind in kinds:
                self._faults[unit, kind] = [fault, times]
                self._met[unit, kind] = 0

    def is_met(self, unit):
        """Whether the fault of a module's reads, if there is one, was met by two of them, or by as
        many as it is for."""
        with self._lock:
            fault, times = self._faults.get((unit, "read"), (None, None))
            return fault is None or self._met[unit, "read"] >= min(times or 2, 2)

    def is_readable(self, unit):
        """Whether a module can be read as things are."""
        with self._lock:
            fault, times = self._faults.get((unit, "read"), (None, None))
            is_quiet = self._master is not None and not self.babble
            return is_quiet and (fault in READABLE or times is not None)

    def heal(self):
        """Ends the faults of all modules."""
        with self._lock:
            self._faults.clear()

    def add(self, address, outputs):
        """Adds a module."""
        with self._lock:
            self.units[address] = Unit(outputs)

    def stall(self, seconds):
        """All replies are held up for this long and until the next request; then they arrive at
        once, in their order."""
        with self._lock:
            self._held_until, self._held_for = float("inf"), time.monotonic() + seconds

    def asked(self, unit):
        """How many requests a module got."""
        with self._lock:
            return self._counts[unit]

    def wait_asked(self, unit, count, seconds):
        """Waits until a module got more requests than that."""
        with self._seen:
            self._seen.wait_for(lambda: self._counts[unit] > count, seconds)

    def is_upset(self, at):
        """Whether the machine did not get round to the line shortly before then, or meanwhile:
        replies were later than anything is guaranteed for."""
        with self._lock:
            return any(abs(late - at) <= UPSET for late in self._held_up)

    def wait_idle(self, seconds):
        """Waits until everything late has been sent."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            with self._lock:
                if not self._strays and not self._queue:
                    return
            time.sleep(0.01)

    def _nudge(self):
        os.write(self._wake[1], b"\0")

    def _note(self, what, data=b""):
        after = (time.monotonic() - self._began) * 1000
        self.trace.append(f"{after:8.1f}  {what:10}  {data.hex(' ')}")

    def _later(self, delay, data, overdue=float("inf")):
        due = time.monotonic() + delay
        heapq.heappush(self._queue, (due, next(self._order), data, overdue))

    def _send(self, data, what="<"):
        self._note(what, data)
        if self._master is not None:
            os.write(self._master, data)

    def _stray(self, delay, data):
        due, overdue = time.monotonic() + delay, self._looked + delay + SPARE
        self._strays.append((due, data, overdue))

    def _send_late(self, data, overdue, what="<"):
        """Sends a late or duplicated reply, unless it would be later than nominal."""
        if time.monotonic() > overdue:
            self._note("held up", data)
        else:
            self._send(data, what)

    def _disturbed(self, data):
        """What happens to a reply: two senders at once can't be understood."""
        return self._random.randbytes(len(data)) if self.babble else data

    def _run(self):
        heard, last, babbled, before = b"", 0.0, 0.0, time.monotonic()
        while not self._stop:
            with self._lock:
                now = time.monotonic()
                if now - before > LOOK + SPARE:
                    self._held_up.append(now)
                before = now
                for stray in [stray for stray in self._strays if stray[0] <= now]:
                    self._strays.remove(stray)
                    self._send_late(stray[1], stray[2], "< late")
                while self._queue and max(self._queue[0][0], self._held_until) <= now:
                    _, _, data, overdue = heapq.heappop(self._queue)
                    self._send_late(self._disturbed(data), overdue)
                if self.babble and now >= babbled:
                    self._send(self._random.randbytes(5), "< babble")
                    babbled = now + 0.005
                times = [stray[0] for stray in self._strays]
                dues = [max(due[0], self._held_until) for due in self._queue[:1]]
                times += [due for due in dues if due < float("inf")]
                times += [babbled] if self.babble else []
                wait = max(min([*times, now + LOOK]) - now, 0)
                ports = [self._wake[0]] + ([self._master] if self._master is not None else [])
            ready = select.select(ports, [], [], wait)[0]
            with self._lock:
                if self._wake[0] in ready:
                    os.read(self._wake[0], 64)
                if self._master is None or self._master not in ready:
                    self._looked = now
                    continue
                looked = time.monotonic()
                data = os.read(self._master, 300)
                self._note(">", data)
                if self.echo:
                    self._send(data, "< echo")
                elif self.echoes:
                    self.echoes -= 1
                    self._send(data, "< back")
                elif self.second_master and time.monotonic() >= self._second_at:
                    self._second_at = time.monotonic() + self._random.uniform(0.3, 0.7)
                    self._send(data, "< second")
                now = time.monotonic()
                heard, last = self._hear((heard if now - last < FORGOTTEN else b"") + data), now
                self._looked = looked

    def _hear(self, heard):
        while True:
            request, length = self.codec.take(heard)
            if not length:
                return heard
            heard = heard[length:]
            if request and request.unit in self.units:
                self._answer(request)
                self._counts[request.unit] += 1
                self._seen.notify_all()

    def _answer(self, request):
        if self._held_for < time.monotonic() < self._held_until:
            self._held_until = time.monotonic() + STRAY
        # Late replies come now: into this request's turn.
        behind = 0
        for _, data, overdue in self._strays:
            self._later(STRAY, data, overdue)
            behind = BEHIND
        self._strays.clear()
        for delay, data in self._answers(request):
            self._later(delay + behind, data)

    def _answers(self, request):
        """What the module sends, each part after its delay."""
        codec, unit = self.codec, self.units[request.unit]
        fault = self._faults.get((request.unit, request.kind), [None, None])
        if fault[1] is not None:
            fault[1] -= 1
            if fault[1] < 0:
                fault = [None, None]
        name = fault[0]
        self._met[request.unit, request.kind] += 1
        idle = {"dead", "other_value", "other_address", "refuse", "other_command", "stuck"}
        if request.kind == "write" and name not in idle:
            codec.act(request, unit)
        unit.reads = {"write": 0, "read": unit.reads + 1}.get(request.kind, unit.reads)
        if name == "stuck":
            # It reports the state that it would have if its relay had moved.
            unit = copy.copy(unit)
            codec.act(request, unit)
        body = codec.body(request, unit)
        frame = codec.seal(body)
        match name:
            case None:
                return [(TURNAROUND, frame)]
            case "stuck":
                return [(TURNAROUND, frame)]
            case "dead":
                return []
            case "read_once":
                return [(TURNAROUND, frame)] if unit.reads == 1 else []
            case "slow":
                return [(SLOW, frame)]
            case "slow_module":
                return [(SLOW_MODULE, frame)]
            case "late_within":
                return [(WITHIN, frame)]
            case "late":
                self._stray(LATE, frame)
                return []
            case "twice":
                self._stray(SLOW + AGAIN, frame)
                return [(SLOW, frame)]
            case "glitch_before":
                return [(TURNAROUND, b"\x00" + frame)]
            case "glitch_after":
                return [(TURNAROUND, frame + b"\xFF")]
            case "pieces":
                cuts = [0, len(frame) // 3, 2 * len(frame) // 3, len(frame)]
                parts = [frame[a:b] for a, b in itertools.pairwise(cuts)]
                return [(TURNAROUND + 0.02 * nth, part) for nth, part in enumerate(parts)]
            case "bad_checksum":
                at = len(frame) - 2
                return [(TURNAROUND, frame[:at] + bytes([frame[at] ^ 1]) + frame[at + 1:])]
            case "fewer":
                return [(TURNAROUND, codec.seal(codec.resize(body, -1)))]
            case "more":
                return [(TURNAROUND, codec.seal(codec.resize(body, 1)))]
            case "refuse":
                return [(TURNAROUND, codec.seal(codec.refusal(request)))]
            case "noise":
                return [(TURNAROUND, noise(request.unit, 40)), (TURNAROUND + 0.005, frame)]
            case _:
                return [(TURNAROUND, codec.seal(getattr(codec, name)(body)))]
