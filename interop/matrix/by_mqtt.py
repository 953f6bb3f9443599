"""What a subscriber of MQTT is told: one of mosquitto, at a broker for each case."""

import itertools
import json
import subprocess

import mqtt
from modbus_tcp import until
from outlets import ANSWER, CHANNELS, NAMES, Follower, must, wall

SITE = "works"
PREFIX = f"railbus/{SITE}"
VALUES = {"ON": 1, "OFF": 0, "None": None}


class ByMqtt(Follower):
    """A subscriber of everything, who trusts a value while its module and the outlet are online."""

    def __init__(self, case):
        super().__init__(case)
        self.broker = mqtt.Broker(["ordered"])
        self.watcher = mqtt.Watcher(self.broker, "mqttv5", f"{PREFIX}/#")
        self.ids = itertools.count()
        # The newest of the topics, as they are called below the prefix.
        self.told = {}
        self.points = {f"{module}.{case.column.labels[nth]}": (unit, nth)
                       for unit, module in NAMES.items() for nth in CHANNELS}

    def settings(self):
        return {**self.broker.settings(), "type": "mqtt", "site": SITE, "write": ["*"],
                "replay_days": 1}

    def is_there(self):
        self.hear()
        return self.told.get("bridge/state") == "online"

    def messages(self):
        return self.watcher.got

    def take(self, message):
        at, _, topic, payload = message
        topic = topic.removeprefix(f"{PREFIX}/")
        self.told[topic] = payload
        if topic == "batch":
            self._past(json.loads(payload)["readings"], at)
        elif topic.endswith("/attr") and self.is_steady:
            self._attr(topic.split("/"), json.loads(payload), at)
        elif topic.endswith(("/state", "/availability")):
            for path, (unit, nth) in self.points.items():
                self.knows(unit, nth, self._value(*path.split(".")), at)

    def _value(self, module, label):
        """What is known of a point, as a number."""
        online = [self.told.get("bridge/state"), self.told.get(f"{module}/availability")]
        value = VALUES[self.told.get(f"{module}/{label}/state", "None")]
        return value if online == ["online", "online"] else None

    def _past(self, readings, at):
        """Every change has its time."""
        for each in readings:
            if each.get("quality") == "good" and each.get("path") in self.points:
                self.was_so(*self.points[each["path"]], int(each["value"]), wall(each["time"]), at,
                            False)

    def _attr(self, topic, attr, at):
        """What is said of a value has the time of its reading, and comes after it."""
        module, label, _ = topic
        which = self.points.get(f"{module}.{label}")
        if which is None:
            return
        value = VALUES[self.told.get(f"{module}/{label}/state", "None")]
        is_good = attr["quality"] == "good"
        if is_good != (value is not None):
            self.false.append(f"{module}.{label} is {attr['quality']}, and its value {value}")
        elif is_good:
            self.was_so(*which, value, wall(attr["time"]), at)

    def switch_on(self, unit, nth):
        """Gives a command, and waits for its result."""
        name = f"c{next(self.ids)}"
        topic = f"{PREFIX}/{NAMES[unit]}/{self.case.column.labels[nth]}"
        command = ["mosquitto_pub", *self.broker.words(), "-q", "1", "-t", f"{topic}/set",
                   "-m", json.dumps({"value": "ON", "id": name})]
        subprocess.run(command, check=True, timeout=ANSWER, capture_output=True)

        def results():
            told = [json.loads(each) for each in self.watcher.all(f"{topic}/result")]
            return [each for each in told if each["id"] == name]

        must(until(results, ANSWER), "no result")
        [end] = results()
        must(end["may_have_acted"] or not self.is_on(unit, nth), "it did nothing, and it is on")
        self.ended(unit, nth, end["end"], end.get("code"), end.get("value"))

    def close(self):
        self.watcher.close()
        self.broker.close()
