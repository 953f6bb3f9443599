"""Boards of other makers, as far as a scan can see them: what each answers to a request.

A stranger is a function from the bytes of one request to those of its reply, or None. What the
boards have is taken from their makers' manuals; the frames are made here.
"""

import struct
import sys
import time

from checksums import crc

ADDRESS = 8


def reply(function, *data):
    """A reply of the module."""
    body = bytes([ADDRESS, function, *data])
    return body + crc(body)


def modbus(coils=(), inputs=(), holding=(), read=(), outside=2, unknown=1):
    """A Modbus module with these runs, each a first number and its content: a count for bits,
    values for registers. `outside` and `unknown` are the exceptions for what it lacks, or None if
    it is silent."""
    spaces = {1: coils, 2: inputs, 3: holding, 4: read}

    def answer(request):
        if len(request) != 8 or request[0] != ADDRESS or crc(request[:6]) != request[6:]:
            return None
        function, start, count = request[1], *struct.unpack(">HH", request[2:6])
        runs = spaces.get(function, ())
        if not runs:
            return unknown and reply(function | 0x80, unknown)
        for first, there in runs:
            size = there if function < 3 else len(there)
            if first <= start and start + count <= first + size:
                if function < 3:
                    return reply(function, -(-count // 8), *bytes(-(-count // 8)))
                words = there[start - first:start - first + count]
                return reply(function, 2 * count, *struct.pack(f">{count}H", *words))
        return outside and reply(function | 0x80, outside)

    return answer


def dcon(name):
    """A DCON module that reports this name, and no more."""

    def answer(request):
        asked = f"${ADDRESS:02X}M\r".encode()
        return f"!{ADDRESS:02X}{name}\r".encode() if request == asked else None

    return answer


def echo(request):
    """A converter that returns everything it receives."""
    return request


def everything(request):
    """A PLC that has everything that is read, with its address in every place where it is looked
    for."""
    if len(request) != 8 or request[0] != ADDRESS or crc(request[:6]) != request[6:]:
        return None
    function, count = request[1], struct.unpack(">H", request[4:6])[0]
    if function in (1, 2):
        return reply(function, -(-count // 8), *bytes(-(-count // 8)))
    if function in (3, 4):
        return reply(function, 2 * count, *struct.pack(">H", ADDRESS) * count)
    return request


def gateway(request):
    """A gateway to Modbus TCP whose module is off: 0A or 0B to every request."""
    if len(request) != 8 or crc(request[:6]) != request[6:]:
        return None
    return reply(request[1] | 0x80, 0x0A if request[1] == 1 else 0x0B)


def slow(request):
    """Coils 0 to 99, an ERC-8's among them, after 0.4 s."""
    time.sleep(0.4)
    return modbus(coils=[(0, 100)])(request)


def garbled(request):
    """An ERC-8's coils; instead of a refusal only a part of one comes."""
    good = modbus(coils=[(60, 8)])(request)
    return good[:3] if good and good[1] & 0x80 else good


# The registers of a meter: floats, and settings far away.
METER = [(0, [0x4366, 0x3333] * 40)]

STRANGERS = {
    "coils from 20 on (pymodbus)": "pymodbus-coils",
    "a hundred of everything (pymodbus)": "pymodbus-all",
    "registers 12, 8": modbus(holding=[(0, [12, ADDRESS, *[0] * 98])]),
    "eight relays, silent to the rest": modbus(coils=[(0, 8)], outside=None, unknown=None),
    "EX9060D": dcon("9060D"),
    "EX9050D": dcon("9050D"),
    "ADAM-4060": dcon("4060"),
    # Relays from 0, all at 00FF; settings at 2000, 4000 and 8000.
    "Waveshare Modbus RTU Relay": modbus(
        coils=[(0, 8), (0xFF, 1)],
        holding=[(0x2000, [1]), (0x4000, [ADDRESS]), (0x8000, [200])],
    ),
    # Relays are registers.
    "eletechsup R4D3B16": modbus(holding=[(0, [0] * 17)], outside=None, unknown=None),
    "SDM120": modbus(read=METER, holding=[(0, [0] * 100)]),
    "PZEM-016": modbus(read=[(0, [2300, 0, 0, 0, 0, 0, 0, 500, 0, 0])],
                       holding=[(1, [0, ADDRESS])], unknown=1),
    "one that echoes": echo,
    "one that has everything": everything,
    "a gateway": gateway,
    "a slow one": slow,
    "garbled refusals": garbled,
}


def serve(kind, port):
    """A pymodbus slave."""
    from pymodbus import FramerType
    from pymodbus.datastore import (
        ModbusDeviceContext,
        ModbusSequentialDataBlock,
        ModbusServerContext,
    )
    from pymodbus.server import StartSerialServer

    only = kind == "pymodbus-coils"
    block = lambda: ModbusSequentialDataBlock(20 if only else 1, [0] * 100)
    spaces = ("co",) if only else ("co", "di", "hr", "ir")
    nothing = lambda: ModbusSequentialDataBlock(60_000, [0])
    blocks = {name: block() if name in spaces else nothing() for name in ("co", "di", "hr", "ir")}
    context = ModbusServerContext(devices={ADDRESS: ModbusDeviceContext(**blocks)}, single=False)
    print("ok", flush=True)
    StartSerialServer(context, framer=FramerType.RTU, port=port, baudrate=9600)


if __name__ == "__main__":
    serve(*sys.argv[1:])
