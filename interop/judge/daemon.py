"""The program under test: its configuration, its process, and requests to it."""

import base64
import http.client
import json
import os
import pathlib
import signal
import socket
import struct
import subprocess
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
# The timeout of everything.
PATIENCE = 20.0
# The daemon closes idle connections; one that was idle for this long is not used again.
IDLE_MAX = 5.0


def program():
    """The program: the one the tests have built, or the one in RAILBUS."""
    named = os.environ.get("RAILBUS")
    folder = ROOT / os.environ.get("CARGO_TARGET_DIR", "target")
    return pathlib.Path(named) if named else folder / "debug/railbus"


def build(always=False):
    """Builds it, unless RAILBUS names one. With one of its tests, as xtask does: cargo has built it
    with the same features for all tests then, and has nothing to do."""
    if os.environ.get("RAILBUS") and not always:
        return
    command = [os.environ.get("CARGO", "cargo"), "build", "--quiet", "--workspace",
               "--bin=railbus", "--test=packaging",
               "--target-dir", str(ROOT / os.environ.get("CARGO_TARGET_DIR", "target"))]
    subprocess.run(command, check=True, cwd=ROOT)


def config(lines, groups=(), scenes=(), poll="250ms", bauds=None):
    """The text of a configuration of these lines."""
    text = ""
    for line in lines:
        baud = (bauds or {}).get(line.name, 19200)
        text += f'[line.{line.name}]\nport = "pty:{line.path}"\nbaud = {baud}\n\n'
        for module in line.modules:
            text += f'[module.{module.name}]\nline = "{line.name}"\nmodel = "{module.model}"\n'
            text += f'address = {module.address}\nprotocol = "{module.protocol}"\n'
            text += f'poll = "{poll}"\nmax_age = "2s"\n'
            if module.protocol == "ascii":
                text += f"checksum = {str(module.has_checksum).lower()}\n"
            if module.model == "r55":
                text += f"baud = 9600\noutputs = {len(module.labels)}\ninputs = 0\n"
            text += "\n"
    for name, members in groups:
        text += f"[group.{name}]\nmembers = {json.dumps(list(members))}\n\n"
    for name, steps in scenes:
        steps = ", ".join(f'{{ set = "{path}", to = {str(to).lower()} }}' for path, to in steps)
        text += f"[scene.{name}]\nsteps = [{steps}]\n\n"
    return text


class OverSocket(http.client.HTTPConnection):
    """HTTP over the daemon's socket."""

    def __init__(self, path):
        super().__init__("localhost", timeout=PATIENCE)
        self.path = path

    def connect(self):
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(self.timeout)
        self.sock.connect(self.path)


class Daemon:
    """The daemon, which may be killed and started again. `lives` are its starts and ends."""

    def __init__(self, folder, text):
        self.folder = pathlib.Path(folder)
        self.socket = str(self.folder / "socket")
        self.config = self.folder / "railbus.toml"
        self.config.write_text(text, encoding="utf-8")
        self.process = None
        # [since, signalled, until, signal] of each process; None while it runs.
        self.lives = []
        self.log = open(self.folder / "log", "ab")
        self._local = threading.local()

    def start(self):
        """Starts it and waits until it answers."""
        environment = {**os.environ, "RAILBUS_LANG": "en",
                       "RAILBUS_STATE": str(self.folder / "state")}
        environment.pop("RAILBUS_CONFIG", None)
        command = [program(), "serve", "--config", self.config, "--socket", self.socket,
                   "--listen", "127.0.0.1:0"]
        self.lives.append([time.monotonic(), None, None, ""])
        self.process = subprocess.Popen(command, stdout=self.log, stderr=self.log,
                                        env=environment, cwd=self.folder)
        deadline = time.monotonic() + PATIENCE
        while True:
            try:
                if self.ask("GET", "/lines")[0] == 200:
                    return
            except OSError:
                pass
            if self.process.poll() is not None or time.monotonic() > deadline:
                tail = (self.folder / "log").read_text(errors="replace")[-2000:]
                raise RuntimeError(f"the daemon does not start: {tail}")
            time.sleep(0.01)

    def end(self, how):
        """Sends it this signal and waits for its end."""
        life = self.lives[-1]
        life[1], life[3] = time.monotonic(), how
        self.process.send_signal(signal.SIGKILL if how == "KILL" else signal.SIGTERM)
        try:
            self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            life[3] = "HUNG"
        life[2] = time.monotonic()

    def close(self):
        """Stops it, if it runs."""
        if self.process and self.process.poll() is None:
            self.end("TERM")
        self.log.close()

    def ask(self, method, path, body=None, headers=None):
        """Sends a request; returns status and JSON. OSError: no answer."""
        connection = getattr(self._local, "connection", None)
        if connection is None or time.monotonic() - self._local.used > IDLE_MAX:
            if connection:
                connection.close()
            connection = self._local.connection = OverSocket(self.socket)
        self._local.used = time.monotonic()
        text = None if body is None else json.dumps(body)
        try:
            connection.request(method, "/api/v1" + path, text, headers or {})
            answer = connection.getresponse()
            data = answer.read()
        except (http.client.HTTPException, OSError) as error:
            connection.close()
            self._local.connection = None
            raise OSError(str(error)) from error
        return answer.status, json.loads(data) if data else None

    def send_signal_at(self, when, how):
        """Kills it at that moment, whatever is in progress."""
        time.sleep(max(when - time.monotonic(), 0))
        self.end(how)


class Follower:
    """A WebSocket that passes each message to `take`, with the time at which it came."""

    def __init__(self, daemon, topics, take):
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.settimeout(PATIENCE)
        self.socket.connect(daemon.socket)
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(
            f"GET /api/v1/ws HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\n"
            f"Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n\r\n"
            .encode())
        self.rest = b""
        while b"\r\n\r\n" not in self.rest:
            self.rest += self._more()
        head, self.rest = self.rest.split(b"\r\n\r\n", 1)
        if b" 101 " not in head.split(b"\r\n")[0]:
            raise OSError(f"no WebSocket: {head[:80]}")
        self._write(1, json.dumps({"sub": topics}).encode())
        self.take = take
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _more(self):
        data = self.socket.recv(65536)
        if not data:
            raise OSError("closed")
        return data

    def _need(self, count):
        while len(self.rest) < count:
            self.rest += self._more()
        data, self.rest = self.rest[:count], self.rest[count:]
        return data

    def _write(self, opcode, data):
        mask = os.urandom(4)
        size = bytes([0x80 | len(data)])
        if len(data) >= 126:
            size = b"\xfe" + struct.pack(">H", len(data))
        masked = bytes(byte ^ mask[nth % 4] for nth, byte in enumerate(data))
        self.socket.sendall(bytes([0x80 | opcode]) + size + mask + masked)

    def _run(self):
        try:
            while True:
                first, size = self._need(2)
                size &= 0x7F
                if size == 126:
                    size = struct.unpack(">H", self._need(2))[0]
                elif size == 127:
                    size = struct.unpack(">Q", self._need(8))[0]
                data = self._need(size)
                if first & 15 == 9:
                    self._write(10, data)
                elif first & 15 == 1:
                    self.take(time.monotonic(), json.loads(data))
                elif first & 15 == 8:
                    return
        except OSError:
            return

    def close(self):
        """Stops receiving."""
        try:
            self.socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self.socket.close()
        self.thread.join()
