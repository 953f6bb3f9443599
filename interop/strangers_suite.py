"""railbus on a line with a board of another maker: it does not take it for one of its families,
and sends it nothing but reads, whatever model it is configured as."""

import json
import os
import pathlib
import select
import subprocess
import sys
import tempfile
import threading
import time
import tty

import strangers
from checksums import crc
from rig import target

HERE = pathlib.Path(__file__).parent
PROGRAM = target() / "debug/railbus"
FAMILIES = ("EDA9060A", "EDA9050", "ERC-8", "EMD-2A2Q", "0x55 board")

# What it is configured as: the model and its protocol.
TAKEN_FOR = (("erc8", "rtu"), ("emd2a2q", "rtu"), ("eda9050", "rtu"), ("eda9060a", "rtu"),
             ("eda9060a", "ascii"), ("eda9050", "ascii"))


def split(buffer):
    """The first whole request in these bytes, and the rest; None while it is incomplete."""
    if buffer[:1] == b"\r":
        return b"", buffer[1:]
    if buffer[:1] in (b"$", b"#", b"%", b"@", b"~"):
        end = buffer.find(b"\r") + 1
        return (buffer[:end], buffer[end:]) if end else (None, buffer)
    size = 6 if buffer[:1] == b"L" else 8
    return (buffer[:size], buffer[size:]) if len(buffer) >= size else (None, buffer)


def only_reads(request):
    """Whether a request only reads."""
    if request[:1] == b"$":
        return request[3:4] in b"M236F" and len(request) in (5, 7)
    if request[:1] == b"L":
        return request[3] in (1, 3, 5)
    if request[:1] == b"\x55" and request[2] in (0x10, 0x40):
        return True
    return crc(request[:-2]) == request[-2:] and request[1] in (1, 2, 3, 4)


class Line:
    """A pseudo-terminal with a stranger at its far end, and all requests that were sent there."""

    def __init__(self, stranger):
        self.near, slave = os.openpty()
        tty.setraw(slave)
        self.port, self.requests, self.closed = os.ttyname(slave), [], False
        self.held, self.process, self.far = slave, None, None
        if isinstance(stranger, str):
            self.far, other = os.openpty()
            tty.setraw(other)
            command = [sys.executable, HERE / "strangers.py", stranger, os.ttyname(other)]
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE,
                                            stderr=subprocess.DEVNULL, text=True)
            self.process.stdout.readline()
            # pymodbus opens the port of a server after it has printed that it did.
            time.sleep(1)
        self.stranger = stranger
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.closed = True
        self.thread.join(5)
        if self.process:
            self.process.kill()
            self.process.wait(5)

    def run(self):
        """Passes requests to the stranger and its replies back."""
        buffer, ends = b"", [end for end in (self.near, self.far) if end is not None]
        while not self.closed:
            ready, _, _ = select.select(ends, [], [], 0.1)
            if self.far in ready:
                os.write(self.near, os.read(self.far, 512))
            if self.near not in ready:
                continue
            buffer += os.read(self.near, 512)
            while buffer:
                request, buffer = split(buffer)
                if request is None:
                    break
                self.requests += [request] if request else []
                if self.far is not None:
                    # A pymodbus server does not recover from bytes that are not Modbus: it detects
                    # no pauses.
                    if crc(request[:-2]) == request[-2:]:
                        os.write(self.far, request)
                elif answer := self.stranger(request):
                    os.write(self.near, answer)


class Tally:
    """One stranger and its result, in the form of the other suites."""

    table, open, covered, inexpressible = "", frozenset(), frozenset(), frozenset()

    def __init__(self, stranger):
        self.passed, self.failures, self.stranger = 0, [], stranger
        with tempfile.TemporaryDirectory(prefix="railbus-interop-") as folder:
            with Line(stranger) as line:
                self.run(line, pathlib.Path(folder) / "railbus.toml")

    def check(self, good, what):
        """Counts."""
        if good:
            self.passed += 1
        else:
            self.failures.append(what)

    def run(self, line, file):
        """A scan, the same with all that it would add, and changes of what it is not."""
        port, addr = f"pty:{line.port}", str(strangers.ADDRESS)

        def railbus(*words):
            return subprocess.run(
                [PROGRAM, *words], capture_output=True, text=True, check=False,
                cwd=file.parent, env=os.environ | {"XDG_STATE_HOME": str(file.parent)},
            )

        scan = ["scan", "--direct", "-l", port, "--addr", addr]
        ran = railbus(*scan, "-o", "json")
        found = json.loads(ran.stdout)["found"] if ran.stdout else None
        self.check(found is not None, f"scan: {ran.stderr[-300:]}")
        answers = self.stranger not in (strangers.echo, strangers.slow)
        self.check(bool(found) or not answers, "nobody was found")
        for one in found or []:
            named = one["model"] in FAMILIES or one["verdict"] == "ok"
            self.check(not named, f"scan: {one}")
        railbus(*scan, "--add", "--yes")
        text = file.read_text() if file.exists() else ""
        self.check("[module." not in text, f"scan --add wrote {text}")
        for model, protocol in TAKEN_FOR:
            file.write_text(
                f'[line.main]\nport = "{port}"\n[module.it]\nline = "main"\nmodel = "{model}"\n'
                f'address = {addr}\nprotocol = "{protocol}"\n'
            )
            ran = railbus("--direct", "config", "set", "it", "address=9", "--yes")
            self.check(ran.returncode != 0, f"config set as {model} in {protocol}: {ran.stdout}")
        written = [request.hex(" ") for request in line.requests if not only_reads(request)]
        self.check(not written, f"no reads: {written}")


SUITES = [
    (f"stranger, {name}", lambda stranger=stranger: Tally(stranger))
    for name, stranger in strangers.STRANGERS.items()
]
