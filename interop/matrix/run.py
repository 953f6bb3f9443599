"""The fault matrix: what two modules can do wrong, in every protocol, against the real program.

A scripted pair of modules (`injector.py`) sits behind a pseudo-terminal; `railbus serve` has the
terminal; a client runs `railbus get` and `railbus set`. Each request ends

- `right`: the true value, or a success that is true,
- `safe`: an error with its code and an exit code that is not 0,
- `false`: a wrong value where nothing is guaranteed: the reply came later than 0.5 s,
- `WRONG`: anything else, such as a false value, the success of a write that never happened, or
  nothing within 15 s.

The columns of outlets ask through these instead (`by_*.py`), and somebody follows them: see
`outlets.py`.

The expected ends are in `ROWS`; those of the last run are in `../matrix.md`. By hand, from the root
of the repository: `target/interop-venv/bin/python interop/matrix/run.py [--write] [--trace]
[WORD...]`, where words select the cases that have one of them in their names, `--write` updates the
table (never with a `WRONG`), and `--trace` keeps the output of all cases, not only of those that
failed.
"""

import collections
import concurrent.futures
import http.client
import json
import os
import pathlib
import socket
import subprocess
import sys
import tempfile
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import commands
import outlets
from by_modbus import ByModbus
from by_mqtt import ByMqtt
from by_opcua import ByOpcua
from by_sparkplug import BySparkplug
from injector import Ascii, Lc02, Line, R55, Rtu, TcpPort, Unit

ROOT = HERE.parent.parent
TABLE = HERE.parent / "matrix.md"
# The output of the cases that failed.
LOG = ROOT / "target/fault-matrix.log"

# Cases in parallel: they mostly wait.
WORKERS = 12
# The timeout of everything.
PATIENCE = 15.0
# How much longer than a request that needs no line an error may take if its reason was known
# before, in seconds. Not the clock alone, which goes on while a busy machine does something else.
AT_ONCE = 1.5
# How far apart requests are, in seconds, and after how many of them the line must work again or the
# babble must be reported.
APART = 0.1
BACK = 18
NAMED = 40
# How long the line may take to recover from another master.
QUIET = 2.0

# The outputs of the two units, all different.
OUTPUTS = {1: 0x25, 2: 0xDA}

# `read` and `write` are what `railbus raw` is given to read unit 1, and to switch its second output
# on. `by` is who sees the units through an outlet of the daemon, if somebody does.
Column = collections.namedtuple("Column", "model protocol codec labels extra read write by",
                                defaults=[None])


def labels(prefix, first):
    """The four outputs that are read."""
    return [f"{prefix}{first + nth}" for nth in range(4)]


def erc8(unit):
    """The registers of an ERC-8: address, speed, parity."""
    return [unit, 1, 0]


def eda(unit):
    """The registers of an EDA9060A: model, address and speed, pulses, protocol."""
    return [0x9060, unit << 8 | 6, 0x000A, 0]


COLUMNS = {
    "rtu, ERC-8": Column("erc8", "rtu", lambda _: Rtu(60, 8, erc8), labels("k", 1), "",
                         ["--crc", "0101003C0008"], ["--crc", "0105003DFF00"]),
    "rtu, EDA9060A": Column("eda9060a", "rtu", lambda _: Rtu(0, 4, eda), labels("do", 0), "",
                            ["--crc", "010100000004"], ["--crc", "01050001FF00"]),
    "ascii, EDA9060A": Column("eda9060a", "ascii", Ascii, labels("do", 0), "",
                              ["--ascii", "$016"], ["--ascii", "#011101"]),
    "lc02, EDA9050": Column("eda9050", "lc02", lambda _: Lc02(), labels("do", 0), "",
                            ["--proto", "lc02", "4C570103"],
                            ["--proto", "lc02", "4C5701040101"]),
    "r55": Column("r55", "r55", lambda _: R55(), labels("k", 1), "outputs = 8\ninputs = 0",
                  ["--proto", "r55", "55011000000000"],
                  ["--proto", "r55", "55011200000002"]),
}
# The lines that none of those could use itself.
COLUMNS |= {f"{outlet}, {name.split(',')[0]}": COLUMNS[name]._replace(by=by)
            for outlet, by in (("Modbus TCP", ByModbus), ("MQTT", ByMqtt),
                               ("Sparkplug", BySparkplug), ("OPC UA", ByOpcua))
            for name in ("ascii, EDA9060A", "r55")}


def program():
    """The program under test."""
    named = os.environ.get("RAILBUS")
    folder = ROOT / os.environ.get("CARGO_TARGET_DIR", "target")
    return pathlib.Path(named) if named else folder / "debug/railbus"


