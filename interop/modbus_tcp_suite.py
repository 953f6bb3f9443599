"""The daemon's Modbus TCP server: masters by others read and switch modules of all families
through it, and it never tells a value that it does not know or a success that was none."""

import itertools
import random
import struct
import threading
import time

from modbus_cases import DONE, SILENT, exception
from modbus_tcp import (
    APART,
    MASTERS,
    MAX_AGE,
    PATIENCE,
    QUICK,
    UNITS,
    Plant,
    ask,
    message,
    until,
    words,
)

ADDRESS, VALUE, FAILURE = exception(2), exception(3), exception(4)
PATH, TARGET = exception(10), exception(11)
# Exceptions as our own client shows them, after the function.
BUSY_HEX, PATH_HEX, TARGET_HEX = "06", "0a", "0b"

# Where the registers about a unit begin, and those of them that are used here.
STATUS, LAST_END = 64, 69
OFFLINE, LINE_ABSENT, UNKNOWN = 3, 4, 4
ALL = {"write": ["*"]}

# A module that stays well while others do not. It takes longer, but not so long that a poll that
# gives way to a command cuts it short.
LAMP = 7
LAMP_TOO = f"""
[module.lamp]
line = "main"
model = "erc8"
address = {LAMP}
sim = {{ turnaround = "50ms" }}
"""


def off(module):
    """All outputs of a module off."""
    return [0] * UNITS[module][2]


def one_on(module, nth):
    """One output on."""
    return [int(place == nth) for place in range(UNITS[module][2])]


# Masters -----------------------------------------------------------------------------------


def masters():
    """Three masters, one after another, each with every module."""
    with Plant(scada=ALL) as s:
        for name, open_master in MASTERS.items():
            with open_master(s.ports["scada"]) as master:
                for nth, module in enumerate(UNITS):
                    by_one(s, name, master, module, nth)
                points(s, name, master)
        with MASTERS["pymodbus"](s.ports["scada"]) as master:
            beside(s, master)
    return s.tally


def by_one(s, name, master, module, nth):
    """One master and one module."""
    unit, first, count = UNITS[module]
    entry, nth = f"{module} by {name}", nth % count
    read = lambda: ask(master, unit, 1, first, count)
    s.check(f"{entry}: read", read(), off(module), "all coils")
    s.check(f"{entry}: read", ask(master, unit, 1, first + nth, 1), [0], "one coil")
    switched = f"{entry}: switched and read back"
    for value, want in ((1, one_on(module, nth)), (0, off(module))):
        s.check(switched, ask(master, unit, 5, first + nth, [value]), DONE, f"FC05 of {value}")
        s.check(switched, read(), want, "all coils")
        s.relays(switched, module, want)
    at_once = f"{entry}: all coils at once"
    some = [int(place % 3 != 1) for place in range(count)]
    for want in (some, off(module)):
        s.check(at_once, ask(master, unit, 15, first, want), DONE, f"FC0F of {want}")
        s.check(at_once, read(), want, "all coils")
        s.relays(at_once, module, want)


def points(s, name, master):
    """What is read only."""
    s.check(f"inputs by {name}", ask(master, 1, 2, 0, 4), [1, 0, 0, 1], "hall")
    for unit, function, at, count in ((6, 2, 0, 7), (2, 2, 0, 7)):
        got = ask(master, unit, function, at, count)
        s.check(f"inputs by {name}", got, [1] * count, f"unit {unit}")
    s.check(f"analog registers by {name}", ask(master, 5, 3, 6, 2), [871, 123], "tank")
    for unit, _, _ in UNITS.values():
        got = ask(master, unit, 4, STATUS, 3)
        good = isinstance(got, list) and got[0] == 0 and got[1] < 100 and got[2] == 1
        s.check(f"status registers by {name}", good, True, f"unit {unit}, {got}")


