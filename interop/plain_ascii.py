"""The ASCII protocol of the EDA modules."""

from plain import SPEEDS, Script, lc02, lc02_reply, r55, rtu, text

FOREIGN = {
    "lc02": lc02(1, 3),
    "rtu": rtu(1, 1, 0, 0, 0, 16),
    "r55": r55(1, 0x10),
}
ADAM = ("$01F", "$014", "$015", "$01I", "$01P", "#**", "~**", "~010", "@01")
ADAM_NAMES = ("$AAF", "$AA4", "$AA5", "$AAI", "$AAP", "#**", "~**", "~AA0", "@AA")
SYNTAX = {
    "no delimiter": ("01M",),
    "unknown letter": ("$01X", "$01m"),
    "no address": ("$M",),
    "half an address": ("$0M", "$1M"),
    "bad digit": ("$0GM", "$G1M"),
    "blank": ("$01 M", "$ 01M", "$01M "),
    "body too short": ("$01", "#0100", "#01000", "%0101400"),
    "body too long": ("$01MM", "#0100011", "#01000111", "%01014006000"),
    "lower-case hex": ("#01000c", "%01014006c0", "%0a01400600"),
    "reply delimiter": ("!01M", ">01M", "?01M"),
}


def module(s, name, outputs, answers_new):
    """What both modules have: `s` talks to one at address 01, 9600 baud, named m."""
    inputs = 4 if outputs == 4 else 7
    full, high = (1 << outputs) - 1, (1 << inputs) - 1

    def data(entries, on, levels=high, checksum=False):
        s.ask(entries, text("$016", checksum), text(f"!{on:02X}{levels:02X}00", checksum))

    def configure(entries, old, new, speed=6, flags=0, was=False):
        reply = f"!{new if answers_new else old:02X}"
        s.ask(entries, text(f"%{old:02X}{new:02X}40{speed:02X}{flags:02X}", was),
              text(reply, was))

    data(["power-up: outputs off", "$AA6 open inputs read 1", "$AA6 unused bits are 0"], 0)
    s.ask("$AAM name", text("$01M"), text(f"!01{name}"))
    s.ask("$AA2 configuration", text("$012"), text("!01400600"))
    for value in range(full + 1):
        s.ask("#AA00dd every value", text(f"#0100{value:02X}"), text(">"))
        entries = ["#AA00dd every value"]
        data(entries + (["$AA6 each output"] if value.bit_count() == 1 else []), value)
    for start, word in ((0, "on"), (full, "off")):
        for channel in range(outputs):
            s.ask("", text(f"#0100{start:02X}"), text(">"))
            s.ask(f"#AA1cdd each channel {word}",
                  text(f"#011{channel:X}0{int(word == 'on')}"), text(">"))
            data(f"#AA1cdd each channel {word}", start ^ 1 << channel)
    s.ask("", text("#010000"), text(">"))
    for channel in range(inputs):
        s.do(f"levels m {1 << channel}")
        data(["$AA6 each input", "$AA6 unused bits are 0"], 0, 1 << channel)
    s.do("levels m 255")
    data("$AA6 unused bits are 0", 0)

    # A refused command changes nothing.
    s.ask("", text("#010005"), text(">"))
    for code in ("00", "41"):
        s.ask(f"%AA type {code}: silent", text(f"%0102{code}0600"))
    for code in ("00", "02", "08", "FF"):
        s.ask(f"%AA speed {code}: silent", text(f"%010240{code}00"))
    for code in ("01", "20", "41", "80", "C0"):
        s.ask(f"%AA format {code}: silent", text(f"%01024006{code}"))
    for order in ("01", "0F", "20", "FF"):
        s.ask(f"#AAoo order {order}: silent", text(f"#01{order}01"))
    for value in ("02", "10", "FF"):
        s.ask(f"#AA1c value {value}: silent", text(f"#0111{value}"))
    for channel in "45678F" if outputs == 4 else "89F":
        s.ask(f"#AA1c channel {channel}: silent", text(f"#011{channel}01"))
    for word, frames in SYNTAX.items():
        for frame in frames:
            s.ask(f"syntax: {word}: silent", text(frame))
    for command, word in zip(ADAM, ADAM_NAMES):
        s.ask(f"ADAM command {word}: silent", text(command))
    for frame in ("$02M", "$026", "#020001", "#021001", "%0203400600", "$00M", "$FFM"):
        s.ask("another address: silent, nothing", text(frame))
    for word, frame in FOREIGN.items():
        s.ask(f"a frame of {word}: silent", frame)
    s.ask("checksum off: one too many: silent", text("$016", True))
    s.ask("checksum off: one too many: silent", text("#010001", True))
    data(["another address: silent, nothing"], 5)
    s.ask("", text("$012"), text("!01400600"))

    # Where a frame begins and ends.
    answer = text(f"!01{name}")
    for frame in (b"\n$01M\r", b"$0\n1M\r", b"$01M\n\r"):
        s.ask("syntax: LF ignored", frame, answer)
    s.ask("syntax: a delimiter starts anew", b"$01$01M\r", answer)
    s.ask("syntax: a delimiter starts anew", b"%0102400600#$01M\r", answer)
    s.ask("syntax: more than 32 characters are discarded", b"$01M" + b"0" * 40 + b"\r")
    s.ask("syntax: more than 32 characters are discarded", b"$" + b"0" * 40 + b"$01M\r", answer)
    s.port.send(b"$0")
    s.settle()
    s.ask("syntax: a request in two pieces", b"1M\r", answer)

    # Addresses and speeds.
    addresses = [*range(2, 256), 0, 1]
    for old, new in zip([1, *addresses], addresses):
        entries = ["$AAM at every address 00-FF"]
        if new in (0, 1, 0x0A, 0x0D, 0x7F, 0xFF):
            entries.append(f"%AA address {new:02X}")
        reply_entry = f"%AA reply: the {'new' if answers_new else 'old'} address"
        configure([*entries, reply_entry], old, new)
        s.ask(entries, text(f"${new:02X}M"), text(f"!{new:02X}{name}"))
    for code, rate in [*SPEEDS.items(), (6, 9600)]:
        before = s.port.rate
        configure([f"%AA speed {code:02}", "%AA: reply in the old speed and checksum state"],
                  1, 1, code)
        if rate != before:
            s.ask("%AA speed: silent at the old one", text("$012"))
        s.port.speed(rate)
        s.ask([f"%AA speed {code:02}", f"$AA2 speed {code:02}"],
              text("$012"), text(f"!0140{code:02X}00"))

    # The checksum.
    configure(["%AA checksum on", "%AA: reply in the old speed and checksum state"],
              1, 1, 6, 0x40)
    carries = ["checksum on: every command", "checksum on: every reply carries one"]
    data(carries, 5, checksum=True)
    for request, reply in (
        ("$01M", f"!01{name}"), ("$012", "!01400640"), ("#010003", ">"), ("#011200", ">"),
        ("#011201", ">"), ("#010005", ">"),
        *((("#014030A", "!01"), ("$013", "!01030A"), ("#014000A", "!01"))
          if outputs == 4 else ()),
    ):
        s.ask(carries, text(request, True), text(reply, True))
    bad = {
        "missing": (b"$01M\r", b"#010000\r"),
        "wrong": (b"$016BA\r", b"#01000012\r", b"%010240060000\r"),
        "lower-case": (b"$016bb\r",),
        "of another frame": (b"$01MBB\r",),
    }
    for word, frames in bad.items():
        for frame in frames:
            s.ask(f"checksum on: {word}: silent, nothing", frame)
            data([f"checksum on: {word}: silent, nothing", "%AA checksum on"], 5, checksum=True)
    configure(["%AA checksum off", "%AA: reply in the old speed and checksum state",
               *carries], 1, 1, 6, 0, was=True)
    data("%AA checksum off", 5)

    # What survives a loss of power.
    configure("", 1, 0x2C, 7, 0x40)
    s.port.speed(19200)
    s.do("power m cycle")
    s.ask("%AA: survives power-off", text("$2C2", True), text("!2C400740", True))
    s.ask("power-up: outputs off", text("$2C6", True), text(f"!00{high:02X}00", True))
    configure("", 0x2C, 1, 6, 0, was=True)
    s.port.speed(9600)


