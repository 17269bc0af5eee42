"use strict";
// Filters the cards by what the form asks for; without scripts all of them stay visible.
const form = document.getElementById("filters");
const cards = Array.from(document.querySelectorAll(".card"));
function apply() {
  const asked = new FormData(form);
  const words = (asked.get("words") || "").toLowerCase().split(/\s+/).filter(Boolean);
  let shown = 0;
  for (const card of cards) {
    const data = card.dataset;
    const ok =
      ["dataset", "split", "scene"].every((name) => !asked.get(name) || data[name] === asked.get(name)) &&
      (!asked.get("class") || data.class.includes("|" + asked.get("class") + "|")) &&
      (!asked.get("failed") || data.failed === "yes") &&
      words.every((word) => data.words.includes(word));
    card.hidden = !ok;
    shown += ok;
  }
  document.getElementById("shown").textContent = shown + " of " + cards.length + " samples shown";
}
form.addEventListener("input", apply);
form.addEventListener("reset", () => setTimeout(apply));
form.addEventListener("submit", (event) => event.preventDefault());
apply();
