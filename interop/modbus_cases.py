"""The requests of the third-party Modbus masters as data: a list of steps for each module.

A step names the entries of `tables.py` that it covers; `""` is an intermediate step. The masters
(`pymodbus_suite.py`, `libmodbus_suite.py`, `mbpoll_suite.py`) differ in what they can send.
"""

import dataclasses

DONE = "done"
SILENT = "silent"


def exception(code):
    """An exception reply."""
    return f"exception {code}"


@dataclasses.dataclass
class Ask:
    """A request: with a count it reads, with values it writes. FC05 and FC06 take one value, and
    FC05 a bit. `want` is a list of values, DONE, SILENT or an exception."""

    entries: str | list
    fc: int
    at: int
    arg: int | list
    want: object


@dataclasses.dataclass
class Raw:
    """Function and data in hexadecimal; the master adds address and CRC."""

    entries: str | list
    pdu: str
    want: object


@dataclasses.dataclass
class Wire:
    """A frame sent as it is, without a CRC being added."""

    entries: str | list
    frame: str
    want: object


@dataclasses.dataclass
class Unit:
    """Changes the address that the master uses."""

    address: int


@dataclasses.dataclass
class Speed:
    """Changes the speed of the master's port."""

    rate: int


@dataclasses.dataclass
class Do:
    """A command at the panel; `want`, if given, is the answer."""

    command: str
    entries: str | list = ""
    want: str | None = None


@dataclasses.dataclass
class Pulses:
    """The pulses since the last such step: channel, least and most milliseconds of each."""

    entries: str | list
    name: str
    want: list


# Shared by all modules ---------------------------------------------------------------------

ABSENT = {
    "07": "07",
    "08": "0800001234",
    "0B": "0B",
    "0C": "0C",
    "11": "11",
    "14": "140706000400010002",
    "15": "150906000400010001000A",
    "16": "16000400F20025",
    "17": "1700000001000000010200FF",
    "18": "18000A",
    "2B": "2B0E0100",
    "41": "4101",
}
FOREIGN = {"ascii": b"$01M\r".hex(), "lc02": "4C570103040D", "r55": "5501100000000066"}


def absent(want, tail):
    """The functions that no module has."""
    return [Raw(f"fc{code}: {tail}", pdu, want) for code, pdu in ABSENT.items()]


def on_the_wire(state):
    """Frames that are no request for the module get no reply; `state` must be unchanged
    afterwards."""
    return [
        Unit(2),
        *[dataclasses.replace(step, entries="another address: silent", want=SILENT)
          for step in state],
        Unit(1),
        *[Wire("wrong CRC: silent", frame, SILENT) for frame in ("0105003CFF004C37", "01030000")],
        *[Wire(f"frame of {len(frame) // 2} bytes: silent", frame, SILENT)
          for frame in ("01", "0180", "01807E")],
        *[Wire(f"a frame of {name}: silent", frame, SILENT) for name, frame in FOREIGN.items()],
        *state,
    ]


def runs(fc, entries, values, first=0, count=None):
    """Reads every run of `values`, which begin at `first`."""
    count = count or len(values)
    return [
        Ask(entries, fc, first + start, length, values[start:start + length])
        for start in range(count)
        for length in range(1, count - start + 1)
    ]


def write_runs(entries, first, count, total=None):
    """Writes every run of coils on and then off again, each checked by reading all."""
    total = total or count
    steps = []
    for start in range(count):
        for length in range(1, count - start + 1):
            after = [int(start <= coil < start + length) for coil in range(total)]
            steps += [
                Ask(entries, 15, first + start, [1] * length, DONE),
                Ask(entries, 1, first, total, after),
                Ask(entries, 15, first + start, [0] * length, DONE),
            ]
    return steps


def each_coil(first, count, total=None):
    """FC05 on and off for each coil, each checked by reading all."""
    total = total or count
    steps = []
    for coil in range(count):
        alone = [int(n == coil) for n in range(total)]
        steps += [
            Ask(f"fc05 coil {first + coil} on", 5, first + coil, [1], DONE),
            Ask([f"fc05 coil {first + coil} on", f"fc01 coil {first + coil}"],
                1, first, total, alone),
            Ask(f"fc05 coil {first + coil} off", 5, first + coil, [0], DONE),
            Ask(f"fc05 coil {first + coil} off", 1, first, total, [0] * total),
        ]
    return steps


# ERC-8 -------------------------------------------------------------------------------------

_OFF = Ask("", 1, 60, 8, [0] * 8)
_ERC8_STATE = [_OFF, Ask("", 3, 0, 3, [1, 1, 0])]
_PATTERN = [1, 0, 1, 1, 0, 0, 1, 0]
_ERC8_SPEEDS = {0: 4800, 2: 19200, 3: 38400, 1: 9600}
_PARITIES = {1: "o", 2: "e", 0: "n"}

