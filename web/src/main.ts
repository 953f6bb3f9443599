import { mount } from "svelte";
import App from "./App.svelte";
import { markDocumentLanguage } from "./i18n/index.svelte";
import * as prefs from "./app/prefs.svelte";
import * as router from "./app/router.svelte";
import "./style.css";

markDocumentLanguage();
prefs.follow();
router.follow();
const target = document.getElementById("app");
if (target) mount(App, { target });
