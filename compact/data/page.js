"use strict";
// on paper all sections are open
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((part) => { part.open = true; }));