ERC8 = [
    Ask("power-up: relays off", 1, 60, 8, [0] * 8),
    *each_coil(60, 8),
    *write_runs("fc0f every run of 60-67", 60, 8),
    Ask("", 15, 60, _PATTERN, DONE),
    *runs(1, "fc01 every run of 60-67", _PATTERN, 60),
    *[Ask(f"fc01 past the end from {at}: exception 2", 1, at, 69 - at, exception(2))
      for at in range(60, 68)],
    *[Ask(f"fc01 coil {at}: exception 2", 1, at, 1, exception(2))
      for at in (0, 59, 68, 96, 65535)],
    Ask("fc01 past 65535: exception 2", 1, 65535, 2, exception(2)),
    Raw("fc01 count 0: exception 3", "01003C0000", exception(3)),
    Raw("fc01 count 2001: exception 3", "01003C07D1", exception(3)),
    *[Ask(f"fc03 register {at}", 3, at, 1, [value]) for at, value in enumerate((1, 1, 0))],
    *runs(3, "fc03 every run of 0-2", [1, 1, 0]),
    *[Ask(f"fc03 past the end from {at}: exception 2", 3, at, 4 - at, exception(2))
      for at in range(3)],
    *[Ask(f"fc03 register {at}: exception 2", 3, at, 1, exception(2)) for at in (3, 65535)],
    Raw("fc03 count 0: exception 3", "0300000000", exception(3)),
    Raw("fc03 count 126: exception 3", "030000007E", exception(3)),
    *[Ask(f"fc05 coil {at}: exception 2", 5, at, [1], exception(2))
      for at in (0, 59, 68, 96, 65535)],
    *[Raw(f"fc05 value {value}: exception 3", f"05003D{value}", exception(3))
      for value in ("0001", "0100", "5500", "FFFF")],
    *[Ask(f"fc06 address {value}: exception 3", 6, 0, [value], exception(3))
      for value in (0, 33, 247, 256, 65535)],
    *[Ask(f"fc06 speed {value}: exception 3", 6, 1, [value], exception(3))
      for value in (4, 255, 256, 65535)],
    *[Ask(f"fc06 parity {value}: exception 3", 6, 2, [value], exception(3))
      for value in (3, 256, 65535)],
    *[Ask(f"fc06 register {at}: exception 2", 6, at, [1], exception(2)) for at in (3, 60, 65535)],
    *[Ask(f"fc0f past the end from {at}: exception 2", 15, at, [1] * (69 - at), exception(2))
      for at in range(60, 68)],
    *[Ask(f"fc0f coil {at}: exception 2", 15, at, [1, 1], exception(2)) for at in (0, 59, 68, 96)],
    Raw("fc0f count 0: exception 3", "0F003C000000", exception(3)),
    Raw("fc0f count 1969: exception 3", "0F003C07B10100", exception(3)),
    Raw("fc0f byte count too small: exception 3", "0F003C000800", exception(3)),
    Raw("fc0f byte count too large: exception 3", "0F003C000802FFFF", exception(3)),
    Raw("fc02: exception 1", "02003C0001", exception(1)),
    Raw("fc04: exception 1", "0400000001", exception(1)),
    Raw("fc10: exception 1", "100000000102000A", exception(1)),
    Ask("fc02: exception 1", 2, 60, 1, exception(1)),
    Ask("fc04: exception 1", 4, 0, 1, exception(1)),
    Ask("fc10: exception 1", 16, 0, [10, 1], exception(1)),
    *absent(exception(1), "exception 1"),
    Ask("", 1, 60, 8, _PATTERN),
    Ask("", 15, 60, [0] * 8, DONE),
    *on_the_wire(_ERC8_STATE),
    # Addresses, up and back.
    *[step for old, new in [*zip(range(1, 32), range(2, 33)), (32, 1)] for step in (
        Ask([f"fc06 address {new}", "fc06 address: reply from the old one"], 6, 0, [new], DONE),
        Unit(new),
        Ask(f"fc06 address {new}", 3, 0, 1, [new]),
    )],
    Unit(32),
    Ask("fc06 address: reply from the old one", 3, 0, 1, SILENT),
    Unit(1),
    *[step for code, rate in _ERC8_SPEEDS.items() for step in (
        Ask(f"fc06 speed {code}", 6, 1, [code], DONE),
        Ask("fc06 speed: silent at the old one", 3, 1, 1, SILENT),
        Speed(rate),
        Ask(f"fc06 speed {code}", 3, 0, 3, [1, code, 0]),
    )],
    *[step for code, letter in _PARITIES.items() for step in (
        Ask(f"fc06 parity {code}", 6, 2, [code], DONE),
        Ask("fc06 parity: silent in the old one", 3, 2, 1, SILENT),
        Do(f"parity {letter}"),
        Ask(f"fc06 parity {code}", 3, 0, 3, [1, 1, code]),
    )],
    # What survives a loss of power.
    Ask("", 6, 0, [9], DONE),
    Unit(9),
    Ask("", 15, 60, [1] * 8, DONE),
    Ask("", 6, 1, [2], DONE),
    Speed(19200),
    Do("power erc8 cycle"),
    Ask("power-up: relays off", 1, 60, 8, [0] * 8),
    Ask("power-up: settings kept", 3, 0, 3, [9, 2, 0]),
    Ask("", 6, 1, [1], DONE),
    Speed(9600),
    Ask("", 6, 0, [1], DONE),
    # Broadcasts: only the address.
    Unit(0),
    Ask("broadcast fc06 address: obeyed, silent", 6, 0, [6], SILENT),
    Unit(6),
    Ask("broadcast fc06 address: obeyed, silent", 3, 0, 3, [6, 1, 0]),
    Ask("", 6, 0, [1], DONE),
    Unit(0),
    Ask("broadcast fc06 bad address: nothing", 6, 0, [33], SILENT),
    Ask("broadcast fc06 speed: nothing", 6, 1, [0], SILENT),
    Ask("broadcast fc06 parity: nothing", 6, 2, [1], SILENT),
    Ask("broadcast fc05: nothing", 5, 60, [1], SILENT),
    Ask("broadcast fc0f: nothing", 15, 60, [1] * 8, SILENT),
    Ask("broadcast fc01: nothing", 1, 60, 8, SILENT),
    Ask("broadcast fc03: nothing", 3, 0, 3, SILENT),
    Ask("broadcast fc10: nothing", 16, 0, [5, 1], SILENT),
    Unit(1),
    *_ERC8_STATE,
]

