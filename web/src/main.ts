import { mount } from "svelte";
import App from "./App.svelte";
import { mark } from "./i18n/index.svelte";
import * as prefs from "./lib/prefs.svelte";
import * as router from "./lib/router.svelte";
import "./style.css";

mark();
prefs.follow();
router.follow();
const target = document.getElementById("app");
if (target) mount(App, { target });