def beside(s, master):
    """An input, and what is in no map."""
    s.sim.do("hall.di1 = 1")
    now = until(lambda: ask(master, 1, 2, 0, 4) == [1, 1, 0, 1])
    s.check("an input that changes", now, True, "hall.di1")
    for unit, function, at, count in (
        (3, 1, 0, 1), (3, 1, 59, 1), (3, 1, 67, 2), (3, 1, 68, 1), (3, 2, 60, 1), (3, 3, 0, 1),
        (3, 4, 0, 1), (3, 4, 63, 1), (3, 4, 64, 9), (5, 1, 7, 1), (5, 1, 10, 1), (5, 3, 5, 2),
        (5, 3, 8, 1), (5, 4, 0, 2), (6, 1, 8, 1), (6, 3, 0, 1), (6, 2, 7, 1),
    ):
        got = ask(master, unit, function, at, count)
        s.check("own map: nothing beside it", got, ADDRESS, f"unit {unit}, FC0{function}, {at}")
    for function, at, values in ((5, 59, [1]), (15, 66, [1, 1, 1]), (6, 0, [1]), (16, 60, [1])):
        got = ask(master, 3, function, at, values)
        s.check("own map: nothing beside it", got, ADDRESS, f"FC{function:02X} to {at}")
    s.relays("own map: nothing beside it", "oven", off("oven"))


# The uniform map ---------------------------------------------------------------------------


def uniform():
    """The same map for all, and units that are not addresses."""
    with Plant(same={"map": "uniform", "units": ["hall=247"], **ALL}) as s:
        for name, open_master in MASTERS.items():
            with open_master(s.ports["same"]) as master:
                by_words(s, name, master)
                numbers(s, name, master)
                runs(s, master)
                if name == "pymodbus":
                    combined(s, master.client)
    return s.tally


def combined(s, client):
    """A mask sets single bits, and a read comes after its write."""
    for entry, reply, want, on in (
        ("uniform map: bits by a mask",
         lambda: client.mask_write_register(
             address=0, and_mask=0xFFFA, or_mask=0x0001, device_id=4),
         None, {0}),
        ("uniform map: bits by a mask",
         lambda: client.mask_write_register(
             address=1, and_mask=0xFFFD, or_mask=0x0002, device_id=4),
         None, {0, 17}),
        ("uniform map: a read with a write",
         lambda: client.readwrite_registers(
             read_address=0, read_count=2, write_address=0, values=[0x0004], device_id=4),
         [0x0004, 0x0002], {2, 17}),
        ("uniform map: a read with a write",
         lambda: client.readwrite_registers(
             read_address=1, read_count=1, write_address=0, values=[0, 0], device_id=4),
         [0], {}),
    ):
        got = reply()
        s.check(entry, got.isError(), False, str(got))
        if want is not None:
            s.check(entry, got.registers, want, "the registers after the write")
        count = UNITS["yard"][2]
        s.relays(entry, "yard", [int(nth in on) for nth in range(count)])


def by_words(s, name, master):
    """Outputs as bits of words."""
    entry = f"uniform map: words by {name}"
    for module, function, values, on in (
        ("oven", 6, [0b1101], {0, 2, 3}),
        ("oven", 16, [0b0110, 0], {1, 2}),
        ("oven", 6, [0], {}),
        ("yard", 16, [0x8001, 0x000A], {0, 15, 17, 19}),
        ("yard", 6, [0x0002], {1, 17, 19}),
        ("yard", 16, [0, 0], {}),
        ("gate", 6, [0x81], {0, 7}),
        ("gate", 6, [0], {}),
    ):
        unit, _, count = UNITS[module]
        said = f"{module}, FC{function:02X} of {values}"
        want = [int(nth in on) for nth in range(count)]
        s.check(entry, ask(master, unit, function, 0, values), DONE, said)
        both = [sum(bit << nth for nth, bit in enumerate(want[at:at + 16])) for at in (0, 16)]
        s.check(entry, ask(master, unit, 3, 0, 2), both, said)
        s.check("uniform map: coils", ask(master, unit, 1, 0, count), want, said)
        got = ask(master, unit, 2, 100, count)
        s.check("uniform map: outputs as inputs", got, want, said)
        s.relays(entry, module, want)
    absent = "uniform map: an output that is not there"
    s.check(absent, ask(master, 3, 6, 0, [0x0100]), VALUE, "the ninth of eight")
    s.check(absent, ask(master, 3, 6, 1, [0]), ADDRESS, "the second word alone")
    s.check(absent, ask(master, 3, 16, 0, [1, 1]), VALUE, "the seventeenth of eight")
    s.check(absent, ask(master, 3, 5, 8, [1]), ADDRESS, "the ninth coil")
    s.relays(absent, "oven", off("oven"))


