import { mount } from "svelte";
import App from "./App.svelte";
import { mark } from "./i18n/index.svelte";
import { dress } from "./lib/prefs.svelte";
import { follow } from "./lib/router.svelte";
import "./style.css";

mark();
dress();
follow();
const target = document.getElementById("app");
if (target) mount(App, { target });
