"""What a Sparkplug host is told: one by others, at a broker for each case."""

import mqtt
import sparkplug
from modbus_tcp import until
from outlets import ANSWER, CHANNELS, EXCHANGE, NAMES, Follower, Refused, must

# How many of the node's faults against the rules are shown.
SHOWN = 3


class BySparkplug(Follower):
    """A host of everything, who trusts what is good of a device that is alive."""

    # What was stale when its request was under way is good from then on (docs/decisions/0049).
    later = EXCHANGE

    def __init__(self, case):
        super().__init__(case)
        self.broker = mqtt.Broker()
        self.host = sparkplug.Host(self.broker)
        # The devices that are alive.
        self.alive = set()
        self.points = {(module, case.column.labels[nth]): (unit, nth)
                       for unit, module in NAMES.items() for nth in CHANNELS}

    def settings(self):
        return {**self.broker.settings(), "type": "sparkplug", "group": sparkplug.GROUP,
                "node": sparkplug.NODE, "write": ["*"], "replay_days": 1}

    def is_there(self):
        return bool(self.host.all(kind="NBIRTH"))

    def messages(self):
        return self.host.got

    def take(self, message):
        kind, device = message.get("kind"), message.get("device")
        if kind in ("NBIRTH", "NDEATH", "DDEATH"):
            self.alive -= {device} if device else set(NAMES.values())
            for (module, _), (unit, nth) in self.points.items():
                if device in (None, module):
                    self.knows(unit, nth, None, message["at"])
        elif kind in ("DBIRTH", "DDATA"):
            self.alive |= {device}
            for each in message.get("metrics", ()):
                if (device, each["name"]) in self.points:
                    self._metric(*self.points[device, each["name"]], each, message["at"])

    def _metric(self, unit, nth, metric, at):
        """An output is so, or was."""
        is_good = sparkplug.quality(metric) == sparkplug.GOOD
        if not metric["historical"]:
            self.knows(unit, nth, int(metric["value"]) if is_good else None, at)
        if is_good:
            self.was_so(unit, nth, int(metric["value"]), metric["time"] / 1000, at,
                        not metric["historical"])

    def _is_alive(self, unit):
        self.hear()
        return NAMES[unit] in self.alive

    def switch_on(self, unit, nth):
        """Gives a command, and waits for its answer, or until the device is dead."""
        device, label = NAMES[unit], self.case.column.labels[nth]
        if not until(lambda: self._is_alive(unit), self.patience(unit)):
            raise Refused("not born")
        since = self.host.count()
        self.host.ask("command", kind="DCMD", node=sparkplug.NODE, device=device,
                      metrics=[(label, "BOOLEAN", True)], timestamp="now")

        def answers():
            return [*self.host.all(since, "DDATA", device, sparkplug.is_answer),
                    *self.host.all(since, "DDEATH", device)]

        must(until(answers, ANSWER), "no answer")
        answer = answers()[0]
        if answer["kind"] == "DDEATH":
            raise Refused("dead")
        said = lambda what: sparkplug.value(answer, f"Last Command/{what}")
        must(said("Metric") == label, "an answer to another command")
        self.ended(unit, nth, said("End"), said("Code"), sparkplug.value(answer, label))

    def lies(self):
        with self.host.lock:
            got = list(self.host.got)
        self.false += [f"by the rules of Sparkplug: {each}"
                       for judge in (sparkplug.judged, sparkplug.unqualified)
                       for each in judge(got)[:SHOWN]]
        return super().lies()

    def close(self):
        self.host.stop()
        self.broker.close()
