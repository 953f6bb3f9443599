"""What the suite of the Modbus RTU slave needs: two terminals that are joined as by wires, and a
daemon that answers at one of them what masters by others ask at the other."""

import errno
import json
import os
import select
import threading
import tty

import libmodbus_suite
import mbpoll_suite
import pymodbus_suite
from modbus_cases import Ask
from modbus_tcp import PATIENCE, UNITS, Plant, until
from rig import Tally

MASTERS = {
    "pymodbus": pymodbus_suite.Master,
    "libmodbus": libmodbus_suite.Master,
    "mbpoll": mbpoll_suite.Master,
}

# How long masters wait for an answer, and for none, in seconds.
ANSWER, NONE = 10.0, 1.0
# Where the registers about a unit begin, and those of its last write.
STATUS, LAST_END = 64, 69


class Wires:
    """Two terminals; what is sent at one is received at the other. `echoes`: the adapter at `near`
    receives what it sends, too."""

    def __init__(self, folder, echoes=False):
        self.echoes = echoes
        self.near, self.far = (os.path.join(folder, name) for name in ("near", "far"))
        self.ends, self.held = [], []
        for link in (self.near, self.far):
            end, terminal = os.openpty()
            tty.setraw(terminal)
            # Held open, so that the terminal does not hang up between two masters.
            self.held.append(terminal)
            self.ends.append(end)
            os.symlink(os.ttyname(terminal), link)
        self.wake, self.stop = os.pipe()
        self.thread = threading.Thread(target=self._carry)
        self.thread.start()

    def _carry(self):
        while True:
            ready, _, _ = select.select([*self.ends, self.wake], [], [])
            if self.wake in ready:
                return
            for end in ready:
                try:
                    data = os.read(end, 4096)
                except OSError as error:
                    if error.errno != errno.EIO:
                        raise
                    return
                near, far = self.ends
                os.write(far if end == near else near, data)
                if self.echoes and end == near:
                    os.write(near, data)

    def close(self):
        """Takes them away."""
        os.close(self.stop)
        self.thread.join(PATIENCE)
        for end in (*self.ends, *self.held, self.wake):
            os.close(end)


class Site(Plant):
    """Simulated modules and a daemon that is a slave at one end of wires, and a Modbus TCP server.
    `slave` are its settings."""

    def __init__(self, turnaround, slave, echoes=False, more=""):
        super().__init__(turnaround=turnaround, scada={"write": ["*"]})
        self.tally = Tally("Modbus RTU slave")
        self.wires = Wires(self.folder.name, echoes)
        text = f'\n[outlet.plc]\ntype = "modbus_rtu"\nport = "pty:{self.wires.near}"\n'
        text += "".join(f"{key} = {json.dumps(value)}\n" for key, value in slave.items())
        with open(self.daemon.config, "a", encoding="utf-8") as file:
            file.write(text + more)

    def __enter__(self):
        super().__enter__()
        try:
            # Quality 0 of all units: the slave knows them.
            with self.master("libmodbus") as master:
                known = lambda unit: ask(master, unit, 4, STATUS, 1) == [0]
                if not until(lambda: all(known(unit) for unit, _, _ in UNITS.values())):
                    raise RuntimeError("the slave is not told of the modules")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        super().__exit__()
        self.wires.close()

    def master(self, name):
        """A master at the other end of the wires."""
        return MASTERS[name](self.wires.far)


def ask(master, unit, fc, at, arg, limit=ANSWER):
    """The outcome of a request: values, `done`, `exception N` or silence."""
    return master.request(unit, Ask("", fc, at, arg, None), limit)