class Client:
    """A request in progress, and how it ends."""

    def __init__(self, case, arguments, judge):
        self.case, self.judge = case, judge
        # How it ended, for each unit.
        self.ends, self.took = [], PATIENCE
        self.arguments = [*arguments, "-o", "json"]
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self):
        began = time.monotonic()
        try:
            done = subprocess.run([program(), *self.arguments, *self.case.way()],
                                  capture_output=True, text=True, timeout=PATIENCE, check=False)
        except subprocess.TimeoutExpired:
            self.ends = ["WRONG: hangs"]
            return
        self.took = time.monotonic() - began
        self.ends = self.judge(done)
        said = f"exit {done.returncode} in {self.took:.2f} s\n{done.stdout}{done.stderr}"
        self.case.log.append(f"{' '.join(self.arguments)}: {self.ends}: {said}")

    def wait_all(self):
        """How it ended for each unit."""
        self.thread.join()
        return self.ends

    def wait(self):
        """How it ended for its only unit."""
        return self.wait_all()[0]


def error_of(done):
    """`safe` and the code of the error, if it is a proper one."""
    for text in (*done.stderr.splitlines(), *done.stdout.splitlines()):
        try:
            told = json.loads(text)
            error = told.get("error") or told["errors"][0]
            return f"safe {error['code']}"
        except (ValueError, LookupError, AttributeError, TypeError):
            continue
    return f"WRONG: exit code {done.returncode} without an error's code"


class OverSocket(http.client.HTTPConnection):
    """HTTP over the daemon's socket."""

    def connect(self):
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(PATIENCE)
        self.sock.connect(self.host)


