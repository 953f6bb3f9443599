"""The 0x55 relay boards."""

from plain import Script, lc02, r55, r55_reply, rtu, text

ALL = 0xFFFFFFFF
EVERYBODY = 245
FOREIGN = {"ascii": text("$01M"), "lc02": lc02(1, 3), "rtu": rtu(1, 1, 0, 0, 0, 16)}
# The unanswered counterparts, which are not at a constant offset.
TWINS = {0x11: 0x31, 0x12: 0x32, 0x13: 0x33, 0x14: 0x34, 0x15: 0x35, 0x16: 0x36,
         0x20: 0x30, 0x21: 0x37, 0x22: 0x38}
# The new state for each function, given its data.
EFFECTS = {
    0x11: lambda state, word: state & ~(1 << word - 1),
    0x12: lambda state, word: state | 1 << word - 1,
    0x13: lambda state, word: word,
    0x14: lambda state, word: state & ~word,
    0x15: lambda state, word: state | word,
    0x16: lambda state, word: state ^ word,
    0x20: lambda state, word: state ^ 1 << word - 1,
}
ONE_CHANNEL = (0x11, 0x12, 0x20, 0x21, 0x22)


class Board(Script):
    """A line with one board or several, whose outputs are tracked here."""

    def __init__(self, *modules):
        super().__init__("0x55 boards", *modules)
        self.address = 1
        self.state = 0

    def command(self, entries, function, word, address=None):
        """A command that is answered with the state, or its unanswered counterpart."""
        original = next((one for one, twin in TWINS.items() if twin == function), function)
        self.state = EFFECTS[original](self.state, word) & ALL
        address = address or self.address
        if function in TWINS:
            self.ask(entries, r55(address, function, word),
                     r55_reply(address, function, self.state))
        else:
            self.port.send(r55(address, function, word))
            self.read(entries)

    def read(self, entries):
        """The state must be the one tracked here."""
        self.ask(entries, r55(self.address, 0x10), r55_reply(self.address, 0x10, self.state))

    def set(self, word):
        """Sets all outputs, in preparation."""
        self.command("", 0x13, word)


def commands():
    """A board of 32 relays: commands that switch at once."""
    with Board("name=m,model=r55") as s:
        s.read(["power-up: relays off", "10 state"])
        for word, function in (("off", 0x11), ("on", 0x12)):
            s.set(0 if word == "on" else ALL)
            for channel in range(1, 33):
                s.command([f"printed table: {word} {channel}", f"{function:x} each channel",
                           f"{function:x} reply: own code, state after"], function, channel)
        # As printed, including the checksums.
        for frame, word in (("5501120000000169", "on 1"), ("5501110000002087", "off 32")):
            s.state = EFFECTS[int(frame[4:6], 16)](s.state, int(frame[6:14], 16))
            s.ask(f"printed table: {word}", bytes.fromhex(frame),
                  r55_reply(1, int(frame[4:6], 16), s.state))
        for word, state in (("on", ALL), ("off", 0)):
            s.command(f"printed table: all {word}", 0x13, state)
        for function in (0x31, 0x32):
            s.set(ALL if function == 0x31 else 0)
            for channel in range(1, 33):
                s.command([f"{function:x} each channel", f"{function:x} never answered"],
                          function, channel)
        for function in (0x13, 0x33):
            for bit in range(32):
                s.command(f"{function:x} every bit", function, 1 << bit)
                s.command(f"{function:x} every bit", function, ALL ^ 1 << bit)
        for function in (0x14, 0x15, 0x16, 0x34, 0x35, 0x36):
            low = function & 0xF
            s.set({4: ALL, 5: 0, 6: 0xA5A5A5A5}[low])
            for bit in range(32):
                s.command(f"{function:x} walking mask", function, 1 << bit)
            s.set(0x0F0F0F0F)
            s.command(f"{function:x} keep the others", function, 0x00FF00FF)
            s.command(f"{function:x} keep the others", function, 0)
        for function in (0x20, 0x30):
            s.set(0x5A5A5A5A)
            for channel in [*range(1, 33)] * 2:
                s.command(f"{function:x} each channel, twice", function, channel)
        for function in (0x10, 0x13, 0x14, 0x15, 0x16, 0x20):
            s.state = s.state if function == 0x10 else EFFECTS[function](s.state, 3)
            kind = "own code, state after" if function < 0x20 else "the state"
            s.ask(f"{function:x} reply: {kind}", r55(1, function, 3),
                  r55_reply(1, function, s.state))
        for function in (0x30, 0x33, 0x34, 0x35, 0x36):
            original = next(one for one, twin in TWINS.items() if twin == function)
            s.state = EFFECTS[original](s.state, 5)
            s.ask(f"{function:x} never answered", r55(1, function, 5))
            s.read(f"{function:x} never answered")
        refused(s)
        chains(s)
        s.set(ALL)
        s.do("power m cycle")
        s.state = 0
        s.read("power-up: relays off")
    return s.tally


