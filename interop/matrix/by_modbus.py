"""What a Modbus TCP master is told, which reads both units all the time."""

import contextlib
import socket
import struct
import threading
import time

from outlets import ANSWER, APART, OUTPUTS, Observer, Refused
from rig import free_port

READ_COILS, WRITE_COIL = 1, 5


class Master:
    """A Modbus TCP master."""

    def __init__(self, port):
        self.stream = socket.create_connection(("127.0.0.1", port), ANSWER)
        self.number = 0

    def close(self):
        """Goes."""
        self.stream.close()

    def ask(self, unit, function, first, second):
        """The data of the answer."""
        self.number = (self.number + 1) & 0xFFFF
        self.stream.sendall(struct.pack(">HHHBBHH", self.number, 0, 6, unit, function, first,
                                        second))
        number, _, length = struct.unpack(">HHH", self._take(6))
        answer = self._take(length)
        if number != self.number or answer[0] != unit:
            raise AssertionError(f"an answer to another request: {answer.hex()}")
        if answer[1] == function | 0x80:
            raise Refused(f"{answer[2]:02X}")
        return answer[2:]

    def _take(self, count):
        data = b""
        while len(data) < count:
            piece = self.stream.recv(count - len(data))
            if not piece:
                raise ConnectionError("the server has closed")
            data += piece
        return data

    def outputs(self, unit):
        """The first four outputs of a unit, as bits."""
        return self.ask(unit, READ_COILS, 0, 4)[1] & 0x0F

    def switch_on(self, unit, nth):
        """Switches an output on."""
        self.ask(unit, WRITE_COIL, nth, 0xFF00)


class ByModbus(Observer):
    """A master that reads all units all the time, and others that ask for something."""

    def __init__(self, case):
        super().__init__(case)
        self.held, self.port = free_port()
        self.closed = threading.Event()
        self.thread = threading.Thread(target=self._run, daemon=True)

    def settings(self):
        return {"type": "modbus_tcp", "listen": f"127.0.0.1:{self.port}", "map": "uniform",
                "write": ["*"]}

    def is_there(self):
        Master(self.port).close()
        return True

    def begin(self):
        self.thread.start()

    def asking(self):
        return contextlib.closing(Master(self.port))

    def _run(self):
        try:
            master = Master(self.port)
            while not self.closed.wait(APART):
                for unit in OUTPUTS:
                    self._look(master, unit)
            master.close()
        except Exception as error:  # Whatever it is, nobody follows any more.
            if not self.closed.is_set():
                self.false.append(f"{type(error).__name__}: {error}")

    def _look(self, master, unit):
        asked = time.monotonic()
        try:
            bits = master.outputs(unit)
        except Refused:
            return
        if self.is_false(unit, bits, asked):
            self.false.append(f"unit {unit} is {bits:04b}")

    def close(self):
        self.closed.set()
        if self.thread.is_alive():
            self.thread.join(ANSWER)
        self.held.close()
