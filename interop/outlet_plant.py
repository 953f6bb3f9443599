"""Simulated modules and a daemon that serves them by one outlet, for the suites of its kinds."""

import json
import os
import tempfile

from judge.daemon import Daemon
from modbus_tcp import Simulator

# From this age on a value is stale, in seconds.
MAX_AGE = 2
SITE = """
[line.main]
port = "pty:{line}"
baud = 19200

[module.oven]
line = "main"
model = "erc8"
address = 3
poll = "300ms"
max_age = "2s"
sim = {{ turnaround = "30ms" }}

[module.hall]
line = "main"
model = "eda9060a"
address = 1
poll = "300ms"
max_age = "2s"
sim = {{ turnaround = "30ms", inputs = {{ di0 = 1, di1 = 0 }} }}

[module.tank]
line = "main"
model = "emd2a2q"
address = 5
poll = "300ms"
max_age = "2s"
sim = {{ turnaround = "30ms", inputs = {{ ai1 = 8.71, ai2 = 2.50 }} }}

[module.oven.point]
k4 = {{ interlock = ["oven.k5"] }}
k6 = {{ locked = true }}
k7 = {{ confirm = true }}

[group.lamps]
members = ["oven.k1", "hall.do0"]

[scene.night]
steps = [{{ set = "oven.k2", to = true }}, {{ set = "hall.do1", to = true }}]
"""
# A module that is read too seldom for how old its values may be: stale, while it answers.
SELDOM = """
[module.yard]
line = "main"
model = "erc8"
address = 9
poll = "4s"
max_age = "1s"
sim = {{ turnaround = "30ms" }}
"""


class OutletPlant:
    """The modules of `SITE` and what a kind adds, and a daemon with one outlet."""

    # The type of the outlet and its name.
    kind, name = "", "scada"

    def __init__(self, tally, settings, more=""):
        self.tally, self.settings = tally, settings
        # What holds ports until the end.
        self.held = []
        self.folder = tempfile.TemporaryDirectory(prefix="railbus-interop-")
        self.site = (SITE + more).format(line=os.path.join(self.folder.name, "line"))
        self.daemon = Daemon(self.folder.name, self.text())
        self.sim = Simulator(self.folder.name, self.daemon.config)

    def text(self, **settings):
        """The configuration, with other settings of the outlet."""
        settings = {**self.settings, **settings}
        text = self.site + f'\n[outlet.{self.name}]\ntype = "{self.kind}"\n'
        return text + "".join(f"{key} = {json.dumps(value)}\n" for key, value in settings.items())

    def __enter__(self):
        try:
            self.sim.start()
            self.daemon.start()
            self.started()
        except BaseException:
            self.__exit__()
            raise
        return self

    def started(self):
        """What is to be done when the daemon runs."""

    def __exit__(self, *_):
        self.daemon.close()
        self.sim.kill()
        self.folder.cleanup()
        for held in self.held:
            held.close()

    def ask(self, method, path, body=None):
        """Asks the daemon."""
        status, answer = self.daemon.ask(method, path, body)
        if status >= 300:
            raise RuntimeError(f"{method} {path}: {status}, {answer}")
        return answer

    def outlet(self):
        """The outlet as the API has it."""
        [found] = [each for each in self.ask("GET", "/outlets")["outlets"]
                   if each["outlet"] == self.name]
        return found

    def problem(self):
        """Its last failure."""
        return self.outlet().get("last_error", {}).get("problem", {})

    def check(self, entries, got, want, what=""):
        """Counts."""
        self.tally.check(entries, got, want, what)