def refused(s):
    """Frames that get no reply and change nothing."""
    s.set(0x12345678)
    for function in ONE_CHANNEL:
        s.ask(f"{function:x} channel 0: silent", r55(1, function, 0))
        for channel in (33, 255):
            s.ask(f"{function:x} channel {channel}: silent", r55(1, function, channel))
    for function in ("00", "0F", "17", "19", "23", "2F", "39", "3F", "42", "72", "FF"):
        s.ask(f"unknown function {function}: silent", r55(1, int(function, 16), 1))
    good = r55(1, 0x13, 0)
    for word, bad in (("sum", good[:-1] + b"\x00"), ("sum", good[:-1] + bytes([good[-1] ^ 1])),
                      ("start byte", r55(1, 0x13, 0, 0x22)), ("start byte", r55(1, 0x13, 0, 0x54))):
        s.ask(f"wrong {word}: silent, nothing", bad)
        s.read(f"wrong {word}: silent, nothing")
    for address in (0, 2, 255):
        s.ask("another address: silent, nothing", r55(address, 0x13, 0))
        s.ask("another address: silent, nothing", r55(address, 0x33, 0))
    s.read("another address: silent, nothing")
    for function in (0x70, 0x71):
        s.ask(f"{function:x} on a board without variables: silent", r55(1, function, 0))
    for word, frame in FOREIGN.items():
        s.ask(f"a frame of {word}: silent", frame)
    reply = r55_reply(1, 0x10, s.state)
    for word, bytes_before in {
        "garbage": (b"\x00", b"\xFF" * 20, b"\x22" * 8),
        "55": (b"\x55", b"\x55" * 3, b"\x55" * 11),
        "half a request": (good[:1], good[:4], good[:7]),
    }.items():
        for before in bytes_before:
            s.ask(f"resynchronisation: {word} before a request", before + r55(1, 0x10), reply)


def chains(s):
    """Requests that follow each other without a gap."""
    s.set(0)
    s.port.send(b"".join(r55(1, 0x32, channel) for channel in range(1, 33)))
    s.state = ALL
    s.read("chain of 32 without a gap")
    s.port.send(b"".join(r55(1, function, word) for function, word in (
        (0x33, 0), (0x35, 0xF0), (0x36, 0x18), (0x30, 32))))
    s.state = 0x800000E8
    s.read("chain of 32 without a gap")
    s.state = 0x80000001
    s.ask("chain: only the last is answered",
          r55(1, 0x13, 0) + r55(1, 0x12, 32) + r55(1, 0x12, 1) + r55(1, 0x10),
          r55_reply(1, 0x10, s.state))
    # The last one that is answered, with the state that it saw.
    s.ask("chain: only the last is answered",
          r55(1, 0x10) + r55(1, 0x33, 0), r55_reply(1, 0x10, s.state))
    s.state = 0
    s.read("chain: only the last is answered")