def numbers(s, name, master):
    """Analog values, each as the API has it."""
    values = [s.points()[f"tank.{label}"] for label in ("ai1", "ai2")]
    scaled = [round(point["value"] * 10 ** point["decimals"]) & 0xFFFF for point in values]
    got = ask(master, 5, 4, 0, 2)
    s.check(f"uniform map: scaled values by {name}", got, scaled, "the API's values as integers")
    s.check(f"uniform map: scaled values by {name}", got, [871, 20], "8.71 V and 2.0 bar")
    got = ask(master, 5, 4, 16, 4)
    floats = list(struct.unpack(">ff", words(*got))) if isinstance(got, list) else got
    want = [struct.unpack(">f", struct.pack(">f", point["value"]))[0] for point in values]
    s.check(f"uniform map: floating-point values by {name}", floats, want, "the API's values")


def runs(s, master):
    """Where things are, and are not."""
    for module, got in (("hall", ask(master, 247, 1, 0, 4)), ("tank", ask(master, 5, 1, 0, 2))):
        s.check("uniform map: coils", got, off(module), module)
    s.check("uniform map: units of its own", ask(master, 1, 1, 0, 4), PATH, "its address")
    s.check("uniform map: coils", ask(master, 3, 1, 60, 1), ADDRESS, "its own map")


# Rights ------------------------------------------------------------------------------------

# What else is said about the outputs of the ERC-8.
SAFETY = """
[module.oven.point]
k4 = { interlock = ["oven.k5"] }
k6 = { locked = true }
k7 = { confirm = true }
"""


def rights():
    """What may not be switched does not move."""
    may = [f"oven.k{nth}" for nth in (1, 4, 5, 6, 7)]
    with Plant(SAFETY, open={"write": [*may, "yard"]}, reading={}) as s:
        with MASTERS["pymodbus"](s.ports["open"]) as master:
            forbidden(s, master)
        s.settle("reading")
        with MASTERS["libmodbus"](s.ports["reading"]) as master:
            for module, (unit, first, count) in UNITS.items():
                entry = "rights: without `write` nothing moves"
                for function, values in ((5, [1]), (15, [1] * count)):
                    got = ask(master, unit, function, first, values)
                    s.check(entry, got, ADDRESS, f"{module}, FC{function:02X}")
                s.relays(entry, module, off(module))
                s.check(entry, ask(master, unit, 1, first, count), off(module), module)
    return s.tally


def forbidden(s, master):
    """With rights for some."""
    put = lambda at, *values: ask(master, 3, 5 if len(values) == 1 else 15, 59 + at, [*values])
    for entry, at, values, want, on in (
        ("rights: an output in `write`", 1, [1], DONE, {1}),
        ("rights: an output that is not in `write`", 2, [1], ADDRESS, {1}),
        ("rights: all coils of a request or none", 1, [0, 0], ADDRESS, {1}),
        ("rights: an output in `write`", 1, [0], DONE, {}),
        ("rights: all coils of a request or none", 1, [1, 1], ADDRESS, {}),
        ("an output that is locked", 6, [1], ADDRESS, {}),
        ("an output that asks for confirmation", 7, [1], FAILURE, {}),
        ("an output that is interlocked", 4, [1], DONE, {4}),
        ("an output that is interlocked", 5, [1], FAILURE, {4}),
        ("an output that is interlocked", 4, [0], DONE, {}),
        ("an output that is interlocked", 4, [1, 1], FAILURE, {}),
        ("an output that is interlocked", 5, [1], DONE, {5}),
        ("an output that is interlocked", 4, [1], FAILURE, {5}),
        ("an output that is interlocked", 5, [0], DONE, {}),
    ):
        s.check(entry, put(at, *values), want, f"k{at} {values}")
        s.relays(entry, "oven", [int(nth in on) for nth in range(1, 9)])
    for module in ("hall", "gate", "tank", "door"):
        unit, first, _ = UNITS[module]
        entry = "rights: an output that is not in `write`"
        s.check(entry, ask(master, unit, 5, first, [1]), ADDRESS, module)
        s.relays(entry, module, off(module))
    entry = "rights: an output in `write`"
    s.check(entry, ask(master, 4, 5, 19, [1]), DONE, "all outputs of yard")
    s.relays(entry, "yard", one_on("yard", 19))
    s.check(entry, ask(master, 4, 5, 19, [0]), DONE, "all outputs of yard")


# Faults ------------------------------------------------------------------------------------


