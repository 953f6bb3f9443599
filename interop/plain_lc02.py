"""LC-02, the hexadecimal protocol of the EDA modules."""

from plain import SPEEDS, Script, lc02, lc02_reply, r55, rtu, text, total

FOREIGN = {"ascii": text("$01M"), "rtu": rtu(1, 1, 0, 0, 0, 16), "r55": r55(1, 0x10)}


def module(s, model, outputs):
    """What both modules have: `s` talks to one at address 01, 9600 baud, named m."""
    inputs = 4 if outputs == 4 else 7
    full, high = (1 << outputs) - 1, (1 << inputs) - 1

    def data(entries, on, levels=high, address=1):
        s.ask(entries, lc02(address, 3), lc02_reply(address, on, levels))

    def write(entries, *body, address=1):
        s.ask(entries, lc02(address, 4, *body), lc02_reply(address))

    def configure(entries, old, new, speed=6):
        s.ask(entries, lc02(old, 2, new, speed, 0), lc02_reply(old))

    data(["power-up: outputs off", "03 open inputs read 1"], 0)
    s.ask("01 configuration: model in BCD, type 00", lc02(1, 1), lc02_reply(1, 6, *model, 0))
    for value in range(full + 1):
        write("04 all: every value", 0xFF, value)
        entries = ["04 all: every value"]
        data(entries + (["03 each output"] if value.bit_count() == 1 else []), value)
    for start, word in ((0, "on"), (full, "off")):
        for channel in range(outputs):
            write("", 0xFF, start)
            write(f"04 each channel {word}", channel, int(word == "on"))
            data(f"04 each channel {word}", start ^ 1 << channel)
    write("", 0xFF, 0)
    for channel in range(inputs):
        s.do(f"levels m {1 << channel}")
        data("03 each input", 0, 1 << channel)
    # 6C 63 01 03 02 06 0D and 6C 63 01 11 22 34 0D.
    on, levels = (0x03, 0x02) if outputs == 4 else (0x11, 0x22)
    write("", 0xFF, on)
    s.do(f"levels m {levels}")
    printed = "6C63010302060D" if outputs == 4 else "6C63011122340D"
    s.ask("03 as printed", bytes.fromhex("4C570103040D"),
          bytes.fromhex(printed))
    s.do("levels m 255")

    # A refused command changes nothing.
    write("", 0xFF, 5)
    for value in (2, 0xFF):
        s.ask(f"04 value {value:02X} for one channel: silent", lc02(1, 4, 0, value))
    for channel in ("04", "07", "FE") if outputs == 4 else ("08", "10", "FE"):
        s.ask(f"04 channel {channel}: silent", lc02(1, 4, int(channel, 16), 1))
    for code in ("00", "02", "08", "FF"):
        s.ask(f"02 speed {code}: silent", lc02(1, 2, 2, int(code, 16), 0))
    for byte in ("01", "40"):
        s.ask(f"02 third byte {byte}: silent", lc02(1, 2, 2, 6, int(byte, 16)))
    for command in ("00", "07", "30", "FF"):
        s.ask(f"unknown command {command}: silent", lc02(1, int(command, 16)))
    good = lc02(1, 4, 0xFF, 0)
    for word, bad in {
        "checksum": good[:-2] + bytes([good[-2] ^ 1, 0x0D]),
        "end byte": good[:-1] + b"\x0A",
        "start byte": b"\x4D" + good[1:],
    }.items():
        s.ask(f"wrong {word}: silent, nothing", bad)
        data(f"wrong {word}: silent, nothing", 5)
    for frame in (lc02(2, 3), lc02(2, 4, 0xFF, 0), lc02(0, 1), lc02(0xFF, 1),
                  lc02(2, 2, 3, 6, 0)):
        s.ask("another address: silent, nothing", frame)
    s.ask("too short: silent", lc02(1, 4, 0xFF))
    data("too short: silent", 5)
    s.ask("too long: silent", lc02(1, 4, 0xFF, 0, 0))
    data(["too long: silent", "another address: silent, nothing"], 5)
    for word, frame in FOREIGN.items():
        s.ask(f"a frame of {word}: silent", frame)
    for garbage in (b"\x00", b"\x4C", b"\x4C\x57", b"\xFF" * 20, b"\x4C\x57\x01"):
        s.ask("garbage before a request is skipped", garbage + lc02(1, 3),
              lc02_reply(1, 5, high))

    # 0D in every field.
    addresses = [0, 0x0A, 0x0D, 0x0C, 0x7F, 0xFF, 1]
    for old, new in zip([1, *addresses], addresses):
        entries = [f"02 address {new:02X}"] if new != 0x0C else []
        configure([*entries, "02 reply: the old address, 5 bytes"], old, new)
        data([*entries, "0D as address"] if new == 0x0D else entries, 5, address=new)
    entries = ["0D as checksum", "every command at every address that makes 0D"]
    commands = {
        (1,): (6, *model, 0), (3,): (5, high), (4, 0xFF, 5): (), (4, 0, 1): (),
        **({(5, 0, 10): (), (6,): (0, 10)} if outputs == 4 else {}),
    }
    at = 1
    for command, reply in commands.items():
        new = (0x0D - total(command)) & 0xFF
        configure("", at, new)
        at = new
        assert lc02(at, *command)[-2:] == b"\x0D\x0D"
        s.ask(entries, lc02(at, *command), lc02_reply(at, *reply))
    new = (0x0D - total((2, 1, 6, 0))) & 0xFF
    configure("", at, new)
    configure(entries, new, 1)
    write("0D as data", 0xFF, 0x0D)
    data("0D as data", 0x0D)
    write("", 0xFF, 5)

    # Speeds, and what survives a loss of power.
    for code, rate in [*SPEEDS.items(), (6, 9600)]:
        before = s.port.rate
        configure(f"02 speed {code:02}", 1, 1, code)
        if rate != before:
            s.ask("02 speed: silent at the old one", lc02(1, 1))
        s.port.speed(rate)
        s.ask([f"02 speed {code:02}", f"01 speed {code:02}"],
              lc02(1, 1), lc02_reply(1, code, *model, 0))
    configure("", 1, 0x2C, 7)
    s.port.speed(19200)
    s.do("power m cycle")
    data(["02 survives power-off", "power-up: outputs off"], 0, address=0x2C)
    configure("", 0x2C, 1)
    s.port.speed(9600)