def jogs():
    """A board of 32 relays: commands that switch later."""
    with Board("name=m,model=r55") as s:
        for function in (0x21, 0x22, 0x37, 0x38):
            closes = function in (0x21, 0x37)
            s.set(0 if closes else ALL)
            before = s.state
            s.do("changes m")
            for channel in range(1, 33):
                after = before ^ 1 << channel - 1
                request = r55(1, function, 10_000 << 8 | channel)
                entries = [f"{function:x} each channel"]
                if function < 0x30:
                    s.ask([*entries, f"{function:x} reply: the state"],
                          request, r55_reply(1, function, after))
                else:
                    s.port.send(request)
                    entries.append(f"{function:x} never answered")
                s.ask(entries, r55(1, 0x10), r55_reply(1, 0x10, after))
                s.do("skip 10000")
                s.check(f"{function:x} each channel", s.rig.pulses("m"), [(channel - 1, 10_000)])
            times(s, function, closes)
        cancelled(s)
        s.set(0)
        s.ask("", r55(1, 0x21, 5000 << 8 | 4), r55_reply(1, 0x21, 8))
        s.state = 8
        s.command("jog: another channel's command leaves it", 0x12, 5)
        s.command("jog: another channel's command leaves it", 0x14, 0x10)
        s.do("skip 5000")
        s.state = 0
        s.read("jog: another channel's command leaves it")
        s.ask("", r55(1, 0x22, 5000 << 8 | 4), r55_reply(1, 0x22, 0))
        s.do("power m cycle")
        s.do("skip 6000")
        s.read("jog: ended by power-off")
    return s.tally


def times(s, function, closes):
    """Times that fit into 24 bits, on channel 7 and in virtual time."""
    rest = s.state
    jogged = rest ^ 1 << 6
    for millis in (0, 1, 1000, 65536, 16777215):
        entry = f"{function:x} time {millis} ms"
        s.set(rest)
        s.do("changes m")
        # A time of 0 is the end state at once.
        request = r55(1, function, millis << 8 | 7)
        if function < 0x30:
            s.ask(entry, request, r55_reply(1, function, jogged if millis else rest))
        else:
            s.port.send(request)
            s.settle()
        s.do(f"skip {millis}")
        s.check(entry, s.rig.pulses("m"), [(6, millis)] if millis else [])
        s.state = rest
        s.port.hear(8, 0)
        s.read(entry)


# Later commands for channel 3 that leave it in a state that a jog of 5 s, close or open, would not:
# function, data, and how often, since a toggle must come twice to restore the state that the jog
# began with.
LATER_ON = [(0x12, 3, 1), (0x13, 4, 1), (0x15, 4, 1), (0x16, 4, 2), (0x20, 3, 2),
            (0x22, 1000 << 8 | 3, 1)]
LATER_OFF = [(0x11, 3, 1), (0x13, 0, 1), (0x14, 4, 1), (0x16, 4, 2), (0x20, 3, 2),
             (0x21, 1000 << 8 | 3, 1)]


def cancelled(s):
    """A later command for the channel ends its jog: the channel does not switch back after 5 s."""
    for jog, later in ((0x21, LATER_ON), (0x37, LATER_ON), (0x22, LATER_OFF), (0x38, LATER_OFF)):
        for function, word, times_sent in later:
            entry = f"{jog:x} after {function:x}: cancelled"
            jogged = 4 if later is LATER_ON else 0
            s.set(4 - jogged)
            request, reply = r55(1, jog, 5000 << 8 | 3), r55_reply(1, jog, jogged)
            if jog < 0x30:
                s.ask(entry, request, reply)
            else:
                s.port.send(request)
            s.state = jogged
            for _ in range(times_sent):
                effect = EFFECTS.get(function, lambda state, _: state ^ 4)
                s.state = effect(s.state, word)
                s.ask(entry, r55(1, function, word), r55_reply(1, function, s.state))
            s.do("skip 6000")
            s.state = jogged
            s.read(entry)