def faults():
    """Modules without power, and a line that has gone."""
    with Plant(LAMP_TOO, turnaround=QUICK, scada=ALL) as s:
        with MASTERS["pymodbus"](s.ports["scada"]) as master:
            power(s, master)
        for module in UNITS:
            dead_write(s, module)
        waiting(s)
        mute(s)
        with MASTERS["pymodbus"](s.ports["scada"]) as master:
            killed(s, master)
    return s.tally


def told_until(want, read, since, is_old=lambda got: isinstance(got, list)):
    """Reads until it gives what is wanted; what it gave at last, how long after `since` the last
    read was begun that still got an old value, any value by default, and what else came."""
    last, between, end = since, set(), time.monotonic() + PATIENCE
    while True:
        began = time.monotonic()
        got = read()
        if got == want or began > end:
            return got, last - since, between
        if is_old(got):
            last = began
        else:
            between.add(str(got))


def power(s, master):
    """A module loses its power, and gets it back."""
    oven = lambda: ask(master, 3, 1, 60, 8)
    lamp = lambda: ask(master, LAMP, 1, 60, 8)
    status = lambda: ask(master, 3, 4, STATUS, 1)
    # A relay that drops with the power.
    until(lambda: ask(master, 3, 5, 60, [1]) == DONE)
    s.sim.do("power oven off")
    since = time.monotonic()
    got, age, between = told_until(TARGET, oven, since)
    s.check("power off: 0B", (got, between), (TARGET, set()), "the first answer without a value")
    s.check("power off: never an old value", age <= MAX_AGE + 1, True, f"{age:.2f} s old,")
    s.check("power off: status 3", until(lambda: status() == [OFFLINE]), True, "oven")
    for _ in range(25):
        s.check("power off: never an old value", oven(), TARGET, "oven")
        s.check("power off: others go on", lamp(), off("oven"), "lamp")
    for value in (1, 0):
        s.check("power off: others go on", ask(master, LAMP, 5, 60, [value]), DONE, "lamp")
        s.check("power off: others go on", lamp(), [value, *[0] * 7], "lamp")
        s.check("power off: others go on", s.sim.outputs("lamp")[0], value, "its relay")
    s.check("power off: status 3", status(), [OFFLINE], "oven")
    s.sim.do("power oven on")
    # What was read before it lost its power may be told again as long as it is not too old.
    is_on = lambda got: got == one_on("oven", 0)
    got, age, between = told_until(off("oven"), oven, since, is_on)
    s.check("power on: the true state", got, off("oven"), "all coils")
    s.check("power on: the true state", between <= {TARGET}, True, f"{between}")
    s.check("power off: never an old value", age <= MAX_AGE + 1, True, f"{age:.2f} s old,")
    s.check("power on: good again", until(lambda: status() == [0]), True, "oven")
    s.settle("scada")


def killed(s, master):
    """The line goes, and comes back."""
    never, again = "a killed line: never an old value", "a killed line: good again"
    read = {module: lambda place=place: ask(master, place[0], 1, *place[1:])
            for module, place in UNITS.items()}
    status = lambda unit: ask(master, unit, 4, STATUS, 1)
    # Relays that drop with the line.
    until(lambda: ask(master, 3, 5, 60, [1]) == DONE and ask(master, 6, 5, 0, [1]) == DONE)
    s.sim.kill()
    since = time.monotonic()
    for module, one in read.items():
        got, age, between = told_until(PATH, one, since)
        s.check("a killed line: 0A", got, PATH, module)
        s.check(never, between <= {TARGET}, True, f"{module}, {between},")
        s.check(never, age <= MAX_AGE + 1, True, f"{module}, {age:.2f} s old,")
    for unit, _, _ in UNITS.values():
        here = until(lambda unit=unit: status(unit) == [LINE_ABSENT])
        s.check("a killed line: status 4", here, True, f"unit {unit}")
    for _ in range(10):
        for module, one in read.items():
            s.check("a killed line: 0A", one(), PATH, module)
    got = ask(master, 3, 5, 61, [1])
    s.check("a killed line: 0A", got in (PATH, TARGET), True, f"a write, {got},")
    s.sim.start()
    for module, one in read.items():
        got, age, between = told_until(off(module), one, since)
        s.check(again, got, off(module), module)
        s.check(again, between <= {PATH, TARGET}, True, f"{module}, {between},")
        s.check(never, age <= MAX_AGE + 1, True, f"{module}, {age:.2f} s old,")