ERC8_SWITCHES = [
    Wire("answer-bad: wrong CRC: exception 8", "0105003CFF004C37", exception(8)),
    Wire("answer-bad: wrong CRC to another address: silent", "0205003CFF004C37", SILENT),
    Wire("answer-bad: wrong CRC to address 0: silent", "0005003CFF004C37", SILENT),
    _OFF,
    Ask("applies=restart: address old until power-up", 6, 0, [4], DONE),
    Ask("applies=restart: speed old until power-up", 6, 1, [2], DONE),
    Ask("applies=restart: parity old until power-up", 6, 2, [2], DONE),
    Ask(["applies=restart: stored settings are read",
         "applies=restart: {address,speed,parity} old until power-up"], 3, 0, 3, [4, 2, 2]),
    Do("power erc8 cycle"),
    Ask("applies=restart: address old until power-up", 3, 0, 3, SILENT),
    Unit(4),
    Ask("applies=restart: speed old until power-up", 3, 0, 3, SILENT),
    Speed(19200),
    Ask("applies=restart: parity old until power-up", 3, 0, 3, SILENT),
    Do("parity e"),
    Ask("applies=restart: {address,speed,parity} old until power-up", 3, 0, 3, [4, 2, 2]),
]

# EMD-2A2Q ----------------------------------------------------------------------------------

_EMD_REGISTERS = [1, 2, 0, 500, 0, 0, 0]
_EMD_STATE = [Ask("", 1, 8, 2, [0, 0]), Ask("", 3, 1, 7, _EMD_REGISTERS)]
_EMD_SPEEDS = {0: 2400, 1: 4800, 3: 19200, 4: 38400, 2: 9600}
_READ_ONLY = (0, 6, 7)


def _emd_command(value, stands, entries):
    """A command through register 5: its bit is set, and cleared when the work is done."""
    return [
        Ask(entries, 6, 5, [value], DONE),
        Ask(entries, 3, 5, 1, [stands]),
        Do("skip 600"),
        Ask(entries, 3, 5, 1, [0]),
    ]


