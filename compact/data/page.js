"use strict";
// a link opens the section it points at; on paper all sections are open
const open = () => { const part = document.getElementById(location.hash.slice(1)); if (part) { part.open = true; } };
addEventListener("hashchange", open);
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((part) => { part.open = true; }));
open();