def eda9060a():
    """EDA9060A."""
    with Script("EDA9060A ASCII", "name=m,model=eda9060a") as s:
        module(s, "9060", 4, answers_new=False)
        for value in (0x10, 0x1F, 0x80, 0xFF):
            s.ask("#AA00dd above 0F: silent", text(f"#0100{value:02X}"))
        for mask in range(16):
            entry = f"#AA4mmww mask {mask}"
            s.ask(entry, text(f"#014{mask:02X}0A"), text("!01"))
            s.ask([entry, "$AA3 mask and width"], text("$013"), text(f"!01{mask:02X}0A"))
        for mask in ("10", "F0", "FF"):
            s.ask(f"#AA4mmww mask {mask}: silent", text(f"#014{mask}0A"))
        for width in ("00", "C9", "FF"):
            s.ask(f"#AA4mmww width {width}: silent", text(f"#01403{width}"))
        s.ask("$AA3 mask and width", text("$013"), text("!010F0A"))
        for width in ("01", "0A", "C8"):
            s.ask(f"#AA4mmww width {width}", text(f"#01404{width}"), text("!01"))
            s.ask(f"#AA4mmww width {width}", text("$013"), text(f"!0104{width}"))
        pulses(s)
        s.ask("", text("#0140705"), text("!01"))
        s.do("power m cycle")
        s.ask("#AA4mmww survives power-off", text("$013"), text("!010705"))
        address_zero(s)
    return s.tally


