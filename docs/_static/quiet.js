// The theme tells the console what it does; there nothing should stand but what is wrong.
const { log } = console;
console.log = (...words) => String(words[0]).startsWith("[PST]") || log(...words);
