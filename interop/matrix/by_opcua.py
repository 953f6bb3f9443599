"""What an OPC UA client is told: one by others, which is subscribed to all outputs."""

import socket
import time

import opcua
from outlets import ANSWER, CHANNELS, DONE, NAMES, UNKNOWN, Follower, Refused, must
from rig import free_port

USER = "scada"
GOOD = "Good"
# What a write is answered with, by how the command ended; with all others nothing was done.
ENDS = {GOOD: DONE[0], "GoodCompletesAsynchronously": "sent", "Uncertain": UNKNOWN}


class Told(opcua.Told):
    """What a subscription was told, of all nodes in one order, and when."""

    def __init__(self):
        super().__init__()
        self.messages = []

    def datachange_notification(self, node, value, data):
        said = data.monitored_item.Value
        self.messages.append((time.monotonic(), node.nodeid.Identifier,
                              opcua.name_of(said.StatusCode), value, said.SourceTimestamp))


class ByOpcua(Follower):
    """A subscriber of all outputs, who trusts what is good, and who reads and writes besides."""

    def __init__(self, case):
        super().__init__(case)
        self.held, self.port = free_port()
        self.told, self.session = Told(), None
        self.points = {f"{module}.{case.column.labels[nth]}": (unit, nth)
                       for unit, module in NAMES.items() for nth in CHANNELS}

    def settings(self):
        return {"type": "opcua", "listen": f"127.0.0.1:{self.port}"}

    def is_there(self):
        socket.create_connection(("127.0.0.1", self.port), ANSWER).close()
        return True

    def begin(self):
        status, answer = self.case.ask("POST", "/users", {
            "name": USER, "role": "admin", "points": [], "password": opcua.PASSWORD})
        must(status < 300, answer)
        self.session = opcua.Session(self.port, USER, timeout=ANSWER)
        self.session.watch(*self.points, told=self.told)
        must(not self.told.refused, self.told.refused)

    def messages(self):
        return list(self.told.messages)

    def take(self, message):
        at, name, status, value, when = message
        which = self.points[name]
        self.knows(*which, int(value) if status == GOOD else None, at)
        must(value is None or when, f"{name} has a value and no source time")
        if value is not None:
            self.was_so(*which, int(value), when.timestamp(), at, status == GOOD)

    def outputs(self, unit):
        """They are read: what the subscription is told is judged by itself."""
        bits = 0
        for nth in CHANNELS:
            status, value, _ = self.session.read(self._name(unit, nth))
            if status != GOOD:
                raise Refused(status)
            bits |= value << nth
        return bits

    def switch_on(self, unit, nth):
        """Writes, and reads what is so then."""
        name = self._name(unit, nth)
        status = self.session.write(name, True)
        now, value, _ = self.session.read(name)
        self.ended(unit, nth, ENDS.get(status, "failed"), status, value if now == GOOD else None)

    def _name(self, unit, nth):
        return f"{NAMES[unit]}.{self.case.column.labels[nth]}"

    def lies(self):
        if self.told.status:
            self.false.append(f"the subscription has ended: {self.told.status}")
        return super().lies()

    def close(self):
        if self.session:
            self.session.close()
            self.session = None
        self.held.close()
