"""The asynchronous pymodbus master: reads coils a given number of times.

Arguments: terminal, address, first coil, number of coils, number of reads.
"""

import asyncio
import logging
import sys

from pymodbus.client import AsyncModbusSerialClient
from pymodbus.exceptions import ModbusException


async def main(terminal: str, address: int, first: int, coils: int, reads: int) -> None:
    logging.disable()
    client = AsyncModbusSerialClient(terminal, baudrate=115200, timeout=0.2, retries=0)
    await client.connect()
    for _ in range(reads):
        try:
            await client.read_coils(first, count=coils, device_id=address)
        except ModbusException:
            pass
    client.close()


asyncio.run(main(sys.argv[1], *map(int, sys.argv[2:6])))
