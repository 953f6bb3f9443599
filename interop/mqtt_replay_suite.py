"""What a receiver of the topic `batch` gets of the daemon's MQTT client: every change in its order,
also those of outages, by mosquitto."""

import json
import time

from modbus_tcp import until
from mqtt import Broker, Plant

POINT = "hall.di1"
PATH = "/points/hall/di1"
TOPIC = "railbus/plant/batch"
SPOKEN = ("5", "3.1.1")


class Receiver:
    """Keeps what is new to it, by the numbers."""

    def __init__(self):
        self.epoch, self.newest = None, 0
        self.kept, self.repeated, self.holes = [], 0, []

    def take(self, payloads):
        """Takes messages in their order."""
        for payload in payloads:
            told = json.loads(payload)
            if told["epoch"] != self.epoch:
                self.epoch, self.newest = told["epoch"], told["seq"] - 1
            for number, reading in enumerate(told["readings"], told["seq"]):
                if number <= self.newest:
                    self.repeated += 1
                    continue
                if number != self.newest + 1 and "missing" not in told:
                    self.holes.append((self.newest, number))
                self.newest = number
                self.kept.append(reading)

    def values(self, path=POINT):
        """What a point was."""
        return [each["value"] for each in self.kept if each.get("path") == path]

    def gaps(self):
        """The times in which changes may be missing."""
        return [each["gap"] for each in self.kept if "gap" in each]


def suite(version):
    """Everything in one version."""

    def run():
        broker = Broker()
        try:
            with Plant(broker, version, replay_days=1) as s:
                s.settled()
                live(s, version)
                outage(s, version)
                restart(s, version)
                if version == "5":
                    unheard(s, version)
                ended(s, version)
        finally:
            broker.close()
        return s.tally

    return run


def receiver(s):
    """All that came so far."""
    found = Receiver()
    found.take(s.watcher.all(TOPIC))
    return found


def change(s, value):
    """An input is another one, and the daemon has read it."""
    s.sim.do(f"{POINT} = {int(value)}")
    read = lambda: s.ask("GET", PATH)["value"] is value
    if not until(read):
        raise RuntimeError(f"{POINT} does not become {value}")


def known(s, values, since=0):
    """Waits until these are the values of the point from there on."""
    until(lambda: receiver(s).values()[since:] == values)
    return receiver(s)


def live(s, version):
    """While everything is there."""
    entry = f"{version}, batch: every change while the broker is there"
    until(lambda: receiver(s).values() and receiver(s).values()[-1] is False)
    paths = {each.get("path") for each in receiver(s).kept}
    for path in ("oven.k1", "oven.k8", "hall.di0", "tank.ai1"):
        s.check(entry, path in paths, True, f"{path} at the beginning")
    before = len(receiver(s).values())
    for value in (True, False):
        change(s, value)
    got = known(s, [True, False], before)
    s.check(entry, got.values()[before:], [True, False], "values")
    s.check(entry, (got.holes, got.gaps()), ([], []), "holes and gaps")
    newest = [each for each in got.kept if each.get("path") == POINT][-1]
    s.check(entry, (newest["quality"], newest["time"] <= newest["at"]), ("good", True), "newest")
    retained = [topic for _, is_kept, topic, _ in s.watcher.got if is_kept and topic == TOPIC]
    s.check(entry, retained, [], "kept by the broker")


def outage(s, version):
    """The broker is away, and comes again."""
    entry = f"{version}, batch: every change of an outage, once and in its order"
    before = receiver(s)
    s.broker.kill()
    until(lambda: s.outlet()["state"] != "running")
    values = [True, False] * 3
    for value in values:
        change(s, value)
    s.broker.start()
    s.watch()
    until(lambda: [each["value"] for payload in s.watcher.all(TOPIC)
                   for each in json.loads(payload)["readings"]
                   if each.get("path") == POINT][-len(values):] == values)
    after = Receiver()
    after.epoch, after.newest = before.epoch, before.newest
    after.take(s.watcher.all(TOPIC))
    s.check(entry, after.values(), values, "values")
    s.check(entry, (after.holes, after.gaps()), ([], []), "holes and gaps")
    times = [each["at"] for each in after.kept]
    s.check(entry, times, sorted(times), "their order")
    s.told(entry, "hall/di1/state", "OFF", "beside it")


def restart(s, version):
    """The daemon is killed while the broker is away."""
    entry = f"{version}, batch: what was on the disk comes after a kill, and then a gap"
    last = receiver(s)
    s.broker.kill()
    until(lambda: s.outlet()["state"] != "running")
    change(s, True)
    change(s, False)
    # By then it is on the disk.
    time.sleep(2.5)
    s.daemon.process.kill()
    s.daemon.process.wait()
    s.sim.do(f"{POINT} = 1")
    s.daemon.start()
    s.broker.start()
    s.watch()
    s.settled()
    got = Receiver()
    got.epoch, got.newest = last.epoch, last.newest

    def is_there():
        got.take(s.watcher.all(TOPIC))
        return got.gaps() and got.values() and got.values()[-1] is True

    until(is_there)
    s.check(entry, got.values()[:2], [True, False], "before the kill")
    s.check(entry, got.holes, [], "holes")
    [gap] = got.gaps()
    s.check(entry, (gap["reason"], gap["from"] < gap["to"]), ("stopped", True), str(gap))
    after = got.kept[got.kept.index({"gap": gap}):]
    paths = {each.get("path") for each in after}
    s.check(entry, {"oven.k1", "hall.di0", "tank.ai1"} <= paths, True, "everything after it")
    s.check(entry, got.values()[-1], True, "what it is now")
    s.check(entry, got.epoch, last.epoch, "the epoch")
    change(s, False)


def unheard(s, version):
    """Nobody receives: nothing is taken for delivered."""
    entry = f"{version}, batch: what nobody receives stays"
    until(lambda: receiver(s).values()[-1] is False and s.outlet()["queue"] == 0)
    last = receiver(s)
    s.watcher.close()
    for value in (True, False, True, False):
        change(s, value)
    until(lambda: s.outlet()["queue"] >= 4)
    s.check(entry, s.outlet()["queue"] >= 4, True, "what waits")
    s.watch()
    got = Receiver()
    got.epoch, got.newest = last.epoch, last.newest

    def is_there():
        got.take(s.watcher.all(TOPIC))
        return len(got.values()) >= 4

    until(is_there)
    s.check(entry, got.values(), [True, False, True, False], "values")
    s.check(entry, (got.holes, got.gaps()), ([], []), "holes and gaps")


def ended(s, version):
    """Without the setting there is no outbox."""
    entry = f"{version}, batch: without replay_days nothing is kept"
    file = s.daemon.folder / "state" / "mqtt-scada.outbox.db"
    s.check(entry, file.exists(), True, "the file before")
    settings = {key: value for key, value in s.settings.items() if key != "replay_days"}
    s.ask("PUT", "/outlets/mqtt/scada", settings)
    until(lambda: not file.exists())
    s.check(entry, file.exists(), False, "the file afterwards")
    until(lambda: s.outlet()["state"] == "running")
    since = s.watcher.count()
    change(s, True)
    s.told(entry, "hall/di1/state", "ON", "the newest value")
    s.check(entry, s.watcher.all(TOPIC, since), [], "batch")


SUITES = [(f"MQTT, every change, {version}", suite(version)) for version in SPOKEN]