EMD2A2Q = [
    Ask("power-up: relays off", 1, 8, 2, [0, 0]),
    *each_coil(8, 2),
    *write_runs("fc0f every run of 8-9", 8, 2),
    Ask("", 15, 8, [0, 1], DONE),
    *runs(1, "fc01 every run of 8-9", [0, 1], 8),
    Ask("", 15, 8, [0, 0], DONE),
    *[Ask(f"fc01 past the end from {at}: exception 2", 1, at, 11 - at, exception(2))
      for at in (8, 9)],
    *[Ask(f"fc01 coil {at}: exception 2", 1, at, 1, exception(2)) for at in (0, 7, 10, 65535)],
    Raw("fc01 count 0: exception 3", "0100080000", exception(3)),
    Raw("fc01 count 2001: exception 3", "01000807D1", exception(3)),
    # The product version, which is not specified, is 12 here.
    *[Ask(f"fc03 register {at}", 3, at, 1, [value])
      for at, value in enumerate([12, *_EMD_REGISTERS])],
    *runs(3, "fc03 every run of 0-7", [12, *_EMD_REGISTERS]),
    *[Ask(f"fc03 past the end from {at}: exception 2", 3, at, 9 - at, exception(2))
      for at in range(8)],
    *[Ask(f"fc03 register {at}: exception 2", 3, at, 1, exception(2)) for at in (8, 65535)],
    Raw("fc03 count 0: exception 3", "0300000000", exception(3)),
    Raw("fc03 count 126: exception 3", "030000007E", exception(3)),
    *[Ask(f"fc05 coil {at}: exception 2", 5, at, [1], exception(2)) for at in (0, 7, 10)],
    *[Raw(f"fc05 value {value}: exception 3", f"050008{value}", exception(3))
      for value in ("0001", "0100", "FFFF")],
    *[Ask(f"fc06 register {at}, read only: exception 2", 6, at, [1], exception(2))
      for at in _READ_ONLY],
    *[Ask(f"fc06 register {at}: exception 2", 6, at, [1], exception(2)) for at in (8, 65535)],
    *[Ask(f"fc06 address {value}: exception 3", 6, 1, [value], exception(3))
      for value in (0, 33, 256, 65535)],
    *[Ask(f"fc06 speed {value}: exception 3", 6, 2, [value], exception(3))
      for value in (5, 256, 65535)],
    *[Ask(f"fc06 parity {value}: exception 3", 6, 3, [value], exception(3))
      for value in (3, 256)],
    *[Ask(f"fc06 voltage {value}: exception 3", 6, 4, [value], exception(3))
      for value in (0, 2001, 65535)],
    *[Ask(f"fc0f past the end from {at}: exception 2", 15, at, [1] * (11 - at), exception(2))
      for at in (8, 9)],
    *[Ask(f"fc0f coil {at}: exception 2", 15, at, [1, 1], exception(2)) for at in (0, 7, 10)],
    Raw("fc0f count 0: exception 3", "0F0008000000", exception(3)),
    Raw("fc0f count 1969: exception 3", "0F000807B10100", exception(3)),
    Raw("fc0f byte count too small: exception 3", "0F0008000200", exception(3)),
    Raw("fc0f byte count too large: exception 3", "0F0008000202FFFF", exception(3)),
    *[Raw(f"fc10 register {at}, read only: exception 2", f"10{at:04X}0001020001", exception(2))
      for at in _READ_ONLY],
    *[Ask(f"fc10 past the end from {at}: exception 2", 16, at, [1, 1], exception(2))
      for at in (7, 8)],
    Raw("fc10 count 0: exception 3", "100004000000", exception(3)),
    Raw("fc10 count 124: exception 3", "100004007CF80000", exception(3)),
    Raw("fc10 byte count too small: exception 3", "10000400010102", exception(3)),
    Raw("fc10 byte count too large: exception 3", "10000400010402580000", exception(3)),
    Ask("fc10 several with a bad value: exception 3, nothing",
        16, 1, [2, 2, 3, 600], exception(3)),
    Ask("fc10 several with a bad value: exception 3, nothing", 16, 4, [2001, 1], exception(3)),
    Ask("fc10 several with a read-only one: exception 2, nothing", 16, 0, [1, 2], exception(2)),
    Ask("fc10 several with a read-only one: exception 2, nothing",
        16, 4, [600, 0, 5], exception(2)),
    Ask(["fc10 several with a bad value: exception 3, nothing",
         "fc10 several with a read-only one: exception 2, nothing"], 3, 1, 7, _EMD_REGISTERS),
    *[Raw(f"fc{code}: exception 1", pdu, exception(1))
      for code, pdu in (("02", "0200080001"), ("04", "0400060001"))],
    Ask("fc02: exception 1", 2, 8, 1, exception(1)),
    Ask("fc04: exception 1", 4, 6, 1, exception(1)),
    *absent(exception(1), "exception 1"),
    *on_the_wire(_EMD_STATE),
    # The analog inputs.
    *[step for value, read in ((871, 871), (2000, 2000), (-30, 0), (0, 0)) for step in (
        Do(f"analog emd2a2q 0 {value}"),
        Ask("analog 1 below 0 reads 0" if value < 0 else f"analog 1 {value}", 3, 6, 2, [read, 0]),
        Do("analog emd2a2q 0 0"),
        Do(f"analog emd2a2q 1 {value}"),
        Ask("analog 2 below 0 reads 0" if value < 0 else f"analog 2 {value}", 3, 6, 2, [0, read]),
        Do("analog emd2a2q 1 0"),
    )],
    *[step for value in (1, 2000, 500) for step in (
        Ask(f"fc06 voltage {value}", 6, 4, [value], DONE),
        Ask(f"fc06 voltage {value}", 3, 4, 1, [value]),
    )],
    # Calibration: 0.30 and 0.20 V are zero, then 5.30 and 5.20 V are ten volts.
    Ask("fc06 command bits 3-15: nothing", 6, 5, [0xFFF8], DONE),
    Ask("fc06 command bits 3-15: nothing", 3, 1, 7, _EMD_REGISTERS),
    Do("analog emd2a2q 0 30"),
    Do("analog emd2a2q 1 20"),
    *_emd_command(1, 1, "fc06 command zero: bit stands until it is done"),
    Ask("fc06 command zero: both inputs read 0", 3, 6, 2, [0, 0]),
    Do("analog emd2a2q 0 530"),
    Do("analog emd2a2q 1 520"),
    Ask("fc06 command zero: both inputs read 0", 3, 6, 2, [500, 500]),
    Ask("", 6, 4, [1000], DONE),
    *_emd_command(2, 2, "fc06 command span: bit stands until it is done"),
    Ask("fc06 command span: both inputs read the voltage", 3, 6, 2, [1000, 1000]),
    Do("analog emd2a2q 0 280"),
    Ask("fc06 command span: both inputs read the voltage", 3, 6, 2, [500, 1000]),
    Do("power emd2a2q cycle"),
    Ask("power-up: settings and calibration kept", 3, 4, 4, [1000, 0, 500, 1000]),
    *_emd_command(3, 1, "fc06 command: zero before span"),
    Ask("fc06 command: zero before span", 3, 6, 2, [0, 0]),
    # Restore: from address 7 at 19200 baud.
    Ask("fc10 several registers", 16, 1, [7, 3, 0, 700, 0], DONE),
    Unit(7),
    Speed(19200),
    Ask("fc10 several registers", 3, 1, 4, [7, 3, 0, 700]),
    Ask("", 5, 9, [1], DONE),
    Ask(["fc06 command restore: address, speed, voltage, calibration",
         "fc06 command: restore before zero"], 6, 5, [7], DONE),
    Unit(1),
    Speed(9600),
    Ask(["fc06 command restore: address, speed, voltage, calibration",
         "fc06 command: restore before zero"], 3, 1, 7, [1, 2, 0, 500, 0, 280, 520]),
    Ask("fc06 command restore: relays stay", 1, 8, 2, [0, 1]),
    Do("power emd2a2q cycle"),
    Ask("power-up: relays off", 1, 8, 2, [0, 0]),
    Do("analog emd2a2q 0 0"),
    Do("analog emd2a2q 1 0"),
    # Registers by FC10, one at a time.
    Raw("fc10 register 4", "1000040001020258", DONE),
    Ask("fc10 register 4", 3, 4, 1, [600]),
    Raw("fc10 register 5", "1000050001020001", DONE),
    Ask("fc10 register 5", 3, 5, 1, [1]),
    Do("skip 600"),
    Raw("fc10 register 1", "1000010001020003", DONE),
    Unit(3),
    Ask("fc10 register 1", 3, 1, 1, [3]),
    Raw("fc10 register 2", "1000020001020003", DONE),
    Speed(19200),
    Ask("fc10 register 2", 3, 2, 1, [3]),
    Raw("fc10 register 3", "1000030001020002", DONE),
    Do("parity e"),
    Ask("fc10 register 3", 3, 1, 4, [3, 3, 2, 600]),
    Ask("", 16, 1, [1, 2, 0, 500, 0], DONE),
    Unit(1),
    Speed(9600),
    Do("parity n"),
    *_EMD_STATE,
    # Addresses, speeds, parities.
    *[step for old, new in [*zip(range(1, 32), range(2, 33)), (32, 1)] for step in (
        Ask([f"fc06 address {new}", "fc06 address: reply from the old one"], 6, 1, [new], DONE),
        Unit(new),
        Ask(f"fc06 address {new}", 3, 1, 1, [new]),
    )],
    Unit(32),
    Ask("fc06 address: reply from the old one", 3, 1, 1, SILENT),
    Unit(1),
    *[step for code, rate in _EMD_SPEEDS.items() for step in (
        Ask(f"fc06 speed {code}", 6, 2, [code], DONE),
        Ask("fc06 speed: silent at the old one", 3, 1, 1, SILENT),
        Speed(rate),
        Ask(f"fc06 speed {code}", 3, 1, 3, [1, code, 0]),
    )],
    *[step for code, letter in _PARITIES.items() for step in (
        Ask(f"fc06 parity {code}", 6, 3, [code], DONE),
        Ask("fc06 parity: silent in the old one", 3, 1, 1, SILENT),
        Do(f"parity {letter}"),
        Ask(f"fc06 parity {code}", 3, 1, 3, [1, 2, code]),
    )],
    # Broadcasts: every write.
    Unit(0),
    Ask("broadcast fc05: obeyed, silent", 5, 8, [1], SILENT),
    Unit(1),
    Ask("broadcast fc05: obeyed, silent", 1, 8, 2, [1, 0]),
    Unit(0),
    Ask("broadcast fc0f: obeyed, silent", 15, 8, [0, 1], SILENT),
    Ask("broadcast fc06: obeyed, silent", 6, 4, [321], SILENT),
    Unit(1),
    Ask("broadcast fc0f: obeyed, silent", 1, 8, 2, [0, 1]),
    Ask("broadcast fc06: obeyed, silent", 3, 4, 1, [321]),
    Unit(0),
    Ask("broadcast fc10: obeyed, silent", 16, 4, [500, 0], SILENT),
    Ask("broadcast fc06 address: obeyed, silent", 6, 1, [5], SILENT),
    Unit(5),
    Ask(["broadcast fc10: obeyed, silent", "broadcast fc06 address: obeyed, silent"],
        3, 1, 4, [5, 2, 0, 500]),
    Ask("", 6, 1, [1], DONE),
    Unit(0),
    Ask("broadcast fc01: nothing", 1, 8, 2, SILENT),
    Ask("broadcast fc03: nothing", 3, 0, 8, SILENT),
    Ask("broadcast bad value: nothing", 6, 1, [33], SILENT),
    Unit(1),
    Ask("broadcast bad value: nothing", 3, 1, 4, [1, 2, 0, 500]),
    Ask("", 15, 8, [0, 0], DONE),
    *_EMD_STATE,
]

