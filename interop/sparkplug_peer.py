"""A Sparkplug host application by others, which is asked over standard input and output: runs with
the Python of `target/sparkplug-venv`, since pysparkplug needs an older paho-mqtt.

`sparkplug_peer.py HOST PORT GROUP` follows a group. Each line of the input is an order in JSON, and
each line of the output a message that came, in the order of the broker, or the answer to an order.
What is published and what came is written and read by pysparkplug. It leaves out the properties of
metrics; these are read by the code that the protocol compiler made for it.
"""

import datetime
import json
import sys
import threading

import pysparkplug as sparkplug
from paho.mqtt import client as paho
from pysparkplug import _protobuf as protobuf

# Data are published with QoS 0; whoever asks for 1 sees that.
ASKED = 1
# How long the broker may take for what is published.
PATIENCE = 20.0


def plain(value):
    """A value as JSON has it; a time as milliseconds."""
    if isinstance(value, datetime.datetime):
        return round(value.timestamp() * 1000)
    return value.hex() if isinstance(value, bytes) else value


def properties(metric):
    """The properties of a metric: type and value of each by its name."""
    found = {}
    for name, property_value in zip(metric.properties.keys, metric.properties.values):
        kind, field = sparkplug.DataType(property_value.type), property_value.WhichOneof("value")
        value = None if field is None else kind.decode(getattr(property_value, field))
        right = field is None or kind.field == field
        found[name] = [kind.name if right else f"{kind.name} in {field}", plain(value)]
    if len(metric.properties.keys) != len(metric.properties.values):
        raise ValueError(f"{metric.name}: not a value for each property")
    return found


def metric_of(metric, raw):
    """A metric as pysparkplug has it."""
    return {
        "name": metric.name, "type": metric.datatype.name, "value": plain(metric.value),
        "time": metric.timestamp, "null": metric.is_null, "historical": metric.is_historical,
        "alias": metric.alias, "properties": properties(raw),
    }


class Host:
    """The connection, and the births by which data are understood."""

    def __init__(self, group):
        self.group, self.births = group, {}
        self.lock = threading.Lock()
        self.client = paho.Client(protocol=paho.MQTTv311)
        self.client.on_connect = self._connected
        self.client.on_subscribe = lambda *_: self.say({"ready": True})
        self.client.on_message = lambda _client, _data, message: self.say(self._read(message))

    def say(self, what):
        """One line of the output."""
        with self.lock:
            print(json.dumps(what), flush=True)

    def _connected(self, client, _data, _flags, code):
        if code:
            self.say({"error": f"the broker refuses: {code}"})
            return
        group = sparkplug.Topic(group_id=self.group, message_type="#")
        state = sparkplug.Topic(message_type=sparkplug.MessageType.STATE, sparkplug_host_id="+")
        client.subscribe([(str(group), ASKED), (str(state), ASKED)])

    def _read(self, message):
        """What a message says; `error` if pysparkplug does not understand it."""
        said = {"topic": message.topic, "qos": message.qos, "retain": bool(message.retain)}
        try:
            topic = sparkplug.Topic.from_str(message.topic)
            said |= {"kind": str(topic.message_type), "node": topic.edge_node_id,
                     "device": topic.device_id}
            # These are our own.
            if not said["kind"].endswith("CMD"):
                self._payload(said, topic, message)
        except Exception as error:  # Whatever it is, it is for the suite to judge.
            said["error"] = f"{type(error).__name__}: {error}"
        return said

    def _payload(self, said, topic, message):
        """What is in it."""
        who = (topic.group_id, topic.edge_node_id, topic.device_id)
        birth = self.births.get(who)
        payload = sparkplug.Message.from_mqtt_message(message, birth=birth).payload
        if isinstance(payload, sparkplug.State):
            said |= {"online": payload.online, "timestamp": payload.timestamp}
            return
        if isinstance(payload, (sparkplug.NBirth, sparkplug.DBirth)):
            self.births[who] = payload
        raw = protobuf.Payload.FromString(message.payload)
        metrics = getattr(payload, "metrics", ())
        if isinstance(payload, sparkplug.NDeath):
            metrics = (payload.bd_seq_metric,)
        # pysparkplug takes a time or number that is not there for 0.
        said |= {
            "timestamp": raw.timestamp if raw.HasField("timestamp") else None,
            "seq": raw.seq if raw.HasField("seq") else None,
            "metrics": [metric_of(*both) for both in zip(metrics, raw.metrics, strict=True)],
        }

    def publish(self, topic, payload, qos=0, retain=False):
        """Publishes bytes, and waits until the broker has them, or until they are sent."""
        told = self.client.publish(topic, payload, qos, retain)
        told.wait_for_publish(PATIENCE)
        return told.is_published()

    def command(self, kind, node, device, metrics, timestamp, typed=True, retain=False, qos=0):
        """A command of these metrics: name, type and value of each. Its time is `now` or another
        one; without a time there is none in the payload."""
        timestamp = sparkplug.get_current_timestamp() if timestamp == "now" else timestamp
        topic = sparkplug.Topic(
            group_id=self.group, message_type=sparkplug.MessageType(kind),
            edge_node_id=node, device_id=device)
        metrics = tuple(
            sparkplug.Metric(timestamp=timestamp, name=name, datatype=sparkplug.DataType[of],
                             value=value, is_null=value is None)
            for name, of, value in metrics)
        payload = {"DCMD": sparkplug.DCmd, "NCMD": sparkplug.NCmd}[kind](timestamp or 0, metrics)
        data = payload.encode(include_dtypes=typed)
        if timestamp is None:
            # pysparkplug does not build such.
            without = protobuf.Payload.FromString(data)
            without.ClearField("timestamp")
            data = without.SerializeToString()
        return self.publish(str(topic), data, qos, retain)

    def state(self, host, online, timestamp):
        """What a host says of itself."""
        topic = sparkplug.Topic(message_type=sparkplug.MessageType.STATE, sparkplug_host_id=host)
        payload = sparkplug.State(timestamp=timestamp, online=online).encode()
        return self.publish(str(topic), payload, 1, True)

    def raw(self, topic, data, retain=False):
        """Any bytes."""
        return self.publish(topic, bytes.fromhex(data), 1, retain)


def main(host, port, group):
    """Follows the group and does what it is told until there is no more input."""
    peer = Host(group)
    peer.client.connect(host, int(port), keepalive=60)
    peer.client.loop_start()
    for line in sys.stdin:
        order = json.loads(line)
        done = getattr(peer, order.pop("do"))(**order)
        peer.say({"done": done})
    peer.client.disconnect()
    peer.client.loop_stop()


if __name__ == "__main__":
    main(*sys.argv[1:])