def dead_write(s, module):
    """A write to a module without power, and what else the connection is told meanwhile."""
    unit, first, count = UNITS[module]
    entry = "a write to a dead module:"
    before = s.silences("lamp")
    s.sim.do(f"power {module} off")
    with s.client("scada") as client:
        write = client.begin(unit, 5, *words(first, 0xFF00))
        own = client.begin(unit, 1, *words(first, count))
        # The other unit is asked again after each answer, until the write is answered.
        asked = client.begin(LAMP, 1, *words(60, 8))
        order, said, others = [], {}, set()
        while write not in said or own not in said:
            answer = client.next()
            if answer in (None, SILENT):
                order.append(answer or "closed")
                break
            transaction, _, text = answer
            order.append({write: "write", own: "own"}.get(transaction, "other"))
            said[transaction] = text
            if transaction == asked:
                others.add(text)
                if write not in said:
                    # Without a pause it would take the machine from the modules.
                    time.sleep(APART)
                    asked = client.begin(LAMP, 1, *words(60, 8))
        # A machine that does not get round to the simulator makes any module silent.
        may = {"01 01 00"} | ({f"81 {TARGET_HEX}"} if s.silences("lamp") > before else set())
        s.check(f"{entry} other units go on", others <= may, True, f"{module}, {others},")
        s.check(f"{entry} {module}", said.get(write, "")[:2], "85", f"{order}, {said.get(write)}")
        s.check(f"{entry} 0B", said.get(write), f"85 {TARGET_HEX}", module)
        s.check(f"{entry} other units go on", order[:1], ["other"], f"{module}, {order},")
        mine = [one for one in order if one != "other"]
        s.check(f"{entry} its own unit waits", mine, ["write", "own"], f"{module}, {order},")
        s.check(f"{entry} 0B", said.get(own), f"81 {TARGET_HEX}", f"{module}, the read behind")
    s.sim.do(f"power {module} on")
    s.settle("scada")
    s.relays(f"{entry} {module}", module, off(module))


def waiting(s):
    """More requests than may wait for a write are refused, and all are answered."""
    entry = "a write to a dead module: too many that wait"
    s.sim.do("power oven off")
    with s.client("scada") as client:
        # In one piece, so that they arrive while the write is under way.
        pdus = [(5, *words(60, 0xFF00)), *[(1, *words(60, 8))] * 20]
        client.send(b"".join(message(nth, 3, *pdu) for nth, pdu in enumerate(pdus)))
        answers = [client.next() for _ in pdus]
    s.sim.do("power oven on")
    want = [(nth, 3, f"81 {BUSY_HEX}") for nth in range(16, 21)]
    want += [(0, 3, f"85 {TARGET_HEX}")] + [(nth, 3, f"81 {TARGET_HEX}") for nth in range(1, 16)]
    s.check(entry, answers, want, "one write and 20 reads")
    s.settle("scada")
    s.relays(entry, "oven", off("oven"))


def mute(s):
    """A module that obeys and does not answer: nobody knows, until it does."""
    entry = "a write that was not answered:"
    s.sim.do("fault oven mute")
    with s.client("scada") as client:
        got = client.ask(3, 5, *words(62, 0xFF00))
        s.check(f"{entry} 0B", got, f"85 {TARGET_HEX}", "k3")
        got = client.ask(3, 4, *words(LAST_END, 1))
        want = f"04 02 00 {UNKNOWN:02x}"
        s.check(f"{entry} the last command unknown", got, want, "its end")
        s.check(f"{entry} 0B", client.ask(3, 1, *words(60, 8)), f"81 {TARGET_HEX}", "a read")
        s.sim.do("fault clear")
        until(lambda: client.ask(3, 1, *words(60, 8))[:2] == "01")
        real = s.sim.outputs("oven")
        bits = sum(bit << nth for nth, bit in enumerate(real))
        got = client.ask(3, 1, *words(60, 8))
        s.check(f"{entry} the truth afterwards", got, f"01 01 {bits:02x}", "all coils")
        s.check(f"{entry} the truth afterwards", real, one_on("oven", 2), "the relays")
    s.settle("scada")


# Bad input ---------------------------------------------------------------------------------


def bad_input():
    """Bytes that are no requests, and requests that ask for nothing that there is."""
    with Plant(scada=ALL, seats={}) as s:
        slow = [threading.Thread(target=half, args=(s, more)) for more in (False, True)]
        for thread in slow:
            thread.start()
        no_modbus(s)
        no_requests(s)
        pieces(s)
        seats(s)
        for thread in slow:
            thread.join()
        for module in UNITS:
            s.check("", s.sim.outputs(module), off(module), f"{module}, after all that,")
    return s.tally