def pulses(s):
    """Pulses of relay 2, in virtual time and exact."""
    for tenths in (1, 10, 200):
        entry = f"pulse of {tenths} tenths"
        s.ask("", text(f"#01404{tenths:02X}"), text("!01"))
        s.do("changes m")
        s.ask(entry, text("#011201"), text(">"))
        s.do(f"skip {100 * tenths}")
        s.check(entry, s.rig.pulses("m"), [(2, 100 * tenths)])
        s.ask(entry, text("$016"), text("!000F00"))
    s.ask("pulse: each bit by its own mode", text("#010005"), text(">"))
    s.ask("pulse: each bit by its own mode", text("$016"), text("!050F00"))
    for request in ("#011200", "#010003"):
        s.ask("pulse: 0 does nothing", text(request), text(">"))
    s.ask(["pulse: 0 does nothing", "pulse: each bit by its own mode"],
          text("$016"), text("!070F00"))
    s.do("skip 20000")
    s.check("pulse: 0 does nothing", s.rig.pulses("m"), [(2, 20000)])
    s.ask("pulse: each bit by its own mode", text("$016"), text("!030F00"))
    s.ask("", text("#010000"), text(">"))
    s.do("changes m")
    s.ask("", text("#011201"), text(">"))
    s.do("skip 12000")
    s.ask("pulse: a second 1 starts the width anew", text("#011201"), text(">"))
    s.do("skip 15000")
    s.check("pulse: a second 1 starts the width anew", s.rig.outputs("m"), 4)
    s.do("skip 5000")
    (_, length), = s.rig.pulses("m")
    s.check("pulse: a second 1 starts the width anew", 32000 <= length <= 40000, True, length)
    entry = "pulse: a change of mode or width leaves it alone"
    s.ask(entry, text("#011201"), text(">"))
    s.ask(entry, text("#0140001"), text("!01"))
    s.do("skip 20000")
    s.check(entry, s.rig.pulses("m"), [(2, 20000)])
    s.ask("", text("#01404C8"), text("!01"))
    s.ask("pulse: ended by power-off", text("#011201"), text(">"))
    s.do("power m cycle")
    s.ask("pulse: ended by power-off", text("$016"), text("!000F00"))


def address_zero(s):
    """Address 00 is the broadcast address in Modbus, so a module there answers nothing."""
    entry = "address 00 in Modbus: broadcast only"
    s.ask("", text("%0100400600"), text("!01"))
    s.ask("", text("#0040005"), text("!00"))
    s.do("protocol m rtu")
    s.ask(entry, rtu(0, 5, 0, 1, 0xFF, 0))
    s.check(entry, s.rig.outputs("m"), 2)
    s.ask(entry, rtu(0, 1, 0, 0, 0, 4))
    s.ask(entry, rtu(1, 1, 0, 0, 0, 4))


def eda9050():
    """EDA9050."""
    with Script("EDA9050 ASCII", "name=m,model=eda9050") as s:
        module(s, "9050", 8, answers_new=True)
        s.ask("no pulses: $AA3: silent", text("$013"))
        s.ask("no pulses: #AA4mmww: silent", text("#014030A"))
        s.ask("printed 082 without delimiter: silent", text("082"))
        s.ask("", text("#0100A5"), text(">"))
        s.do("init m ground")
        there = "INIT* pin: to LC-02 and back"
        s.ask("INIT* pin: ASCII silent while grounded", text("$016"))
        s.ask([there, "INIT* pin: settings and outputs stay"],
              lc02(1, 3), lc02_reply(1, 0xA5, 0x7F))
        s.ask([there, "INIT* pin: settings and outputs stay"],
              lc02(1, 1), lc02_reply(1, 6, 0x90, 0x50, 0))
        s.do("init m open")
        s.ask([there, "a frame of lc02: silent"], lc02(1, 3))
        s.ask([there, "INIT* pin: settings and outputs stay"], text("$016"), text("!A57F00"))
    return s.tally


def switches():
    """The options of the simulator."""
    with Script("ASCII switches", "name=m,model=eda9060a,aloud,lower-case") as s:
        for word, requests in {
            "bad value": ("#010010", "#011401", "%0101400800", "#0140300"),
            "unknown command": ("$01F",),
            "syntax": ("$01MM",),
        }.items():
            for request in requests:
                s.ask(f"aloud: {word} gets ?AA", text(request), text("?01"))
        for request in ("#020010", "$02F"):
            s.ask("aloud: another address: silent", text(request))
        s.ask("lower-case: taken", text("#01000a"), text(">"))
        s.ask("lower-case: taken", text("$016"), text("!0A0F00"))
    tally = s.tally
    for applies, table in (("restart", "address,speed,checksum"), ("address", "speed,checksum")):
        with Script("ASCII switches", f"name=m,model=eda9060a,applies={applies}") as s:
            s.tally = tally
            s.ask("", text("%0105400740"), text("!01"))
            if applies == "restart":
                entries = f"applies=restart: {{{table}}} old until power-up"
                s.ask(entries, text("$012"), text("!01400740"))
            else:
                entries = [f"applies=address: address at once, {word} at power-up"
                           for word in table.split(",")]
                s.ask(entries, text("$01M"))
                s.ask(entries, text("$05M"), text("!059060"))
            s.do("power m cycle")
            s.ask(entries, text("$05M"))
            s.port.speed(19200)
            s.ask(entries, text("$05M", True), text("!059060", True))
    return tally


SUITES = [
    ("plain, EDA9050 ASCII", eda9050),
    ("plain, EDA9060A ASCII", eda9060a),
    ("plain, ASCII switches", switches),
]