class Case:
    """One row in one protocol: a line, a daemon, and the requests."""

    program = staticmethod(program)

    def __init__(self, column, row):
        checksum = row.checksum and column.protocol == "ascii"
        self.column, self.direct = column, row.direct
        self.log, self.tcp = [], None
        self.folder = tempfile.TemporaryDirectory(prefix="railbus-matrix-")
        path = pathlib.Path(self.folder.name)
        self.socket, self.config = path / "socket", path / "railbus.toml"
        self.line = Line(column.codec(checksum), str(path / "line"))
        kind, all_outputs = (outlets.Watched, outlets.OUTPUTS) if column.by else (Unit, OUTPUTS)
        for address, outputs in all_outputs.items():
            full = 0x0F if column.model == "eda9060a" else 0xFF
            self.line.units[address] = kind(outputs & full, 0x0F)
        port = f"pty:{self.line.path}"
        if row.tcp:
            self.tcp = TcpPort(self.line.path)
            port = f"tcp:127.0.0.1:{self.tcp.number}"
        age = f'max_age = "{outlets.MAX_AGE}s"' if column.by else ""
        modules = "".join(
            f'[module.{name}]\nline = "main"\nmodel = "{column.model}"\naddress = {address}\n'
            f'protocol = "{column.protocol}"\nchecksum = {str(checksum).lower()}\n'
            f'poll = "{"200ms" if row.polls or column.by else "never"}"\n{column.extra}\n'
            f'{age}\n'
            for address, name in ((1, "a"), (2, "b"))
        )
        self.observer = column.by(self) if column.by else None
        if row.warm and column.by:
            # The program is to know them as slow; through an outlet nobody asks for a reading.
            for address in all_outputs:
                self.line.play(address, "slow")
        outlet = self.observer.text() if column.by else ""
        self.config.write_text(f'[line.main]\nport = "{port}"\n{modules}{outlet}')
        self.daemon = None

    def __enter__(self):
        try:
            if not self.direct:
                self.start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def start(self):
        """Starts the daemon and waits until it listens."""
        command = [program(), "serve", "--config", self.config, "--socket", self.socket,
                   "--listen", "127.0.0.1:0", "-v"]
        self.errors = open(pathlib.Path(self.folder.name) / "log", "a+", encoding="utf-8")
        self.daemon = subprocess.Popen(command, stdout=self.errors, stderr=self.errors,
                                       cwd=self.folder.name)
        deadline = time.monotonic() + PATIENCE
        while not self.answers():
            if self.daemon.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError(f"the daemon does not start: {self.journal()}")
            time.sleep(0.02)
        if self.observer:
            self.observer.begin()

    def lies(self):
        """What was told through the outlet meanwhile that was false."""
        return self.observer.lies() if self.observer else []

    def answers(self):
        """Whether the daemon listens. A socket left by one that was killed does not count."""
        try:
            if self.ask("GET", "/lines")[0] != 200:
                return False
            return not self.observer or self.observer.is_there()
        except OSError:
            return False

    def ask(self, method, path, body=None):
        """Sends the daemon an HTTP request; returns status and answer."""
        connection = OverSocket(str(self.socket))
        text = None if body is None else json.dumps(body)
        try:
            connection.request(method, "/api/v1" + path, text)
            answer = connection.getresponse()
            said = json.loads(answer.read() or b"null")
        finally:
            connection.close()
        if method != "GET":
            self.log.append(f"{method} {path} {text}: {answer.status} {said}")
        return answer.status, said

    def point(self, channel):
        """The path of an output of unit 1."""
        return f"/points/a/{self.column.labels[channel]}"

    def kill(self):
        """The daemon gets a kill -9."""
        self.daemon.kill()
        self.daemon.wait()
        self.line.free()
        self.errors.close()

    def stop(self):
        """Stops the daemon with SIGTERM."""
        self.daemon.terminate()
        try:
            self.daemon.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.daemon.kill()
            self.daemon.wait()
            self.log.append("the daemon did not stop")
        self.log.append(self.journal())
        self.errors.close()
        self.daemon = None

    def journal(self):
        """What the daemon has logged."""
        self.errors.flush()
        return pathlib.Path(self.errors.name).read_text(encoding="utf-8")

    def __exit__(self, *_):
        if self.daemon:
            self.stop()
        if self.observer:
            self.observer.close()
        if self.tcp:
            self.tcp.close()
        self.line.close()
        self.folder.cleanup()

    def way(self):
        """The flags for the daemon, or for the port."""
        if self.direct:
            return ["--direct", "--config", self.config]
        return ["--socket", self.socket]

    def truth(self, address):
        """The real state of the outputs that are read of a unit."""
        outputs = self.line.units[address].outputs
        name = "ab"[address - 1]
        return {f"{name}.{label}": bool(outputs >> nth & 1)
                for nth, label in enumerate(self.column.labels)}

    def getting(self, *addresses, fresh=True):
        """Starts a read of the outputs of these units, or of their cached values."""
        if self.observer:
            return self.observer.read(*addresses)
        want = [self.truth(address) for address in addresses]

        def judge(done):
            return [self._judge_read(done, truth) for truth in want]

        paths = [path for truth in want for path in truth]
        return Client(self, ["get", *paths, *(["--fresh"] if fresh else [])], judge)

    def _judge_read(self, done, want):
        try:
            points = json.loads(done.stdout)["points"] if done.stdout.strip() else []
        except (ValueError, LookupError):
            return "WRONG: no JSON"
        told = {point["path"]: point.get("value") for point in points
                if point["quality"] == "good" and point.get("value") is not None
                and point["path"] in want}
        for path, value in told.items():
            if value != want[path]:
                return f"WRONG: {path} told {value}"
        if told == want:
            return "right"
        return error_of(done) if done.returncode else "WRONG: no value, and no error"

    def putting(self, address):
        """Starts a command that switches on the first output that is off."""
        if self.observer:
            return self.observer.write(address)
        unit = self.line.units[address]
        nth = min(nth for nth in range(4) if not unit.outputs >> nth & 1)
        path = f"{'ab'[address - 1]}.{self.column.labels[nth]}"

        def judge(done):
            if done.returncode:
                return [error_of(done)]
            is_on = bool(unit.outputs >> nth & 1)
            return ["right" if is_on else "WRONG: success, but nothing was switched"]

        return Client(self, ["set", path, "on"], judge)

    def lines(self):
        """The state of the line, which is reported without using the line."""
        done = subprocess.run([program(), "ls", "lines", "-o", "json", *self.way()],
                              capture_output=True, text=True, timeout=PATIENCE, check=False)
        self.log.append(done.stdout + done.stderr)
        return done.stdout

    def get(self, address):
        """How reading a unit ends."""
        return self.getting(address).wait()

    def put(self, address):
        """How switching on an output of a unit ends."""
        return self.putting(address).wait()

    def flip(self, address):
        """Somebody switches all outputs at the unit."""
        self.line.units[address].outputs ^= 0x0F

    def warm_up(self):
        """Both modules answer once, slowly, so that the program uses its longest timeout from now
        on. Then their outputs change, so that the cached values are no longer true."""
        for address in OUTPUTS:
            self.line.play(address, "slow")
            ends = (self.get(address) for _ in range(3))
            if "right" not in ends:
                raise RuntimeError(f"unit {address} can't be read to begin with")
            self.flip(address)
        self.line.heal()


# The rows ----------------------------------------------------------------------------------

RIGHT, SAFE, EITHER = {"right"}, {"safe"}, {"right", "safe"}


def s0(case):
    """Clean."""
    # A machine that is busy holds replies up for longer than a fast module is waited for.
    case.warm_up()
    yield from _asked(case)


def s1(case):
    """A's replies come after the timeout, while the line is idle; then B is read."""
    case.warm_up()
    case.line.play(1, "late")
    yield case.get(1)
    case.line.wait_idle(2)
    yield case.get(2)


def s2(case):
    """The late reply comes during the same request to the same unit, whose outputs have changed."""
    case.warm_up()
    case.line.play(1, "late")
    yield case.get(1)
    case.line.heal()
    case.flip(1)
    yield case.get(1)