def no_modbus(s):
    """What ends a connection."""
    good = message(9, 3, 1, *words(60, 8))
    hello = bytes.fromhex("16 03 01 00 05 01 00 00 01 03")
    for entry, data in (
        *((f"closed: length {size}", struct.pack(">HHHB", 1, 0, size, 3) + good[7:])
          for size in (0, 1, 255, 256, 65535)),
        ("closed: protocol 1", good[:3] + b"\x01" + good[4:]),
        ("closed: HTTP", b"GET / HTTP/1.1\r\nHost: railbus\r\n\r\n"),
        ("closed: TLS", hello),
    ):
        with s.client("scada") as client:
            client.send(data)
            s.check(entry, client.next(), None, data.hex(" "))
        with s.client("scada") as client:
            client.send(good + data)
            before = "closed: what came before is answered"
            s.check(before, client.next(), (9, 3, "01 01 00"), data.hex(" "))
            s.check(before, client.next(), None, data.hex(" "))


def no_requests(s):
    """What is refused, with the connection kept."""
    with s.client("scada") as client:
        for entry, unit, pdu, want in (
            ("function 07: 01", 3, "07", "87 01"),
            ("function 08: 01", 3, "08 00 00 12 34", "88 01"),
            ("function 16 without registers: 02", 3, "16 00 3C 00 01 00 01", "96 02"),
            ("function 17 without registers: 02", 3, "17 00 3C 00 01 00 3C 00 01 02 00 01",
             "97 02"),
            ("function 41: 01", 3, "41 00", "c1 01"),
            ("quantity: 03", 3, "01 00 3C 00 00", "81 03"),
            ("quantity: 03", 3, "01 00 3C 07 D1", "81 03"),
            ("quantity: 03", 1, "02 00 00 00 00", "82 03"),
            ("quantity: 03", 5, "03 00 06 00 00", "83 03"),
            ("quantity: 03", 5, "03 00 06 00 7E", "83 03"),
            ("quantity: 03", 5, "04 00 40 00 00", "84 03"),
            ("quantity: 03", 3, "0F 00 3C 00 00 00", "8f 03"),
            ("quantity: 03", 3, "0F 00 3C 00 08 02 FF 00", "8f 03"),
            ("quantity: 03", 4, "10 00 00 00 00 00", "90 03"),
            ("quantity: 03", 4, "10 00 00 00 01 04 00 01 00 00", "90 03"),
            ("values of FC05: 03", 3, "05 00 3C 55 00", "85 03"),
            ("values of FC05: 03", 3, "05 00 3C 00 FF", "85 03"),
            ("values of FC05: 03", 3, "05 00 3C FF FF", "85 03"),
            ("a body that is no request: 03", 3, "01", "81 03"),
            ("a body that is no request: 03", 3, "01 00 3C 00", "81 03"),
            ("a body that is no request: 03", 3, "05 00 3C FF", "85 03"),
            ("a body that is no request: 03", 3, "05 00 3C FF 00 00", "85 03"),
            ("addresses outside: 02", 3, "01 00 3B 00 01", "81 02"),
            ("addresses outside: 02", 3, "01 00 3C 00 09", "81 02"),
            ("addresses outside: 02", 3, "01 FF FF 00 02", "81 02"),
            ("addresses outside: 02", 5, "03 FF FF 00 02", "83 02"),
            ("addresses outside: 02", 3, "05 00 44 FF 00", "85 02"),
            ("addresses outside: 02", 3, "0F 00 40 00 08 01 FF", "8f 02"),
            ("addresses outside: 02", 3, "0F FF FF 00 02 01 03", "8f 02"),
            ("a unit that is none: 0A", 9, "01 00 3C 00 08", f"81 {PATH_HEX}"),
            ("a unit that is none: 0A", 9, "05 00 3C FF 00", f"85 {PATH_HEX}"),
            ("a unit that is none: 0A", 248, "03 00 00 00 01", f"83 {PATH_HEX}"),
            ("the gateway itself: 01", 255, "01 00 3C 00 08", "81 01"),
            ("the gateway itself: 01", 0, "0F 00 3C 00 08 01 FF", "8f 01"),
            ("the gateway itself: 01", 0, "05 00 3C FF 00", "85 01"),
        ):
            got = client.ask(unit, *bytes.fromhex(pdu))
            s.check(entry, got, want, f"unit {unit}, {pdu}")
        for entry, unit, said in (
            ("the gateway itself: name", 0, b"railbus"),
            ("the gateway itself: name", 255, b"railbus"),
            ("a module's name", 3, b"ERC-8"),
            ("a module's name", 1, b"EDA9060A"),
        ):
            answer = client.ask(unit, 0x2B, 0x0E, 1, 0)
            named = answer[:8] == "2b 0e 01" and said.hex(" ") in answer
            s.check(entry, named, True, f"unit {unit}, {answer}")
        answer = client.ask(3, 0x2B, 0x0E, 5, 0)
        s.check("a module's name", answer, "ab 03", "a code that is none")
        s.check("", client.ask(3, 1, *words(60, 8)), "01 01 00", "it goes on")


