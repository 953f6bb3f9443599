"""A slave with pymodbus, like `slave.c` with libmodbus."""

import sys

from pymodbus import FramerType
from pymodbus.datastore import (
    ModbusDeviceContext,
    ModbusSequentialDataBlock,
    ModbusServerContext,
)
from pymodbus.server import StartSerialServer

# A block counts from 1 where addresses on the wire count from 0.
coils = ModbusSequentialDataBlock(1, [False] * 100)
registers = ModbusSequentialDataBlock(1, [0] * 6 + [871, 123, 0, 0])
device = ModbusDeviceContext(co=coils, hr=registers)
context = ModbusServerContext(devices={3: device}, single=False)
print("ok", flush=True)
StartSerialServer(context, framer=FramerType.RTU, port=sys.argv[1], baudrate=9600)
