"""The daemon's Modbus gateway to a line: masters by others read the modules themselves beside the
polling, switch what they may, and change nothing else."""

import os
import threading
import time

from modbus_cases import DONE, Raw, exception
from modbus_tcp import ANSWER, HOST, MASTERS, Client, Plant, ask, message, until, words

FUNCTION, VALUE, PATH, TARGET = exception(1), exception(3), exception(10), exception(11)

# The modules that are asked, by name: unit, and where their outputs begin and how many there are.
UNITS = {"oven": (3, 60, 8), "tank": (5, 8, 2), "door": (6, 0, 8)}
# A module that only the simulator has, and one that nobody has.
SPARE, NOBODY = 9, 77
OVEN = (3, 1, 60, 8)

# A line with another protocol on it, too. The modules take their time: a machine that does not get
# round to the simulator has the rest of it, as with the other server.
LINE = """
[line.main]
port = "pty:{line}"
baud = 19200

[module.hall]
line = "main"
model = "eda9060a"
address = 1
{each}
sim = {{ {slow}, inputs = {{ di0 = 1, di1 = 0 }} }}

[module.oven]
line = "main"
model = "erc8"
address = 3
{each}
sim = {{ {slow} }}

[module.tank]
line = "main"
model = "emd2a2q"
address = 5
{each}
sim = {{ {slow}, inputs = {{ ai1 = 8.71, ai2 = 1.23 }} }}

[module.door]
line = "main"
model = "eda9050"
address = 6
protocol = "rtu"
{each}
sim = {{ {slow} }}
"""
EACH = 'poll = "1s"\nmax_age = "10s"'
SPARE_TOO = f"""
[module.spare]
line = "main"
model = "erc8"
address = {SPARE}
"""


class Site(Plant):
    """Simulated modules on a line, and a daemon with gateways to it."""

    table = "Modbus gateway to a line"
    kind = {"type": "modbus_line", "line": "main"}

    def __init__(self, more="", turnaround="30ms", **outlets):
        super().__init__(more, turnaround, **outlets)

    def modules(self, line, turnaround):
        """The configuration of line and modules."""
        return LINE.format(line=line, slow=f'turnaround = "{turnaround}"', each=EACH)

    def simulated(self, turnaround):
        """The file with what is simulated: one more than the daemon has."""
        plant = os.path.join(self.folder.name, "plant.toml")
        text = self.modules(os.path.join(self.folder.name, "line"), turnaround)
        with open(plant, "w", encoding="utf-8") as file:
            file.write(f'{text}{SPARE_TOO}sim = {{ turnaround = "{turnaround}" }}\n')
        return plant

    def settle(self, outlet=None):
        """Waits until every point is good and every gateway listens."""
        good = lambda: all(point["quality"] == "good" for point in self.points().values())
        if not until(good) or not all(until(lambda p=port: listens(p)) for port in
                                      self.ports.values()):
            raise RuntimeError("the modules are not read")


def listens(port):
    """Whether a gateway answers for itself."""
    try:
        with Client(port) as client:
            return client.ask(255, 0x2B, 0x0E, 1, 0)[:5] == "2b 0e"
    except OSError:
        return False


def raw(master, unit, pdu):
    """The outcome of a function that masters have no call for."""
    return master.request(unit, Raw("", pdu, None), ANSWER)


def one_on(module, nth):
    """One output on."""
    return [int(place == nth) for place in range(UNITS[module][2])]


# Masters -----------------------------------------------------------------------------------


def masters():
    """Three masters, one after another."""
    with Site(tool={"write": ["*"]}) as s:
        for name, open_master in MASTERS.items():
            with open_master(s.ports["tool"]) as master:
                reads(s, name, master)
                for nth, module in enumerate(UNITS):
                    switches(s, name, master, module, nth)
    return s.tally


def reads(s, name, master):
    """What a master reads is what the API says, and what no map has."""
    for module, (unit, first, count) in UNITS.items():
        got = ask(master, unit, 1, first, count)
        s.check(f"{module} by {name}: as in the API", got, s.outputs(module), "all coils")
    values = [round(s.points()[f"tank.{label}"]["value"] * 100) for label in ("ai1", "ai2")]
    got = ask(master, 5, 3, 6, 2)
    s.check(f"tank by {name}: as in the API", got, values, "analog values")
    # Registers with the module's settings, which no map of the other server has.
    got = ask(master, 5, 3, 0, 2)
    s.check(f"settings by {name}: read", isinstance(got, list), True, f"tank, {got},")
    got = ask(master, SPARE, 1, 60, 8)
    s.check(f"a module that is not configured by {name}: read", got, [0] * 8, "spare")
    # It is the module that says so.
    got = ask(master, 3, 1, 200, 8)
    s.check(f"the module's own exceptions by {name}", got, exception(2), "oven")