def pieces(s):
    """The same messages, cut otherwise."""
    with s.client("scada") as client:
        data = message(0xFFFF, 3, 1, *words(60, 8))
        for place in range(len(data)):
            client.send(data[place:place + 1])
        s.check("a message byte by byte", client.next(), (0xFFFF, 3, "01 01 00"), "13 pieces")
        numbers = (7, 7, 0, 65535, 1)
        client.send(b"".join(message(nth, 3, 1, *words(60, 8)) for nth in numbers) + data[:5])
        got = [client.next() for _ in numbers]
        want = [(nth, 3, "01 01 00") for nth in numbers]
        s.check("messages in one piece", got, want, "five and the beginning of another")
        client.send(data[5:])
        s.check("messages in one piece", client.next(), (0xFFFF, 3, "01 01 00"), "the other")


def seats(s):
    """Eight connections of one address."""
    read = (3, 1, *words(60, 8))
    clients = [s.client("seats") for _ in range(8)]
    until(lambda: clients[0].ask(*read) == "01 01 00")
    for client in clients:
        s.check("connections: eight work", client.ask(*read), "01 01 00", "before the ninth")
    with s.client("seats") as ninth:
        s.check("connections: the ninth is closed", ninth.next(), None, "the ninth")
    for client in clients:
        s.check("connections: eight work", client.ask(*read), "01 01 00", "after the ninth")
    clients.pop().close()
    free = until(lambda: served(s, read))
    s.check("connections: a free place", free, True, "after one has gone")
    for client in clients:
        s.check("connections: eight work", client.ask(*read), "01 01 00", "to the end")
        client.close()


def served(s, read):
    """Whether a new connection is served."""
    with s.client("seats") as client:
        try:
            return client.ask(*read) == "01 01 00"
        except OSError:
            return False


def half(s, more):
    """Half a message and, if `more`, now and then another byte of a message that never ends."""
    with s.client("scada") as client:
        began = time.monotonic()
        client.send(message(1, 3, 16, *words(0, 123), 246, *[0] * 246)[:8])
        client.socket.settimeout(1.0)
        got = SILENT
        while got == SILENT and time.monotonic() < began + 30:
            got = client.next()
            if more and got == SILENT:
                try:
                    client.send(b"\0")
                except OSError:
                    got = None
        took = time.monotonic() - began
    closed = "half a message: " + ("more bytes give no more time" if more else "closed")
    s.check(closed, got, None, f"after {took:.1f} s")
    s.check("half a message: not at once", took >= 9, True, f"after {took:.1f} s")


# Two masters at once -----------------------------------------------------------------------

# How long they do it, in seconds, and how many requests of each are too few.
HAMMERING, FEWEST = 8.0, 10
# What a machine without time for the modules may make of a request.
ALLOWED = (TARGET, exception(6))


def together():
    """Two masters and a client that does not wait for answers, all at the same modules."""
    with Plant(turnaround=QUICK, scada=ALL) as s:
        end = time.monotonic() + HAMMERING
        hammers = [Hammer(s, "pymodbus", 0, end), Hammer(s, "libmodbus", 1, end)]
        hammers.append(Pipelined(s, end))
        for hammer in hammers:
            hammer.start()
        for hammer in hammers:
            hammer.join()
            entry = f"two masters at once: {hammer.who}"
            s.check(entry, hammer.wrong, [], "answers that are wrong:")
            s.check(entry, hammer.good >= FEWEST, True, f"{hammer.good} good requests")
        s.settle("scada")
        agree(s, {relay: value for hammer in hammers for relay, value in hammer.known.items()})
    return s.tally


