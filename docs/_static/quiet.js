// The theme tells the console what it does; there nothing should stand but what is wrong.
const { log } = console;
console.log = (...words) => String(words[0]).startsWith("[PST]") || log(...words);

// As the theme does for code: what has to be scrolled is reached by the keyboard.
const reach = () => document.querySelectorAll(".formulas").forEach((formula) => {
  if (formula.scrollWidth > formula.clientWidth) formula.setAttribute("tabindex", "0");
  else formula.removeAttribute("tabindex");
});
addEventListener("load", reach);
addEventListener("resize", reach);