def s3(case):
    """The late replies of unit 1 come while unit 2 is read, before its own reply."""
    case.warm_up()
    yield from _late_and_other(case)


def _late_and_other(case):
    case.line.play(1, "late")
    before = case.line.asked(1)
    first = case.getting(1)
    case.line.wait_asked(1, before, 5)
    second = case.getting(2)
    yield first.wait()
    yield second.wait()


def s4(case):
    """The same, and unit 2 is dead."""
    case.warm_up()
    case.line.play(2, "dead")
    yield from _late_and_other(case)


def s5(case):
    """The adapter echoes, the module is dead, an output is written."""
    case.line.echo = True
    case.line.play(1, "dead", ("read", "write", "other"))
    yield case.put(1)
    yield case.get(2)


def s6(case):
    """The adapter echoes, the modules are alive."""
    case.line.echo = True
    yield from s0(case)


def _asked(case):
    """Both are read and one is written, however they do."""
    yield case.get(1)
    yield case.get(2)
    yield case.put(1)


def _always(fault, warm=True):
    def row(case):
        if warm:
            case.warm_up()
        for address in OUTPUTS:
            case.line.play(address, fault, ("read", "write"))
        yield from _asked(case)

    return row


def s10(case):
    """The checksum of the first reply is wrong, of a read and of a write."""
    case.line.play(1, "bad_checksum", ("read",), 1)
    yield case.get(1)
    yield case.get(2)
    case.line.play(1, "bad_checksum", ("write",), 1)
    yield case.put(1)


def s17(case):
    """Noise before each reply, on a line that was clean."""
    case.warm_up()
    yield from _always("noise", warm=False)(case)


def _read_fault(fault):
    def row(case):
        case.line.play(1, fault)
        yield case.get(1)
        yield case.get(2)

    return row


def _write_fault(fault):
    def row(case):
        case.line.play(1, fault, ("write",))
        yield case.put(1)
        yield case.get(2)

    return row


def s15(case):
    """The module refuses, or is silent if its protocol has no refusal."""
    fault = "refuse" if hasattr(case.line.codec, "refusal") else "dead"
    case.line.play(1, fault, ("read", "write"))
    yield case.get(1)
    yield case.put(1)
    yield case.get(2)


def s18(case):
    """Something on the line never stops sending."""
    case.warm_up()
    case.line.babble = True
    yield case.get(1)
    yield case.put(2)
    for _ in range(NAMED):
        if '"babble":true' in case.lines().replace(" ", ""):
            yield "named"
            return
        time.sleep(APART)
    yield "WRONG: too late"


def s19(case):
    """The reply comes twice, the second time while unit 2 is read; then unit 1 is read again, its
    outputs having changed."""
    case.warm_up()
    case.line.play(1, "twice")
    before = case.line.asked(1)
    first = case.getting(1)
    case.line.wait_asked(1, before, 5)
    second = case.getting(2)
    yield first.wait()
    yield second.wait()
    case.flip(1)
    yield case.get(1)


def s20(case):
    """The late `>` of unit 1 comes while dead unit 2 is written; its late data while unit 2 is
    read."""
    case.warm_up()
    case.line.play(1, "late", ("write",))
    case.line.play(2, "dead", ("write",))
    before = case.line.asked(1)
    first = case.putting(1)
    case.line.wait_asked(1, before, 5)
    second = case.putting(2)
    yield first.wait()
    yield second.wait()
    case.line.heal()
    case.line.wait_idle(2)
    yield from _late_and_other(case)


def s21(case):
    """The port is gone for 3 s and comes back under another name."""
    case.warm_up()
    case.line.unplug()
    gone = time.monotonic()
    client = case.getting(1)
    end = client.wait()
    began = time.monotonic()
    case.lines()
    bare = time.monotonic() - began
    yield "WRONG: too late" if client.took > bare + AT_ONCE else end
    time.sleep(max(gone + 3 - time.monotonic(), 0))
    case.line.plug()
    for _ in range(BACK):
        end = case.get(1)
        if not end.startswith("safe"):
            break
        time.sleep(APART)
    yield "WRONG: too late" if end.startswith("safe") else end


def s22(case):
    """The relays of unit 1 do not move: it acknowledges, and reads otherwise."""
    case.line.play(1, "stuck", ("write",))
    yield case.put(1)
    yield case.get(2)


def s22_lost(case):
    """The same, and after the first read-back all others are lost."""
    case.warm_up()
    yield case.get(1)
    case.line.play(1, "stuck", ("write",))
    case.line.play(1, "read_once")
    yield case.put(1)


def s23(case):
    """Requests are echoed before their replies, on a line without echo so far."""
    yield case.get(1)
    case.line.echoes = 2
    time.sleep(2)
    yield case.get(1)
    yield case.get(2)


