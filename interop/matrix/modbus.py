"""The same faults seen through Modbus TCP: what a master is told of the units while they happen.

A master reads both units all the time. Each value that it is told has to be one that the unit had
since the value could at the earliest have been read; everything else is false, whatever was asked
for at that moment. A read is `right` if the true value is told in the end, and `safe` if it is an
exception. A write is `right` if its normal answer is true, and `safe` if it is an exception.
"""

import socket
import struct
import threading
import time

from injector import Unit

# How old a value may be, in seconds, and how much later it may be told: the daemon says within
# 0.1 s that it is old, but a busy machine may not get round to it.
MAX_AGE = 1.0
LATE = 2.0
# How long until a read is `safe`: long enough for a unit that answers to be found again.
FOUND = 10.0
# How long a master waits for an answer.
ANSWER = 15.0
APART = 0.02
# What the units hold, also with all of their first four outputs switched: never the same.
OUTPUTS = {1: 0x21, 2: 0xDA}

READ_COILS, WRITE_COIL = 1, 5


class Watched(Unit):
    """A unit that remembers when its outputs were what."""

    def __init__(self, outputs, inputs=0):
        self.past = []
        super().__init__(outputs, inputs)

    @property
    def outputs(self):
        """What they are now."""
        return self.past[-1][1]

    @outputs.setter
    def outputs(self, outputs):
        # One tuple at a time: other threads read it.
        self.past = [*self.past, (time.monotonic(), outputs)]

    def had(self, bits, since):
        """Whether the first four outputs were these at any moment since then."""
        past = self.past
        ends = [at for at, _ in past[1:]] + [float("inf")]
        return any(end >= since and outputs & 0x0F == bits
                   for (_, outputs), end in zip(past, ends))


class Refused(Exception):
    """An exception of Modbus."""


class Master:
    """A Modbus TCP master."""

    def __init__(self, port):
        self.stream = socket.create_connection(("127.0.0.1", port), ANSWER)
        # When it was first answered.
        self.number, self.answered = 0, None

    def close(self):
        """Goes."""
        self.stream.close()

    def ask(self, unit, function, first, second):
        """The data of the answer."""
        self.number = (self.number + 1) & 0xFFFF
        self.stream.sendall(struct.pack(">HHHBBHH", self.number, 0, 6, unit, function, first,
                                        second))
        number, _, length = struct.unpack(">HHH", self._take(6))
        answer = self._take(length)
        self.answered = self.answered or time.monotonic()
        if number != self.number or answer[0] != unit:
            raise AssertionError(f"an answer to another request: {answer.hex()}")
        if answer[1] == function | 0x80:
            raise Refused(f"{answer[2]:02X}")
        return answer[2:]

    def _take(self, count):
        data = b""
        while len(data) < count:
            piece = self.stream.recv(count - len(data))
            if not piece:
                raise ConnectionError("the server has closed")
            data += piece
        return data

    def outputs(self, unit):
        """The first four outputs of a unit, as bits."""
        return self.ask(unit, READ_COILS, 0, 4)[1] & 0x0F

    def switch_on(self, unit, nth):
        """Switches an output on."""
        self.ask(unit, WRITE_COIL, nth, 0xFF00)


class Asked:
    """A request in progress, and how it ends; as `Client` of the other columns."""

    def __init__(self, case, what, work):
        # How long the first answer took.
        self.end, self.took = "WRONG: hangs", ANSWER
        self.case, self.what = case, what
        self.thread = threading.Thread(target=self._run, args=(work,), daemon=True)
        self.thread.start()

    def _run(self, work):
        began = time.monotonic()
        master = Master(self.case.port)
        try:
            self.end = work(master)
        except (OSError, AssertionError) as error:
            self.end = f"WRONG: {type(error).__name__}: {error}"
        finally:
            master.close()
        self.took = (master.answered or time.monotonic()) - began
        self.case.log.append(f"{self.what}: {self.end} in {self.took:.2f} s")

    def wait(self):
        """How it ended."""
        self.thread.join()
        return self.end


class Watch:
    """A master that reads all units all the time, until it is closed."""

    def __init__(self, case):
        self.case, self.false, self.told = case, [], 0
        self.closed = threading.Event()
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self):
        try:
            master = Master(self.case.port)
            while not self.closed.wait(APART):
                for unit in OUTPUTS:
                    self._look(master, unit)
            master.close()
        except (OSError, AssertionError) as error:
            if not self.closed.is_set():
                self.false.append(f"{type(error).__name__}: {error}")

    def _look(self, master, unit):
        asked = time.monotonic()
        try:
            bits = master.outputs(unit)
        except Refused:
            return
        self.told += 1
        if not self.case.line.units[unit].had(bits, asked - MAX_AGE - LATE):
            self.false.append(f"unit {unit} is {bits:04b}")

    def close(self):
        """Ends it; what it was told that was false."""
        self.closed.set()
        self.thread.join(ANSWER)
        return self.false


def free_port():
    """A port that nobody listens at."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def settings(port):
    """The server in the configuration of the daemon."""
    return (f'[outlet.scada]\ntype = "modbus_tcp"\nlisten = "127.0.0.1:{port}"\n'
            'map = "uniform"\nwrite = ["*"]\n')


def reading(case, unit):
    """Starts a read of the outputs of a unit."""
    def work(master):
        last, end = "none", time.monotonic() + FOUND
        while time.monotonic() < end:
            asked = time.monotonic()
            try:
                bits = master.outputs(unit)
            except Refused as refused:
                last = f"safe {refused}"
            else:
                watched = case.line.units[unit]
                if not watched.had(bits, asked - MAX_AGE - LATE):
                    return f"WRONG: told {bits:04b}"
                if watched.had(bits, asked):
                    return "right"
                last = "WRONG: an old value"
            time.sleep(APART)
        return last

    return Asked(case, f"read of unit {unit}", work)


def writing(case, unit):
    """Starts a write that switches on the first output that is off."""
    watched = case.line.units[unit]
    nth = min(nth for nth in range(4) if not watched.outputs >> nth & 1)

    def work(master):
        # A unit of which nothing is known yet can be commanded, too.
        try:
            master.switch_on(unit, nth)
        except Refused as refused:
            return f"safe {refused}"
        is_on = bool(watched.outputs >> nth & 1)
        return "right" if is_on else "WRONG: success, but nothing was switched"

    return Asked(case, f"write to unit {unit}", work)
