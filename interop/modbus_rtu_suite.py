"""The daemon's Modbus RTU slave: masters by others read and switch modules of all families through
a serial port, and it never tells a value that it does not know or a success that was none."""

import threading

import modbus_tcp
from modbus_cases import DONE, SILENT, Raw, exception
from modbus_rtu import LAST_END, MASTERS, NONE, STATUS, Site, ask
from modbus_tcp import QUICK, TURNAROUND, UNITS, until

ADDRESS, ACKNOWLEDGE, BUSY = exception(2), exception(5), exception(6)
TARGET = exception(11)
# The end of a write, as its register has it.
READ_BACK, REPLIED, UNKNOWN = 1, 2, 4
ALL = {"write": ["*"]}
# No module has it.
NOBODY = 77


def one_on(module, nth, value=1):
    """One output on."""
    return [value * (place == nth) for place in range(UNITS[module][2])]


def masters():
    """Three masters, one after another, each with every module."""
    with Site(TURNAROUND, {"reply_within_ms": 5000, **ALL}) as s:
        for name in MASTERS:
            with s.master(name) as master:
                for nth, module in enumerate(UNITS):
                    by_one(s, name, master, module, nth)
                ascii_inputs(s, name, master)
                got = ask(master, NOBODY, 1, 0, 1, NONE)
                s.check(f"no module by {name}: silence", got, SILENT)
                s.check(f"no module by {name}: silence", ask(master, 3, 1, 60, 8), [0] * 8, "after")
        with s.master("pymodbus") as master:
            broadcast(s, master)
    return s.tally


def by_one(s, name, master, module, nth):
    """One master and one module."""
    unit, first, count = UNITS[module]
    nth %= count
    entry = f"{module} by {name}"
    read = lambda: ask(master, unit, 1, first, count)
    s.check(f"{entry}: read", read(), [0] * count, "all coils")
    for value in (1, 0):
        switched = f"{entry}: switched and read back"
        s.check(switched, ask(master, unit, 5, first + nth, [value]), DONE, f"FC05 of {value}")
        s.check(switched, read(), one_on(module, nth, value), "all coils")
        s.relays(switched, module, one_on(module, nth, value))


def ascii_inputs(s, name, master):
    """Inputs and registers."""
    entry = f"inputs and registers by {name}"
    s.check(entry, ask(master, 1, 2, 0, 4), [1, 0, 0, 1], "hall, which speaks ASCII")
    s.check(entry, ask(master, 5, 3, 6, 2), [871, 123], "tank")
    s.check(entry, ask(master, 4, 4, STATUS, 1), [0], "yard's quality")
    s.check(entry, ask(master, 3, 1, 0, 1), ADDRESS, "oven has no coil 0")


def broadcast(s, master):
    """Writes to all slaves."""
    number = lambda: ask(master, 3, 4, LAST_END - 1, 1)
    before = number()
    for pdu in ("05003CFF00", "0F003C000801FF", "0600000001"):
        got = master.request(0, Raw("", pdu, SILENT), NONE)
        s.check("a broadcast: silence", got in (SILENT, DONE), True, f"{pdu}: {got}")
    for module in UNITS:
        s.relays("a broadcast: nothing moves", module, one_on(module, 0, 0))
    s.check("a broadcast: nothing moves", number(), before, "commands")


def rights():
    """Without `write` nothing moves."""
    with Site(QUICK, {}) as s:
        for name in MASTERS:
            with s.master(name) as master:
                for module, (unit, first, count) in UNITS.items():
                    entry = f"rights by {name}: nothing moves"
                    s.check(entry, ask(master, unit, 5, first, [1]), ADDRESS, module)
                    s.relays(entry, module, one_on(module, 0, 0))
                    s.check(entry, ask(master, unit, 1, first, count), [0] * count, module)
    return s.tally


def faults():
    """A module without power, and writes that take longer than an answer may."""
    with Site(QUICK, ALL) as s:
        for name in MASTERS:
            with s.master(name) as master:
                dead(s, name, master)
    return s.tally


def dead(s, name, master):
    """The oven loses its power, and gets it back."""
    entry = f"a dead module by {name}"
    s.sim.do("power oven off")
    read = lambda: ask(master, 3, 1, 60, 8)
    s.check(f"{entry}: 0B", until(lambda: read() == TARGET), True, "oven")
    got = ask(master, 4, 1, 0, 20)
    s.check(f"{entry}: others go on", got, [0] * 20, "yard")
    if name != "mbpoll":
        got = ask(master, 3, 5, 61, [1])
        s.check(f"{entry}: no success", got in (TARGET, ACKNOWLEDGE), True, f"oven: {got}")
        ended = until(lambda: ask(master, 3, 4, LAST_END, 1) == [UNKNOWN])
        s.check(f"{entry}: no success", ended, True, "the end of the write")
        s.check(f"{entry}: others go on", ask(master, 4, 5, 3, [1]), DONE, "yard")
        s.relays(f"{entry}: others go on", "yard", one_on("yard", 3))
        s.check(f"{entry}: others go on", ask(master, 4, 5, 3, [0]), DONE, "yard")
    s.sim.do("power oven on")
    s.check(f"{entry}: good again", until(lambda: read() == [0] * 8), True, "oven")