def s24(case):
    """A second master sends the same at the same moment, repeatedly; then it is gone."""
    yield case.get(1)
    case.line.second_master = True
    time.sleep(6)
    case.line.second_master = False
    time.sleep(QUIET)
    yield case.get(1)
    yield case.get(2)


def s25(case):
    """The adapter begins to echo after both modules were read, and unit 1 is dead then."""
    yield case.get(1)
    yield case.get(2)
    case.line.play(1, "dead", ("read", "write", "other"))
    case.line.echo = True
    yield case.put(1)
    yield case.get(2)


def s36(case):
    """Unit 1 falls silent, and somebody switches it by hand: what was known of it is not true any
    more, however soon that is noticed."""
    yield case.get(1)
    case.line.play(1, "dead", ("read", "write", "other"))
    case.flip(1)
    yield case.get(1)
    yield case.get(2)


def _both(fault, other=None):
    """One command without a daemon for both units."""
    def row(case):
        case.line.play(1, fault)
        case.line.play(2, other)
        yield from case.getting(1, 2).wait_all()

    return row


def s2_direct(case):
    """Like S2, but each request opens the port anew."""
    case.line.play(1, "late")
    yield case.get(1)
    case.line.heal()
    case.flip(1)
    yield case.get(1)


class Row:
    """A row: what happens, what is requested, and which ends each request may have."""

    def __init__(self, run, what, asks, *ends, **besides):
        self.run, self.what, self.asks, self.ends = run, what, asks, ends
        self.absent = besides.get("absent", {})
        self.checksum = besides.get("checksum", False)
        self.direct = besides.get("direct", False)
        self.polls = besides.get("polls", False)
        self.tcp = besides.get("tcp", False)
        self.warm = besides.get("warm", False)


READS = "A reads 1, B reads 2"
ALL = "A reads 1, B reads 2, C writes 1"
NO_VALUE = "the reply to a write names no value"
NO_ADDRESS = "the reply to a write names no address"

