"""What the suite of the OPC UA server needs: modules, the daemon, and a client by others."""

import logging
import pathlib
import subprocess
import threading
import time

from asyncua import Client, ua
from asyncua.common.subscription import Subscription
from asyncua.crypto import security_policies
from asyncua.sync import ThreadLoop

from modbus_tcp import HOST, until
from outlet_plant import SELDOM, OutletPlant
from rig import Tally, free_port

NAMESPACE = "urn:railbus:site"
PASSWORD = "correct horse battery"
# Those whom the daemon knows, with role and points.
USERS = {"admin": ("admin", []), "li": ("operator", []), "wang": ("operator", ["oven.k1"]),
         "guest": ("viewer", [])}
POLICIES = {
    "Basic256Sha256": security_policies.SecurityPolicyBasic256Sha256,
    "Aes256_Sha256_RsaPss": security_policies.SecurityPolicyAes256Sha256RsaPss,
}
# A client that says what it goes through on the terminal.
logging.getLogger("asyncua").setLevel(logging.CRITICAL)


class Certificates:
    """Certificates of clients, by openssl."""

    def __init__(self, folder, *names):
        self.folder = pathlib.Path(folder)
        for name in names:
            self._openssl("req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2",
                          "-subj", f"/CN={name}", "-addext", f"subjectAltName=URI:{uri(name)}",
                          "-keyout", f"{name}-key.pem", "-out", f"{name}.pem")
            self._openssl("x509", "-in", f"{name}.pem", "-outform", "der", "-out", f"{name}.der")

    def _openssl(self, *words):
        done = subprocess.run(["openssl", *words], cwd=self.folder, check=True,
                              capture_output=True, text=True)
        return done.stdout

    def thumbprint(self, name):
        """As openssl shows it, with colons."""
        said = self._openssl("x509", "-in", f"{name}.pem", "-noout", "-fingerprint", "-sha1")
        return said.strip().split("=")[1]

    def files(self, name):
        """Certificate and key."""
        return str(self.folder / f"{name}.der"), str(self.folder / f"{name}-key.pem")


def uri(name):
    """What a client calls itself."""
    return f"urn:interop:{name}"


class Told:
    """What a subscription was told, in its order: status, value and source time by node."""

    def __init__(self):
        self.got, self.lock, self.status = {}, threading.Lock(), None

    def datachange_notification(self, node, value, data):
        """Called by asyncua."""
        said = data.monitored_item.Value
        with self.lock:
            its = self.got.setdefault(node.nodeid.Identifier, [])
            its.append((name_of(said.StatusCode), value, said.SourceTimestamp))

    def status_change_notification(self, status):
        """Called by asyncua: the subscription has ended."""
        self.status = status.Status

    def all(self, name, since=0):
        """Status and value of a node, in their order."""
        with self.lock:
            return [(status, value) for status, value, _ in self.got.get(name, [])[since:]]

    def count(self, name):
        """How often something was told of it."""
        return len(self.all(name))

    def newest(self, name):
        """Status and value that were told last."""
        return (self.all(name) or [None])[-1]


def name_of(status):
    """The name of a status, without what it says besides."""
    return ua.StatusCode(status.value & 0xFFFF0000).name