def agree(s, known):
    """All say the same of all relays, and what was switched is so."""
    with MASTERS["mbpoll"](s.ports["scada"]) as master:
        for module, (unit, first, count) in UNITS.items():
            real = s.sim.outputs(module)
            wanted = [known.get((module, nth), bit) for nth, bit in enumerate(real)]
            s.check("two masters at once: simulator agree", real, wanted, module)
            # Where a machine without time made a command unknown, the next poll tells.
            until(lambda module=module, real=real: s.outputs(module) == real)
            s.check("two masters at once: API agree", s.outputs(module), real, module)
            read = lambda place=(unit, 1, first, count): ask(master, *place)
            until(lambda read=read, real=real: read() == real)
            s.check("two masters at once: mbpoll agree", read(), real, module)


class Hammer(threading.Thread):
    """A master that switches every other output of all modules, and reads them back."""

    def __init__(self, s, who, parity, end):
        super().__init__()
        self.s, self.who, self.parity, self.end = s, who, parity, end
        self.random = random.Random(parity)
        # The outputs whose state is known, what was wrong, and how many requests were answered.
        self.known, self.wrong, self.good = {}, [], 0

    def run(self):
        """Until the end."""
        try:
            with MASTERS[self.who](self.s.ports["scada"]) as master:
                while time.monotonic() < self.end and not self.wrong:
                    self.step(master, self.random.choice(list(UNITS)))
        except Exception as error:
            self.wrong.append(repr(error))

    def step(self, master, module):
        """Switches an output and reads all."""
        unit, first, count = UNITS[module]
        mine = range(self.parity, count, 2)
        nth, value = self.random.choice(mine), self.random.getrandbits(1)
        got = ask(master, unit, 5, first + nth, [value])
        self.known.pop((module, nth), None)
        if self.counted(got, DONE, f"{module} {nth} to {value}"):
            self.known[module, nth] = value
        got = ask(master, unit, 1, first, count)
        want = [self.known.get((module, nth)) for nth in mine]
        mine_only = got
        if isinstance(got, list) and len(got) == count:
            mine_only = [bit if (module, nth) in self.known else None
                         for nth, bit in enumerate(got) if nth in mine]
        self.counted(mine_only, want, f"{module}, every other")
        if module == "tank":
            self.counted(ask(master, 5, 3, 6, 2), [871, 123], "tank's registers")

    def counted(self, got, want, what):
        """Counts."""
        if got == want:
            self.good += 1
        elif got not in ALLOWED:
            self.wrong.append(f"{what}: {got!r}, not {want!r}")
        return got == want


class Pipelined(threading.Thread):
    """A client that asks many things at once, and is answered each by its number."""

    who = "pipelined"

    def __init__(self, s, end):
        super().__init__()
        self.s, self.end, self.random = s, end, random.Random(2)
        self.known, self.wrong, self.good = {}, [], 0

    def run(self):
        """Until the end."""
        try:
            with self.s.client("scada") as client:
                for first in itertools.count(0, 12):
                    if time.monotonic() > self.end or self.wrong:
                        break
                    self.burst(client, first % 60_000)
        except Exception as error:
            self.wrong.append(repr(error))

    def burst(self, client, first):
        """Twelve requests in one piece."""
        asked = {}
        for transaction in range(first, first + 12):
            unit, at, most = self.random.choice(list(UNITS.values()))
            count = self.random.randint(1, most)
            asked[transaction] = unit, f"01 {(count + 7) // 8:02x}", (count + 7) // 8
            client.send(message(transaction, unit, 1, *words(at, count)))
        for _ in range(12):
            transaction, unit, text = client.next()
            wanted, head, size = asked.pop(transaction)
            fits = text[:5] == head and len(text) == 5 + 3 * size or text == f"81 {TARGET_HEX}"
            if unit != wanted or not fits:
                self.wrong.append(f"{transaction}: unit {unit}, {text}; not {wanted}, {head}")
            else:
                self.good += 1


SUITES = [
    ("Modbus TCP, masters", masters),
    ("Modbus TCP, uniform map", uniform),
    ("Modbus TCP, rights", rights),
    ("Modbus TCP, faults", faults),
    ("Modbus TCP, bad input", bad_input),
    ("Modbus TCP, two masters", together),
]