def eda9060a():
    """EDA9060A."""
    with Script("EDA9060A LC-02", "name=m,model=eda9060a,proto=lc02") as s:
        module(s, (0x90, 0x60), 4)
        for value in (0x10, 0x1F, 0x80, 0xFF):
            s.ask("04 all above 0F: silent", lc02(1, 4, 0xFF, value))
        for mask in range(16):
            s.ask([f"05 mask {mask}", "05 reply: 5 bytes"], lc02(1, 5, mask, 10), lc02_reply(1))
            s.ask([f"05 mask {mask}", "06 mask and width"], lc02(1, 6), lc02_reply(1, mask, 10))
        for mask in (16, 255):
            s.ask(f"05 mask {mask}: silent", lc02(1, 5, mask, 10))
        for width in (0, 201, 255):
            s.ask(f"05 width {width}: silent", lc02(1, 5, 0, width))
        s.ask("06 mask and width", lc02(1, 6), lc02_reply(1, 15, 10))
        for width in (10, 1, 200):
            s.ask(f"05 width {width}", lc02(1, 5, 4, width), lc02_reply(1))
            s.ask(f"05 width {width}", lc02(1, 6), lc02_reply(1, 4, width))
            if width == 10:
                continue
            entry = f"pulse of {width} tenths"
            s.do("changes m")
            s.ask(entry, lc02(1, 4, 2, 1), lc02_reply(1))
            if width == 200:
                for body in ((2, 0), (0xFF, 0)):
                    s.ask("pulse: 0 does nothing", lc02(1, 4, *body), lc02_reply(1))
                s.ask("pulse: 0 does nothing", lc02(1, 3), lc02_reply(1, 4, 15))
            s.do(f"skip {100 * width}")
            s.check(entry, s.rig.pulses("m"), [(2, 100 * width)])
            s.ask(entry, lc02(1, 3), lc02_reply(1, 0, 15))
    return s.tally


def eda9050():
    """EDA9050 with its INIT* pin grounded."""
    with Script("EDA9050 LC-02", "name=m,model=eda9050,proto=lc02") as s:
        module(s, (0x90, 0x50), 8)
        s.ask("05: silent", lc02(1, 5, 1, 10))
        s.ask("06: silent", lc02(1, 6))
    return s.tally


SUITES = [("plain, EDA9050 LC-02", eda9050), ("plain, EDA9060A LC-02", eda9060a)]