EMD2A2Q_SWITCHES = [
    Wire("answer-bad: wrong CRC: exception 8", "01050008FF000DF9", exception(8)),
    Ask("", 1, 8, 2, [0, 0]),
    Ask("applies=restart: {address,speed,parity} old until power-up", 16, 1, [4, 3, 1], DONE),
    Ask(["applies=restart: stored settings are read",
         "applies=restart: {address,speed,parity} old until power-up"], 3, 1, 3, [4, 3, 1]),
    Do("power emd2a2q cycle"),
    Ask("applies=restart: address old until power-up", 3, 1, 3, SILENT),
    Unit(4),
    Ask("applies=restart: speed old until power-up", 3, 1, 3, SILENT),
    Speed(19200),
    Ask("applies=restart: parity old until power-up", 3, 1, 3, SILENT),
    Do("parity o"),
    Ask("applies=restart: {address,speed,parity} old until power-up", 3, 1, 3, [4, 3, 1]),
]

# EDA modules in Modbus mode ----------------------------------------------------------------

_EDA_SPEEDS = {3: 1200, 4: 2400, 5: 4800, 7: 19200, 6: 9600}
_EDA_ADDRESSES = (2, 85, 247, 248, 255, 1)


def _fc10(at, *words):
    """FC10 as raw data: some masters write a single register with FC06 instead."""
    data = "".join(f"{word:04X}" for word in words)
    return f"10{at:04X}{len(words):04X}{2 * len(words):02X}{data}"


def _eda_refusals(outputs, inputs):
    """Requests that both modules leave unanswered; coils and inputs exist up to these numbers."""
    return [
        *[Raw(f"fc05 value {value}: silent", f"050001{value}", SILENT)
          for value in ("0001", "0100", "FFFF")],
        Raw("fc0f count 0: silent", "0F0000000000", SILENT),
        Raw("fc0f byte count too small: silent", "0F0000000300", SILENT),
        Raw("fc0f byte count too small: silent", "0F00000003", SILENT),
        Raw("fc0f byte count too large: silent", "0F0000000302FFFF", SILENT),
        Raw("fc10 count 0: silent", "100000000000", SILENT),
        Raw("fc10 byte count too small: silent", "10000000010102", SILENT),
        Raw("fc10 byte count too large: silent", "100000000104020600FF", SILENT),
        Raw("fc10 address 0: silent", _fc10(0, 0x0006), SILENT),
        *[Raw(f"fc10 speed {code}: silent", _fc10(0, 0x0200 | code), SILENT)
          for code in (0, 2, 8, 255)],
        *absent(SILENT, "silent"),
        Raw("fc01 count 0: silent", "0100000000", SILENT),
        Raw("fc01 count 2001: silent", "01000007D1", SILENT),
        Raw("fc02 count 0: silent", "0200000000", SILENT),
        *[Raw(f"fc{code}: silent", pdu, SILENT)
          for code, pdu in (("04", "0400000001"), ("06", "0600000206"))],
        Ask("fc04: silent", 4, 0, 1, SILENT),
        Ask("fc06: silent", 6, 0, [0x0206], SILENT),
        Ask([f"fc05 coil {outputs}: silent"], 5, outputs, [1], SILENT),
        Ask([f"fc02 input {inputs}: silent"], 2, inputs, 1, SILENT),
    ]


def _eda_addresses(read_back):
    """Every address that FC10 may set; `read_back(address)` verifies it."""
    steps = []
    for new in _EDA_ADDRESSES:
        steps += [
            Raw([f"fc10 address {new}", "fc10 address: reply from the old one"],
                _fc10(0, new << 8 | 6), DONE),
            Unit(new),
            *read_back(new, f"fc10 address {new}"),
        ]
    return [*steps, Unit(255), Ask("fc10 address: reply from the old one", 1, 0, 1, SILENT),
            Unit(1)]


def _eda_speeds(read_back):
    """Every speed that FC10 may set; `read_back(code)` verifies it."""
    steps = []
    for code, rate in _EDA_SPEEDS.items():
        steps += [
            Raw(f"fc10 speed {code}", _fc10(0, 0x0100 | code), DONE),
            Ask("fc10 speed: silent at the old one", 1, 0, 1, SILENT),
            Speed(rate),
            *read_back(code, f"fc10 speed {code}"),
        ]
    return steps