def addresses():
    """Reading and writing the address, and the DIP switch."""
    with Board("name=m,model=r55,outputs=8") as s:
        for to, word in ((EVERYBODY, "245"), (1, "own address")):
            s.ask(f"40 to {word}", r55(to, 0x40), r55_reply(1, 0x40, 1))
        s.do("power m cycle")
        new = [*range(2, 245), *range(246, 256), 1]
        for n, (old, address) in enumerate(zip([1, *new], new)):
            if n % 10 == 0:
                s.do("power m cycle")
            s.ask(["41 every address but 0 and 245",
                   "41 within the window: answered from the old address"],
                  r55(old, 0x41, address), r55_reply(old, 0x41, address))
            s.ask("41 every address but 0 and 245", r55(address, 0x10), r55_reply(address, 0x10))
        s.do("power m cycle")
        for address in (0, 245):
            s.ask(f"41 address {address}: silent, nothing", r55(1, 0x41, address))
            s.read(f"41 address {address}: silent, nothing")
        s.do("power m cycle")
        s.do("skip 8000")
        s.ask("41 after 8 s: obeyed", r55(1, 0x41, 9), r55_reply(1, 0x41, 9))
        s.do("power m cycle")
        s.address = 9
        s.read("41 survives power-off")
        for millis in (10_001, 60_000):
            s.do("power m cycle")
            s.do(f"skip {millis}")
            s.ask("41 after the window: silent, nothing", r55(9, 0x41, 3))
            s.read("41 after the window: silent, nothing")
        s.do("power m cycle")
        s.ask("41 to 245: obeyed, silent", r55(EVERYBODY, 0x41, 4))
        s.address = 4
        s.read("41 to 245: obeyed, silent")
        s.do("dip m 7")
        s.ask("DIP switch is the address", r55(4, 0x10))
        s.address = 7
        s.read("DIP switch is the address")
        s.ask("DIP switch is the address", r55(EVERYBODY, 0x40), r55_reply(7, 0x40, 7))
        s.do("power m cycle")
        s.ask("41 with a DIP switch: silent, nothing", r55(7, 0x41, 3))
        s.read("41 with a DIP switch: silent, nothing")
        s.do("dip m 0")
        s.address = 4
        s.read(["DIP switch 0: stored address", "41 with a DIP switch: silent, nothing"])
    return s.tally


def everybody():
    """Boards of 8 and 32 relays on one line, and requests to 245."""
    with Board("name=a,model=r55,addr=1", "name=b,model=r55,addr=2,outputs=8") as s:

        def both(entries):
            """Both boards have the state tracked here."""
            for address, mask in ((1, ALL), (2, 0xFF)):
                s.ask(entries, r55(address, 0x10), r55_reply(address, 0x10, s.state & mask))

        s.ask("10 to 245: silent", r55(EVERYBODY, 0x10))
        for function in (*EFFECTS, *(TWINS[one] for one in EFFECTS)):
            original = next((one for one, twin in TWINS.items() if twin == function), function)
            word = 5 if original in ONE_CHANNEL else 0x33
            s.state = EFFECTS[original](s.state, word)
            entry = f"{function:x} to 245: obeyed, silent"
            s.ask(entry, r55(EVERYBODY, function, word))
            both([entry, "two boards obey one broadcast"])
        for function in (0x21, 0x37, 0x22, 0x38):
            entry = f"{function:x} to 245: obeyed, silent"
            closes = function in (0x21, 0x37)
            rest = 0 if closes else 0xF
            s.ask("", r55(EVERYBODY, 0x33, rest))
            s.ask(entry, r55(EVERYBODY, function, 60000 << 8 | 2))
            s.state = rest ^ 2
            both(entry)
            s.do("skip 60000")
            s.state = rest
            both(entry)
        s.state = 0
        s.ask("two boards obey one broadcast", bytes.fromhex("55F533000000007D"))
        both("two boards obey one broadcast")
        s.state = ALL
        s.ask("two boards obey one broadcast", bytes.fromhex("55F533FFFFFFFF79"))
        both(["two boards obey one broadcast", "33 to 245: obeyed, silent"])

        # The smaller board has no more channels.
        for function in ONE_CHANNEL:
            s.ask(f"{function:x} channel above the count: silent", r55(2, function, 9))
        for function in (0x31, 0x32, 0x30, 0x37, 0x38):
            s.port.send(r55(2, function, 9))
            s.ask(f"{function:x} channel above the count: nothing",
                  r55(2, 0x10), r55_reply(2, 0x10, 0xFF))
        for function, word, state in ((0x13, 0xFFFFFF00, 0), (0x15, 0xFFFFFF01, 1),
                                      (0x16, 0xFFFFFF02, 3), (0x14, 0xFFFFFF00, 3)):
            s.ask(f"{function:x} bits above the count: nothing",
                  r55(2, function, word), r55_reply(2, function, state))
    return s.tally


