"use strict";
// Plays MeshCat's animation: a button, a slider of the time, and the time. MeshCat's own controls are hidden.

(() => {
  const animator = viewer.animator;
  viewer.gui.domElement.style.display = "none";
  if (!animator.duration) return;
  const bar = document.createElement("div"), button = document.createElement("button");
  const slider = document.createElement("input"), told = document.createElement("output");
  bar.id = "player";
  Object.assign(slider, { type: "range", min: 0, max: animator.duration, step: "any", value: 0 });
  slider.setAttribute("aria-label", "Time");
  bar.append(button, slider, told);
  document.body.append(bar);
  animator.mixer.timeScale = start.speed;

  const display = animator.display_progress.bind(animator), pause = animator.pause.bind(animator);
  const label = () => { button.textContent = animator.playing ? "Pause" : "Play"; };
  animator.display_progress = (time) => {
    display(time);
    slider.value = time;
    told.textContent = `${(start.first + time).toFixed(2)} s`;
    label();
  };
  animator.pause = () => {  // MeshCat calls it at the end of what plays once
    pause();
    label();
  };
  const seek = (time) => {
    animator.seek(time);
    animator.display_progress(time);
  };
  const play = (on) => {
    if (on && animator.time >= animator.duration) seek(0);
    if (on) animator.play();
    else animator.pause();
    animator.display_progress(animator.time);
  };
  slider.addEventListener("input", () => {
    const time = slider.valueAsNumber;  // before what pausing shows
    play(false);
    seek(time);
  });
  button.addEventListener("click", () => play(!animator.playing));
  play(true);
  play(start.playing);
  seek((start.time ?? start.first) - start.first);
})();