def _inputs(name, entry, inputs, total):
    """Each input high alone, then all open again."""
    steps = []
    for high in range(inputs):
        want = [int(n == high) for n in range(total)]
        steps += [Do(f"levels {name} {1 << high}"),
                  Ask(entry.format(high), 2, 0, total, want),
                  Ask(entry.format(high), 2, high, 1, [1])]
    return [*steps, Do(f"levels {name} {(1 << inputs) - 1}")]


_9060A_STATE = [Ask("", 1, 0, 16, [0] * 16), Ask("", 3, 0, 4, [0x9060, 0x0106, 0x000A, 0])]
_9060A_READ = [0x9060, 0x0106, 0x000A, 0x0000]


def _9060a_width(tenths):
    """A pulse of this width on relay 2, in virtual time."""
    entry = f"pulse of {tenths} tenths"
    return [
        Raw(entry, _fc10(1, 0x0400 | tenths), DONE),
        Do("changes eda9060a"),
        Ask(entry, 5, 2, [1], DONE),
        Do(f"skip {100 * tenths}"),
        Ask([entry, "pulse: read back as 1, then 0"], 1, 0, 4, [0, 0, 0, 0]),
        Pulses(entry, "eda9060a", [(2, 100 * tenths, 100 * tenths)]),
    ]


EDA9060A = [
    Ask("power-up: relays off", 1, 0, 16, [0] * 16),
    *each_coil(0, 4),
    *write_runs("fc0f every run of 0-3", 0, 4),
    Raw("fc0f 16 coils as printed", "0F00000010020500", DONE),
    Ask("fc0f 16 coils as printed", 1, 0, 16, [1, 0, 1, 0] + [0] * 12),
    *runs(1, "fc01 every run of 0-3", [1, 0, 1, 0]),
    *[Ask([f"fc01 coil {at}", "fc01 coils 4-15 read 0"], 1, at, 1, [0]) for at in range(4, 16)],
    Ask("fc01 coils 4-15 read 0", 1, 3, 13, [0] * 13),
    Ask("fc0f bits 4-15 ignored", 15, 4, [1] * 12, DONE),
    Ask("fc0f bits 4-15 ignored", 1, 0, 16, [1, 0, 1, 0] + [0] * 12),
    Ask("fc0f bits 4-15 ignored", 15, 2, [0, 1, 1, 1], DONE),
    Ask("fc0f bits 4-15 ignored", 1, 0, 16, [1, 0, 0, 1] + [0] * 12),
    Ask("", 15, 0, [0] * 16, DONE),
    Ask("fc02 open inputs read 1", 2, 0, 16, [1, 1, 1, 1] + [0] * 12),
    *_inputs("eda9060a", "fc02 input {}", 4, 16),
    *[Ask([f"fc02 input {at}", "fc02 inputs 4-15 read 0"], 2, at, 1, [0])
      for at in range(4, 16)],
    Do("levels eda9060a 10"),
    *runs(2, "fc02 every run of 0-3", [0, 1, 0, 1]),
    Do("levels eda9060a 15"),
    *[Ask(f"fc03 register {at}", 3, at, 1, [value]) for at, value in enumerate(_9060A_READ)],
    *runs(3, "fc03 every run of 0-3", _9060A_READ),
    *[Ask(f"fc0{fc} past the end from {at}: silent", fc, at, 17 - at, SILENT)
      for fc in (1, 2) for at in (0, 4, 15)],
    *[Ask(f"fc01 coil {at}: silent", 1, at, 1, SILENT) for at in (16, 65535)],
    *[Ask(f"fc02 input {at}: silent", 2, at, 1, SILENT) for at in (16, 65535)],
    *[Ask(f"fc03 past the end from {at}: silent", 3, at, 5 - at, SILENT) for at in range(4)],
    *[Ask(f"fc03 register {at}: silent", 3, at, 1, SILENT) for at in (4, 65535)],
    Raw("fc03 count 0: silent", "0300000000", SILENT),
    *[Ask(f"fc05 coil {at}: silent", 5, at, [1], SILENT) for at in (4, 15)],
    *[Ask(f"fc0f past the end from {at}: silent", 15, at, [1] * (17 - at), SILENT)
      for at in (0, 15)],
    Ask("fc0f coil 16: silent", 15, 16, [1, 1], SILENT),
    *_eda_refusals(16, 16),
    *[Raw(f"fc10 pulse mask {mask}: silent", _fc10(1, mask << 8 | 10), SILENT)
      for mask in (16, 128)],
    *[Raw(f"fc10 pulse width {width}: silent", _fc10(1, 0x0100 | width), SILENT)
      for width in (0, 201, 255)],
    Ask("fc10 both with a bad value: silent, nothing", 16, 0, [0x0206, 0x0100], SILENT),
    Ask("fc10 both with a bad value: silent, nothing", 16, 0, [0x0208, 0x010A], SILENT),
    Ask("fc10 both with a bad value: silent, nothing", 3, 0, 4, _9060A_READ),
    *[Raw(f"fc10 register {at}: silent", _fc10(at, 0x0206), SILENT) for at in (2, 3, 65535)],
    Ask("fc10 past the end from 0: silent", 16, 0, [0x0106, 0x010A, 0], SILENT),
    Ask("fc10 past the end from 1: silent", 16, 1, [0x010A, 0], SILENT),
    *_9060A_STATE,
    *on_the_wire(_9060A_STATE),
    # The two maps: what is written at one number is read at the next.
    Raw(["maps: written at 1, read at 2", "fc10 pulse mask 13", "fc10 pulse width 100"],
        _fc10(1, 0x0D64), DONE),
    Ask("maps: written at 1, read at 2", 3, 0, 4, [0x9060, 0x0106, 0x0D64, 0]),
    # Register 1 read and echoed at 1 would be the pulse setting: mask 1, width 6.
    Raw("maps: echo of read 1 at its own number", _fc10(1, 0x0106), DONE),
    Ask("maps: echo of read 1 at its own number", 3, 0, 4, [0x9060, 0x0106, 0x0106, 0]),
    Raw("maps: echo of read 2 at its own number", _fc10(2, 0x0106), SILENT),
    Raw("maps: written at 0, read at 1", _fc10(0, 0x0206), DONE),
    Unit(2),
    Ask("maps: written at 0, read at 1", 3, 0, 4, [0x9060, 0x0206, 0x0106, 0]),
    Ask("fc10 both registers", 16, 0, [0x0106, 0x000A], DONE),
    Unit(1),
    Ask("fc10 both registers", 3, 0, 4, _9060A_READ),
    *[step for mask in range(16) for step in (
        Raw(f"fc10 pulse mask {mask}", _fc10(1, mask << 8 | 10), DONE),
        Ask(f"fc10 pulse mask {mask}", 3, 2, 1, [mask << 8 | 10]),
    )],
    *[step for width in (1, 100, 200, 10) for step in (
        Raw(f"fc10 pulse width {width}", _fc10(1, width), DONE),
        Ask(f"fc10 pulse width {width}", 3, 2, 1, [width]),
    )],
    # Pulses.
    *[step for tenths in (1, 10, 200) for step in _9060a_width(tenths)],
    Do("changes eda9060a"),
    Ask(["pulse: read back as 1, then 0", "pulse: level channels of the same write stay"],
        15, 0, [1, 0, 1, 0], DONE),
    Ask(["pulse: read back as 1, then 0", "pulse: 0 does nothing"], 1, 0, 4, [1, 0, 1, 0]),
    Do("skip 9000"),
    Ask("pulse: 0 does nothing", 15, 0, [1, 1, 0, 1], DONE),
    Ask("pulse: 0 does nothing", 5, 2, [0], DONE),
    Ask("pulse: 0 does nothing", 1, 0, 4, [1, 1, 1, 1]),
    Do("skip 11000"),
    Pulses("pulse: 0 does nothing", "eda9060a", [(2, 20000, 20000)]),
    Ask(["pulse: read back as 1, then 0", "pulse: level channels of the same write stay"],
        1, 0, 4, [1, 1, 0, 1]),
    Ask("pulse: a second 1 starts the width anew", 5, 2, [1], DONE),
    Do("skip 12000"),
    Ask("pulse: a second 1 starts the width anew", 15, 2, [1, 1], DONE),
    Do("skip 20000"),
    Pulses("pulse: a second 1 starts the width anew", "eda9060a", [(2, 32000, 40000)]),
    Ask("pulse: a change of mode or width leaves it alone", 5, 2, [1], DONE),
    Raw("pulse: a change of mode or width leaves it alone", _fc10(1, 0x0001), DONE),
    Do("skip 1000"),
    Ask("pulse: a change of mode or width leaves it alone", 1, 0, 4, [1, 1, 1, 1]),
    Do("skip 19000"),
    Pulses("pulse: a change of mode or width leaves it alone", "eda9060a", [(2, 20000, 20000)]),
    Ask("", 15, 0, [0] * 4, DONE),
    Raw("", _fc10(1, 0x000A), DONE),
    *_eda_addresses(lambda new, entry: [Ask(entry, 3, 1, 1, [new << 8 | 6])]),
    *_eda_speeds(lambda code, entry: [Ask(entry, 3, 1, 1, [0x0100 | code])]),
    # What survives a loss of power.
    Ask("", 16, 0, [0x2106, 0x0305], DONE),
    Unit(0x21),
    Ask("", 5, 2, [1], DONE),
    Do("power eda9060a cycle"),
    Ask("power-up: relays off", 1, 0, 4, [0] * 4),
    Ask("power-up: settings kept", 3, 0, 4, [0x9060, 0x2106, 0x0305, 0]),
    Ask("", 16, 0, [0x0106, 0x000A], DONE),
    # Broadcasts.
    Unit(0),
    Ask("broadcast fc05: obeyed, silent", 5, 1, [1], SILENT),
    Unit(1),
    Ask("broadcast fc05: obeyed, silent", 1, 0, 4, [0, 1, 0, 0]),
    Unit(0),
    Ask("broadcast fc0f: obeyed, silent", 15, 0, [1, 0, 0, 1], SILENT),
    Ask("broadcast fc01: nothing", 1, 0, 4, SILENT),
    Ask("broadcast fc02: nothing", 2, 0, 4, SILENT),
    Ask("broadcast fc03: nothing", 3, 0, 4, SILENT),
    Ask("broadcast fc10: obeyed, silent", 16, 0, [0x0306, 0x0064], SILENT),
    Unit(3),
    Ask("broadcast fc0f: obeyed, silent", 1, 0, 4, [1, 0, 0, 1]),
    Ask("broadcast fc10: obeyed, silent", 3, 1, 2, [0x0306, 0x0064]),
]