ROWS = {
    "S0": Row(s0, "clean", ALL, RIGHT, RIGHT, RIGHT, warm=True),
    "S0 cold": Row(_asked, "the same, of units that nothing is known of", ALL,
                   EITHER, EITHER, EITHER),
    "S1": Row(s1, "the replies come after the timeout, while the line is idle", READS,
              EITHER, RIGHT, warm=True),
    "S2": Row(s2, "the late reply lands in the next request of the same unit and shape",
              "A and B read 1", EITHER, RIGHT, warm=True),
    "S3": Row(s3, "the late reply of unit 1 lands in a request to unit 2", READS, EITHER, RIGHT,
              warm=True),
    "S4": Row(s4, "the same, and unit 2 is dead", READS, EITHER, SAFE, warm=True),
    "S5": Row(s5, "echoing adapter, unit 1 is dead", "A writes 1, B reads 2", SAFE, RIGHT),
    "S6": Row(s6, "echoing adapter, the units are alive", ALL, RIGHT, RIGHT, RIGHT, warm=True),
    "S7": Row(_always("glitch_before"), "a 00 before each reply", ALL, RIGHT, RIGHT, RIGHT,
              warm=True),
    "S8": Row(_always("glitch_after"), "an FF after each reply", ALL, RIGHT, RIGHT, RIGHT,
              warm=True),
    "S9": Row(_always("pieces"), "each reply in three pieces 20 ms apart", ALL,
              RIGHT, RIGHT, RIGHT, warm=True),
    "S10": Row(s10, "a bad checksum once (ascii: checksums on)", ALL, EITHER, RIGHT, EITHER,
               checksum=True),
    "S11": Row(_read_fault("fewer"), "fewer values than asked", READS, SAFE, RIGHT),
    "S12": Row(_read_fault("more"), "more values than asked", READS, SAFE, RIGHT),
    "S13": Row(_write_fault("other_value"), "reply to a write with another value, nothing done",
               "A writes 1, B reads 2", SAFE, RIGHT,
               absent={"ascii": NO_VALUE, "lc02": NO_VALUE}),
    "S14": Row(_write_fault("other_address"),
               "reply to a write with another address, nothing done",
               "A writes 1, B reads 2", SAFE, RIGHT, absent={"ascii": NO_ADDRESS}),
    "S15": Row(s15, "exception, `?AA`, or silence where the protocol has no refusal",
               "A reads 1, B writes 1, C reads 2", SAFE, SAFE, RIGHT),
    "S16": Row(_read_fault("other_command"), "reply with another function or command", READS,
               SAFE, RIGHT),
    "S17": Row(s17, "40 bytes of noise before each reply", ALL, RIGHT, RIGHT, RIGHT, warm=True),
    "S17 cold": Row(_always("noise", warm=False), "the same from the opening of the port on", ALL,
                    RIGHT, RIGHT, EITHER),
    "S18": Row(s18, "a babbling line", "A reads 1, B writes 2; is it named?",
               SAFE, SAFE, {"named"}, warm=True),
    "S19": Row(s19, "each reply of unit 1 comes twice", "A reads 1, B reads 2, C reads 1",
               RIGHT, RIGHT, RIGHT, warm=True),
    "S20": Row(s20, "late `>` or data of unit 1 in the turn of unit 2, which is dead to writes",
               "A writes 1, B writes 2, C reads 1, D reads 2", EITHER, SAFE, EITHER, RIGHT,
               absent={name: "its replies say whose they are" for name in ("rtu", "lc02", "r55")},
               warm=True),
    "S21": Row(s21, "the port is gone for 3 s and comes back under another name",
               "A reads 1 meanwhile, B reads 1 within 2 s after", SAFE, RIGHT, warm=True),
    "S22": Row(s22, "unit 1 acknowledges and does not move", "A writes 1, B reads 2", SAFE, RIGHT),
    "S22 lost": Row(s22_lost, "the same, and its read-backs but the first are lost",
                    "A reads 1, B writes 1", RIGHT, SAFE, warm=True),
    "S23": Row(s23, "two requests come back, once; the units are polled",
               "A reads 1 before, B reads 1 and C reads 2 after", RIGHT, RIGHT, RIGHT, polls=True),
    "S24": Row(s24, "a second master says the same at the same moment; the units are polled",
               "A reads 1 before, B reads 1 and C reads 2 after", RIGHT, RIGHT, RIGHT, polls=True),
    "S25": Row(s25, "the adapter begins to echo when the line is at work, and unit 1 is dead",
               "A reads 1, B reads 2, C writes 1, D reads 2", RIGHT, RIGHT, SAFE, RIGHT),
    "S26": Row(commands.beside_a_pulse(commands.pulse),
               "a pulse, and a set off 0, 2 and 5 ms later",
               "A: is it off in the end", RIGHT),
    "S27": Row(commands.beside_a_pulse(commands.lease),
               "a lease, and a set off 0, 2 and 5 ms later",
               "A: is it off in the end", RIGHT),
    "S28": Row(commands.kill_after_takeover,
               "a set takes a pulse over, is answered, and then kill -9",
               "A: is it as it was set", RIGHT),
    "S29": Row(commands.kill_within_a_lease, "a lease is renewed, and then kill -9",
               "A: does it hold until it said, B: does it end", RIGHT, RIGHT),
    "S30": Row(commands.kills_within_a_lease, "kill -9 again and again within a lease",
               "A: does it end", RIGHT),
    "S31": Row(commands.end_is_tried_again, "unit 1 is away for 4 s when its pulse is to end",
               "A: does it end when it is back", RIGHT),
    "S32": Row(commands.borrower_is_killed, "the line is lent to a scan, which gets a kill -9",
               "A: does a pulse end in time, B reads 1", RIGHT, RIGHT),
    "S33": Row(commands.grown_old, "unit 1 is dead; the units are polled",
               "A reads 1 before, B asks what is known of 1 and C of 2, D: is only 1 blamed",
               RIGHT, SAFE, RIGHT, RIGHT, polls=True),
    "S34": Row(commands.stalls,
               "all replies are held up for 1.5 s, and come in their order when somebody asks",
               "A reads 1 before, B in it, C after", RIGHT, EITHER, RIGHT, polls=True),
    "S34 tcp": Row(commands.stalls, "the same on a `tcp:` line",
                   "A reads 1 before, B in it, C after", RIGHT, EITHER, RIGHT, polls=True,
                   tcp=True),
    "S35": Row(commands.taken_address,
               "the address that unit 1 is to have is taken by a slow module",
               "A reads 1, B: is it refused", RIGHT, SAFE,
               absent={name: "its units here show too little to be taken for their model"
                       for name in ("rtu", "lc02")}),
    "S36": Row(s36, "unit 1 is dead, and is switched by hand; the units are polled",
               "A reads 1 before, B reads 1 and C reads 2 after", RIGHT, SAFE, RIGHT, polls=True),
    "S2 raw": Row(commands.raw_late, "as S2; no daemon, and the first question is a `raw`",
                  "A and B read 1", SAFE, RIGHT, direct=True),
    "S5 raw": Row(commands.raw_echo, "as S5; no daemon, and the write is a `raw`",
                  "A writes 1, B reads 2", SAFE, RIGHT, direct=True),
    "S22 direct": Row(s22, "as S22; no daemon", "A writes 1, B reads 2", SAFE, RIGHT, direct=True),
    "S0 direct": Row(_both(None), "clean; no daemon, one command asks both", READS, RIGHT, RIGHT,
                     direct=True),
    "S1 direct": Row(_both("late"), "as S1 and S3; no daemon, one command asks both", READS,
                     EITHER, RIGHT, direct=True),
    "S2 direct": Row(s2_direct, "as S2; no daemon, each question opens the port anew",
                     "A and B read 1", EITHER, RIGHT, direct=True),
    "S4 direct": Row(_both("late", "dead"), "as S4; no daemon, one command asks both", READS,
                     EITHER, SAFE, direct=True),
    "S5 direct": Row(s5, "as S5; no daemon", "A writes 1, B reads 2", SAFE, RIGHT, direct=True),
    "S2 polled": Row(s2, "as S2; the units are polled as well", "A and B read 1", EITHER, RIGHT,
                     polls=True),
    "S3 polled": Row(s3, "as S3; the units are polled as well", READS, EITHER, RIGHT,
                     polls=True),
    "S4 polled": Row(s4, "as S4; the units are polled as well", READS, EITHER, SAFE, polls=True),
    "S19 polled": Row(s19, "as S19; the units are polled as well",
                      "A reads 1, B reads 2, C reads 1", RIGHT, RIGHT, RIGHT, polls=True),
}


