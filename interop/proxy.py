"""The daemon's way to a broker, on which everything can go wrong: whoever else is at the broker has
a way of his own."""

import collections
import select
import socket
import threading
import time

from modbus_tcp import HOST, PATIENCE
from rig import free_port

# The directions: to the broker, and to the daemon.
UP, DOWN = "up", "down"
# The ends of a connection.
BROKER, DAEMON = "broker", "daemon"
# How often it is looked whether bytes that are held can pass, in seconds.
TICK = 0.01
# How many bytes a network holds.
HELD_MAX = 1 << 20

# What happens to bytes: none pass, each passes so much later, or so many a second.
Rule = collections.namedtuple("Rule", "is_frozen delay rate", defaults=[False, 0.0, None])
CLEAN = Rule()


class Held:
    """Bytes that wait until they may pass."""

    def __init__(self):
        self.pieces, self.size = collections.deque(), 0
        # Since when bytes are counted where only so many a second pass.
        self.since = 0.0

    def add(self, now, data):
        """More came."""
        if not self.pieces:
            self.since = now
        self.pieces.append((now, data))
        self.size += len(data)

    def due(self, now, rule):
        """What passes now."""
        if rule.rate is None:
            self.since = now
        if not self.pieces or rule.is_frozen or self.pieces[0][0] + rule.delay > now:
            return b""
        came, data = self.pieces.popleft()
        if rule.rate is not None:
            count = int((now - self.since) * rule.rate)
            self.since += count / rule.rate
            data, rest = data[:count], data[count:]
            if rest:
                self.pieces.appendleft((came, rest))
        self.size -= len(data)
        return data


class Link:
    """A connection: its socket to the daemon, and the one to the broker."""

    def __init__(self, daemon, broker):
        self.ends = {DAEMON: daemon, BROKER: broker}
        # The end that has lost it; the other one is not told.
        self.lost = None

    def shut(self, *ends):
        """These ends see that it is gone."""
        for end in ends:
            try:
                self.ends[end].shutdown(socket.SHUT_RDWR)
            except OSError:
                pass


class Proxy:
    """The way. `port` is where it begins; it is open."""

    def __init__(self, broker):
        self.broker = broker
        self.held, self.port = free_port()
        self.listener, self.links = None, set()
        self.rules = {UP: CLEAN, DOWN: CLEAN}
        self.lock = threading.Lock()
        self.open()

    def open(self):
        """From now on there is a way."""
        listener = socket.socket()
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((HOST, self.port))
        listener.listen()
        with self.lock:
            self.listener = listener
        threading.Thread(target=self._run, args=[listener], daemon=True).start()

    def cut(self):
        """From now on there is none, as if the network were down and both ends knew it."""
        with self.lock:
            listener, self.listener = self.listener, None
            if listener:
                for link in self.links:
                    link.shut(DAEMON, BROKER)
                try:
                    listener.shutdown(socket.SHUT_RDWR)
                except OSError:
                    pass
        if listener:
            listener.close()

    def lose(self, end):
        """One end loses all connections, and the other is not told: it waits for nothing."""
        with self.lock:
            for link in self.links:
                if not link.lost:
                    link.lost = end
                    link.shut(end)

    def freeze(self, *ways):
        """Nothing passes in these directions; the connections stay."""
        self._rule(ways, Rule(is_frozen=True))

    def delay(self, seconds, *ways):
        """Everything passes so much later."""
        self._rule(ways, Rule(delay=seconds))

    def trickle(self, rate, *ways):
        """So many bytes a second pass."""
        self._rule(ways, Rule(rate=rate))

    def heal(self):
        """Everything passes at once, also what was held; and there is a way."""
        self._rule((), CLEAN)
        if not self.listener:
            self.open()

    def _rule(self, ways, rule):
        self.rules = {**self.rules, **dict.fromkeys(ways or (UP, DOWN), rule)}

    def _run(self, listener):
        while True:
            try:
                client, _ = listener.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=[listener, client], daemon=True).start()

    def _serve(self, listener, client):
        with client:
            try:
                server = socket.create_connection((HOST, self.broker.port), PATIENCE)
            except OSError:
                return
            server.settimeout(None)
            with server:
                link = Link(client, server)
                with self.lock:
                    if self.listener is not listener:
                        return
                    self.links.add(link)
                other = threading.Thread(target=self._pass, args=[link, BROKER, DAEMON, DOWN],
                                         daemon=True)
                other.start()
                self._pass(link, DAEMON, BROKER, UP)
                other.join()
                with self.lock:
                    self.links.remove(link)

    def _pass(self, link, source, sink, way):
        """Passes what comes from one end to the other, until its end."""
        held, is_open = Held(), True
        while is_open or held.pieces:
            if is_open and held.size < HELD_MAX:
                data = self._received(link.ends[source], TICK if held.pieces else None)
                is_open = data != b""
                if data:
                    held.add(time.monotonic(), data)
            else:
                time.sleep(TICK)
            while data := held.due(time.monotonic(), self.rules[way]):
                self._sent(link, sink, data)
        # The other half stays: a connection that is closed before all was read loses what was sent.
        if not link.lost:
            try:
                link.ends[sink].shutdown(socket.SHUT_WR)
            except OSError:
                pass

    @staticmethod
    def _received(end, wait):
        """The next bytes; none in this time, or empty ones at the end."""
        if not select.select([end], [], [], wait)[0]:
            return None
        try:
            return end.recv(65536)
        except OSError:
            return b""

    @staticmethod
    def _sent(link, sink, data):
        """Sends bytes, unless that end is gone: then nobody gets them."""
        try:
            link.ends[sink].sendall(data)
        except OSError:
            pass

    def close(self):
        """Ends it for good."""
        self.heal()
        self.cut()
        self.held.close()
