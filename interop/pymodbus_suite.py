"""pymodbus against every module with Modbus RTU. It can send everything: what it refuses to build
goes out as a PDU of our own, and damaged frames through its packet trace."""

import logging

from pymodbus.client import ModbusSerialClient
from pymodbus.exceptions import ModbusIOException
from pymodbus.pdu import ModbusPDU

from masters import drive
from modbus_cases import DONE, SILENT, Ask, Raw, Wire, exception

logging.getLogger("pymodbus").setLevel(logging.CRITICAL)


class Verbatim(ModbusPDU):
    """A request with given bytes."""

    def __init__(self, unit, pdu):
        super().__init__(dev_id=unit)
        self.function_code, self.data = pdu[0], pdu[1:]

    def encode(self):
        return self.data


class Master:
    """pymodbus on a port."""

    def __init__(self, port):
        self.frame = None
        self.client = self.open(port)
        # Otherwise it gives up a port after a few silences.
        self.client.set_max_no_responses(1_000_000)
        if not self.client.connect():
            raise ConnectionError(f"pymodbus cannot open {port}")

    def open(self, port):
        """The client, not yet connected."""
        return ModbusSerialClient(port, baudrate=9600, retries=0, trace_packet=self._packet)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Closes the port."""
        self.client.close()

    def speed(self, rate):
        """Changes the speed."""
        # Closing and opening it again would race with its lock, which children of other threads
        # hold for a moment.
        self.client.socket.baudrate = rate

    def can(self, _unit, _step):
        """Whether it can send this."""
        return True

    def request(self, unit, step, timeout):
        """Sends a request and returns the outcome."""
        for params in (self.client.comm_params, self.client.transaction.comm_params):
            params.timeout_connect = timeout
        self.frame = bytes.fromhex(step.frame) if isinstance(step, Wire) else None
        try:
            reply = self._send(unit, step)
        except ModbusIOException as error:
            return SILENT if "No response" in str(error) else str(error)
        if reply.isError():
            return exception(reply.exception_code)
        if isinstance(step, Ask) and isinstance(step.arg, int):
            bits = step.fc in (1, 2)
            if bits and any(reply.bits[step.arg:]):
                return "bits above the count"
            return [int(bit) for bit in reply.bits[:step.arg]] if bits else reply.registers
        return DONE

    def _send(self, unit, step):
        client = self.client
        if not isinstance(step, Ask):
            pdu = bytes.fromhex(step.pdu) if isinstance(step, Raw) else b"\x07"
            return client.execute(False, Verbatim(unit, pdu))
        at, arg = step.at, step.arg
        match step.fc:
            case 1:
                return client.read_coils(at, count=arg, device_id=unit)
            case 2:
                return client.read_discrete_inputs(at, count=arg, device_id=unit)
            case 3:
                return client.read_holding_registers(at, count=arg, device_id=unit)
            case 4:
                return client.read_input_registers(at, count=arg, device_id=unit)
            case 5:
                return client.write_coil(at, bool(arg[0]), device_id=unit)
            case 6:
                return client.write_register(at, arg[0], device_id=unit)
            case 15:
                return client.write_coils(at, [bool(bit) for bit in arg], device_id=unit)
            case 16:
                return client.write_registers(at, arg, device_id=unit)
        raise ValueError(step)

    def _packet(self, sending, packet):
        return self.frame if sending and self.frame else packet


SUITES = drive("pymodbus", Master)