def kinds():
    """Boards with inputs, and one with variables."""
    with Board("name=mixed,model=r55,addr=1,outputs=16,inputs=16,layout=mixed",
               "name=in,model=r55,addr=2,outputs=0,inputs=32,layout=inputs",
               "name=core,model=r55,addr=3,outputs=8,variables=32") as s:
        entry = "mixed board: inputs in D1-D2, outputs in D3-D4"
        s.ask(entry, r55(1, 0x10), r55_reply(1, 0x10, 0xFFFF0000))
        for bit in range(16):
            s.do(f"levels mixed {1 << bit}")
            s.ask(entry, r55(1, 0x13, 0x8001), r55_reply(1, 0x13, 0x8001 | 1 << 16 + bit))
        s.ask(entry, r55(1, 0x12, 16), r55_reply(1, 0x12, 0x80008001))
        s.ask(entry, r55(1, 0x13, ALL), r55_reply(1, 0x13, 0x8000FFFF))
        s.ask("mixed board: outputs above 16: silent", r55(1, 0x12, 17))
        for bit in range(32):
            s.do(f"levels in {1 << bit}")
            s.ask("input board: the inputs", r55(2, 0x10), r55_reply(2, 0x10, 1 << bit))
        for function in (0x11, 0x12, 0x20, 0x21, 0x22):
            s.ask("input board: commands: no effect", r55(2, function, 1))
        for function in (0x13, 0x14, 0x15, 0x16):
            s.ask("input board: commands: no effect",
                  r55(2, function, ALL), r55_reply(2, function, 1 << 31))
        for index in (0, 31):
            for value in (1, 16777215, 0, 0x123456):
                word = value << 8 | index
                s.ask([f"71 index {index}", *([f"71 value {value}"] if value != 0x123456 else [])],
                      r55(3, 0x71, word), r55_reply(3, 0x71, word))
                s.ask([f"70 index {index}", f"71 index {index}"],
                      r55(3, 0x70, index), r55_reply(3, 0x70, word))
        for index in (32, 255):
            s.ask(f"71 index {index}: silent", r55(3, 0x71, 0x100 | index))
            s.ask(f"70 index {index}: silent", r55(3, 0x70, index))
        s.ask("71 to 245: obeyed, silent", r55(EVERYBODY, 0x71, 0xABCDEF05))
        s.ask("71 to 245: obeyed, silent", r55(3, 0x70, 5), r55_reply(3, 0x70, 0xABCDEF05))
        s.ask("70 to 245: silent", r55(EVERYBODY, 0x70, 5))
        s.do("power core cycle")
        for index in (0, 5, 31):
            s.ask("variables are 0 after power-up", r55(3, 0x70, index),
                  r55_reply(3, 0x70, index))
    return s.tally


SUITES = [
    ("plain, 0x55 board, commands", commands),
    ("plain, 0x55 board, jogs", jogs),
    ("plain, 0x55 board, addresses", addresses),
    ("plain, 0x55 boards, everybody", everybody),
    ("plain, 0x55 boards, kinds", kinds),
]