class Session:
    """A client with a session, in calls that wait."""

    def __init__(self, port, user=None, password=PASSWORD, policy=None, files=None, called=None,
                 timeout=4):
        self.loop = ThreadLoop()
        self.loop.start()
        self.client = Client(f"opc.tcp://{HOST}:{port}/", timeout)
        if user:
            self.client.set_user(user)
            self.client.set_password(password)
        try:
            if policy:
                self.client.application_uri = uri(called)
                mode = ua.MessageSecurityMode.SignAndEncrypt
                self.loop.post(self.client.set_security(POLICIES[policy], *files, mode=mode))
            self.loop.post(self.client.connect())
            self.namespace = self.loop.post(self.client.get_namespace_index(NAMESPACE))
        except BaseException:
            self.loop.stop()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Ends it, whether or not the server is there."""
        try:
            self.loop.post(self.client.disconnect())
        except Exception:
            pass
        self.loop.stop()

    def node(self, name):
        """A node of the site."""
        return self.client.get_node(ua.NodeId(name, self.namespace))

    def do(self, coroutine):
        """Waits for it."""
        return self.loop.post(coroutine)

    def read(self, name, attribute=ua.AttributeIds.Value):
        """Status, value and source time."""
        said = self.do(self.node(name).read_attribute(attribute, raise_on_bad_status=False))
        value = said.Value.Value if said.Value else None
        return name_of(said.StatusCode), value, said.SourceTimestamp

    def write(self, name, value):
        """The status of a write."""
        return self.statuses([(name, value)])[0]

    def statuses(self, writes):
        """The statuses of several writes in one request."""
        wanted = ua.WriteParameters()
        for name, value in writes:
            one = ua.WriteValue()
            one.NodeId = ua.NodeId(name, self.namespace)
            one.AttributeId = ua.AttributeIds.Value
            one.Value = ua.DataValue(ua.Variant(value))
            wanted.NodesToWrite.append(one)
        return [name_of(status) for status in self.do(self.client.uaclient.write(wanted))]

    def call(self, module, method, *arguments):
        """The status of a call, and what it gave."""
        request = ua.CallMethodRequest()
        request.ObjectId = ua.NodeId(module, self.namespace)
        request.MethodId = ua.NodeId(f"{module}/{method}", self.namespace)
        request.InputArguments = [each if isinstance(each, ua.Variant) else ua.Variant(each)
                                  for each in arguments]
        [done] = self.do(self.client.uaclient.call([request]))
        return name_of(done.StatusCode), [each.Value for each in done.OutputArguments or []]

    def watch(self, *names, filtered=False, interval=50.0, period=50, told=None):
        """Begins to follow nodes; what it is told."""
        told = told or Told()
        subscription: Subscription = self.do(self.client.create_subscription(period, told))
        wanted = None
        if filtered:
            wanted = ua.DataChangeFilter()
            wanted.Trigger = ua.DataChangeTrigger.StatusValue
        items = [subscription._make_monitored_item_request(
            self.node(name), ua.AttributeIds.Value, wanted, 100,
            ua.MonitoringMode.Reporting, interval) for name in names]
        created = self.do(subscription.create_monitored_items(items))
        told.handles = {item: one.RequestedParameters.ClientHandle
                        for item, one in zip(created, items) if isinstance(item, int)}
        told.subscription, told.items = subscription.subscription_id, created
        told.refused = [name_of(each) for each in created if isinstance(each, ua.StatusCode)]
        return told

    def mode(self, told, mode):
        """Sets the mode of all items of a subscription."""
        wanted = ua.SetMonitoringModeParameters()
        wanted.SubscriptionId, wanted.MonitoringMode = told.subscription, mode
        wanted.MonitoredItemIds = told.items
        self.do(self.client.uaclient.set_monitoring_mode(wanted))

    def shorten(self, told):
        """Gives the items of a subscription a queue of one."""
        wanted = ua.ModifyMonitoredItemsParameters()
        wanted.SubscriptionId = told.subscription
        for item in told.items:
            one = ua.MonitoredItemModifyRequest()
            one.MonitoredItemId = item
            one.RequestedParameters.SamplingInterval = 0.0
            one.RequestedParameters.QueueSize = 1
            one.RequestedParameters.DiscardOldest = True
            one.RequestedParameters.ClientHandle = told.handles[item]
            wanted.ItemsToModify.append(one)
        self.do(self.client.uaclient.modify_monitored_items(wanted))

    def history(self, name, since, until_time, most=0, bounds=False, pages=100):
        """Status and value of what was kept, in so many pages at most."""
        asked = ua.ReadRawModifiedDetails(IsReadModified=False)
        asked.StartTime, asked.EndTime = (at or ua.get_win_epoch() for at in (since, until_time))
        asked.NumValuesPerNode, asked.ReturnBounds = most, bounds
        kept, point = [], None
        for _ in range(pages):
            page = self.do(self.node(name).history_read(asked, point))
            page.StatusCode.check()
            kept += page.HistoryData.DataValues or []
            point = page.ContinuationPoint
            if not point:
                break
        return [(name_of(each.StatusCode), each.Value.Value if each.Value else None,
                 each.SourceTimestamp) for each in kept]


class Plant(OutletPlant):
    """Simulated modules, and a daemon that serves them."""

    kind = "opcua"
    # Modules no value of which is ever known.
    unread = ()

    def __init__(self, tally=None, **settings):
        held, self.port = free_port()
        settings = {"listen": f"{HOST}:{self.port}", **settings}
        super().__init__(tally or Tally("OPC UA"), settings, SELDOM)
        self.held.append(held)

    def started(self):
        """Makes the users, and waits for the values."""
        for name, (role, points) in USERS.items():
            self.ask("POST", "/users", {"name": name, "role": role, "points": points,
                                        "password": PASSWORD})
        self.settled()

    def settled(self):
        """Waits until it serves, and every value is known that is read."""
        points = lambda: self.ask("GET", "/points")["points"]
        is_known = lambda: all(each["quality"] in ("good", "stale") for each in points()
                               if each["module"] not in self.unread)
        if not until(lambda: self.outlet()["state"] == "running" and is_known()):
            raise RuntimeError(f"it does not serve: {self.outlet()}")

    def configure(self, **settings):
        """Gives the outlet other settings."""
        self.ask("PUT", "/outlets/opcua/scada", {**self.settings, **settings})
        until(lambda: self.outlet()["state"] == "running")

    def session(self, user="li", **how):
        """A session, as soon as somebody listens."""
        deadline = time.monotonic() + 20
        while True:
            try:
                return Session(self.port, user, **how)
            except OSError:
                if time.monotonic() > deadline:
                    raise

    def told(self, entries, told, name, want, what=""):
        """This is what was told last, at last."""
        until(lambda: told.newest(name) == want)
        self.check(entries, told.newest(name), want, f"{name} {what}")

    def reads(self, entries, session, name, want, what=""):
        """This is read, at last."""
        until(lambda: session.read(name)[:2] == want)
        self.check(entries, session.read(name)[:2], want, f"{name} {what}")
