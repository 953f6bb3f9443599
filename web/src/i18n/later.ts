// The texts of the pages that are loaded later, and with them.
import { admin } from "./admin";
import { api } from "./api";
import { backup } from "./backup";
import { calibrate } from "./calibrate";
import { events } from "./events";
import { groups } from "./groups";
import { outlets } from "./outlets";
import { recover } from "./recover";
import { rules } from "./rules";
import { send } from "./send";
import { settings } from "./settings";
import { sim } from "./sim";
import { system } from "./system";
import { trends } from "./trends";

export const later = {
  ...admin,
  ...api,
  ...backup,
  ...calibrate,
  ...events,
  ...groups,
  ...outlets,
  ...recover,
  ...rules,
  ...send,
  ...settings,
  ...sim,
  ...system,
  ...trends,
};
