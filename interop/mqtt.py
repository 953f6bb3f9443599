"""What the suite of the MQTT client needs: brokers and their clients by others, and the daemon."""

import json
import os
import pathlib
import shutil
import socket
import subprocess
import tempfile
import threading
import time

from modbus_tcp import PATIENCE, until
from outlet_plant import OutletPlant
from rig import HOST, Tally, free_port

# Where Debian has the broker.
MOSQUITTO = shutil.which("mosquitto") or "/usr/sbin/mosquitto"
USER, PASSWORD = "railbus", "correct horse"


class Certificates:
    """An authority, a broker's certificate and a client's, by openssl."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self._openssl("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256",
                      "-nodes", "-days", "2", "-subj", "/CN=authority",
                      "-keyout", "ca.key", "-out", "ca.pem")
        for name, more in (("broker", f"subjectAltName=IP:{HOST},DNS:localhost"),
                           ("elsewhere", "subjectAltName=DNS:elsewhere.example"),
                           ("client", "subjectAltName=DNS:client")):
            (self.folder / "more").write_text(more)
            self._openssl("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
                          "-subj", f"/CN={name}", "-keyout", f"{name}.key", "-out", "request")
            self._openssl("x509", "-req", "-in", "request", "-CA", "ca.pem", "-CAkey", "ca.key",
                          "-CAcreateserial", "-days", "2", "-extfile", "more",
                          "-out", f"{name}.pem")
        # The broker gives up its rights.
        for file in self.folder.iterdir():
            file.chmod(0o644)

    def _openssl(self, *words):
        subprocess.run(["openssl", *words], cwd=self.folder, check=True, capture_output=True)

    def __getitem__(self, name):
        return str(self.folder / name)


class Broker:
    """mosquitto. `kinds` is what it wants: `tls`, `password`, `client` for a certificate; for a
    `reader` nobody may publish. One that is `ordered` lets no message of QoS 0 pass those of QoS 1
    that it holds back, as mosquitto does after 20 without a receipt."""

    def __init__(self, kinds=(), certificate="broker"):
        self.kinds = set(kinds)
        self.folder = tempfile.TemporaryDirectory(prefix="railbus-broker-")
        os.chmod(self.folder.name, 0o755)
        self.held, self.port = free_port()
        lines = [f"listener {self.port} {HOST}", "persistence false", "sys_interval 1"]
        self.certificates = None
        if "password" in self.kinds:
            users = os.path.join(self.folder.name, "users")
            subprocess.run(["mosquitto_passwd", "-b", "-c", users, USER, PASSWORD],
                           check=True, capture_output=True)
            os.chmod(users, 0o644)
            lines += [f"password_file {users}", "allow_anonymous false"]
        else:
            lines.append("allow_anonymous true")
        if "tls" in self.kinds:
            self.certificates = Certificates(self.folder.name)
            lines += [f"cafile {self.certificates['ca.pem']}",
                      f"certfile {self.certificates[certificate + '.pem']}",
                      f"keyfile {self.certificates[certificate + '.key']}"]
        if "client" in self.kinds:
            lines.append("require_certificate true")
        if "reader" in self.kinds:
            rights = os.path.join(self.folder.name, "rights")
            pathlib.Path(rights).write_text("topic read railbus/#\n")
            lines.append(f"acl_file {rights}")
        if "ordered" in self.kinds:
            lines.append("max_inflight_messages 0")
        self.config = os.path.join(self.folder.name, "mosquitto.conf")
        pathlib.Path(self.config).write_text("\n".join(lines) + "\n")
        self.process = None
        self.start()

    def start(self):
        """Starts it, with an empty store."""
        self.process = subprocess.Popen([MOSQUITTO, "-c", self.config],
                                        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        if not until(self._listens):
            raise RuntimeError("mosquitto does not start")

    def _listens(self):
        try:
            socket.create_connection((HOST, self.port), PATIENCE).close()
        except OSError:
            return False
        return True

    def kill(self):
        """Ends it at once."""
        if self.process:
            self.process.kill()
            self.process.wait()
            self.process = None

    def close(self):
        """Ends it for good."""
        self.kill()
        self.held.close()
        self.folder.cleanup()

    def words(self):
        """How the clients of mosquitto reach it."""
        words = ["-h", HOST, "-p", str(self.port)]
        if "password" in self.kinds:
            words += ["-u", USER, "-P", PASSWORD]
        if "tls" in self.kinds:
            words += ["--cafile", self.certificates["ca.pem"]]
        if "client" in self.kinds:
            words += ["--cert", self.certificates["client.pem"],
                      "--key", self.certificates["client.key"]]
        return words

    def settings(self):
        """How the daemon reaches it."""
        settings = {"host": HOST, "port": self.port}
        if "password" in self.kinds:
            settings["username"] = USER
        if "tls" in self.kinds:
            settings |= {"tls": "on", "ca": self.certificates["ca.pem"]}
        if "client" in self.kinds:
            settings |= {"cert": self.certificates["client.pem"],
                         "key": self.certificates["client.key"]}
        return settings


class OldBroker:
    """A broker that only knows 3.1.1: it refuses version 5, and passes on everything else."""

    def __init__(self, broker):
        self.broker = broker
        self.listener = socket.create_server((HOST, 0))
        self.port = self.listener.getsockname()[1]
        self.refused = 0
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self):
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=[client], daemon=True).start()

    def _serve(self, client):
        with client:
            first = client.recv(65536)
            # The version follows the name of the protocol.
            at = first.find(b"MQTT") + 4
            if first[at] != 4:
                self.refused += 1
                client.sendall(bytes([0x20, 2, 0, 1]))
                return
            with socket.create_connection((HOST, self.broker.port)) as server:
                server.sendall(first)
                other = threading.Thread(target=self._pass, args=[server, client], daemon=True)
                other.start()
                self._pass(client, server)
                other.join()

    @staticmethod
    def _pass(source, sink):
        try:
            while data := source.recv(65536):
                sink.sendall(data)
            sink.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass

    def close(self):
        """Takes no more."""
        self.listener.close()


class Watcher:
    """`mosquitto_sub` with more of its words: all messages, and the newest of each topic."""

    def __init__(self, broker, version, topic="#", *words):
        self.got, self.lock = [], threading.Lock()
        command = ["mosquitto_sub", *broker.words(), "-V", version, "-q", "1", "-t", topic,
                   "-F", "%r %t %p", *words]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True,
                                        stderr=subprocess.DEVNULL)
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self):
        for line in self.process.stdout:
            retained, topic, payload = line.rstrip("\n").split(" ", 2)
            with self.lock:
                self.got.append((time.monotonic(), retained == "1", topic, payload))

    def all(self, topic, since=0):
        """The payloads of a topic, in their order, after so many messages."""
        with self.lock:
            return [payload for _, _, told, payload in self.got[since:] if told == topic]

    def newest(self, topic):
        """The newest payload of a topic; None if there was none."""
        found = self.all(topic)
        return found[-1] if found else None

    def count(self):
        """How many messages came so far."""
        with self.lock:
            return len(self.got)

    def order(self, since=0):
        """The topics in the order of their messages."""
        with self.lock:
            return [topic for _, _, topic, _ in self.got[since:]]

    def close(self):
        """Ends it."""
        self.process.kill()
        self.process.wait()
        self.thread.join()
        self.process.stdout.close()


class Plant(OutletPlant):
    """Simulated modules, and a daemon that serves them at a broker."""

    kind = "mqtt"

    def __init__(self, broker, version="auto", port=None, tally=None, **settings):
        settings = {**broker.settings(), "version": version, "site": "plant", **settings}
        if port:
            settings["port"] = port
        super().__init__(tally or Tally("MQTT"), settings)
        self.broker = broker
        self.password = PASSWORD if "password" in broker.kinds else None
        self.spoken = {"3.1.1": "mqttv311"}.get(version, "mqttv5")
        self.watcher = None

    def started(self):
        """Follows what is published from the beginning."""
        if self.password:
            self.ask("PUT", "/outlets/mqtt/scada/secret", {"secret": self.password})
        self.watch()

    def __exit__(self, *words):
        if self.watcher:
            self.watcher.close()
        super().__exit__(*words)

    def watch(self):
        """Begins to follow what is published."""
        if self.watcher:
            self.watcher.close()
        self.watcher = Watcher(self.broker, self.spoken)

    def code(self):
        """The code of its last failure."""
        return self.problem().get("code")

    def newest(self, topic):
        """The newest payload of a topic of the site."""
        return self.watcher.newest(f"railbus/plant/{topic}")

    def settled(self):
        """Waits until every value is told."""
        known = lambda: all(
            self.newest(f"{topic}/state") not in (None, "None")
            for topic in ("oven/k1", "oven/k8", "hall/di0", "tank/ai1", "tank/k1")
        )
        if not until(lambda: self.newest("bridge/state") == "online" and known()):
            with self.watcher.lock:
                raise RuntimeError(f"nothing is told: {self.outlet()}, {self.watcher.got[-30:]}")
        return self

    def publish(self, topic, payload, *words):
        """`mosquitto_pub`, to a topic of the site."""
        self.publish_at(f"railbus/plant/{topic}", payload, *words)

    def publish_at(self, topic, payload, *words):
        """`mosquitto_pub`."""
        command = ["mosquitto_pub", *self.broker.words(), "-V", self.spoken, "-q", "1",
                   "-t", topic, "-m", payload, *words]
        subprocess.run(command, check=True, timeout=PATIENCE, capture_output=True)

    def order(self, topic, payload, *words, verb="set"):
        """Orders something; its result."""
        result = f"railbus/plant/{topic}/result"
        before = len(self.watcher.all(result))
        self.publish(f"{topic}/{verb}", payload, *words)
        until(lambda: len(self.watcher.all(result)) > before)
        found = self.watcher.all(result)[before:]
        return json.loads(found[0]) if found else None

    def told(self, entries, topic, want, what=""):
        """This is the newest of a topic, at last."""
        until(lambda: self.newest(topic) == want)
        self.check(entries, self.newest(topic), want, f"{topic} {what}")