def switches(s, name, master, module, nth):
    """An output on and off, and all at once."""
    unit, first, count = UNITS[module]
    entry, nth = f"{module} by {name}: switched and read back", nth % count
    for value, want in ((1, one_on(module, nth)), (0, [0] * count)):
        s.check(entry, ask(master, unit, 5, first + nth, [value]), DONE, f"FC05 of {value}")
        # At once: what is answered is read back.
        s.relays(entry, module, want)
        s.check(entry, ask(master, unit, 1, first, count), want, "all coils")
    for want in ([int(place % 3 != 1) for place in range(count)], [0] * count):
        s.check(entry, ask(master, unit, 15, first, want), DONE, f"FC0F of {want}")
        s.relays(entry, module, want)


# Rights ------------------------------------------------------------------------------------

SAFETY = """
[module.oven.point]
k4 = { interlock = ["oven.k5"] }
k6 = { locked = true }
"""


def rights():
    """What may not be switched does not move, and no setting changes."""
    may = [f"oven.k{nth}" for nth in (1, 4, 5, 6)]
    with Site(SAFETY, open={"write": may}, reading={}) as s:
        for name, open_master in MASTERS.items():
            with open_master(s.ports["reading"]) as master:
                nothing_moves(s, name, master)
        with MASTERS["pymodbus"](s.ports["open"]) as master:
            some(s, master)
            settings(s, master)
    return s.tally


def nothing_moves(s, name, master):
    """Without `write`."""
    entry = f"without `write` by {name}: 01, nothing moves"
    for module, (unit, first, count) in UNITS.items():
        s.check(entry, ask(master, unit, 5, first, [1]), FUNCTION, f"{module}, FC05")
        s.check(entry, ask(master, unit, 15, first, [1] * count), FUNCTION, f"{module}, FC0F")
        s.relays(entry, module, [0] * count)


def some(s, master):
    """With rights for some outputs, and the site's own rules."""
    put = lambda at, *values: ask(master, 3, 5 if len(values) == 1 else 15, 59 + at, [*values])
    for entry, at, values, want, on in (
        ("rights: an output in `write`", 1, [1], DONE, {1}),
        ("rights: an output that is not in `write`: 01", 2, [1], FUNCTION, {1}),
        ("rights: an output that is not in `write`: 01", 1, [0, 0], FUNCTION, {1}),
        ("rights: an output in `write`", 1, [0], DONE, {}),
        ("rules: an output that is locked: 01", 6, [1], FUNCTION, {}),
        ("rules: an output that is interlocked: 04", 4, [1], DONE, {4}),
        ("rules: an output that is interlocked: 04", 5, [1], exception(4), {4}),
        ("rules: an output that is interlocked: 04", 4, [0], DONE, {}),
    ):
        s.check(entry, put(at, *values), want, f"k{at} {values}")
        s.relays(entry, "oven", [int(nth in on) for nth in range(1, 9)])
    _, audit = s.daemon.ask("GET", "/audit?limit=50")
    by = {(entry["module"], entry["who"], entry["via"]) for entry in audit["items"]}
    want = {("oven", "modbus_line:open", f"modbus_line {HOST}")}
    s.check("rights: an output in `write`", by, want, "the audit log")


