"""A real Home Assistant that is asked over standard input and output: runs where it is installed.

`ha.py FOLDER` starts the whole program with this configuration folder. Each line of the input is
an order in JSON, and each line of the output its answer.
"""

import asyncio
import json
import os
import sys
import threading

from homeassistant import bootstrap, runner
from homeassistant.const import EVENT_STATE_CHANGED
from homeassistant.core import callback
from homeassistant.helpers import device_registry, entity_registry

# What is told of a device and an entity.
DEVICE = ("name", "manufacturer", "model", "model_id", "serial_number", "sw_version", "hw_version",
          "via_device_id", "configuration_url")
ENTITY = ("id", "name", "unique_id", "platform", "domain", "original_name", "original_device_class",
          "unit_of_measurement", "entity_category", "disabled_by", "device_id")


class Control:
    """The orders."""

    def __init__(self, hass):
        self.hass = hass
        # Every state that an entity had, in order.
        self.seen = {}
        hass.bus.async_listen(EVENT_STATE_CHANGED, self._changed)

    @callback
    def _changed(self, event):
        state = event.data["new_state"]
        told = self.seen.setdefault(event.data["entity_id"], [])
        shown = state.state if state else None
        # It may be an attribute that has changed.
        if told[-1:] != [shown]:
            told.append(shown)

    async def states(self):
        """State and attributes of every entity."""
        return {state.entity_id: {"state": state.state, **state.attributes}
                for state in self.hass.states.async_all()}

    async def history(self, entity):
        """Every state that an entity had since the start; None: it was taken away."""
        return self.seen.get(entity, [])

    async def registry(self):
        """What is registered from MQTT, whether it is there at the moment or not."""
        devices = device_registry.async_get(self.hass).devices
        entities = entity_registry.async_get(self.hass).entities
        mqtt = {entry.entry_id for entry in self.hass.config_entries.async_entries("mqtt")}
        return {
            "devices": {
                device.id: {"identifiers": sorted(each[1] for each in device.identifiers)}
                | {key: getattr(device, key, None) for key in DEVICE}
                for device in devices.values() if mqtt & set(device.config_entries)
            },
            "entities": {
                entity.entity_id: {key: getattr(entity, key, None) for key in ENTITY}
                for entity in entities.values() if entity.config_entry_id in mqtt
            },
        }

    async def named(self):
        """The entities that say who they are, by that, whatever they are from."""
        entities = entity_registry.async_get(self.hass).entities
        return {entity.unique_id: entity.entity_id for entity in entities.values()}

    async def rename(self, entity, name):
        """Gives an entity another name, as its user does."""
        entity_registry.async_get(self.hass).async_update_entity(entity, name=name)

    async def call(self, service, entity):
        """Calls a service such as `switch.turn_on`, and waits for its end."""
        domain, name = service.split(".")
        await self.hass.services.async_call(domain, name, {"entity_id": entity}, blocking=True)

    async def loaded(self):
        """How each configured integration does."""
        entries = self.hass.config_entries.async_entries()
        return {entry.domain: entry.state.value for entry in entries}

    async def stop(self):
        """Ends it."""
        self.hass.async_create_task(self.hass.async_stop())


async def serve(control, lines, answers):
    """Carries out the orders, one after the other."""
    while order := await lines.get():
        words = json.loads(order)
        try:
            done = {"done": await getattr(control, words.pop("do"))(**words)}
        except Exception as error:  # Whoever asked is told.
            done = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(done, default=str), file=answers, flush=True)
    # Who asks is gone.
    await control.stop()


def feed(loop, lines):
    """Passes standard input on."""
    for line in sys.stdin:
        loop.call_soon_threadsafe(lines.put_nowait, line)
    loop.call_soon_threadsafe(lines.put_nowait, "")


async def main(folder, answers):
    """Starts it, and runs until it is stopped."""
    config = runner.RuntimeConfig(config_dir=folder, skip_pip=True, log_no_color=True)
    hass = await bootstrap.async_setup_hass(config)
    if hass is None or hass.config.recovery_mode:
        return 1
    lines = asyncio.Queue()
    loop = asyncio.get_running_loop()
    orders = loop.create_task(serve(Control(hass), lines, answers))
    threading.Thread(target=feed, args=[loop, lines], daemon=True).start()
    code = await hass.async_run(attach_signals=False)
    orders.cancel()
    return code


if __name__ == "__main__":
    # Nothing but answers goes to standard output.
    ANSWERS = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    asyncio.set_event_loop_policy(runner.HassEventLoopPolicy(debug=False))
    sys.exit(asyncio.run(main(sys.argv[1], ANSWERS)))