def slow():
    """The modules take 100 ms, and an answer may take 50 ms."""
    with Site(TURNAROUND, {"reply_within_ms": 50, **ALL}) as s:
        with s.master("pymodbus") as master:
            for value in (1, 0):
                got = ask(master, 3, 5, 60, [value])
                s.check("a slow write: 05", got, ACKNOWLEDGE, "oven")
                got = ask(master, 3, 5, 61, [1])
                s.check("a slow write: another is refused", got, BUSY, "oven")
                s.check("a slow write: another is refused", ask(master, 5, 3, 6, 2), [871, 123])
                end = lambda: ask(master, 3, 4, LAST_END, 1)
                done = until(lambda: end() in ([READ_BACK], [REPLIED]))
                s.check("a slow write: its end is told", done, True, f"oven: {end()}")
                got = ask(master, 3, 4, LAST_END + 1, 2)
                s.check("a slow write: its end is told", got, [0, 60], "no error, coil 60")
                s.relays("a slow write: its end is told", "oven", one_on("oven", 0, value))
                now = until(lambda: ask(master, 3, 1, 60, 8) == one_on("oven", 0, value))
                s.check("a slow write: its end is told", now, True, "its coils")
    return s.tally


def echoes():
    """An adapter that receives what it sends: each write is one command."""
    with Site(QUICK, {"reply_within_ms": 5000, **ALL}, echoes=True) as s:
        with s.master("libmodbus") as master:
            number = lambda: ask(master, 3, 4, LAST_END - 1, 1)[0]
            for nth in range(8):
                before = number()
                for value in (1, 0):
                    got = ask(master, 3, 5, 60 + nth, [value])
                    s.check("an adapter that echoes: switched once", got, DONE, f"k{nth + 1}")
                s.check("an adapter that echoes: switched once", number(), before + 2, "commands")
                s.check("an adapter that echoes: read", ask(master, 3, 1, 60, 8), [0] * 8, "oven")
                s.check("an adapter that echoes: read", ask(master, 4, 1, 0, 20), [0] * 20, "yard")
            s.check("an adapter that echoes: switched once", number(), 16, "commands")
    return s.tally


# What a command of another one may make of a request at the same moment.
ALLOWED = (TARGET, BUSY)
TIMES = 20


def together():
    """A PLC on the wires and SCADA over Modbus TCP, at the same modules."""
    with Site(QUICK, {"reply_within_ms": 5000, **ALL}) as s:
        wrong, known = [], {}
        def work(who, master, parity):
            good = 0
            for turn in range(TIMES):
                module = ("yard", "hall", "oven")[turn % 3]
                unit, first, count = UNITS[module]
                nth, value = (2 * turn + parity) % count, turn // 3 % 2
                got = modbus_tcp.ask(master, unit, 5, first + nth, [value])
                known.pop((module, nth), None)
                if got == DONE:
                    known[module, nth] = value
                elif got not in ALLOWED:
                    wrong.append(f"{who}: {module} {nth}: {got}")
                got = modbus_tcp.ask(master, unit, 1, first, count)
                want = known.get((module, nth), None)
                if isinstance(got, list):
                    good += 1
                    if want is not None and got[nth] != want:
                        wrong.append(f"{who}: {module} {nth} is {got[nth]}, not {want}")
                elif got not in ALLOWED:
                    wrong.append(f"{who}: {module}: {got}")
            if not good:
                wrong.append(f"{who}: nothing was read")
        over_tcp = modbus_tcp.MASTERS["pymodbus"]
        with s.master("libmodbus") as plc, over_tcp(s.ports["scada"]) as scada:
            other = threading.Thread(target=work, args=("SCADA", scada, 1))
            other.start()
            work("PLC", plc, 0)
            other.join()
            entry = "a PLC and SCADA at the same time"
            s.check(entry, wrong, [], "answers that are wrong:")
            for module, (unit, first, count) in UNITS.items():
                real = s.sim.outputs(module)
                wanted = [known.get((module, nth), bit) for nth, bit in enumerate(real)]
                s.check(entry, real, wanted, module)
                for who, master in (("PLC", plc), ("SCADA", scada)):
                    read = lambda master=master, place=(unit, 1, first, count): (
                        modbus_tcp.ask(master, *place))
                    s.check(entry, until(lambda: read() == real), True, f"{module} by {who}")
    return s.tally


SUITES = [
    ("Modbus RTU slave, masters", masters),
    ("Modbus RTU slave, rights", rights),
    ("Modbus RTU slave, faults", faults),
    ("Modbus RTU slave, slow writes", slow),
    ("Modbus RTU slave, echo", echoes),
    ("Modbus RTU slave, with SCADA", together),
]
