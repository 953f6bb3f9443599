"""ASCII, LC-02 and 0x55 in a plain script: codec and port are all here, and nothing is imported
that knows these protocols. The requests are in `plain_ascii.py`, `plain_lc02.py` and
`plain_r55.py`."""

import os
import select
import termios
import time

from rig import Rig, Tally

SPEEDS = {3: 1200, 4: 2400, 5: 4800, 6: 9600, 7: 19200}
# How long to wait for a reply that must come, in seconds.
PATIENCE = 10.0


def total(data):
    """The low byte of the sum, which all three protocols use."""
    return sum(data) & 0xFF


def text(body, checksum=False):
    """An ASCII frame, request or reply: `$01M`."""
    data = body.encode()
    return data + (f"{total(data):02X}".encode() if checksum else b"") + b"\r"


def lc02(address, command, *data):
    """An LC-02 request."""
    body = bytes([address, command, *data])
    return b"\x4C\x57" + body + bytes([total(body), 0x0D])


def lc02_reply(address, *data):
    """The reply to one."""
    body = bytes([address, *data])
    return b"\x6C\x63" + body + bytes([total(body), 0x0D])


def r55(address, function, word=0, start=0x55):
    """A request to a 0x55 board."""
    body = bytes([start, address, function]) + word.to_bytes(4, "big")
    return body + bytes([total(body)])


def r55_reply(address, function, word=0):
    """The reply to one."""
    return r55(address, function, word, 0x22)


def rtu(*body):
    """A Modbus frame, which modules in these protocols must ignore."""
    crc = 0xFFFF
    for byte in body:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return bytes(body) + crc.to_bytes(2, "little")


class Port:
    """A serial port in raw mode."""

    def __init__(self, path):
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        self.rate = 0
        self.speed(9600)

    def close(self):
        """Closes the port."""
        os.close(self.fd)

    def speed(self, rate):
        """Sets the speed, and raw mode with it."""
        code = getattr(termios, f"B{rate}")
        control = termios.CS8 | termios.CREAD | termios.CLOCAL
        termios.tcsetattr(self.fd, termios.TCSANOW,
                          [0, 0, control, 0, code, code, termios.tcgetattr(self.fd)[6]])
        self.rate = rate

    def send(self, data):
        """Sends; the wire takes its time."""
        os.write(self.fd, data)

    def hear(self, count, seconds):
        """At most this many bytes, within this many seconds."""
        deadline = time.monotonic() + seconds
        heard = b""
        while len(heard) < count:
            left = deadline - time.monotonic()
            if not select.select([self.fd], [], [], max(left, 0))[0]:
                break
            heard += os.read(self.fd, count - len(heard))
        return heard


class Script:
    """One line, and a suite on it."""

    def __init__(self, table, *modules):
        self.tally = Tally(table)
        self.rig = Rig(*modules)
        self.port = Port(self.rig.port)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.port.close()
        self.rig.__exit__()

    def ask(self, entries, request, reply=b""):
        """Sends a request: exactly this reply must come, or none."""
        surplus = self.port.hear(256, 0)
        self.port.send(request)
        got = self.port.hear(len(reply), PATIENCE) if reply else self.unwanted()
        what = f"{request.hex(' ')} ({request!r})"
        self.tally.check(entries, (surplus + got).hex(" "), reply.hex(" "), what)

    def unwanted(self):
        """What came although nothing should have: the rig knows how much that is, not our clock."""
        return self.port.hear(self.rig.silence(), PATIENCE)

    def check(self, entries, got, want, what="the rig"):
        """A check of something else than a reply."""
        self.tally.check(entries, got, want, what)

    def do(self, command):
        """Runs a command at the panel."""
        return self.rig.do(command)

    def settle(self):
        """Waits until the wire has carried what was sent without a reply."""
        self.ask("", b"", b"")


def _collect():
    # At the end, since these modules import this one.
    import plain_ascii
    import plain_lc02
    import plain_r55

    return [*plain_r55.SUITES, *plain_ascii.SUITES, *plain_lc02.SUITES]


SUITES = _collect()
