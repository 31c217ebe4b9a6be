// What a point is, at once and under a finger too: the title inside it, which browsers show late and phones never.
const tip = document.createElement("div");
tip.id = "tip";
tip.hidden = true;
document.body.append(tip);
for (const kind of ["pointerover", "pointerdown"]) document.addEventListener(kind, (event) => {
  const words = event.target.closest("svg use, svg path")?.querySelector("title")?.textContent;
  tip.hidden = !words;
  if (!words) return;
  tip.textContent = words;
  tip.style.left = Math.max(4, Math.min(event.clientX + 12, innerWidth - tip.offsetWidth - 4)) + "px";
  tip.style.top = Math.max(4, event.clientY - tip.offsetHeight - 12) + "px";
});