EDA9060A_SWITCHES = [
    Ask("aloud: fc04: exception 1", 4, 0, 1, exception(1)),
    Ask("aloud: fc06: exception 1", 6, 0, [0x0206], exception(1)),
    Raw("aloud: fc07: exception 1", "07", exception(1)),
    Ask("aloud: fc01 past the end: exception 2", 1, 15, 2, exception(2)),
    Ask("aloud: fc02 past the end: exception 2", 2, 16, 1, exception(2)),
    Ask("aloud: fc03 past the end: exception 2", 3, 0, 5, exception(2)),
    Ask("aloud: fc05 past the end: exception 2", 5, 4, [1], exception(2)),
    Ask("aloud: fc0f past the end: exception 2", 15, 0, [1] * 17, exception(2)),
    Ask("aloud: fc10 past the end: exception 2", 16, 1, [0x000A, 0], exception(2)),
    Raw("aloud: fc05 value 0001: exception 3", "0500010001", exception(3)),
    Raw("aloud: fc10 address 0: exception 3", _fc10(0, 0x0006), exception(3)),
    Raw("aloud: fc10 speed 8: exception 3", _fc10(0, 0x0108), exception(3)),
    Raw("aloud: fc10 width 0: exception 3", _fc10(1, 0x0100), exception(3)),
    Raw("aloud: fc10 mask 16: exception 3", _fc10(1, 0x100A), exception(3)),
    Wire("aloud: wrong CRC: silent", "01040000000131CB", SILENT),
    Unit(2),
    Ask("aloud: another address: silent", 4, 0, 1, SILENT),
    Unit(0),
    Ask("aloud: broadcast: silent", 6, 0, [0x0206], SILENT),
    Unit(1),
    *_9060A_STATE,
    Ask("applies=restart: {address,speed} old until power-up", 16, 0, [0x0407, 0x000A], DONE),
    Ask(["applies=restart: stored settings are read",
         "applies=restart: {address,speed} old until power-up"], 3, 1, 1, [0x0407]),
    Do("power eda9060a cycle"),
    Ask("applies=restart: address old until power-up", 3, 1, 1, SILENT),
    Unit(4),
    Ask("applies=restart: speed old until power-up", 3, 1, 1, SILENT),
    Speed(19200),
    Ask("applies=restart: {address,speed} old until power-up", 3, 1, 1, [0x0407]),
]

