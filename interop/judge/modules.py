"""Modules of all five families as their datasheets describe them: frames, outputs, timed outputs.

Nothing of the project's own code is used here. A module acts on a frame, and logs in the world
what it was commanded and what its relays did; what happens to its reply is up to the line.
"""

import collections
import threading

from checksums import crc, total

Act = collections.namedtuple("Act", "lo hi kind value frame answered")
Act.__doc__ = """A command for one relay that a module carried out. It arrived between `lo` and
`hi`; `kind` is `set`, `toggle` or `timed`; `answered` says whether a reply was sent."""

Reply = collections.namedtuple("Reply", "lo sent states clean")
Reply.__doc__ = "A reading of outputs: the states told, and whether it came unspoilt in time."


class World:
    """What really happened, by the judge's own clock."""

    def __init__(self):
        self.changes = collections.defaultdict(list)
        self.acts = collections.defaultdict(list)
        self.replies = collections.defaultdict(list)
        # Periods in which a relay, a module or a line had a fault.
        self.troubles = collections.defaultdict(list)
        # When the test's own machine sent a reply later than guaranteed, by line.
        self.overdue = collections.defaultdict(list)
        # Periods in which the replies of a line were held up longer than guaranteed.
        self.stalls = collections.defaultdict(list)
        self.lines = {}
        self.frames = 0
        self.lock = threading.Lock()

    def change(self, relay, when, value, cause):
        """A relay or an input has this state from now on."""
        changes = self.changes[relay]
        if not changes or changes[-1][1] != value:
            changes.append((when, value, cause))

    def trouble(self, what, since, until=None):
        """Something has a fault from then on, or had one until then."""
        self.troubles[what].append([since, until])

    def stall(self, line, since, until):
        """The replies of a line are held up for this long."""
        stalls = self.stalls[line]
        if stalls and stalls[-1][1] >= since:
            stalls[-1][1] = until
        else:
            stalls.append([since, until])

    def trouble_ends(self, what, until):
        """The fault has ended."""
        for stretch in self.troubles[what]:
            if stretch[1] is None:
                stretch[1] = until


def word(data):
    """Two bytes as a number."""
    return data[0] << 8 | data[1]


class Module:
    """A module. `labels` are those of its outputs, `inputs` those of its inputs."""

    protocol = ""
    # Whether a garbled reply can be told from a good one.
    has_checksum = True
    # Whether its data replies contain its address.
    names_itself = True

    def __init__(self, world, name, address, outputs, inputs=()):
        self.world, self.name, self.address = world, name, address
        self.labels = [f"{name}.{label}" for label in outputs]
        self.inputs = [f"{name}.{label}" for label in inputs]
        self.state, self.levels = 0, 0
        self.powered, self.stuck, self.welded, self.deaf = True, 0, 0, False
        # When its last reply has been sent.
        self.busy_until = 0.0
        # Outputs that change by themselves: channel -> (when, to what).
        self.due = {}
        # Outputs that give pulses, and how long in seconds.
        self.pulse_mask, self.width = 0, 1.0
        for relay in self.labels + self.inputs:
            world.change(relay, 0.0, False, "at the beginning")

    def settle(self, now):
        """Timed outputs that have ended by now."""
        for channel, (when, value) in sorted(self.due.items()):
            if when <= now:
                del self.due[channel]
                self._move(channel, value, when, "its own time is up")

    def _move(self, channel, value, when, cause):
        bit = 1 << channel
        if self.stuck & bit or (self.welded & bit and not value):
            return
        self.state = self.state & ~bit | bit * value
        self.world.change(self.labels[channel], when, bool(value), cause)

    def order(self, seen, channel, value, kind="set", after=None):
        """Switches one output; `after` is when it switches back by itself."""
        if channel >= len(self.labels):
            return
        lo, hi, frame = seen
        bit = 1 << channel
        if kind == "toggle":
            value = not self.state & bit
        if kind == "set" and self.pulse_mask & bit:
            if not value:
                return
            kind, after = "timed", self.width
        self.due.pop(channel, None)
        if after is not None:
            self.due[channel] = (hi + after, not value)
        self.world.acts[self.labels[channel]].append(Act(lo, hi, kind, bool(value), frame, True))
        self._move(channel, value, hi, f"frame {frame}")

    def orders(self, seen, mask, on, kind="set"):
        """Switches several outputs."""
        for channel in range(len(self.labels)):
            if mask >> channel & 1:
                self.order(seen, channel, bool(on >> channel & 1), kind)

    def unanswered(self, frame):
        """The reply to that frame was not sent."""
        for relay in self.labels:
            acts = self.world.acts[relay]
            if acts and acts[-1].frame == frame:
                acts[-1] = acts[-1]._replace(answered=False)

    def set_power(self, on, now):
        """Switches its supply off or on; without it outputs drop."""
        self.settle(now)
        if not on:
            self.due.clear()
            self.powered = False
            for channel in range(len(self.labels)):
                self._move(channel, False, now, "no power")
            self.world.trouble(self.name, now)
        else:
            self.powered = True
            self.world.trouble_ends(self.name, now)

    def exchange(self, now):
        """Replaces it by another module of the same kind."""
        self.set_power(False, now)
        self.set_power(True, now)

    def set_levels(self, levels, now):
        """Sets the inputs."""
        self.levels = levels
        for channel, path in enumerate(self.inputs):
            self.world.change(path, now, bool(levels >> channel & 1), "an input changes")

    def told(self):
        """What a reading of its outputs reports now, by relay."""
        return {relay: bool(self.state >> nth & 1) for nth, relay in enumerate(self.labels)}