# What becomes of a write that is not done, where the row leaves no doubt of it.
UNDONE = {"S5": "unknown", "S13": "failed", "S14": "unknown", "S22": "failed",
          "S22 lost": "failed", "S25": "unknown"}
# How outlets say so; 0B of Modbus TCP says both (docs/decisions/0042), and Sparkplug commands no
# device that is dead.
SAYS = {"unknown": ("unknown", "0B", "dead", "not born"), "failed": ("failed", "0B")}


def told_as(row_name, end):
    """An end through an outlet; wrong if a write is said to have become of something else."""
    word, _, why = end.partition(" ")
    if row_name not in UNDONE or word != "safe" or why.startswith(SAYS[UNDONE[row_name]]):
        return end
    return f"WRONG: {end}, and not {UNDONE[row_name]}"


def run_case(row_name, column_name):
    """The ends of one row in one column, with the traffic and the output of the programs."""
    row, column = ROWS[row_name], COLUMNS[column_name]
    case = Case(column, row)
    ends = []
    try:
        with case:
            for end in row.run(case):
                allowed = row.ends[len(ends)] if len(ends) < len(row.ends) else ()
                if "false" in allowed and end.startswith("WRONG") and " told " in end:
                    end = f"false {end}"
                ends.append(end)
            if column.by:
                ends = [told_as(row_name, end) for end in ends]
            if lies := case.lies():
                case.log += lies
                ends[-1] = f"WRONG: somebody was told: {lies[0]}"
    except Exception as error:  # Whatever breaks a case off fails it, and only it.
        ends.append(f"WRONG: broke off, {type(error).__name__}: {error}")
    return ends, [*case.line.trace, *case.log]


# The table ---------------------------------------------------------------------------------

LETTERS = "ABCDE"
# The rows whose requests can be made through an outlet: the units are always polled there.
THROUGH = {f"S{number}" for number in (*range(20), 21, 22, 24, 25, 36)}
POLLED = {"S24", "S36"}
NOT_ASKED = "nothing that is asked through an outlet"


def absence(row_name, column_name):
    """Why a row is not applicable to a protocol, if it is not."""
    row, column = ROWS[row_name], COLUMNS[column_name]
    if column.by and not row_name.split()[0] in THROUGH:
        return NOT_ASKED
    if column.by and (row.direct or row.polls != (row_name in POLLED)):
        return NOT_ASKED
    return row.absent.get(column.protocol)


def allowed_ends(row, column):
    """Which ends each request may have. Through an outlet a read gets what is known: of a unit that
    is silent that is right until it is too old."""
    if not column.by:
        return row.ends
    is_read = [f"{letter} writes" not in row.asks for letter in LETTERS]
    return [EITHER if allowed == SAFE and read else allowed
            for allowed, read in zip(row.ends, is_read)]


def is_allowed(ends, may_be):
    """Whether each request ended in one of its allowed ways."""
    words = [end.split()[0] for end in ends]
    return len(words) == len(may_be) and all(
        word in allowed for word, allowed in zip(words, may_be)
    )


def cell(ends, may_be):
    """The ends as the table shows them. If two are equally good, timing decides between them, and
    the table shows both."""
    words = []
    for nth, end in enumerate(ends):
        # A case that breaks off has one end more.
        letter, allowed = LETTERS[nth], may_be[nth] if nth < len(may_be) else set()
        word = end if end.startswith("WRONG") else end.split()[0]
        shown = must_be(allowed) if {word} < allowed else word
        words.append(f"{letter} {shown}")
    return ", ".join(words)


def must(may_be):
    """The cell of a row whose requests end as they must."""
    ends = enumerate(may_be)
    return ", ".join(f"{LETTERS[nth]} {must_be(allowed)}" for nth, allowed in ends)