_9050_STATE = [Ask("", 1, 0, 8, [0] * 8)]
_9050_INPUTS = [0, 1, 1, 0, 1, 0, 0]

EDA9050 = [
    Ask("power-up: outputs off", 1, 0, 8, [0] * 8),
    *each_coil(0, 8),
    *write_runs("fc0f every run of 0-7", 0, 8),
    Ask("", 15, 0, _PATTERN, DONE),
    *runs(1, "fc01 every run of 0-7", _PATTERN),
    Ask("", 15, 0, [0] * 8, DONE),
    Ask("fc02 open inputs read 1", 2, 0, 7, [1] * 7),
    *_inputs("eda9050", "fc02 input {}", 7, 7),
    Do("levels eda9050 22"),
    *runs(2, "fc02 every run of 0-6", _9050_INPUTS),
    Do("levels eda9050 127"),
    *[Ask(f"fc01 past the end from {at}: silent", 1, at, 9 - at, SILENT) for at in (0, 4, 7)],
    *[Ask(f"fc01 coil {at}: silent", 1, at, 1, SILENT) for at in (8, 65535)],
    Ask("fc01 count 9: silent", 1, 0, 9, SILENT),
    *[Ask(f"fc02 past the end from {at}: silent", 2, at, 8 - at, SILENT) for at in (0, 3, 6)],
    Ask("fc02 input 8: silent", 2, 8, 1, SILENT),
    Ask("fc02 count 8: silent", 2, 0, 8, SILENT),
    Ask("fc05 coil 8: silent", 5, 8, [1], SILENT),
    *[Ask(f"fc0f past the end from {at}: silent", 15, at, [1] * (9 - at), SILENT)
      for at in (0, 4, 7)],
    Ask("fc0f coil 8: silent", 15, 8, [1, 1], SILENT),
    Ask("fc0f count 9: silent", 15, 0, [1] * 9, SILENT),
    *_eda_refusals(16, 7),
    Raw("fc03: silent", "0300000001", SILENT),
    Ask("fc03: silent", 3, 0, 4, SILENT),
    *[Raw(f"fc10 register {at}: silent", _fc10(at, 0x0206), SILENT) for at in (1, 2)],
    Ask("fc10 count 2: silent", 16, 0, [0x0206, 0x000A], SILENT),
    *_9050_STATE,
    *on_the_wire(_9050_STATE),
    Do("init eda9050 ground"),
    Ask("INIT* pin: nothing", 1, 0, 8, [0] * 8),
    Do("init eda9050 open"),
    Ask("INIT* pin: nothing", 1, 0, 8, [0] * 8),
    *_eda_addresses(lambda new, entry: [Ask(entry, 1, 0, 8, [0] * 8)]),
    *_eda_speeds(lambda code, entry: [Ask(entry, 1, 0, 8, [0] * 8)]),
    Raw("", _fc10(0, 0x2106), DONE),
    Unit(0x21),
    Ask("", 15, 0, _PATTERN, DONE),
    Do("power eda9050 cycle"),
    Ask(["power-up: outputs off", "power-up: settings kept"], 1, 0, 8, [0] * 8),
    Raw("", _fc10(0, 0x0106), DONE),
    Unit(0),
    Ask("broadcast fc05: obeyed, silent", 5, 6, [1], SILENT),
    Unit(1),
    Ask("broadcast fc05: obeyed, silent", 1, 0, 8, [0, 0, 0, 0, 0, 0, 1, 0]),
    Unit(0),
    Ask("broadcast fc0f: obeyed, silent", 15, 0, _PATTERN, SILENT),
    Ask("broadcast fc01: nothing", 1, 0, 8, SILENT),
    Ask("broadcast fc02: nothing", 2, 0, 7, SILENT),
    Raw("broadcast fc10: obeyed, silent", _fc10(0, 0x0306), SILENT),
    Unit(3),
    Ask(["broadcast fc0f: obeyed, silent", "broadcast fc10: obeyed, silent"],
        1, 0, 8, _PATTERN),
]

# The line of each table, and its steps.
LINES = {
    "ERC-8": ("model=erc8,addr=1", ERC8),
    "ERC-8 switches": ("model=erc8,addr=1,answer-bad,applies=restart", ERC8_SWITCHES),
    "EMD-2A2Q": ("model=emd2a2q,addr=1", EMD2A2Q),
    "EMD-2A2Q switches": ("model=emd2a2q,addr=1,answer-bad,applies=restart", EMD2A2Q_SWITCHES),
    "EDA9060A Modbus": ("model=eda9060a,addr=1,proto=rtu", EDA9060A),
    "EDA9060A Modbus switches": (
        "model=eda9060a,addr=1,proto=rtu,aloud,applies=restart", EDA9060A_SWITCHES),
    "EDA9050 Modbus": ("model=eda9050,addr=1,proto=rtu", EDA9050),
}