def settings(s, master):
    """What a module keeps, and what all modules would obey."""
    kept = lambda: ask(master, 5, 3, 0, 6)
    before = kept()
    s.check("a register of settings: 01", isinstance(before, list), True, f"{before}")
    for unit, fc, at, values in ((5, 6, 0, [9]), (5, 16, 0, [9]), (5, 16, 0, [9] * 4),
                                 (3, 6, 0, [9]), (NOBODY, 6, 0, [9])):
        got = ask(master, unit, fc, at, values)
        s.check("a register of settings: 01", got, FUNCTION, f"unit {unit}, FC{fc:02X}")
    s.check("a register of settings: 01", kept(), before, "the registers")
    for unit, at in ((3, 68), (3, 0), (SPARE, 60), (1, 0)):
        got = ask(master, unit, 5, at, [1])
        s.check("a coil that is no known output: 01", got, FUNCTION, f"unit {unit}, {at}")
    s.check("a coil that is no known output: 01", s.sim.outputs("spare"), [0] * 8, "spare")
    with Client(s.ports["open"]) as client:
        for pdu in ("05 00 3C FF 00", "06 00 00 00 09", "01 00 3C 00 08"):
            got = client.ask(0, *bytes.fromhex(pdu))
            s.check("all modules at once: 01", got, f"{int(pdu[:2], 16) | 0x80:02x} 01", pdu)
        s.check("a function that is not known: 01", client.ask(3, 0x11), "91 01", "FC11")
        s.check("no address of a module: 0A", client.ask(250, 1, 0, 60, 0, 1), "81 0a", "250")
    for module, (_, _, count) in UNITS.items():
        s.relays("all modules at once: 01", module, [0] * count)


# Faults ------------------------------------------------------------------------------------

# How many reads are compared, and how much longer they may take beside a dead unit.
READS, SLOWER = 60, 2.0


def faults():
    """A module without power, and a line that has gone."""
    with Site(tool={"write": ["*"]}) as s:
        with MASTERS["pymodbus"](s.ports["tool"]) as master:
            dead(s, master)
            gone(s, master)
    return s.tally


class Hammer(threading.Thread):
    """A client that asks for a unit again and again."""

    def __init__(self, port, unit):
        super().__init__()
        self.port, self.unit, self.answers, self.ends = port, unit, [], threading.Event()

    def run(self):
        """Until it is to end."""
        with Client(self.port) as client:
            while not self.ends.is_set():
                self.answers.append(client.ask(self.unit, 1, *words(60, 8)))
                # Without a pause it would take the machine from the modules.
                time.sleep(0.01)