def must_be(allowed):
    """The ends that are equally good."""
    return " or ".join(word for word in ("right", "safe", "false", "named") if word in allowed)


def as_table(cells):
    """The page to be committed."""
    lines = [
        "# The fault matrix",
        "",
        "Made by `interop/matrix/run.py --write`, which also says what the words mean; the run",
        "without `--write` compares. Units 1 and 2 hold different values. Where `right` and `safe`",
        "are as good, time decides between them. `-`: see below. Boards of other makers have a",
        "suite of their own, `interop/strangers_suite.py`: they get nothing but reads.",
        "",
        "The columns of Modbus TCP, MQTT, Sparkplug and OPC UA are what a master, a subscriber, a",
        "host and a client are told of units on such a line. These are polled. `right` also says",
        "that a client subscribed all the time got no false value, and was told when a value was",
        "no longer good. The last value of a silent unit is right until it is too old.",
        "",
        "| row | what happens | asked | " + " | ".join(COLUMNS) + " |",
        "|---" * (3 + len(COLUMNS)) + "|",
    ]
    for name, row in ROWS.items():
        shown = [cells.get((name, column), "-") for column in COLUMNS]
        lines.append(f"| {name} | {row.what} | {row.asks} | {' | '.join(shown)} |")
    lines += ["", "Not in every protocol:", ""]
    for name, row in ROWS.items():
        for protocol, why in row.absent.items():
            lines.append(f"- {name}, {protocol}: {why}.")
    return "\n".join(lines) + "\n"


def committed():
    """The cells of the committed table."""
    found = {}
    if TABLE.exists():
        for line in TABLE.read_text(encoding="utf-8").splitlines():
            parts = [part.strip() for part in line.split("|")[1:-1]]
            if parts and parts[0] in ROWS:
                found |= {(parts[0], column): told for column, told in zip(COLUMNS, parts[3:])}
    return found


def cases(words):
    """The applicable rows and columns that were selected."""
    names = [(row, column) for row in ROWS for column in COLUMNS if not absence(row, column)]
    wanted = [name for name in names
              if not words or any(word in name[0].split() or word in name[1] for word in words)]
    # Long ones first.
    return sorted(wanted, key=lambda name: name[0] not in ("S18", "S20", "S21", "S4", "S15"))


def judged(name, known):
    """Runs a case; returns whether it ended as it must, its cell and its trace."""
    may_be = allowed_ends(ROWS[name[0]], COLUMNS[name[1]])
    ends, trace = run_case(*name)
    told = cell(ends, may_be)
    return is_allowed(ends, may_be) and known in (None, told), told, trace


def run(words, write=False, trace=False):
    """Runs the cases; returns how many passed, and the failures as text."""
    known, wanted, failures, said = committed(), cases(words), [], []
    expected = [None if write else known.get(name, "nothing") for name in wanted]
    with concurrent.futures.ProcessPoolExecutor(WORKERS) as pool:
        results = dict(zip(wanted, pool.map(judged, wanted, expected)))
    for name, (good, told, lines) in results.items():
        label = ", ".join(name)
        if not good:
            differs = "" if "WRONG" in told else f", not as committed: {known.get(name)}"
            failures.append(f"{label}: {told}{differs}")
        if trace or not good:
            said.append("\n".join([f"--- {label}: {told}", *lines]))
    if said:
        LOG.parent.mkdir(exist_ok=True)
        LOG.write_text("\n".join(said) + "\n", encoding="utf-8")
    if write:
        cells = {name: told if good else must(allowed_ends(ROWS[name[0]], COLUMNS[name[1]]))
                 for name, (good, told, _) in results.items()}
        TABLE.write_text(as_table(known | cells if words else cells), encoding="utf-8")
    return len(wanted) - len(failures), failures


class Tally:
    """The overall result, in the form of the other suites."""

    table, open, covered, inexpressible = "", frozenset(), frozenset(), frozenset()

    def __init__(self):
        self.passed, self.failures = run([])


SUITES = [("fault matrix", Tally)]


def main(words):
    """Runs what the arguments name; returns the exit code."""
    began = time.monotonic()
    flags = [word for word in words if word.startswith("--")]
    words = [word for word in words if not word.startswith("--")]
    if not program().exists():
        print(f"missing: {program()}; build it by: cargo build -p railbus")
        print("0 passed, 1 failed")
        return 1
    passed, failures = run(words, "--write" in flags, "--trace" in flags)
    for failure in failures:
        print(f"FAILED {failure}")
    if failures or "--trace" in flags:
        print(f"what was said: {LOG}")
    print(f"{passed + len(failures)} cases in {time.monotonic() - began:.0f} s")
    print(f"{passed} passed, {len(failures)} failed")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
