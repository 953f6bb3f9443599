"""A Home Assistant with the MQTT integration, which may be stopped and started again."""

import json
import pathlib
import queue
import shutil
import subprocess
import tempfile
import threading

import install
from modbus_tcp import HOST, PATIENCE, until
from rig import free_port

HERE = pathlib.Path(__file__).resolve().parent
# Only its own computer reaches it.
CONFIGURATION = """
homeassistant:
  time_zone: UTC
  packages: {packages}
http:
  server_host: {host}
  server_port: {port}
"""


class Home:
    """What it was told stays in its folder from start to start. `packages` are texts of its
    configuration, by name."""

    def __init__(self, broker, version, packages=None):
        self.root = install.root(version)
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="home-", dir=self.root / "tmp"))
        self.held, port = free_port()
        self.process = self.answers = None
        shutil.copy(HERE / "ha.py", self.folder)
        packages = packages or {}
        for name, text in packages.items():
            (self.folder / f"{name}.yaml").write_text(text, encoding="utf-8")
        included = "".join(f"\n    {name}: !include {name}.yaml" for name in packages) or "{}"
        text = CONFIGURATION.format(host=HOST, port=port, packages=included)
        (self.folder / "configuration.yaml").write_text(text)
        entry = {
            "entry_id": "broker", "domain": "mqtt", "title": "broker", "source": "user",
            "version": 1, "minor_version": 1, "unique_id": None, "disabled_by": None,
            "pref_disable_new_entities": False, "pref_disable_polling": False, "options": {},
            "data": {"broker": HOST, "port": broker.port},
        }
        stored = {"version": 1, "minor_version": 1, "key": "core.config_entries",
                  "data": {"entries": [entry]}}
        (self.folder / ".storage").mkdir()
        (self.folder / ".storage/core.config_entries").write_text(json.dumps(stored))

    def start(self):
        """Starts it, and waits until it has the broker."""
        inside = pathlib.Path("/") / self.folder.relative_to(self.root)
        command = install.command(self.root, install.PYTHON, inside / "ha.py", inside)
        with open(self.folder / "said", "ab") as said:
            self.process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said, text=True,
                env=install.environment())
        self.answers = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()
        if not until(lambda: self.ask("loaded").get("mqtt") == "loaded"):
            raise RuntimeError(f"Home Assistant does not reach the broker: {self.said()[-3000:]}")

    def _listen(self):
        process, answers = self.process, self.answers
        for line in process.stdout:
            answers.put(line)
        answers.put("")

    def said(self):
        """What it logged."""
        return (self.folder / "said").read_text(encoding="utf-8")

    def ask(self, do, **words):
        """Gives it an order; what it answers."""
        try:
            self.process.stdin.write(json.dumps({"do": do, **words}) + "\n")
            self.process.stdin.flush()
            line = self.answers.get(timeout=PATIENCE)
        except (BrokenPipeError, queue.Empty):
            line = ""
        if not line:
            raise RuntimeError(f"Home Assistant does not answer `{do}`: {self.said()[-3000:]}")
        answer = json.loads(line)
        if "error" in answer:
            raise RuntimeError(f"Home Assistant, `{do}` {words}: {answer['error']}")
        return answer["done"]

    def stop(self):
        """Ends it as its user does."""
        self.ask("stop")
        self.process.stdin.close()
        if self.process.wait(PATIENCE):
            raise RuntimeError(f"Home Assistant ends with an error: {self.said()[-3000:]}")
        self.process = None

    def close(self):
        """Ends it for good."""
        if self.process:
            self.process.kill()
            self.process.wait()
            self.process = None
        self.held.close()
        shutil.rmtree(self.folder)