class Rtu(Module):
    """Modbus RTU: coils from `first` on. `registers` answers function 3, where there is one."""

    protocol = "rtu"
    first = 0
    speaks_exceptions = False

    @staticmethod
    def take(data):
        """The length of the request at the beginning of these bytes; 0 if there is none."""
        if len(data) < 8:
            return 0
        length = 9 + data[6] if data[1] in (0x0F, 0x10) else 8
        if len(data) < length or crc(data[:length - 2]) != data[length - 2:length]:
            return 0
        return length

    def is_for(self, frame):
        """Whether the request is for this module."""
        return frame[0] == self.address

    def register(self, _number):
        """The value of a holding register; None if it does not exist."""
        return None

    def act(self, frame, seen):
        """Carries out a frame. Returns the reply, and whether it reports the outputs."""
        function, at, count = frame[1], word(frame[2:]), word(frame[4:])
        body = self._body(function, at, count, frame, seen)
        if body is None:
            if not self.speaks_exceptions:
                return None, False
            body = bytes([frame[0], function | 0x80, 2])
        return body + crc(body), function == 1

    def _body(self, function, at, count, frame, seen):
        head, at = bytes([frame[0], function]), at - (self.first if function in (1, 5, 15) else 0)
        size = len(self.labels if function in (1, 5, 15) else self.inputs)
        if function in (1, 2):
            if not (0 <= at and 0 < count and at + count <= self.span(function, size)):
                return None
            levels = self.state if function == 1 else self.levels
            data = (levels >> at & (1 << count) - 1).to_bytes((count + 7) // 8, "little")
            return head + bytes([len(data)]) + data
        if function == 3:
            values = [self.register(number) for number in range(at, at + count)]
            if not values or None in values:
                return None
            return head + bytes([2 * count]) + b"".join(v.to_bytes(2, "big") for v in values)
        if function == 5 and 0 <= at < size and count in (0, 0xFF00):
            self.order(seen, at, count == 0xFF00)
            return frame[:6]
        if function == 15 and 0 <= at and at + count <= self.span(1, size):
            on = int.from_bytes(frame[7:7 + frame[6]], "little")
            self.orders(seen, (1 << count) - 1 << at, on << at)
            return frame[:6]
        return None

    def span(self, _function, size):
        """How many bits the map has."""
        return size


class Erc8(Rtu):
    """ERC-8: eight relays at the coils 60 to 67."""

    model = "erc8"
    first = 60
    speaks_exceptions = True

    def __init__(self, world, name, address):
        super().__init__(world, name, address, [f"k{n}" for n in range(1, 9)])

    def register(self, number):
        """Address, baud code, parity."""
        return {0: self.address, 1: 1, 2: 0}.get(number)


class Emd(Rtu):
    """EMD-2A2Q: two relays at the coils 8 and 9, two analog inputs."""

    model = "emd2a2q"
    first = 8
    speaks_exceptions = True

    def __init__(self, world, name, address):
        super().__init__(world, name, address, ["k1", "k2"])

    def register(self, number):
        """Version, address, baud code, parity, calibration, its command bits, two values."""
        values = [0x0100, self.address, 2, 0, 500, 0, 321, 654]
        return values[number] if number < len(values) else None


def eda_labels(count):
    """The labels of an EDA module's outputs and inputs."""
    outputs = [f"do{n}" for n in range(count)]
    return outputs, [f"di{n}" for n in range(4 if count == 4 else 7)]


class EdaRtu(Rtu):
    """EDA9060A on Modbus RTU: 16 coils of which four are relays."""

    model = "eda9060a"

    def __init__(self, world, name, address):
        super().__init__(world, name, address, *eda_labels(4))

    def span(self, _function, _size):
        """Four channels, the rest is reserved."""
        return 16

    def register(self, number):
        """Model, address and baud, pulses, protocol."""
        pulses = self.pulse_mask << 8 | round(self.width * 10)
        values = [0x9060, self.address << 8 | 6, pulses, 0]
        return values[number] if number < len(values) else None


class EdaAscii(Module):
    """An EDA module in its ASCII protocol. `is_old`: an EDA9060 from before it had pulses."""

    protocol = "ascii"
    names_itself = False

    def __init__(self, world, name, address, count, checksum=True, is_old=False):
        super().__init__(world, name, address, *eda_labels(count))
        self.model = "eda9060a" if count == 4 else "eda9050"
        self.has_checksum, self.is_old = checksum, is_old

    @staticmethod
    def take(data):
        """A delimiter, then everything up to the carriage return."""
        end = data.find(b"\r") + 1
        return end if data[:1] in b"$#%" and end else 0

    def is_for(self, frame):
        """Whether the request is for this module, with a correct checksum if it uses one."""
        text = frame[:-1]
        if self.has_checksum:
            if text[-2:] != b"%02X" % total(text[:-2]):
                return False
            text = text[:-2]
        return len(text) >= 4 and text[1:3] == b"%02X" % self.address

    def act(self, frame, seen):
        """Carries out a frame. Returns the reply, and whether it reports the outputs."""
        text = frame[:-3 if self.has_checksum else -1].decode("latin-1")
        own, command = f"!{self.address:02X}", text[3:]
        reply = None
        if text[0] == "$":
            reply = {
                "M": own + ("9060" if len(self.labels) == 4 else "9050"),
                "2": own + "4006" + ("40" if self.has_checksum else "00"),
                "6": f"!{self.state:02X}{self.levels:02X}00",
            }.get(command)
            if command == "3" and len(self.labels) == 4 and not self.is_old:
                reply = f"{own}{self.pulse_mask:02X}{round(self.width * 10):02X}"
        elif text[0] == "#" and len(command) == 4:
            try:
                order, data = int(command[:2], 16), int(command[2:], 16)
            except ValueError:
                return None, False
            if order == 0 and data < 1 << len(self.labels):
                self.orders(seen, (1 << len(self.labels)) - 1, data)
                reply = ">"
            elif order >> 4 == 1 and order & 15 < len(self.labels) and data < 2:
                self.order(seen, order & 15, bool(data))
                reply = ">"
        if reply is None:
            return None, False
        body = reply.encode()
        body += b"%02X" % total(body) if self.has_checksum else b""
        return body + b"\r", text[0] == "$" and command == "6"


class EdaLc02(Module):
    """An EDA module in LC-02."""

    protocol = "lc02"
    LENGTHS = {1: 6, 2: 9, 3: 6, 4: 8, 5: 8, 6: 6}

    def __init__(self, world, name, address, count):
        super().__init__(world, name, address, *eda_labels(count))
        self.model = "eda9060a" if count == 4 else "eda9050"

    @classmethod
    def take(cls, data):
        """The length depends on the command."""
        length = cls.LENGTHS.get(data[3], 0) if len(data) >= 6 else 0
        good = length and len(data) >= length and data[:2] == b"\x4C\x57"
        good = good and data[length - 1] == 0x0D and total(data[2:length - 2]) == data[length - 2]
        return length if good else 0

    def is_for(self, frame):
        """Whether the request is for this module."""
        return frame[2] == self.address

    def act(self, frame, seen):
        """Carries out a frame. Returns the reply, and whether it reports the outputs."""
        command, count = frame[3], len(self.labels)
        data = None
        if command == 1:
            data = [6, 0x90, 0x60 if count == 4 else 0x50, 0]
        elif command == 3:
            data = [self.state, self.levels]
        elif command == 4:
            channel, value = frame[4], frame[5]
            if channel == 0xFF and value < 1 << count:
                self.orders(seen, (1 << count) - 1, value)
                data = []
            elif channel < count and value < 2:
                self.order(seen, channel, bool(value))
                data = []
        elif command == 6 and count == 4:
            data = [self.pulse_mask, round(self.width * 10)]
        if data is None:
            return None, False
        body = bytes([self.address, *data])
        return b"\x6C\x63" + body + bytes([total(body), 0x0D]), command == 3


class R55(Module):
    """A 0x55 board of relays."""

    protocol = "r55"
    model = "r55"

    def __init__(self, world, name, address, count=8):
        super().__init__(world, name, address, [f"k{n}" for n in range(1, count + 1)])

    @staticmethod
    def take(data):
        """Always eight bytes."""
        return 8 if len(data) >= 8 and data[0] == 0x55 and total(data[:7]) == data[7] else 0

    def is_for(self, frame):
        """Whether the request is for this board."""
        return frame[1] == self.address

    def act(self, frame, seen):
        """Carries out a frame. Returns the reply, and whether it reports the outputs."""
        function, data = frame[2], int.from_bytes(frame[3:7], "big")
        silent = {0x30: 0x20, 0x37: 0x21, 0x38: 0x22}
        plain = silent.get(function, function - 0x20 if 0x31 <= function <= 0x36 else function)
        everything, channel = (1 << len(self.labels)) - 1, frame[6] - 1
        if plain in (0x11, 0x12, 0x20, 0x21, 0x22) and not 0 <= channel < len(self.labels):
            return None, False
        match plain:
            case 0x10:
                pass
            case 0x40:
                body = bytes([0x22, self.address, function, 0, 0, 0, self.address])
                return body + bytes([total(body)]), False
            case 0x11 | 0x12:
                self.order(seen, channel, plain == 0x12)
            case 0x13:
                self.orders(seen, everything, data)
            case 0x14:
                self.orders(seen, data, 0)
            case 0x15:
                self.orders(seen, data, data)
            case 0x16:
                self.orders(seen, data, 0, "toggle")
            case 0x20:
                self.order(seen, channel, True, "toggle")
            case 0x21 | 0x22:
                seconds = int.from_bytes(frame[3:6], "big") / 1000
                self.order(seen, channel, plain == 0x21, "timed", seconds)
            case _:
                return None, False
        if plain != function:
            return None, False
        body = bytes([0x22, self.address, function]) + self.state.to_bytes(4, "big")
        return body + bytes([total(body)]), function == 0x10