def took(s, entry, master):
    """How long many reads of a module take that answers. A machine that does not get round to the
    simulator makes it silent now and then."""
    began = time.monotonic()
    got = [ask(master, 5, 3, 6, 2) for _ in range(READS)]
    others = [one for one in got if one not in ([871, 123], TARGET)]
    s.check(entry, others, [], "tank")
    s.check(entry, got.count(TARGET) <= READS // 10, True, f"{got.count(TARGET)} silences")
    return time.monotonic() - began


def dead(s, master):
    """One module loses its power, and others are read beside it."""
    entry = "a dead unit: others answer in time"
    before = took(s, entry, master)
    s.sim.do("power oven off")
    s.check("a dead unit: 0B", ask(master, *OVEN), TARGET, "oven")
    s.check("a dead unit: 0B", ask(master, NOBODY, 1, 0, 8), TARGET, "a unit that nobody has")
    hammers = [Hammer(s.ports["tool"], unit) for unit in (3, NOBODY)]
    for hammer in hammers:
        hammer.start()
    beside = took(s, entry, master)
    for hammer in hammers:
        hammer.ends.set()
        hammer.join()
        s.check("a dead unit: 0B", set(hammer.answers), {"81 0b"}, f"unit {hammer.unit}")
    s.check(entry, beside <= SLOWER * before, True, f"{beside:.1f} s, not {before:.1f} s,")
    got = ask(master, 3, 5, 60, [1])
    s.check("a dead unit: 0B", got, TARGET, "a write")
    s.sim.do("power oven on")
    back = until(lambda: ask(master, *OVEN) == [0] * 8)
    s.check("a dead unit: back", back, True, "oven")
    s.settle()
    s.relays("a dead unit: back", "oven", [0] * 8)


def gone(s, master):
    """The line goes, and comes back."""
    s.sim.kill()
    for unit in (3, 5, SPARE):
        here = until(lambda unit=unit: ask(master, unit, 1, 60, 1) == PATH)
        s.check("a killed line: 0A", here, True, f"unit {unit}")
    s.check("a killed line: 0A", ask(master, 3, 5, 60, [1]), PATH, "a write")
    s.sim.start()
    s.check("a killed line: back", until(lambda: ask(master, *OVEN) == [0] * 8), True, "oven")


# Many at once ------------------------------------------------------------------------------


def many():
    """Requests that do not wait for answers, and connections."""
    with Site(tool={"write": ["*"]}) as s:
        pipelined(s)
        joined(s)
        seats(s)
    return s.tally


def pipelined(s):
    """Many requests in one piece: each is answered once, by its number."""
    read = {3: (1, *words(60, 8)), 5: (3, *words(6, 2)), 6: (1, *words(0, 8))}
    want = {3: "01 01 00", 5: "03 04 03 67 00 7b", 6: "01 01 00"}
    with Client(s.ports["tool"]) as client:
        units = [(3, 5, 6)[nth % 3] for nth in range(16)]
        client.send(b"".join(message(100 + nth, unit, *read[unit])
                             for nth, unit in enumerate(units)))
        got = sorted(client.next() for _ in units)
        asked = [(100 + nth, unit, want[unit]) for nth, unit in enumerate(units)]
        s.check("many requests in one piece", got, asked, "16 reads")
        # Each is another one, so that none is answered with another.
        pdus = [(1, *words(60 + nth % 8, 1 + nth // 8)) for nth in range(8)]
        pdus += [(2, *words(nth, 1)) for nth in range(12)]
        client.send(b"".join(message(nth, 3, *pdu) for nth, pdu in enumerate(pdus)))
        got = [client.next() for _ in pdus]
        busy = sorted(transaction for transaction, _, text in got if text[3:] == "06")
        s.check("too many that wait: 06", busy, [16, 17, 18, 19], "the last four of 20")
        s.check("too many that wait: 06", sorted(one[0] for one in got), list(range(20)), "all")
        write = client.begin(3, 5, *words(60, 0xFF00))
        after = client.begin(3, 1, *words(60, 8))
        got = [client.next(), client.next()]
        asked = [(write, 3, "05 00 3c ff 00"), (after, 3, "01 01 01")]
        s.check("a read behind a write shows it", got, asked, "k1")
        client.ask(3, 5, *words(60, 0))


def seated(s):
    """A connection that is served: the server may not have noticed yet that others have gone."""
    def tried():
        client = Client(s.ports["tool"])
        try:
            if client.ask(255, 0x2B, 0x0E, 1, 0)[:5] == "2b 0e":
                return client
        except OSError:
            pass
        client.close()
        return None

    return until(tried)


def joined(s):
    """Eight clients that ask for the same at the same time do not take the line eight times."""
    entry = "equal reads at once are one"
    clients = [seated(s) for _ in range(8)]
    for reads in ([(6, 1, *words(0, 8))] * 8, [(6, 1, *words(0, 1 + nth)) for nth in range(8)]):
        for client, read in zip(clients, reads, strict=True):
            client.begin(*read)
        got = {client.next()[2] for client in clients}
        s.check(entry, got, {"01 01 00"}, "door")
    times = {}
    for name, each in (("equal", lambda nth: 8), ("different", lambda nth: 1 + nth)):
        began = time.monotonic()
        for _ in range(8):
            for nth, client in enumerate(clients):
                client.begin(6, 1, *words(0, each(nth)))
            for client in clients:
                client.next()
        times[name] = time.monotonic() - began
    for client in clients:
        client.close()
    # Eight times as many exchanges, and polls between them.
    s.check(entry, 2 * times["equal"] < times["different"], True, f"{times}")


def seats(s):
    """Eight connections of one address, and what is no Modbus."""
    read = (5, 3, *words(6, 2))
    clients = [seated(s) for _ in range(8)]
    for client in clients:
        s.check("connections: eight work", client.ask(*read), "03 04 03 67 00 7b", "each")
    with Client(s.ports["tool"]) as ninth:
        s.check("connections: the ninth is closed", ninth.next(), None, "the ninth")
    clients[0].send(b"GET / HTTP/1.1\r\nHost: railbus\r\n\r\n")
    s.check("closed: no Modbus", clients[0].next(), None, "HTTP")
    for client in clients[1:]:
        s.check("connections: eight work", client.ask(*read), "03 04 03 67 00 7b", "the others")
    for client in clients:
        client.close()


SUITES = [
    ("Modbus gateway to a line, masters", masters),
    ("Modbus gateway to a line, rights", rights),
    ("Modbus gateway to a line, faults", faults),
    ("Modbus gateway to a line, many", many),
]
